"""Latency from a brush stroke to the changed terrain, stalls of the window, times until a view is still."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import shapely
from PIL import Image

from sketchterrain.array_types import UInt8Array
from sketchterrain.benchmarks import live_shape
from sketchterrain.benchmarks.draped_data import random_lines, write_layer
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.pictures import block_differences
from sketchterrain.benchmarks.plotting import (
    BLUE,
    GREEN,
    GREY,
    HUES,
    INK,
    ORANGE,
    BarPanel,
    draw_bars,
    new_figure,
)
from sketchterrain.benchmarks.report import Row, Table, Tables, samples_of, value_of
from sketchterrain.benchmarks.timing import TimedContext, spread
from sketchterrain.document.drapes import draped_layer
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import DeviceError
from sketchterrain.generation.building import build
from sketchterrain.geometry.camera import Camera
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.models.features import SelectedFeature
from sketchterrain.ui.models.painting import Stroke
from sketchterrain.ui.models.selection import FeatureDrag
from sketchterrain.ui.models.workspace import Handle, Selection
from sketchterrain.ui.view3d.camera import overview
from sketchterrain.ui.window import MainWindow

if TYPE_CHECKING:
    from PyQt6.QtCore import QCoreApplication


_RATE, _TIMEOUT, _HEARTBEAT = 0.008, 120.0, 5  # s between places of the mouse, s to wait, ms


class Painted(NamedTuple):
    """Times of one stroke, and how late the event loop was."""

    # s of the monotonic clock: last sketch, placing started, finished, recipe received, tiles written
    times: tuple[float, ...]
    drafts: tuple[float, ...]  # s until something of each sketch is shown: a draft, or the terrain
    stalls: tuple[float, ...]  # s that each beat of a timer in the event loop came too late


@cache
def _application() -> QCoreApplication:
    """Return Qt's application, kept to the end: all Qt objects would be deleted with it."""
    from PyQt6.QtWidgets import QApplication

    return QApplication.instance() or QApplication([])


