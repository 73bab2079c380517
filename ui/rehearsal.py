"""Someone who paints in the program's window, while it is watched how soon the terrain follows."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import DeviceError
from sketchterrain.ui.application import Garbage

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from PyQt6.QtCore import QCoreApplication

    from sketchterrain.sketch import Sketch
    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.engine.protocol import Followed, Trouble
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.window import MainWindow

__all__ = ["Painted", "Rehearsal"]

_SIZE: Final = (1600, 900)  # px of the window
_RATE: Final = 0.008  # s between two places of a mouse
_HEARTBEAT: Final = 5  # ms
_TIMEOUT: Final = 120.0  # s


@dataclass(frozen=True)
class Painted:
    """What was seen while a stroke was painted.

    Attributes
    ----------
    times : tuple of tuples
        For each sketch that went out: when it was made, when placing began and ended what was shown for it,
        when its recipe was sent, when the engine took it, when the view's tiles had its heights; s of the
        system's monotonic clock.
    stalls : tuple of float
        s that each beat of a timer in the window's event loop came too late.
    """

    times: tuple[tuple[float, ...], ...]
    stalls: tuple[float, ...]


class Rehearsal:
    """The program's window with its real processes, and a heart that beats in its event loop.

    Parameters
    ----------
    sketch
        To begin with.
    """

    def __init__(self, sketch: Sketch) -> None:
        from PyQt6.QtCore import Qt, QTimer

        from sketchterrain.ui.engine.link import EngineLink
        from sketchterrain.ui.models.document import Document

        self._application = _application()
        self._document: Document = Document(sketch)
        self._link: EngineLink = EngineLink(self._document)
        self._made: dict[int, float] = {}
        self._followed: list[Followed] = []
        self._troubles: list[Trouble] = []
        self._beats: list[float] = []
        self._link.sent.connect(self._made.__setitem__)
        self._link.followed.connect(self._followed.append)
        self._link.trouble.connect(self._troubles.append)
        self._heart = QTimer()
        self._heart.setTimerType(Qt.TimerType.PreciseTimer)
        self._heart.timeout.connect(self._beat)
        self._folder = TemporaryDirectory(prefix="sketchterrain-rehearsal-")
        self._window = _window(self._document, self._link, Path(self._folder.name))
        self._window.resize(*_SIZE)
        self._window.show()
        self._link.start()
        self._wait(lambda: self._link.frame is not None)
        self._garbage = Garbage()

    def end(self) -> None:
        """Close the window and end the processes."""
        self._heart.stop()
        self._garbage.end()
        self._link.stop()
        self._document.saved(self._document.sketch, Path(self._folder.name))  # or it would ask
        self._window.close()
        self._window.deleteLater()
        self._application.processEvents()
        self._folder.cleanup()

    def paint(self, layer: str, label: int, path: Sequence[tuple[float, float]], radius: float) -> Painted:
        """Paint a stroke at a mouse's rate, wait until the terrain is there, and undo it.

        Parameters
        ----------
        layer, label
            With what; label 0 erases.
        path
            Places of the mouse (px of the sketch, right and down).
        radius
            Of the brush, px.

        Raises
        ------
        DeviceError
            If the terrain does not follow.
        """
        from sketchterrain.ui.painting.stroke import Stroke

        for watched in (self._made, self._followed, self._beats):
            watched.clear()
        draft = self._document.begin_draft(layer)
        stroke = Stroke(draft.image, label)
        self._heart.start(_HEARTBEAT)
        for number, (x, y) in enumerate(path):
            began = time.monotonic()
            boxes = [stroke.to(x, y, radius)]
            boxes += [stroke.finish()] if number == len(path) - 1 else []
            for box in boxes:
                if box is not None:
                    draft.touch(box)
            self._pause(began + _RATE)
        draft.commit(f"Paint {layer}")
        self._heart.stop()
        stalls = np.diff(self._beats) - _HEARTBEAT * 1e-3
        self._wait(self._is_there)
        seen = Painted(self._times(), tuple(stalls.tolist()))
        self._document.undo()
        self._wait(self._is_there)
        return seen

    def _beat(self) -> None:
        self._beats.append(time.monotonic())

    def _times(self) -> tuple[tuple[float, ...], ...]:
        versions = np.array([each.version for each in self._followed])
        found: list[tuple[float, ...]] = []
        for version, made in sorted(self._made.items()):
            shown = self._followed[int(np.searchsorted(versions, version))]
            found.append((made, shown.begun, shown.placed, shown.ready, shown.received, shown.shown))
        return tuple(found)

    def _is_there(self) -> bool:
        newest = max(self._made, default=-1)
        return not self._made or any(each.version >= newest for each in self._followed)

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
