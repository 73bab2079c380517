"""While one paints: from a stroke to the changed terrain in the view, and whether the window stalls."""

from __future__ import annotations

import os
import time
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.sketch_scaling import sketch_of
from sketchterrain.benchmarks.timing import spread
from sketchterrain.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Callable

    from PyQt6.QtCore import QCoreApplication

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext
    from sketchterrain.sketch import Sketch
    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.engine.plan import Followed
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.window import MainWindow

__all__ = ["SEED", "STAGES", "measure"]

SEED: Final = 11
STAGES: Final = ("waiting", "placing", "areas", "handing over", "tiles")
_SIDE, _BLOBS = 512, 18
_WINDOW: Final = (1600, 900)
_RATE: Final = 0.008
"""s between two places of a mouse."""
_HEARTBEAT: Final = 5
"""ms."""
_LAYERS: Final = ("mountain", "hill", "dune", "forest", "river", "lake")
_TIMEOUT: Final = 120.0

_COLUMNS = (
    Column("painting", "painting"),
    Column("updates", "sketches"),
    Column("median_ms", "median, ms"),
    Column("p95_ms", "95 %, ms"),
    Column("most_ms", "most, ms"),
    *(Column(f"{stage}_ms".replace(" ", "_"), f"{stage}, ms") for stage in STAGES),
    Column("stall_ms", "longest stall, ms"),
    Column("stall_p95_ms", "95 % of stalls, ms"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Milliseconds from a stroke to changed terrain, and the window's longest stall, by the clock.

    A sketch of 512 px with 20 shapes (18 blobs, a lake, a river) in the program's own window, with the real
    processes behind it on the device that they choose. Two ways of painting, in turns through six layers,
    radii from 8 to 40 px: `strokes` of 60 to 120 places 8 ms apart, as a mouse tells them; `dabs`, each after
    the one before is there; each is undone after. The time begins when the window makes the sketch that it
    sends, and ends when the view's tiles hold the heights of that sketch or a newer one; drawing them comes
    after. It is made of `waiting` (for what is being placed; on its way), `placing`, `areas` (what changed,
    and packing it), `handing over` (the engine ends a frame that it draws) and `tiles`: their means. A stall
    is how much later than 5 ms after the one before the window's event loop gets to a timer, while one
    paints.
    """
    del context  # the processes open devices of their own
    work = _Painting(sketch_with_twenty_shapes())
    try:
        rows = [work.row("strokes", effort.live_strokes), work.row("dabs", effort.live_dabs)]
    finally:
        work.end()
    return Outcome((Table(f"From a stroke to changed terrain, seed {SEED}", _COLUMNS, tuple(rows)),))


def sketch_with_twenty_shapes() -> Sketch:
    """Eighteen blobs in four layers, a lake and a winding river on 512 px."""
    sketch = sketch_of(_SIDE, _BLOBS)
    lake = np.zeros((_SIDE, _SIDE), np.uint8)
    down, across = np.ogrid[:_SIDE, :_SIDE]
    lake[(down - 0.86 * _SIDE) ** 2 + 0.5 * (across - 0.62 * _SIDE) ** 2 < (0.06 * _SIDE) ** 2] = 1
    return sketch.replace(layers={**sketch.layers, "lake": lake})


class _Painting:
    """A document in the program's window, and a heart that beats in the event loop."""

    def __init__(self, sketch: Sketch) -> None:
        from PyQt6.QtCore import Qt, QTimer

        from sketchterrain.ui.engine.link import EngineLink
        from sketchterrain.ui.models.document import Document

        self._application = _application()
        self._document: Document = Document(sketch)
        self._link: EngineLink = EngineLink(self._document)
        self._rng = np.random.default_rng(SEED)
        self._made: dict[int, float] = {}
        self._followed: list[Followed] = []
        self._beats: list[float] = []
        self._link.sent.connect(self._made.__setitem__)
        self._link.followed.connect(self._followed.append)
        self._troubles: list[Any] = []
        self._link.trouble.connect(self._troubles.append)
        self._heart = QTimer()
        self._heart.setTimerType(Qt.TimerType.PreciseTimer)
        self._heart.timeout.connect(lambda: self._beats.append(time.monotonic()))
        self._folder = TemporaryDirectory(prefix="sketchterrain-live-")
        self._window = _window(self._document, self._link, Path(self._folder.name))
        self._window.resize(*_WINDOW)
        self._window.show()
        self._link.start()
        self._wait(lambda: self._link.frame is not None)
        for layer in _LAYERS:  # what is made once is made before
            self._stroke(layer, places=1)
            self._wait(self._is_there)

    def end(self) -> None:
        """End the processes."""
        self._heart.stop()
        self._link.stop()
        self._document.saved(self._document.sketch, Path(self._folder.name))  # or it would ask
        self._window.close()
        self._window.deleteLater()
        self._application.processEvents()
        self._folder.cleanup()

    def row(self, painting: str, count: int) -> Row:
        """Paint so many strokes or dabs, and return what was found."""
        samples: list[tuple[float, ...]] = []
        stalls: list[float] = []
        for number in range(count):
            self._made.clear()
            self._followed.clear()
            self._beats.clear()
            self._heart.start(_HEARTBEAT)
            places = int(self._rng.integers(60, 121)) if painting == "strokes" else 1
            self._stroke(_LAYERS[number % len(_LAYERS)], places=places)
            self._heart.stop()
            stalls += (np.diff(self._beats) - _HEARTBEAT * 1e-3).tolist()
            self._wait(self._is_there)
            samples += self._times()
            self._document.undo()  # every stroke meets the same sketch
            self._wait(self._is_there)
        return _found(painting, samples, stalls)

    def _times(self) -> list[tuple[float, ...]]:
        """Return when each sketch was made, and when the first shown that has it went through each stage."""
        versions = np.array([each.version for each in self._followed])
        found: list[tuple[float, ...]] = []
        for version, made in sorted(self._made.items()):
            shown = self._followed[int(np.searchsorted(versions, version))]
            found.append((made, shown.begun, shown.placed, shown.ready, shown.received, shown.shown))
        return found

    def _stroke(self, layer: str, *, places: int) -> None:
        from sketchterrain.ui.painting.stroke import Stroke

        at = self._rng.uniform(0.1, 0.9, 2) * _SIDE
        way = self._rng.normal(0.0, 2.5, 2)
        radius = float(self._rng.uniform(8.0, 40.0)) * (0.3 if layer == "river" else 1.0)
        draft = self._document.begin_draft(layer)
        stroke = Stroke(draft.image, int(self._rng.integers(0, 3) > 0))
        for number in range(places):
            began = time.monotonic()
            boxes = [stroke.to(float(at[0]), float(at[1]), radius)]
            boxes += [stroke.finish()] if number == places - 1 else []
            for box in boxes:
                if box is not None:
                    draft.touch(box)
            way += self._rng.normal(0.0, 0.6, 2)
            at += np.clip(way, -6.0, 6.0)
            self._pause(began + _RATE)
        draft.commit(f"Paint {layer}")

    def _is_there(self) -> bool:
        return (
            bool(self._made) and self._followed[-1:] != [] and self._followed[-1].version >= max(self._made)
        )

    def _pause(self, until: float) -> None:
        from PyQt6.QtCore import QEventLoop

        while (left := until - time.monotonic()) > 0.0:
            self._application.processEvents(QEventLoop.ProcessEventsFlag.AllEvents)
            time.sleep(min(left, 0.001))
        self._application.processEvents()

    def _wait(self, until: Callable[[], bool]) -> None:
        end = time.monotonic() + _TIMEOUT
        self._pause(time.monotonic() + 0.02)  # so that what was painted last is on its way
        while not until():
            if self._troubles or time.monotonic() > end:
                lines = "; ".join(each.line for each in self._troubles)
                raise DeviceError(f"the terrain does not follow what is painted: {lines or 'no answer'}")
            self._pause(time.monotonic() + 0.002)


def _window(document: Document, link: EngineLink, folder: Path) -> MainWindow:
    """Return the program's window, which keeps what it keeps in a folder."""
    from sketchterrain.ui.models.bookmarks import Bookmarks
    from sketchterrain.ui.models.preferences import Preferences
    from sketchterrain.ui.models.recent import RecentFiles
    from sketchterrain.ui.models.saving import Saving
    from sketchterrain.ui.models.workspace import Workspace
    from sketchterrain.ui.window import MainWindow

    return MainWindow(
        document,
        Workspace(),
        link,
        preferences=Preferences(folder / "desktop.ini"),
        recent=RecentFiles(folder / "recent"),
        saving=Saving(document),
        bookmarks=Bookmarks(document, folder / "bookmarks"),
    )


@cache
def _application() -> QCoreApplication:
    """Return the program's Qt, without a screen unless there is one."""
    from PyQt6.QtWidgets import QApplication

    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    return QApplication.instance() or QApplication([])


def _found(painting: str, times: list[tuple[float, ...]], stalls: list[float]) -> Row:
    stages = np.diff(times, axis=1)
    samples = stages.sum(axis=1).tolist()
    whole, means = spread(samples), stages.mean(axis=0)
    return {
        "painting": painting,
        "updates": len(samples),
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
    }