class EngineProbe:
    """The real processes of a sketch's view, and the event loop that receives their frames."""

    def __init__(self, sketch: Sketch) -> None:
        if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
        from sketchterrain.ui.engine.link import EngineLink
        from sketchterrain.ui.models.document import Document

        self._application = _application()
        self.document = Document(sketch)
        self._link = EngineLink(self.document)
        self.frames: list[tuple[float, msg.FrameFacts]] = []  # s of the monotonic clock when it was shown
        self._errors: list[msg.ErrorReport] = []
        self._written: list[msg.PictureWritten] = []
        self._requested = 0.0
        self._link.frame_shown.connect(lambda facts: self.frames.append((time.monotonic(), facts)))
        self._link.error_reported.connect(self._errors.append)
        self._link.picture_written.connect(self._written.append)

    def start(self, view: msg.ViewState) -> float:
        """Start the processes; return the seconds until the first frame."""
        self._link.set_view(view)
        return self._first_frame(self._link.start)

    def turn(self) -> float:
        """Turn the camera; return the seconds until the first frame that shows it."""
        return self._first_frame(lambda: self._link.send(msg.Turn(_TURN, 0.0)))

    def rest(self, seconds: float) -> None:
        """Wait until so many seconds after the start or the last turn."""
        self._pause(self._requested + seconds)

    def settle(self) -> float:
        """Wait for the refined picture; return the seconds since the start or the last turn."""
        self.wait(lambda: self.frames[-1][1].converged)
        return self.frames[-1][0] - self._requested

    def look(self, pose: Camera) -> float:
        """Jump to a camera; return the seconds until the first frame that shows it."""
        return self._first_frame(lambda: self._link.send(msg.Look(pose)))

    def frame_rate(self, seconds: float) -> float:
        """Return the frames a second while the camera turns for some seconds."""
        before, end = len(self.frames), time.monotonic() + seconds
        while time.monotonic() < end:
            self._link.send(msg.Turn(0.1 * _TURN, 0.0))
            self._pause(time.monotonic() + _RATE)
        rate = (len(self.frames) - before) / seconds
        self.settle()
        return rate

    def stroke(self, layer: str, label: int, path: Sequence[tuple[float, float]], radius: float) -> None:
        """Paint a stroke (px of the sketch) at a mouse's rate."""
        draft = self.document.begin_draft(layer)
        stroke = Stroke(draft.image, label)
        for x, y in path:
            began = time.monotonic()
            if (box := stroke.to(x, y, radius)) is not None:
                draft.touch(box)
            self._pause(began + _RATE)
        if (box := stroke.finish()) is not None:
            draft.touch(box)
        draft.commit(f"Paint {layer}")

    def compare_with_still(self, saved: Path) -> Row:
        """Return how the picture of 1 s after the last view or stroke differs from a still of its camera."""
        self._pause(time.monotonic() + _LATER)
        facts, picture = self.frames[-1][1], self._link.picture
        assert picture is not None  # noqa: S101 # a frame was shown
        size, pose = (facts.width, facts.height), facts.pose
        live = live_shape.saved_shape(saved, size)
        terrain = build(self.document.sketch)
        still = live_shape.still_shape(terrain, Camera(pose.eye, pose.target, fov=pose.fov), size)
        self.settle()
        with TemporaryDirectory(prefix="sketchterrain-still-") as folder:
            shown, drawn = (str(Path(folder, f"{name}.png")) for name in ("shown", "drawn"))
            picture.save(shown)
            self._link.send(msg.RenderPicture(drawn, *size))
            self.wait(lambda: any(each.path == drawn for each in self._written))
            pictures = [np.asarray(Image.open(path).convert("RGB")) for path in (shown, drawn)]
        return {
            "columns": 100.0 * live_shape.columns_alike(live, still),
            "water": live_shape.water_overlap(live, still),
            "difference": float(block_differences(*pictures).mean()),
        }

    def wait(self, until: Callable[[], bool]) -> None:
        """Run the event loop until something holds; DeviceError if it never does."""
        end = time.monotonic() + _TIMEOUT
        self._pause(time.monotonic() + 0.02)  # so that what was sent last is on its way
        while not until():
            if self._errors or time.monotonic() > end:
                lines = "; ".join(each.line for each in self._errors) or "no answer"
                raise DeviceError(f"the view does not follow: {lines}")
            self._pause(time.monotonic() + 0.002)

    def end(self) -> None:
        """End the processes."""
        self._link.stop()

    def _first_frame(self, request: Callable[[], None]) -> float:
        """Return the seconds from a request to the first frame with another camera."""
        before = self.frames[-1][1].pose if self.frames else None
        self._requested = time.monotonic()
        request()
        self.wait(lambda: bool(self.frames) and self.frames[-1][1].pose != before)
        return self.frames[-1][0] - self._requested

    def _pause(self, until: float) -> None:
        while (left := until - time.monotonic()) > 0.0:
            self._application.processEvents()
            time.sleep(min(left, 0.001))
        self._application.processEvents()


