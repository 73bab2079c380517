"""Draped layers: error, memory and time of the ways to draw them, data in use, picking and editing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Final, NamedTuple
from unittest.mock import patch

import numpy as np
import shapely

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.benchmarks.draped_data import (
    PAPER_RASTER,
    SEED,
    Shapes,
    edge_error,
    exact_coverage,
    random_areas,
    random_lines,
    write_layer,
    write_raster,
)
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import open_ground
from sketchterrain.benchmarks.plotting import Curves, draw_curves
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.timing import TimedContext, spread
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.drape.drapes import Drapes
from sketchterrain.drape.raster_source import DrapedRaster
from sketchterrain.features.edits import with_places
from sketchterrain.features.levels import Level
from sketchterrain.features.picking import PICK
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.offscreen import canvas
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun
from sketchterrain.render.targets import depth_rows

GROUND: Final = "valley_river"
COMPARED: Final = ("tiles", "two-step", "geometry")
RANGES: Final = {"near": (0.0, 500.0), "far": (500.0, 1e6)}
"""Distances (m) from the eye over which errors are taken together."""
_BARE: Final = ("clouds", "haze", "grass", "rocks", "shadows", "trees", "water", "detail")
_SUN = Sun(200.0, 60.0)
_SAMPLES = 4  # along a pixel of a picture's samples, of the reference
_SIZE = (320, 180)  # px, where errors are measured
_LARGE = (1024, 1024)  # px, as in the paper on two-step draping
_WIDE, _THIN = 8.0, 0.3  # m: widths of lines
_COLOUR = "#ffffff"
_COUNTRY = 10.0  # extents of the sketch along that of much data
_ROUNDS = 3  # most, of drawing a view
_STEPS = 9  # of opacity, of the curve from share to light
_MOVES = 0.5  # m a step of a drag

_ERRORS = {
    "edge_p50": "edge, median px",
    "kept": "share of what should be covered",
    "still": "drawing ÷ without layers",
}
_DATA = {"vertices": "vertices read, %", "most": "at a time, %", "raster": "pixels of the raster read, %"}
_MOTION = {"edge_p50": "where edges move, median /255", "elsewhere": "elsewhere, 99.9 %"}
_INTERACTION = {"right": "right, %", "read": "vertices read"}


class GroundView(NamedTuple):
    """A view of the ground: height of the eye above it, m, and how far it looks down, degrees."""

    name: str
    height: float
    down: float

    def camera(self, terrain: Terrain) -> Camera:
        """Return the camera over the sketch, looking north-east."""
        x, y = 0.45 * terrain.extent, 0.3 * terrain.extent
        z = float(terrain.heights(x, y)) + self.height
        ahead = np.radians(self.down)
        along = 100.0 * np.array([0.3 * np.cos(ahead), 0.95 * np.cos(ahead), -np.sin(ahead)])
        return Camera((x, y, z), tuple((np.array([x, y, z]) + along).tolist()), fov=50.0)


VIEWS: Final = (
    GroundView("foot", 1.7, 4.0),
    GroundView("hill", 60.0, 10.0),
    GroundView("air", 1500.0, 35.0),
    GroundView("above", 3000.0, 80.0),
)


class DrapedPictures:
    """Pictures of a bare terrain with draped layers by one method; `close` it in the end."""

    def __init__(self, terrain: Terrain, size: tuple[int, int], method: str, *, live: bool = False) -> None:
        self.terrain, self.size = terrain, size
        self._stack = ExitStack()
        self.context, _, self.framebuffer = self._stack.enter_context(canvas(size))
        driver = self.context.info["GL_RENDERER"]
        quality = Quality.for_renderer(driver) if live else Quality.for_still(size)
        quality = replace(quality, without=quality.without | frozenset(_BARE))
        self.renderer = Renderer(self.context, terrain, sun=_SUN, quality=quality, drape_method=method)

    def opened(self, layers: Sequence[DrapedLayer]) -> Drapes:
        """Return layers as drapes of the terrain."""
        sketch = self.terrain.sketch
        drapes = Drapes.open(layers, sketch.frame, sketch.size, sketch.extent)
        if drapes.problems:
            raise ValueError(drapes.problems[0])
        return drapes

    def close(self) -> None:
        """Release the context."""
        self._stack.close()

    def show(self, camera: Camera, drapes: Drapes | None) -> float:
        """Draw the still picture of a camera; return the seconds it took."""
        start = perf_counter()
        self.renderer.set_drapes(drapes)
        self.renderer.prepare(camera, self.size)
        return self.draw(camera) - start

    def draw(self, camera: Camera, size: tuple[int, int] | None = None) -> float:
        """Draw a prepared picture, inside of a size (px) of its own if given; return the time (s) then."""
        view, inner = self.renderer._clipped(camera), size or self.size
        for _ in self.renderer.scenery.draw(view, self.framebuffer, size=inner, clock=0.0):
            pass
        self.context.finish()
        return perf_counter()

    def shaded(self, camera: Camera, drapes: Drapes | None) -> Float64Array:
        """Return the light of the bare ground, (rows, columns), row 0 on top."""
        self.show(camera, drapes)
        texture: Any = self.renderer.scenery._targets[self.size].textures["shaded"]
        width, height = self.size
        pixels = np.frombuffer(texture.read(), np.float32).reshape(height, width, 4)
        return np.asarray(pixels[::-1, :, :3].sum(axis=-1), np.float64)

    def ground(self, camera: Camera) -> Float64Array:
        """Return the ground at samples of the pixels, (rows, columns, 3), m from the eye; NaN is sky."""
        size = (_SAMPLES * self.size[0], _SAMPLES * self.size[1])
        self.renderer.prepare(camera, self.size)
        self.draw(camera, size)
        view, targets = self.renderer._clipped(camera)[0], self.renderer.scenery._targets[size]
        wide, high = targets.sample_size
        depth = depth_rows(targets.depth).astype(np.float64)
        x, y = ((np.arange(count) + 0.5) / count * 2.0 - 1.0 for count in (wide, high))
        clip = np.stack(np.broadcast_arrays(x[None, :], -y[:, None], 2.0 * depth - 1.0, 1.0), axis=-1)
        away = clip @ np.linalg.inv(view.to_clip(size[0] / size[1])).T
        places = away[..., :3] / away[..., 3:]
        places[depth >= 1.0] = np.nan
        return np.asarray(places)

    @property
    def nbytes(self) -> int:
        """Bytes of textures and buffers that draped layers take."""
        scenery = self.renderer.scenery
        return scenery.appearance.nbytes + scenery.draped.nbytes


class KnownLayer(NamedTuple):
    """A layer whose coverage is known."""

    kind: str
    layer: DrapedLayer
    covered: Shapes  # areas that it covers


def known_layers(folder: Path, count: int, extent: float) -> list[KnownLayer]:
    """Return layers of random areas, wide lines and thin lines, white."""
    areas, lines = random_areas(count, extent), random_lines(count, extent)
    file = write_layer(folder / "lines.fgb", lines)
    layers = [KnownLayer("areas", _white(write_layer(folder / "areas.fgb", areas)), areas)]
    for kind, width in (("wide lines", _WIDE), ("thin lines", _THIN)):
        drawn = DrapedLayer(str(file), style={"colour": _COLOUR, "width": width, "unit": "m"})
        layers.append(KnownLayer(kind, drawn, shapely.buffer(lines, 0.5 * width, quad_segs=16)))
    return layers


def _white(file: Path, opacity: float = 1.0) -> DrapedLayer:
    return DrapedLayer(str(file), style={"colour": "", "fill": _COLOUR, "fill_opacity": opacity})


class _Calibration(NamedTuple):
    """What the shaded ground of a view shows of a white layer: light by share, and where the ground is."""

    bare: Float64Array  # light without
    full: Float64Array  # … and with a layer that covers all of it
    curve: Float64Array  # of light between them, by share
    ground: Float64Array  # as of `DrapedPictures.ground`

    def share(self, shaded: Float64Array) -> Float64Array:
        """Return the share of pixels that are white."""
        light = (shaded - self.bare) / np.where(self.full > self.bare, self.full - self.bare, np.inf)
        return np.interp(light, self.curve, np.linspace(0.0, 1.0, len(self.curve)))


def _calibrated(terrain: Terrain, folder: Path, effort: Effort) -> dict[str, _Calibration]:
    corner, far = -terrain.extent, 2.0 * terrain.extent
    file = write_layer(folder / "all.fgb", np.array([shapely.box(corner, corner, far, far)], object))
    pictures, found = DrapedPictures(terrain, _SIZE, "tiles"), {}
    for view in VIEWS[: effort.drape_views]:
        camera = view.camera(terrain)
        light = [
            pictures.shaded(camera, pictures.opened((_white(file, share),)) if share else None)
            for share in np.linspace(0.0, 1.0, _STEPS).tolist()
        ]
        bare, full = light[0], light[-1]
        seen = full > bare
        curve = np.array([np.median((each - bare)[seen] / (full - bare)[seen]) for each in light])
        found[view.name] = _Calibration(bare, full, curve, pictures.ground(camera))
    pictures.close()
    return found


def error_rows(terrain: Terrain, folder: Path, effort: Effort) -> Iterator[Row]:
    """Compare the coverage of pixels by each method with the exact one."""
    layers = known_layers(folder, effort.drape_features, terrain.extent)
    known = _calibrated(terrain, folder, effort)
    exact: dict[tuple[str, str], Float64Array] = {}
    for method in COMPARED:
        pictures = DrapedPictures(terrain, _SIZE, method)
        for view in VIEWS[: effort.drape_views]:
            camera, calibration = view.camera(terrain), known[view.name]
            on_map = calibration.ground[..., :2] + np.array(camera.eye[:2])
            distance = np.sqrt((calibration.ground**2).sum(axis=-1))[:: 2 * _SAMPLES, :: 2 * _SAMPLES]
            for each in layers:
                key = view.name, each.kind
                if key not in exact:
                    exact[key] = exact_coverage(each.covered, on_map, 2 * _SAMPLES)
                pictures.show(camera, None)
                drapes = pictures.opened((each.layer,))
                first = pictures.show(camera, drapes)
                share = calibration.share(pictures.shaded(camera, drapes))
                memory = pictures.nbytes + drapes.nbytes
                still = _still_ratio(pictures, camera, drapes, min(effort.rounds, _ROUNDS))
                for name, (low, high) in RANGES.items():
                    within = (distance >= low) & (distance < high)
                    row = _error_row(share, exact[key], within, is_thin=each.kind == "thin lines")
                    if row:
                        keys = {"view": view.name, "method": method, "kind": each.kind, "range": name}
                        times = {"first_ms": 1e3 * first, "still": still, "memory_mb": memory / 1e6}
                        yield {**keys, **row, **times}
        pictures.close()


def _error_row(
    found: Float64Array, exact: Float64Array, within: BoolArray, *, is_thin: bool
) -> Mapping[str, float]:
    whole = float(exact[within].sum())
    if whole < 5.0:
        return {}
    kept = float(found[within].sum()) / whole
    if is_thin:
        return {"kept": kept}
    outside = np.where(within, 0.0, np.nan)
    errors = edge_error(found + outside, exact + outside)
    errors = errors[np.isfinite(errors)]
    if len(errors) < 20:
        return {"kept": kept}
    p50, p99 = np.percentile(errors, (50, 99)).tolist()
    return {"edges": len(errors), "edge_p50": p50, "edge_p99": p99, "kept": kept}


def _still_ratio(pictures: DrapedPictures, camera: Camera, drapes: Drapes, rounds: int) -> float:
    """Return the time to draw a prepared picture with layers over that without, rounds alternating."""
    seconds: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(rounds):
        for is_draped in (True, False):
            pictures.show(camera, drapes if is_draped else None)
            start = perf_counter()
            seconds[is_draped].append(pictures.draw(camera) - start)
    return median(seconds[True]) / median(seconds[False])


def motion_rows(terrain: Terrain, folder: Path, effort: Effort) -> Iterator[Row]:
    """Turn and orbit slowly, and compare the change of pixels from frame to frame with the exact one."""
    areas = known_layers(folder, effort.drape_features, terrain.extent)[0]
    view = VIEWS[-1 if effort.drape_views == 1 else 1]
    for name, turn in (("pan", 0.3), ("orbit", 1.0)):
        cameras = [_moved(view.camera(terrain), turn * step, name) for step in range(effort.drape_frames)]
        exact: list[Float64Array] = []
        light: list[tuple[Float64Array, Float64Array]] = []
        for method in COMPARED:
            pictures = DrapedPictures(terrain, _SIZE, method)
            white, drapes = pictures.opened((_white(folder / "all.fgb"),)), pictures.opened((areas.layer,))
            found = []
            for number, camera in enumerate(cameras):
                if method == COMPARED[0]:
                    on_map = pictures.ground(camera)[..., :2] + np.array(camera.eye[:2])
                    exact.append(exact_coverage(areas.covered, on_map, 2 * _SAMPLES))
                    light.append((pictures.shaded(camera, None), pictures.shaded(camera, white)))
                bare, full = light[number]
                share = (pictures.shaded(camera, drapes) - bare) / np.where(full > bare, full - bare, np.inf)
                found.append(np.clip(share, 0.0, 1.0))
            pictures.close()
            errors = np.array(found) - np.array(exact)
            change = 255.0 * np.abs(np.diff(errors, axis=0))
            moving = np.abs(np.diff(exact, axis=0)) > 0.0
            p50, p99 = np.percentile(change[moving], (50, 99)).tolist()
            still = float(np.percentile(change[~moving], 99.9))
            yield {"motion": name, "method": method, "edge_p50": p50, "edge_p99": p99, "elsewhere": still}


def _moved(camera: Camera, pixels: float, motion: str) -> Camera:
    """Return a camera turned by so many px, or moved around its target by as many."""
    eye, target = np.array(camera.eye), np.array(camera.target)
    angle = pixels * 2.0 * np.tan(np.radians(0.5 * camera.fov)) / _SIZE[1]
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    if motion == "pan":
        return replace(camera, target=tuple((eye + turn @ (target - eye)).tolist()))
    return replace(camera, eye=tuple((target + turn @ (eye - target)).tolist()))


@contextmanager
def counted_reads() -> Iterator[Counter[str]]:
    """Count the vertices and pixels that are read from sources."""
    counts = Counter[str]()
    vertices, read = Level.vertices, DrapedRaster._read

    def counted_vertices(self: Level, items: Any) -> Float64Array:
        found = vertices(self, items)
        counts["vertices"] += len(found)
        counts["most"] = max(counts["most"], len(found))
        return found

    def counted_read(
        self: DrapedRaster, west: float, north: float, texel: float, shape: tuple[int, int]
    ) -> Any:
        counts["pixels"] += shape[0] * shape[1]
        return read(self, west, north, texel, shape)

    with patch.object(Level, "vertices", counted_vertices), patch.object(DrapedRaster, "_read", counted_read):
        yield counts


def data_rows(terrain: Terrain, folder: Path, effort: Effort) -> Iterator[Row]:
    """Show as much data as the paper on two-step draping, and count what views read of them."""
    points = 100
    count = max(effort.drape_vertices // points, 1)
    corner, side = 0.5 * (1.0 - _COUNTRY) * terrain.extent, _COUNTRY * terrain.extent
    lines = random_lines(count, side, points=points, step=terrain.extent / 400.0)
    lines = shapely.transform(lines, lambda places: places + corner)
    vectors = DrapedLayer(str(write_layer(folder / "many.fgb", lines)), style={"width": 1.0})
    box = (corner, corner, corner + side, corner + side)
    picture = DrapedLayer(str(write_raster(folder / "large.vrt", box)))
    for method in COMPARED[:2]:  # the others show no rasters
        pictures = DrapedPictures(terrain, _LARGE, method)
        drapes = pictures.opened((picture, vectors))
        for view in VIEWS:
            camera = view.camera(terrain)
            pictures.show(camera, None)
            with counted_reads() as counts:
                first = pictures.show(camera, drapes)
            yield {
                "view": view.name,
                "method": method,
                "vertices": 100.0 * counts["vertices"] / (count * points),
                "most": 100.0 * counts["most"] / (count * points),
                "raster": 100.0 * counts["pixels"] / (PAPER_RASTER[0] * PAPER_RASTER[1]),
                "memory_mb": (pictures.nbytes + drapes.nbytes) / 1e6,
                "first_ms": 1e3 * first,
            }
        pictures.close()


def interaction_rows(terrain: Terrain, folder: Path, effort: Effort) -> Iterator[Row]:
    """Pick, drag, restyle and reorder among many features."""
    count, random = effort.drape_many, np.random.default_rng(SEED)
    side = terrain.extent
    areas = random_areas(count // 2, side, radius=0.3 * side / count**0.5)
    lines = random_lines(count // 4, side)
    offset = random.uniform(1.2, 1.6, lines.shape)[:, None]  # 1 to 3 px from one edge to the next
    other = shapely.get_coordinates(lines) + np.repeat(offset, shapely.get_num_coordinates(lines), axis=0)
    lines = np.concatenate([lines, shapely.set_coordinates(lines.copy(), other)])
    layers = (
        DrapedLayer(str(write_layer(folder / "cells.fgb", areas)), style={"fill": "#33aa55", "width": 0.0}),
        DrapedLayer(str(write_layer(folder / "ways.fgb", lines)), style={"width": 1.0, "unit": "m"}),
    )
    pictures = DrapedPictures(terrain, _LARGE, "tiles", live=True)
    drapes = pictures.opened(layers)
    yield _pick_row(drapes, (areas, lines), random, effort.drape_picks)
    camera = VIEWS[1].camera(terrain)
    _frames_until_loaded(pictures, camera, drapes)
    changes: dict[str, Callable[[int], Drapes]] = {
        "opacity": lambda k: drapes.updated((layers[0], layers[1].replace(opacity=0.3 + 0.5 * (k % 2)))),
        "restyled": lambda k: drapes.updated((layers[0], layers[1].replace(colour=f"#{1000 + k:06d}"))),
        "hidden": lambda k: drapes.updated((layers[0], layers[1].replace(visible=k % 2))),
        "order": lambda k: drapes.updated(layers if k % 2 else layers[::-1]),
    }
    for name, change in changes.items():
        with counted_reads() as counts:
            times = [_frames_until_loaded(pictures, camera, change(k)) for k in range(effort.drape_edits)]
        parts = zip(("first frame", "all of it"), zip(*times, strict=True), strict=True)
        yield from (
            {**_time_row(f"{name}: {part}", each), "read": counts["vertices"]} for part, each in parts
        )
    yield _drag_row(drapes, layers, camera, pictures, effort.drape_edits)
    pictures.close()


def _frames_until_loaded(
    pictures: DrapedPictures, camera: Camera, drapes: Drapes, held: tuple[int, int] | None = None
) -> tuple[float, float]:
    """Return the time (s), without drawing, to update the first frame and all until tiles show a change."""
    renderer, seconds = pictures.renderer, list[float]()
    start = perf_counter()
    renderer.set_drapes(drapes, held)
    while not seconds or not renderer.scenery.appearance.converged:
        stats = renderer.frame(camera, pictures.framebuffer, elapsed=0.05)
        pictures.context.finish()
        seconds.append(perf_counter() - start - stats.draw_seconds)
        start = perf_counter()
    return seconds[0], sum(seconds)


def _time_row(what: str, seconds: Sequence[float]) -> Row:
    return {"what": what, **spread(seconds).cells("count")}


def _pick_row(drapes: Drapes, shapes: tuple[Shapes, Shapes], random: np.random.Generator, count: int) -> Row:
    """Pick at random places and beside lines, and compare with a search through all features."""
    texel, half = 0.2, 0.5
    areas, lines = shapes
    trees = shapely.STRtree(areas), shapely.STRtree(lines)
    places = random.uniform(0.0, drapes.extent, (count, 2))
    beside = shapely.get_coordinates(lines[random.integers(len(lines), size=count // 2)])
    beside = beside[random.integers(len(beside), size=count // 2)]
    places[: count // 2] = beside + random.uniform(-2.0, 2.0, beside.shape) * (half + PICK * texel)
    seconds, right = [], 0
    for x, y in places.tolist():
        start = perf_counter()
        found = drapes.pick(x, y, texel)
        seconds.append(perf_counter() - start)
        point, expected = shapely.Point(x, y), None
        near = trees[1].query(point, predicate="dwithin", distance=half + PICK * texel)
        gap = shapely.distance(lines[near], point) - half
        if (gap <= 0.0).any():
            expected = 1, int(near[gap <= 0.0].max())
        elif len(inside := trees[0].query(point, predicate="within")):
            expected = 0, int(inside.max())
        elif len(near):
            expected = 1, int(near[np.argmin(gap)])
        right += expected == (found and found[:2])
    return {**_time_row("pick", seconds), "right": 100.0 * right / count}


def _drag_row(
    drapes: Drapes, layers: tuple[DrapedLayer, ...], camera: Camera, pictures: DrapedPictures, count: int
) -> Row:
    """Drag a vertex of a line near the middle of a view, until each frame shows it."""
    eye, ahead = np.array(camera.eye[:2]), np.array(camera.forward[:2])
    x, y = (eye + 150.0 * ahead / np.hypot(*ahead)).tolist()
    held = 1, int(drapes.features(1, (x - 60.0, y - 60.0, x + 60.0, y + 60.0))[0])
    seconds = []
    for step in range(count + 2):
        start = perf_counter()
        table = drapes.table(1)
        places = np.concatenate(table.feature(held[1]).rings)
        places[2] += _MOVES * np.array([(-1.0) ** step, 1.0])
        moved = layers[1].replace(edits=with_places(table, held[1], places).edits)
        drapes = drapes.updated((layers[0], moved))
        pictures.renderer.set_drapes(drapes, held)
        stats = pictures.renderer.frame(camera, pictures.framebuffer, elapsed=0.3)
        pictures.context.finish()
        seconds.append(perf_counter() - start - stats.draw_seconds + stats.drape_seconds)
    return _time_row("vertex dragged: a frame", seconds[2:])


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Drape synthetic lines and areas over a terrain by each method; pick, edit and restyle them.

    Error: layers of random areas, of lines 8 m wide, and of lines 0.3 m wide, white, from 1.7 m, a hill
    and the air, at 320 × 180 px. The share of each pixel follows from the shaded ground with the layer,
    without, and with a layer that covers everything. It is compared with the share of the ground that is
    drawn in the pixel, found at 8 × 8 places. `edge`: displacement of edges, px, near (up to 500 m) and
    far; `kept`: covered share over the exact one. `first`: ms to prepare and draw a view whose ground is
    ready; `still`: time to draw it again over that without layers, rounds alternating. `memory`:
    textures, buffers and caches of layers, MB.

    Data: a raster of 28,800 × 72,000 px and 4.9 million vertices, as in the paper on two-step draping, at
    1024² px, over 41 × 41 km. `vertices` and `raster`: what a view reads over what the files have, where
    what several tiles read counts for each of them; `at a time`: the most that one tile reads.

    Motion: a camera turned by 0.3 px a frame, or moved around its target by 1 px; change of pixels between
    frames less that of the exact shares, for white areas over the ground.

    Interaction, among 100,000 features at 1024² px: picks at random places and beside lines, of which pairs
    lie 1 to 3 px apart, against a search through all of them; a layer restyled, hidden, moved: work of the
    first frame and of all until tiles show it, without the drawing of frames; a vertex dragged: work of a
    frame, with what is draped over it, without the rest.
    """
    with TemporaryDirectory() as name:
        folder, terrain = Path(name), open_ground(GROUND, context)
        errors = tuple(error_rows(terrain, folder, effort))
        data = tuple(data_rows(terrain, folder, effort))
        motion = tuple(motion_rows(terrain, folder, effort))
        interaction = tuple(interaction_rows(terrain, folder, effort))
    return (
        Table("Errors of draped layers", errors, _ERRORS),
        Table("Data in use", data, _DATA),
        Table("Motion", motion, _MOTION),
        Table("Picking and editing", interaction, _INTERACTION),
    )


_PANELS = [
    Curves(
        *("", "first_ms", {"": "edge_p99"}),
        by="method",
        text="view",
        units=("ms", "edge error, 99 %, px"),
        asked=(0.5,),
    ),
    Curves("", "first_ms", {"": "memory_mb"}, by="method", text="view", units=("ms", "memory, MB")),
]
draw_drapes = partial(draw_curves, "Draped layers", _PANELS, each="kind")
