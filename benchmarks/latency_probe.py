"""Latency of the desktop program: strokes painted in its window, and when the view's terrain follows."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import DeviceError
from sketchterrain.ui.app import new_window
from sketchterrain.ui.models.painting import Stroke

if TYPE_CHECKING:
    from PyQt6.QtCore import QCoreApplication

    from sketchterrain.ui.engine.protocol import ErrorReport, TerrainUpdated

_RATE, _TIMEOUT, _HEARTBEAT = 0.008, 120.0, 5  # s between places of the mouse, s to wait, ms


class Painted(NamedTuple):
    """Times of one stroke: a row for each sketch that was sent, and how late the event loop was."""

    # s of the monotonic clock: sketch made, placing begun and ended, recipe sent, received, tiles written
    times: tuple[tuple[float, ...], ...]
    stalls: tuple[float, ...]  # s that each beat of a timer in the event loop came too late


@cache
def _application() -> QCoreApplication:
    """Return Qt's application, kept to the end: all Qt objects would be deleted with it."""
    from PyQt6.QtWidgets import QApplication

    return QApplication.instance() or QApplication([])


class LatencyProbe:
    """The program's window with its real processes, and a heartbeat in its event loop."""

    def __init__(self, sketch: Sketch) -> None:
        if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
        from PyQt6.QtCore import Qt, QTimer

        from sketchterrain.ui.application import GarbageCollection
        from sketchterrain.ui.engine.link import EngineLink
        from sketchterrain.ui.models.document import Document
        from sketchterrain.ui.models.preferences import Preferences

        self._application = _application()
        self._document = Document(sketch)
        self._link = EngineLink(self._document)
        self._made: dict[int, float] = {}
        self._followed: list[TerrainUpdated] = []
        self._troubles: list[ErrorReport] = []
        self._beats: list[float] = []
        self._link.sent.connect(self._made.__setitem__)
        self._link.terrain_updated.connect(self._followed.append)
        self._link.error_reported.connect(self._troubles.append)
        self._heart = QTimer(timerType=Qt.TimerType.PreciseTimer)  # type: ignore[call-arg] # a property
        self._heart.timeout.connect(lambda: self._beats.append(time.monotonic()))
        self._folder = TemporaryDirectory(prefix="sketchterrain-latency-")
        folder = Path(self._folder.name)
        self._window = new_window(self._document, self._link, Preferences(folder / "desktop.ini"), folder)
        self._window.resize(1600, 900)
        self._window.show()
        self._link.start()
        self._wait(lambda: self._link.frame is not None)
        self._garbage = GarbageCollection()

    def end(self) -> None:
        """Close the window and end the processes."""
        self._garbage.stop()
        self._link.stop()
        self._document.mark_saved(self._document.sketch, Path(self._folder.name))  # or it would ask
        self._window.close()
        self._window.deleteLater()
        self._application.processEvents()
        self._folder.cleanup()

    def paint(self, layer: str, label: int, path: Sequence[tuple[float, float]], radius: float) -> Painted:
        """Paint a stroke (px of the sketch) at a mouse's rate, wait for the terrain, and undo it."""
        for watched in (self._made, self._followed, self._beats):
            watched.clear()
        draft = self._document.begin_draft(layer)
        stroke = Stroke(draft.image, label)
        self._heart.start(_HEARTBEAT)
        for x, y in path:
            began = time.monotonic()
            if (box := stroke.to(x, y, radius)) is not None:
                draft.touch(box)
            self._pause(began + _RATE)
        if (box := stroke.finish()) is not None:
            draft.touch(box)
        draft.commit(f"Paint {layer}")
        self._heart.stop()
        stalls = np.diff(self._beats) - _HEARTBEAT * 1e-3
        self._wait(self._is_there)
        times = []
        for version, made in sorted(self._made.items()):
            at = next(each for each in self._followed if each.version >= version)
            times.append((made, at.started, at.placed, at.sent, at.received, at.displayed))
        self._document.undo()
        self._wait(self._is_there)
        return Painted(tuple(times), tuple(stalls.tolist()))

    def _is_there(self) -> bool:
        return all(any(each.version >= version for each in self._followed) for version in self._made)

    def _pause(self, until: float) -> None:
        while (left := until - time.monotonic()) > 0.0:
            self._application.processEvents()
            time.sleep(min(left, 0.001))
        self._application.processEvents()

    def _wait(self, until: Callable[[], bool]) -> None:
        end = time.monotonic() + _TIMEOUT
        self._pause(time.monotonic() + 0.02)  # so that what was painted last is on its way
        while not until():
            if self._troubles or time.monotonic() > end:
                lines = "; ".join(each.line for each in self._troubles) or "no answer"
                raise DeviceError(f"the terrain does not follow what is painted: {lines}")
            self._pause(time.monotonic() + 0.002)