class LatencyProbe(EngineProbe):
    """The program's window with its real processes, and a heartbeat in its event loop."""

    def __init__(self, sketch: Sketch) -> None:
        super().__init__(sketch)
        from PyQt6.QtCore import Qt, QTimer

        from sketchterrain.ui.application import GarbageCollection
        from sketchterrain.ui.models.workspace import Preferences, Workspace

        self._created: dict[int, float] = {}
        self._followed: list[msg.TerrainUpdated] = []
        self._beats: list[float] = []
        self._link.sent.connect(self._created.__setitem__)
        self._link.terrain_updated.connect(self._followed.append)
        self._heart = QTimer(timerType=Qt.TimerType.PreciseTimer)  # type: ignore[call-arg] # a property
        self._heart.timeout.connect(lambda: self._beats.append(time.monotonic()))
        self._folder = TemporaryDirectory(prefix="sketchterrain-latency-")
        folder = Path(self._folder.name)
        preferences = Preferences(folder / "desktop.ini")
        self._window = MainWindow(self.document, Workspace(), self._link, preferences, folder)
        self._window.resize(1600, 900)
        self._window.show()
        self._link.start()
        self.wait(lambda: bool(self.frames))
        self._garbage = GarbageCollection()

    def end(self) -> None:
        """Close the window and end the processes."""
        self._garbage.stop()
        super().end()
        self.document.mark_saved(self.document.state, Path(self._folder.name))  # or it would ask
        self._window.close()
        self._window.deleteLater()
        self._application.processEvents()
        self._folder.cleanup()

    def paint(self, layer: str, label: int, path: Sequence[tuple[float, float]], radius: float) -> Painted:
        """Paint a stroke (px of the sketch) at a mouse's rate, wait for the terrain, and undo it."""
        for watched in (self._created, self._followed, self._beats):
            watched.clear()
        self._heart.start(_HEARTBEAT)
        self.stroke(layer, label, path, radius)
        self._heart.stop()
        stalls = np.diff(self._beats) - _HEARTBEAT * 1e-3
        self.wait(self._is_there)
        drafts = [
            next(each for each in self._followed if each.version >= version).displayed - created
            for version, created in sorted(self._created.items())
        ]
        last = max(self._created)
        at = next(each for each in self._followed if each.version >= last and not each.draft)
        times = self._created[last], at.started, at.placed, at.received, at.displayed
        self.document.undo()
        self.wait(self._is_there)
        return Painted(times, tuple(drafts), tuple(stalls.tolist()))

    def vertex(self, layer: str, number: int) -> Handle:
        """Return the middle vertex of a vector, the number counted round."""
        vectors = self.document.sketch.vectors[layer]
        name = int(vectors.ids[number % len(vectors)])
        line = vectors.feature(name).rings[0]
        own = SelectedFeature.find(self.document, Selection(layer, name))
        assert own is not None  # noqa: S101 # it was there
        return own.vertex_handles[len(line) // 2]

    def draped_vertex(self, feature: int) -> Handle:
        """Return the first vertex of a feature of the first draped layer."""
        self.wait(lambda: self.document.drapes.current is not None)
        own = SelectedFeature.find(self.document, Selection("drape", feature, layer=0))
        assert own is not None  # noqa: S101 # as above
        return own.vertex_handles[0]

    def drag(self, handle: Handle) -> tuple[float, float, float]:
        """Drag a vertex for a second and undo it; return the figures of `_drags`."""
        self._created.clear()
        self._followed.clear()
        before = len(self.frames)
        drag = FeatureDrag(self.document, self._link.placed, handle)
        for step in range(_DRAG_STEPS):
            began = time.monotonic()
            drag.to(handle.x + 0.3 * step, handle.y)
            self._pause(began + _DRAG_RATE)
        released, count = time.monotonic(), len(self.frames) - before
        drag.finish()
        placing, final = 0.0, 0.0
        if handle.selection.is_draped:
            final = self.turn()  # messages are answered in order: its picture shows the edit
        else:
            self.wait(lambda: bool(self._created) and self._is_there())
            last = next(each for each in self._followed if each.version >= max(self._created))
            count = len({each.version for each in self._followed if each.displayed <= released})
            placing, final = last.placed - last.started, max(last.displayed - released, 0.0)
        self.document.undo()
        self.wait(self._is_there)
        return count / (_DRAG_STEPS * _DRAG_RATE), 1e3 * placing, 1e3 * final

    def _is_there(self) -> bool:
        final = max((each.version for each in self._followed if not each.draft), default=-1)
        return all(version <= final for version in self._created)


SEED: Final = 11
STAGES: Final = ("waiting", "placing", "handing over", "tiles")
_SIDE, _BLOBS = 512, 18
_SKETCH_SEED = 5
_RADIUS_SHARE = 0.38  # of a shape's cell
_ROUGHNESS = ((2, 0.15), (3, 0.1), (5, 0.05))  # lobes of an outline and their depths
_LAYERS: Final = ("mountain", "hill", "dune", "forest", "river", "lake")

_HEADINGS = {"draft_ms": "first shown, median, ms"}
_TURN: Final = 3.0  # degrees
_SIZE: Final = 640, 360  # px of pictures that are compared
_RATED: Final = 3.0  # s of the turning camera
_LATER: Final = 1.0  # s after a view or a stroke, at which its picture is compared
_DRAG_PRESETS: Final = ("mountain_pass", "andorra")
_DRAG_STEPS, _DRAG_RATE = 60, 0.016  # motions of a drag, and s between them
_DRAPED_LINES: Final = 10_000
_DRAG_KEYS = ("preset", "layer", "rate", "placing_ms", "final_ms", "final_p95_ms")
_DRAGS = {"rate": "terrains (drape: pictures) a second while dragging"}
_VIEWS = {"answer_ms": "motion while it refines, median, ms"}
_SHAPES = {
    "columns": "columns within 3 px, %",
    "water": "water, intersection over union",
    "rate": "frames a second",
}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Milliseconds from a stroke to changed terrain, stalls of the window, and seconds until a view is still.

    A sketch of 512 px with 20 shapes (18 blobs, a lake, a river) in the program's own window, with the real
    processes behind it on the device that they choose. Two ways of painting, in turns through six layers,
    radii from 8 to 40 px: `strokes` of 60 to 120 places 8 ms apart, as a mouse tells them; `dabs`, each after
    the one before is there; each is undone after. The time begins when the window makes a sketch that it
    sends, and ends when the view's tiles hold the heights of that sketch or a newer one; drawing them comes
    after. What is shown `first` of every sketch may be a draft on coarse ground; the `final` terrain counts
    from the last sketch of a stroke. Its time is made of `waiting` (for what is being placed; on its way),
    `placing`, `handing over` (packing the recipe; the engine ends a frame that it draws) and `tiles` (what
    changed, and computing it): their means. A stall is how much later than 5 ms after the one before the
    window's event loop gets to a timer, while one paints.

    The view of presets: seconds from the start of the engine's processes, with caches of earlier runs, to the
    first frame and to the refined picture, and from a turn of 3° to that; how long a turn takes to be shown
    at several moments of refinement; the most memory of the processes. The live picture 1 s after a view
    appears or a stroke ends is compared with a still of the same camera, sun and clock: columns in which all
    silhouettes are within 3 pixels, the water's masks, and the mean colours of blocks of 16² pixels. The
    frame rate is that of a turning camera. Animation is off.
    """
    del context  # the processes open devices of their own
    probe = LatencyProbe(sketch_with_twenty_shapes())
    try:
        _row(probe, "dabs", len(_LAYERS))  # what is made once is made before
        counts = {"strokes": effort.live_strokes, "dabs": effort.live_dabs}
        rows = [_row(probe, painting, count) for painting, count in counts.items()]
    finally:
        probe.end()
    drags = tuple(row for preset in _DRAG_PRESETS for row in _drags(preset, effort.live_drags))
    views = tuple(_view(preset, effort) for preset in effort.view_presets)
    shapes = tuple(row for preset in effort.view_presets for row in _shapes(preset, effort))
    size = "{} × {}".format(*effort.view_sizes[-1])
    return (
        Table(f"From a stroke to changed terrain, seed {SEED}", tuple(rows), _HEADINGS),
        Table("Dragging a vertex", drags, _DRAGS),
        Table(f"The view from start to still, {size}", views, _VIEWS),
        Table("Live picture beside the still of its camera, {} × {}".format(*_SIZE), shapes, _SHAPES),
    )


def _drags(preset: str, count: int) -> Iterator[Row]:
    """Drag vertices: what is shown a second meanwhile, ms of placing the last one, and until it is shown."""
    sketch = load_sketch(preset)
    with TemporaryDirectory(prefix="sketchterrain-lines-") as folder:
        lines = random_lines(_DRAPED_LINES, sketch.extent)
        layer = draped_layer(write_layer(Path(folder, "lines.fgb"), lines))
        middle = shapely.points(0.5 * np.array(sketch.size))
        near = np.argsort(shapely.distance(lines, middle))[:count].tolist()
        probe = LatencyProbe(sketch.replace(drapes=(layer,)))
        try:
            for name in (*filter(lambda name: len(sketch.vectors[name]), ("road", "river", "lake")), "drape"):
                found = np.array(
                    [
                        probe.drag(
                            probe.draped_vertex(near[number])
                            if name == "drape"
                            else probe.vertex(name, 7 * number)
                        )
                        for number in range(count)
                    ]
                )
                values = *np.median(found, axis=0).tolist(), float(np.percentile(found[:, 2], 95))
                yield dict(zip(_DRAG_KEYS, (preset, name, *values), strict=True))
        finally:
            probe.end()


def _view(preset: str, effort: Effort) -> Row:
    """Open a preset, turn and wait; return the times, and how the picture at rest differs from the still."""
    probe, answers = EngineProbe(load_sketch(preset)), []
    width, height = effort.view_sizes[-1]
    try:
        first = probe.start(msg.ViewState(width=width, height=height, plays=False))
        still = probe.settle()
        probe.turn()
        turned = probe.settle()
        for seconds in effort.view_moments:
            probe.turn()
            probe.rest(seconds)
            answers.append(probe.turn())
        probe.settle()
        memory = max(facts.memory for _, facts in probe.frames)
    finally:
        probe.end()
    return {
        "preset": preset,
        "first_s": first,
        "still_s": still,
        "turned_s": turned,
        "answer_ms": float(np.median(answers)) * 1e3,
        "answer_most_ms": max(answers) * 1e3,
        "memory_gb": memory * 1e-9,
        "answer_seconds": answers,
    }


def _shapes(preset: str, effort: Effort) -> Iterator[Row]:
    """Compare live pictures with stills: of the opening view, of the whole sketch, and after strokes."""
    sketch, rng = load_sketch(preset), np.random.default_rng(SEED)
    bounds = (0.0, 0.0, *sketch.size)
    with TemporaryDirectory(prefix="sketchterrain-shapes-") as folder:
        saved = Path(folder, "shape")
        with live_shape.measured_engine(saved):
            probe = EngineProbe(sketch)
            probe.start(msg.ViewState(width=_SIZE[0], height=_SIZE[1], plays=False))
        try:
            for view in ("opening", "whole sketch"):
                if view != "opening":
                    probe.look(overview(bounds, 0.0, aspect=_SIZE[0] / _SIZE[1]))
                seen = probe.compare_with_still(saved)
                yield {"preset": preset, "view": view, **seen, "rate": probe.frame_rate(_RATED)}
            for number in range(effort.live_strokes):
                layer = _LAYERS[number % len(_LAYERS)]
                side = min(sketch.width_px, sketch.height_px)
                probe.stroke(layer, *_random_stroke(rng, layer, side, places=60))
                yield {"preset": preset, "view": f"stroke of {layer}", **probe.compare_with_still(saved)}
        finally:
            probe.end()


def sketch_with_twenty_shapes() -> Sketch:
    """Eighteen blobs in four layers, a lake and a winding river on 512 px."""
    sketch = sketch_of(_SIDE, _BLOBS)
    lake = np.zeros((_SIDE, _SIDE), np.uint8)
    down, across = np.ogrid[:_SIDE, :_SIDE]
    lake[(down - 0.86 * _SIDE) ** 2 + 0.5 * (across - 0.62 * _SIDE) ** 2 < (0.06 * _SIDE) ** 2] = 1
    return sketch.replace(layers={**sketch.layers, "lake": lake})


def _row(probe: LatencyProbe, painting: str, count: int) -> Row:
    """Paint so many strokes or dabs, and return what was found."""
    rng = np.random.default_rng(SEED)
    times: list[tuple[float, ...]] = []
    drafts: list[float] = []
    stalls: list[float] = []
    for number in range(count):
        places = int(rng.integers(60, 121)) if painting == "strokes" else 1
        layer = _LAYERS[number % len(_LAYERS)]
        seen = probe.paint(layer, *_random_stroke(rng, layer, _SIDE, places=places))
        times.append(seen.times)
        drafts += seen.drafts
        stalls += seen.stalls
    return _found(painting, times, drafts, stalls)


def _random_stroke(
    rng: np.random.Generator, layer: str, side: int, *, places: int
) -> tuple[int, list[tuple[float, float]], float]:
    """Return label, path and radius (px) of a stroke in a sketch of a side (px)."""
    ways = rng.normal(0.0, 2.5, 2) + np.cumsum(rng.normal(0.0, 0.6, (places, 2)), axis=0)
    path = rng.uniform(0.1, 0.9, 2) * side + np.cumsum(np.clip(ways, -6.0, 6.0), axis=0)
    radius = float(rng.uniform(8.0, 40.0)) * (0.3 if layer == "river" else 1.0)
    return int(rng.integers(0, 3) > 0), [(x, y) for x, y in path.tolist()], radius


def _found(painting: str, times: list[tuple[float, ...]], drafts: list[float], stalls: list[float]) -> Row:
    stages = np.diff(times, axis=1)
    samples = stages.sum(axis=1).tolist()
    whole, first, means = spread(samples), spread(drafts), stages.mean(axis=0)
    return {
        "painting": painting,
        "updates": len(drafts),
        "strokes": len(samples),
        "draft_ms": first.median * 1e3,
        "draft_p95_ms": first.p95 * 1e3,
        "median_ms": whole.median * 1e3,
        "p95_ms": whole.p95 * 1e3,
        "most_ms": max(samples) * 1e3,
        **{
            f"{name}_ms".replace(" ", "_"): float(mean) * 1e3
            for name, mean in zip(STAGES, means, strict=True)
        },
        "stall_ms": max(stalls, default=0.0) * 1e3,
        "stall_p95_ms": float(np.percentile(stalls or [0.0], 95)) * 1e3,
        "seconds": samples,
        "draft_seconds": drafts,
    }


def sketch_of(side: int, shapes: int) -> Sketch:
    """Return blobs in rows, a fourth of them in each layer of point features, and a winding river."""
    rng = np.random.default_rng(_SKETCH_SEED)
    layers = {name: np.zeros((side, side), np.uint8) for name in (*FEATURE_TYPES, "river")}
    columns = math.ceil(math.sqrt(shapes))
    cell = side / columns
    for number in range(shapes):
        row, column = divmod(number, columns)
        image = layers[FEATURE_TYPES[number % len(FEATURE_TYPES)]]
        _paint_blob(image, ((row + 0.5) * cell, (column + 0.5) * cell), _RADIUS_SHARE * cell, rng)
    across = np.arange(side)
    down = (side * (0.5 + 0.2 * np.sin(9.0 * across / side))).astype(int)
    for offset in range(-(side // 256), side // 256 + 1):
        layers["river"][np.clip(down + offset, 0, side - 1), across] = 1
    return Sketch(layers=layers)


def _paint_blob(image: UInt8Array, at: tuple[float, float], radius: float, rng: np.random.Generator) -> None:
    top, left = (max(int(middle - radius), 0) for middle in at)
    bottom, right = (math.ceil(middle + radius) + 1 for middle in at)
    window = image[top:bottom, left:right]
    down, across = np.ogrid[: window.shape[0], : window.shape[1]]
    down, across = down + top + 0.5 - at[0], across + left + 0.5 - at[1]
    angle = np.arctan2(down, across)
    outline = 0.7 + sum(depth * np.cos(k * angle + rng.uniform(0, 2 * math.pi)) for k, depth in _ROUGHNESS)
    window[down**2 + across**2 <= np.maximum(radius * outline, 0.8) ** 2] = 1


GOALS = (150.0, 600.0)
"""ms, within which 95 % of changes shall be shown first, and the final terrain be there."""
_STAGE_COLOURS = (GREY, BLUE, ORANGE, GREEN)


def draw_live(rows: Sequence[Row]) -> Any:
    """How many changes are there after a time; what the mean of it is made of."""
    figure = new_figure(10.0, 3.8, "Painting while the terrain follows")
    shares, parts = figure.subplots(1, 2)
    for row, colour in zip(rows, HUES, strict=False):
        for key, name, style in (("draft_seconds", "first shown", "--"), ("seconds", "final", "-")):
            ms = np.sort(samples_of(row, key)) * 1e3
            share = np.arange(1, len(ms) + 1) / len(ms) * 100.0
            shares.plot(ms, share, style, color=colour, linewidth=1.8, label=f"{row['painting']}, {name}")
    for goal in GOALS:
        shares.axvline(goal, color=INK, linewidth=0.9, linestyle=":")
    shares.axhline(95.0, color=INK, linewidth=0.9, linestyle=":")
    shares.set(xlim=(0, None), ylim=(0, 101), xlabel="ms from the stroke to its heights in the view's tiles")
    shares.set(ylabel="%", title="There after")
    shares.legend(loc="lower right")
    names = [str(row["painting"]) for row in rows]
    left = np.zeros(len(rows))
    for stage, colour in zip(STAGES, _STAGE_COLOURS, strict=True):
        widths = np.array([value_of(row, f"{stage}_ms".replace(" ", "_")) for row in rows])
        parts.barh(names, widths, left=left, color=colour, height=0.5, label=stage)
        left = left + widths
    parts.invert_yaxis()
    parts.set(xlabel="ms, mean", title="Where the time goes")
    parts.legend(ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.18), fontsize=8)
    return figure


_PANELS = (
    BarPanel(
        "There after",
        "s",
        {"first frame": "first_s", "still": "still_s", "still after a turn": "turned_s"},
        asked=(3.0, 8.0, 4.0),
    ),
    BarPanel(
        "A turn while it refines", "ms", {"median": "answer_ms", "most": "answer_most_ms"}, asked=(50.0,)
    ),
)
draw_views = partial(draw_bars, "The view from start to still", _PANELS, ("preset",))
"""Draw the times until views are there and still, and those of motion meanwhile."""
