"""Where the parts of the window stand: the sketch in the middle, panels left, the 3-D view right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QObject, Qt, QTimer
from PyQt6.QtWidgets import QToolBar

from sketchterrain.ui.dock import Dock

if TYPE_CHECKING:
    from collections.abc import Mapping

    from PyQt6.QtCore import QByteArray
    from PyQt6.QtWidgets import QMainWindow, QMenu, QWidget

__all__ = ["PARTS", "Layout", "Part"]

_VERSION = 1  # of the panels that there are: a layout of others is not restored


@dataclass(frozen=True)
class Part:
    """One panel: its title, and which group of tabs it stands in at first."""

    title: str
    group: str


PARTS: Final = {
    "layers": Part("Layers", "left"),
    "properties": Part("Properties", "left below"),
    "world": Part("World", "left below"),
    "light": Part("Light", "left below"),
    "view": Part("3-D view", "right"),
    "history": Part("History", "right below"),
    "adherence": Part("Adherence", "right below"),
    "contradictions": Part("Contradictions", "right below"),
    "bookmarks": Part("Bookmarks", "right below"),
}
"""All panels by name, in the order of their tabs."""
_LEFT = 300  # px
_BELOW = 190


class Layout(QObject):
    """The panels of a window.

    Parameters
    ----------
    window
    contents
        A widget for each of `PARTS`.
    """

    def __init__(self, window: QMainWindow, contents: Mapping[str, QWidget]) -> None:
        super().__init__(window)
        self._window = window
        self._alone = ""
        self._before: QByteArray | None = None
        self.docks = {name: Dock(name, part.title, contents[name], window) for name, part in PARTS.items()}
        for corner in (Qt.Corner.TopLeftCorner, Qt.Corner.BottomLeftCorner):
            window.setCorner(corner, Qt.DockWidgetArea.LeftDockWidgetArea)
        for corner in (Qt.Corner.TopRightCorner, Qt.Corner.BottomRightCorner):
            window.setCorner(corner, Qt.DockWidgetArea.RightDockWidgetArea)
        self._titles = QTimer(self)
        self._titles.setSingleShot(True)
        self._titles.setInterval(0)
        self._titles.timeout.connect(self._show_titles)
        for dock in self.docks.values():
            dock.dockLocationChanged.connect(self._look_soon)
            dock.topLevelChanged.connect(self._look_soon)
            dock.visibilityChanged.connect(self._look_soon)
        self.reset()

    @property
    def alone(self) -> str:
        """What has the window for itself: ``canvas``, ``view`` or, as usual, nothing."""
        return self._alone

    def add_toggles(self, menu: QMenu) -> None:
        """Put a switch for each panel into a menu."""
        for dock in self.docks.values():
            action = dock.toggleViewAction()
            if action is not None:
                action.setStatusTip(f"Show the panel {dock.windowTitle()}")
                menu.addAction(action)

    def reset(self) -> None:
        """Put all panels and bars where they are at first."""
        self.show_alone("")
        for bar in self._window.findChildren(QToolBar):
            bar.show()
        left, right = Qt.DockWidgetArea.LeftDockWidgetArea, Qt.DockWidgetArea.RightDockWidgetArea
        groups: dict[str, list[Dock]] = {}
        for name, dock in self.docks.items():
            dock.setFloating(False)
            self._window.removeDockWidget(dock)
            groups.setdefault(PARTS[name].group, []).append(dock)
        for area, above, below in ((left, "left", "left below"), (right, "right", "right below")):
            first = groups[above][0]
            self._window.addDockWidget(area, first)
            self._window.splitDockWidget(first, groups[below][0], Qt.Orientation.Vertical)
            for earlier, dock in zip(groups[below], groups[below][1:], strict=False):
                self._window.tabifyDockWidget(earlier, dock)
            for dock in (first, *groups[below]):
                dock.show()
            groups[below][0].raise_()
        self.share_out()

    def share_out(self) -> None:
        """Give the panels their usual sizes in the window as it is."""
        width, height = self._window.width(), self._window.height()
        across, down = Qt.Orientation.Horizontal, Qt.Orientation.Vertical
        layers, properties, view, history = (
            self.docks[name] for name in ("layers", "properties", "view", "history")
        )
        self._window.resizeDocks([layers, view], [_LEFT, (width - _LEFT) // 2], across)
        self._window.resizeDocks([layers, properties], [height * 2 // 5, height * 3 // 5], down)
        self._window.resizeDocks([view, history], [height - _BELOW, _BELOW], down)

    def show_alone(self, part: str) -> None:
        """Give the window to one part.

        Parameters
        ----------
        part
            ``canvas`` or ``view``; empty: show everything again, as it was.
        """
        if part == self._alone:
            return
        canvas = self._window.centralWidget()
        if canvas is None:
            return
        if self._before is None:
            self._before = self._window.saveState(_VERSION)
        if part:
            for name, dock in self.docks.items():
                dock.setVisible(name == part)
            if part == "view":
                self.docks["view"].setFloating(False)
            canvas.setVisible(part == "canvas")
        else:
            canvas.show()
            self._window.restoreState(self._before, _VERSION)
            self._before = None
        self._alone = part
        (canvas if part != "view" else self.docks["view"].widget() or canvas).setFocus()

    def state(self) -> QByteArray:
        """Return where everything stands when nothing has the window for itself."""
        return self._window.saveState(_VERSION) if self._before is None else self._before

    def restore(self, state: QByteArray) -> bool:
        """Put everything where it stood; False if that was another program's idea."""
        done = self._window.restoreState(state, _VERSION)
        self._titles.start()
        return done

    def _look_soon(self, *_: object) -> None:
        self._titles.start()

    def _show_titles(self) -> None:
        # What is a tab says its name there.
        for dock in self.docks.values():
            dock.show_title(dock.isFloating() or not self._window.tabifiedDockWidgets(dock))
