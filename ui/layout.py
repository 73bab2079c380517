"""Layout of the window: docks around the sketch, one part alone, the whole screen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from PyQt6.QtCore import QByteArray, QObject, QSize, Qt, QTimer
from PyQt6.QtGui import QScreen
from PyQt6.QtWidgets import (
    QDockWidget,
    QHBoxLayout,
    QLabel,
    QMainWindow,
    QMenu,
    QSizePolicy,
    QToolBar,
    QToolButton,
    QWidget,
)

from sketchterrain.ui.actions import Actions
from sketchterrain.ui.look.icons import tool_button
from sketchterrain.ui.look.theme import SMALL, SPACING


class Dock(QDockWidget):
    """A panel at the side of a window."""

    def __init__(self, name: str, title: str, content: QWidget, parent: QWidget) -> None:
        super().__init__(title, parent)
        self.setObjectName(f"dock-{name}")
        self.name = name
        self.setWidget(content)
        self.setFeatures(
            QDockWidget.DockWidgetFeature.DockWidgetMovable
            | QDockWidget.DockWidgetFeature.DockWidgetFloatable
            | QDockWidget.DockWidgetFeature.DockWidgetClosable
        )
        self._title = _Title(self)
        self.setTitleBarWidget(self._title)
        self.topLevelChanged.connect(self._title.show_state)

    def bring_up(self) -> None:
        """Show it, before others of its tabs."""
        self.show()
        self.raise_()

    def show_title(self, shown: bool) -> None:
        """Have a title above it, or leave that to its tab."""
        self._title.show_all(shown)


class _Title(QWidget):
    """The title and two buttons. Presses beside these are the dock's: it is dragged by them."""

    def __init__(self, dock: Dock) -> None:
        super().__init__(dock)
        self._dock = dock
        row = QHBoxLayout(self)
        row.setContentsMargins(SPACING, SMALL, SMALL, 0)
        row.setSpacing(0)
        name = QLabel(dock.windowTitle())
        font = name.font()
        font.setBold(True)
        name.setFont(font)
        row.addWidget(name)
        row.addStretch(1)
        self._float = _button("float", f"Float {dock.windowTitle()}")
        self._float.clicked.connect(self._float_or_dock)
        close = _button("close", f"Close {dock.windowTitle()}")
        close.clicked.connect(dock.close)
        row.addWidget(self._float)
        row.addWidget(close)
        self._parts = (name, self._float, close)
        self._shown = True
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)

    def _float_or_dock(self) -> None:
        self._dock.setFloating(not self._dock.isFloating())

    def show_state(self, floats: bool) -> None:
        """Say what the button does now."""
        what = "Dock" if floats else "Float"
        self._float.setToolTip(f"{what} {self._dock.windowTitle()}")

    def show_all(self, shown: bool) -> None:
        if shown != self._shown:
            self._shown = shown
            for part in self._parts:
                part.setVisible(shown)
            self.updateGeometry()

    def sizeHint(self) -> QSize:
        return super().sizeHint() if self._shown else QSize(60, 0)

    def minimumSizeHint(self) -> QSize:
        # A long title must not keep a narrow panel from being narrow.
        return QSize(60, super().minimumSizeHint().height() if self._shown else 0)


def _button(name: str, title: str) -> QToolButton:
    button = tool_button(name, title, side=12)
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    button.setAutoRaise(True)
    return button


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
    """The panels of a window."""

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
        """Give the window to one part."""
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


_ALONE: Final = ("canvas", "view")


class FullViews(QObject):
    """Binds the actions that make something large, and shows which of them is on."""

    def __init__(self, window: QMainWindow, actions: Actions, layout: Layout | None = None) -> None:
        super().__init__(window)
        self._window, self._actions, self._layout = window, actions, layout
        self._was_maximised = False
        actions.bind({"leave": self.leave})
        actions.bind_checked({"full-screen": self.fill_screen})
        if layout is not None:
            actions.bind({"reset-layout": self._reset})
            actions.bind_checked({f"{part}-only": partial(self._show_alone, part) for part in _ALONE})
        self._refresh()

    def fill_screen(self, on: bool) -> None:
        """Use the whole screen, or go back to how the window was."""
        if on:
            self._was_maximised = self._window.isMaximized()
            self._window.showFullScreen()
        elif self._was_maximised:
            self._window.showMaximized()
        else:
            self._window.showNormal()
        self._refresh()

    def leave(self) -> None:
        """Go back by one step."""
        if self._layout is not None and self._layout.alone:
            self._show_alone("", False)
        else:
            self.fill_screen(False)

    def _show_alone(self, part: str, on: bool) -> None:
        if self._layout is not None:
            self._layout.show_alone(part if on else "")
            self._refresh()

    def _reset(self) -> None:
        if self._layout is not None:
            self._layout.reset()
            self._refresh()

    def _refresh(self) -> None:
        alone, actions = "", self._actions
        if self._layout is not None:
            alone = self._layout.alone
            for part in _ALONE:
                actions[f"{part}-only"].setChecked(alone == part)
        actions["full-screen"].setChecked(self._window.isFullScreen())
        # Esc is others' as long as there is nothing to leave.
        actions["leave"].setEnabled(bool(alone) or self._window.isFullScreen())


def fitting_size(size: QSize, screen: QScreen | None) -> QSize:
    """Return a size that a screen has room for."""
    if screen is None:
        return size
    room = screen.availableSize()
    return QSize(min(size.width(), room.width() * 24 // 25), min(size.height(), room.height() * 23 // 25))
