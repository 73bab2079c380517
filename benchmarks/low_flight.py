"""Bruneton & Neyret's flight over the synthetic country: time to update tiles of ground and appearance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from time import perf_counter
from types import SimpleNamespace
from typing import Any, Final, cast

import numpy as np
from scipy.optimize import brentq

from sketchterrain.array_types import Bounds, Float64Array, StructuredArray
from sketchterrain.benchmarks.plotting import BLUE, INK, SMALL, VERMILION, new_figure
from sketchterrain.benchmarks.report import Row, Table, samples_of
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.appearance import AppearanceTextures
from sketchterrain.render.ground_stream import QUAD, QUAD_PER_TOLERANCE, view_of
from sketchterrain.render.quality import Quality, TimeBudget
from sketchterrain.terrain.surfaces import vertex_dtype
from sketchterrain.tiles.lod import CameraView, ScreenError
from sketchterrain.tiles.stream import TileStream
from sketchterrain.tiles.tile_pool import Batch

SIZE: Final = (1024, 768)
"""px."""
SECONDS: Final = 73.0
RATE: Final = 60.0
"""Frames a second."""
LATE: Final = 0.025
"""s of updates that 99.8 % of the frames shall stay within."""

_LENGTH = 13_000.0  # m
_SPEEDS, _HEIGHTS = (2000.0 / 3.6, 60.0 / 3.6, 90.0 / 3.6), (5000.0, 8.0, 5.0)  # m/s, m: first, slowest, last
_SLOWEST = 60.0  # s
_FOV = float(np.degrees(2.0 * np.arctan(np.tan(np.radians(40.0)) * SIZE[1] / SIZE[0])))  # 80° across
_FAR = 71_000.0  # m: to the corners of the sketch, beyond which nothing is drawn
_AHEAD = 3.0  # s: where the eye looks
_BUDGETS = (0.006, 0.010)  # s a frame for ground; for appearance with its selection

_HEADINGS = {
    "within": "≤ 25 ms, % of frames",
    "within_frame": "≤ 16.7 ms, %",
    "missing": "frames with a coarser tile for a missing one, %",
}


class TileUpdates:
    """Tiles of ground and appearance for a camera as the renderer has them, without a GPU."""

    def __init__(self, terrain: Terrain) -> None:
        quality = Quality()
        slots = quality.tile_memory // (65 * 65 * vertex_dtype(len(terrain.materials)).itemsize)
        quad = QUAD + QUAD_PER_TOLERANCE * quality.tolerance
        metric = ScreenError(quality.tolerance, quad=quad, neighbour_limit=quality.neighbour_limit)
        texture = SimpleNamespace(write=lambda *given, **named: None)
        context = SimpleNamespace(texture_array=lambda *given, **named: texture)
        self.terrain = terrain
        self.stream = TileStream(terrain.extent, slots=slots, metric=metric, bounds=(0.0, 0.0, *terrain.size))
        self._store = terrain.vertex_store(slots)
        self.textures = AppearanceTextures(cast(Any, context), terrain, quality)

    @property
    def used(self) -> tuple[int, int]:
        """Tiles of ground in memory, and appearance tiles that the last view shows."""
        cache = self.textures._cache
        return self.stream.pool.count, 0 if cache is None else len(cache.tiles._needed.codes)

    def converge(self, view: CameraView) -> None:
        """Evaluate all tiles of a view."""
        self.stream.generate_all(view, self._write)
        self._paint(view)

    def frame(self, view: CameraView) -> tuple[float, ...]:
        """Go on by a frame; return s to choose tiles, for ground, appearance, their tiles, if complete."""
        start, written = perf_counter(), 0.0
        batch = self.stream.plan(view, budget=_BUDGETS[0])
        if batch:
            before = perf_counter()
            properties = self._write(batch)
            written = perf_counter() - before
            self.stream.mark_generated(batch, properties, seconds=written)
        self.stream.advance(view, elapsed=1.0 / RATE)
        advanced, drawn = perf_counter(), self.textures.drawn
        self.textures.update(view, self.stream.pool, TimeBudget(_BUDGETS[1]))
        seconds = advanced - start - written, written, perf_counter() - advanced
        complete = self.stream.complete and self.textures.converged
        return *seconds, len(batch.keys), self.textures.drawn - drawn, complete

    def edited(self, terrain: Terrain, areas: Sequence[Bounds], view: CameraView) -> int:
        """Take a changed terrain and evaluate again what a view shows of it; return how many tiles."""
        self.terrain = terrain
        self.stream.invalidate(areas)
        count, before = 0, self.textures.drawn
        while batch := self.stream.stale_batch(self.stream.draw_list(view)):
            self.stream.mark_generated(batch, self._write(batch), seconds=None)
            count += len(batch.keys)
        self.textures.set_terrain(terrain, areas)
        self._paint(view)
        return count + self.textures.drawn - before

    def _paint(self, view: CameraView) -> None:
        while not self.textures.update(replace(view, velocity=(0.0, 0.0, 0.0)), self.stream.pool):
            pass

    def _write(self, batch: Batch) -> StructuredArray:
        return self.terrain.write_tiles(batch.keys, batch.slots, batch.parents, self._store)


def flight_views(terrain: Terrain, times: Float64Array) -> list[CameraView]:
    """Return the views of the flight at times (s), over the middle of the sketch, eastward."""
    step = 1.0 / RATE
    grid = np.arange(0.0, SECONDS + _AHEAD + 2.0 * step, step)

    def speeds(power: float) -> Float64Array:
        return _eased(_SPEEDS, grid, power)

    power = brentq(lambda each: float(speeds(each)[grid < SECONDS].sum()) * step - _LENGTH, 0.5, 8.0)
    speed = speeds(power)
    along = np.append(0.0, np.cumsum(speed)[:-1]) * step
    x, y = 0.5 * terrain.extent - 0.5 * _LENGTH + along, np.full(len(along), 0.5 * terrain.extent)
    floor = terrain.heights(x, y, cell_size=2.0).astype(np.float64)
    smooth = np.convolve(np.pad(floor, 60, mode="edge"), np.full(121, 1.0 / 121.0), mode="valid")
    above = _eased(_HEIGHTS, grid, power)
    z = np.maximum(smooth + above, floor + 0.5 * above)
    views = []
    for time in times.tolist():
        at = round(time / step)
        ahead = at + round(_AHEAD / step)
        target = float(x[ahead]), float(y[ahead]), float(smooth[ahead])
        camera = Camera((float(x[at]), float(y[at]), float(z[at])), target, fov=_FOV)
        velocity = float(speed[at]), 0.0, float(z[at + 1] - z[at]) / step
        views.append(view_of(camera, SIZE, draw_distance=_FAR, velocity=velocity))
    return views


def _eased(values: tuple[float, float, float], time: Float64Array, power: float) -> Float64Array:
    """Return values at times: of the start, the slowest place, and the end, even in their logarithms."""
    first, middle, last = np.log(values)
    share = np.minimum(time / _SLOWEST, 1.0) ** power
    after = np.clip((time - _SLOWEST) / (SECONDS - _SLOWEST), 0.0, 1.0)
    return np.asarray(np.exp(first + (middle - first) * share + (last - middle) * after))


def flight_table(terrain: Terrain, frames: int) -> Table:
    """Fly twice, and return what the updates of the last so many frames took."""
    views = flight_views(terrain, SECONDS + np.arange(-frames, 0) / RATE)
    rows = tuple(_flown(terrain, views, what) for what in ("first", "again, what levels need is there"))
    return Table(f"Updates of {frames} frames, 1024 × 768 at 60 Hz", rows, _HEADINGS)


def _flown(terrain: Terrain, views: Sequence[CameraView], what: str) -> Row:
    updates, start = TileUpdates(terrain), perf_counter()
    updates.converge(views[0])
    row: dict[str, Any] = {"what": what, "first_s": perf_counter() - start}
    parts = np.array([(*updates.frame(view), *updates.used) for view in views], np.float64)
    seconds = parts[:, :3].sum(axis=1)
    row["update_ms"], row["worst_ms"] = 1e3 * float(seconds.mean()), 1e3 * float(seconds.max())
    row["p95_ms"] = 1e3 * float(np.percentile(seconds, 95))
    row["within"], row["within_frame"] = (
        100.0 * float((seconds <= most).mean()) for most in (LATE, 1 / RATE)
    )
    for number, name in enumerate(("choice_ms", "ground_ms", "appearance_ms")):
        row[name] = 1e3 * float(parts[:, number].mean())
    for number, name in enumerate(("ground", "textures")):
        count, used = parts[:, 3 + number], parts[:, 6 + number]
        row[f"{name}_mean"], row[f"{name}_most"] = float(count.mean()), int(count.max())
        row[f"{name}_used"] = int(used.max())
    row["missing"] = 100.0 * float((parts[:, 5] == 0.0).mean())
    return row | {"seconds": seconds.tolist(), "textures_each": parts[:, 4].tolist()}


def draw_flight(rows: Sequence[Row]) -> Any:
    """Draw the time of updates and the appearance tiles of each frame."""
    figure = new_figure(9.0, 4.2, "A flight over 600,000 curves")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for row, hue in zip(rows, (VERMILION, BLUE), strict=False):
        seconds, textures = (np.array(samples_of(row, key)) for key in ("seconds", "textures_each"))
        time = SECONDS + np.arange(-len(seconds), 0) / RATE
        for axes, values in ((upper, seconds * 1e3), (lower, textures)):
            axes.plot(time, values, ".", markersize=1.5, color=hue, rasterized=True, label=str(row["what"]))
    upper.legend(fontsize=SMALL, markerscale=6)
    upper.axhline(1e3 * LATE, color=INK, linewidth=0.9, linestyle=":")
    upper.set(ylabel="ms", title="Update; dotted: 25 ms", yscale="log")
    lower.set(ylabel="tiles", xlabel="s", title="Appearance tiles")
    for axes in (upper, lower):
        axes.tick_params(labelsize=SMALL)
    return figure
