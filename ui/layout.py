"""Layout of the window: dock panels, maximised parts and full screen."""

from collections.abc import Iterable, Mapping
from functools import partial
from itertools import islice, pairwise
from typing import Final, cast

from PyQt6.QtCore import QByteArray, QEvent, QObject, QSize, Qt
from PyQt6.QtGui import QKeyEvent, QScreen
from PyQt6.QtWidgets import (
    QAbstractButton,
    QAbstractSpinBox,
    QApplication,
    QDockWidget,
    QLineEdit,
    QMainWindow,
    QMenu,
    QToolBar,
    QWidget,
)

from sketchterrain.ui.actions import Actions
from sketchterrain.ui.look.theme import described
from sketchterrain.ui.models.background import single_shot


class Dock(QDockWidget):
    """A dock panel; it has no title bar where a tab shows its title."""

    def __init__(self, name: str, title: str, content: QWidget, parent: QWidget) -> None:
        super().__init__(title, parent)
        self.setObjectName(f"dock-{name}")
        self.setWidget(content)
        self._no_title = QWidget(self)
        self._no_title.hide()
        for name, verb in (("close", "Close"), ("float", "Float or dock")):
            button = self.findChild(QAbstractButton, f"qt_dockwidget_{name}button")
            described(button, f"{verb} {title}", f"{verb} {title}").setFocusPolicy(Qt.FocusPolicy.TabFocus)

    def show_title(self, is_shown: bool) -> None:
        """Show the title bar, or none."""
        bar = None if is_shown else self._no_title
        if self.titleBarWidget() is not bar:
            self.setTitleBarWidget(bar)


_VERSION = 2  # of the set of panels: layouts of other versions are not restored


PANELS: Final = {
    "layers": ("Layers", "left"),
    "properties": ("Properties", "left below"),
    "world": ("World", "left below"),
    "base": ("Base", "left below"),
    "light": ("Light", "left below"),
    "view": ("3-D view", "right"),
    "history": ("History", "right below"),
    "adherence": ("Adherence", "right below"),
    "contradictions": ("Contradictions", "right below"),
    "bookmarks": ("Bookmarks", "right below"),
}
"""Title and initial group of tabs of each panel, in the order of their tabs."""
_LEFT_WIDTH = 300  # px
_BOTTOM_HEIGHT = 190


class PanelLayout(QObject):
    """Arranges the panels of a window."""

    def __init__(self, window: QMainWindow, contents: Mapping[str, QWidget]) -> None:
        super().__init__(window)
        self._window = window
        self.maximised = ""  # ``canvas``, ``view`` or, usually, empty
        self._previous: QByteArray | None = None  # state before a part was maximised
        self.docks = {name: Dock(name, title, contents[name], window) for name, (title, _) in PANELS.items()}
        for corner in (Qt.Corner.TopLeftCorner, Qt.Corner.BottomLeftCorner):
            window.setCorner(corner, Qt.DockWidgetArea.LeftDockWidgetArea)
        for corner in (Qt.Corner.TopRightCorner, Qt.Corner.BottomRightCorner):
            window.setCorner(corner, Qt.DockWidgetArea.RightDockWidgetArea)
        self._titles = single_shot(self, 0, self._update_titles)
        for dock in self.docks.values():
            for signal in (dock.dockLocationChanged, dock.topLevelChanged, dock.visibilityChanged):
                signal.connect(self._update_titles_later)
        self.reset()

    def add_toggles(self, menu: QMenu) -> None:
        """Add an action for each panel's visibility to a menu."""
        for dock in self.docks.values():
            action = dock.toggleViewAction()
            if action is not None:
                action.setStatusTip(f"Show the panel {dock.windowTitle()}")
                menu.addAction(action)

    def show_panel(self, name: str) -> None:
        """Show a panel before the others of its group."""
        self.docks[name].show()
        self.docks[name].raise_()

    def reset(self) -> None:
        """Restore the initial arrangement of panels and bars."""
        self.maximise("")
        for bar in self._window.findChildren(QToolBar):
            bar.show()
        groups: dict[str, list[Dock]] = {}
        for name, dock in self.docks.items():
            dock.setFloating(False)
            self._window.removeDockWidget(dock)
            groups.setdefault(PANELS[name][1], []).append(dock)
        areas = Qt.DockWidgetArea
        for area, side in ((areas.LeftDockWidgetArea, "left"), (areas.RightDockWidgetArea, "right")):
            first, below = groups[side][0], groups[f"{side} below"]
            self._window.addDockWidget(area, first)
            self._window.splitDockWidget(first, below[0], Qt.Orientation.Vertical)
            for earlier, dock in pairwise(below):
                self._window.tabifyDockWidget(earlier, dock)
            for dock in (first, *below):
                dock.show()
            below[0].raise_()
        self.set_default_sizes()

    def set_default_sizes(self) -> None:
        """Give the panels their default sizes in the window's current size."""
        width, height = self._window.width(), self._window.height()
        across, down = Qt.Orientation.Horizontal, Qt.Orientation.Vertical
        layers, properties, view, history = (
            self.docks[name] for name in ("layers", "properties", "view", "history")
        )
        self._window.resizeDocks([layers, view], [_LEFT_WIDTH, (width - _LEFT_WIDTH) // 2], across)
        self._window.resizeDocks([layers, properties], [height * 2 // 5, height * 3 // 5], down)
        self._window.resizeDocks([view, history], [height - _BOTTOM_HEIGHT, _BOTTOM_HEIGHT], down)

    def maximise(self, part: str) -> None:
        """Show only ``canvas`` or ``view``; restore everything for an empty name."""
        canvas = self._window.centralWidget()
        if part == self.maximised or canvas is None:
            return
        if self._previous is None:
            self._previous = self._window.saveState(_VERSION)
        if part:
            for name, dock in self.docks.items():
                dock.setVisible(name == part)
            if part == "view":
                self.docks["view"].setFloating(False)
            canvas.setVisible(part == "canvas")
        else:
            canvas.show()
            self._window.restoreState(self._previous, _VERSION)
            self._previous = None
        self.maximised = part
        (canvas if part != "view" else self.docks["view"].widget() or canvas).setFocus()

    def state(self) -> QByteArray:
        """Return the arrangement without a maximised part."""
        return self._window.saveState(_VERSION) if self._previous is None else self._previous

    def restore(self, state: QByteArray) -> bool:
        """Restore an arrangement; return False if it is of another version."""
        self._titles.start()
        return self._window.restoreState(state, _VERSION)

    def _update_titles_later(self, *_: object) -> None:
        self._titles.start()

    def _update_titles(self) -> None:
        for dock in self.docks.values():
            dock.show_title(dock.isFloating() or not self._window.tabifiedDockWidgets(dock))


_PARTS: Final = ("canvas", "view")
_FIELDS: Final = QLineEdit, QAbstractSpinBox


class PaneFocus(QObject):
    """Keeps the keyboard focus on the pane under the pointer, but on a field in a dock while it is edited.

    Enter in a field, or hiding it, returns the focus to the pane under the pointer, else the last one.
    """

    def __init__(self, window: QMainWindow, panes: Iterable[QWidget], docks: Iterable[QDockWidget]) -> None:
        super().__init__(window)
        self._panes, self._docks = list(panes), tuple(docks)  # the last pane is the first
        for widget in (*self._panes, *self._docks):
            widget.installEventFilter(self)
        for dock in self._docks:
            dock.visibilityChanged.connect(self.leave_field)
        cast(QApplication, QApplication.instance()).focusChanged.connect(self._follow)
        self._panes[0].setFocus()

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        kind, kinds, active = event and event.type(), QEvent.Type, QApplication.activeWindow()
        if isinstance(event, QKeyEvent) and kind == kinds.KeyPress and watched in self._docks:
            if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
                self.leave_field()
        elif kind == kinds.TabletPress or (kind == kinds.Enter and active in (self.parent(), *self._docks)):
            is_edited = kind == kinds.Enter and isinstance(QApplication.focusWidget(), _FIELDS)
            self._focus(pane for pane in self._panes if pane is watched and not is_edited)
        return False

    def leave_field(self, *_: object) -> None:
        """Return the focus from a field in a dock, or from what is hidden there, to a pane."""
        focus = QApplication.focusWidget()
        if focus is not None and (isinstance(focus, _FIELDS) or focus.visibleRegion().isEmpty()):
            self._return_from(focus)

    def _follow(self, old: QWidget | None, new: QWidget | None) -> None:
        """Record the last pane; Qt gives the focus of a hidden or disabled widget to the next one."""
        if new in self._panes:
            self._panes.sort(key=lambda pane: pane is not new)
        elif old is not None and not (old.isVisible() and old.isEnabled()):
            self._return_from(old)

    def _return_from(self, widget: QWidget) -> None:
        if any(dock.isAncestorOf(widget) for dock in self._docks):
            panes = sorted(self._panes, key=lambda pane: not pane.underMouse())
            self._focus(pane for pane in panes if not pane.visibleRegion().isEmpty())

    def _focus(self, panes: Iterable[QWidget]) -> None:
        """Focus the first of some panes, also in a window that floats."""
        for pane in islice(panes, 1):
            pane.setFocus()
            if QApplication.activeWindow() not in (None, pane.window()):
                pane.activateWindow()


class FullScreenActions(QObject):
    """Binds the actions for full screen and maximised parts, and shows their state."""

    def __init__(self, window: QMainWindow, actions: Actions, layout: PanelLayout | None = None) -> None:
        super().__init__(window)
        self._window, self._actions, self._layout = window, actions, layout
        self._was_maximised = False
        actions.bind({"leave": self.leave})
        actions.bind_checked({"full-screen": self.set_full_screen})
        if layout is not None:
            actions.bind({"reset-layout": self._reset})
            actions.bind_checked({f"{part}-only": partial(self._maximise, part) for part in _PARTS})
        self._refresh()

    def set_full_screen(self, on: bool) -> None:
        """Use the whole screen, or return to the window's previous state."""
        if on:
            self._was_maximised = self._window.isMaximized()
            self._window.showFullScreen()
        elif self._was_maximised:
            self._window.showMaximized()
        else:
            self._window.showNormal()
        self._refresh()

    def leave(self) -> None:
        """Leave the maximised part, else full screen."""
        if self._layout is not None and self._layout.maximised:
            self._maximise("", False)
        else:
            self.set_full_screen(False)

    def _maximise(self, part: str, on: bool) -> None:
        if self._layout is not None:
            self._layout.maximise(part if on else "")
            self._refresh()

    def _reset(self) -> None:
        if self._layout is not None:
            self._layout.reset()
            self._refresh()

    def _refresh(self) -> None:
        maximised, actions = "", self._actions
        if self._layout is not None:
            maximised = self._layout.maximised
            for part in _PARTS:
                actions[f"{part}-only"].setChecked(maximised == part)
        actions["full-screen"].setChecked(self._window.isFullScreen())
        # Otherwise Esc stays available to tools.
        actions["leave"].setEnabled(bool(maximised) or self._window.isFullScreen())


def fitting_size(size: QSize, screen: QScreen | None) -> QSize:
    """Return a window size reduced to fit a screen."""
    if screen is None:
        return size
    room = screen.availableSize()
    return QSize(min(size.width(), room.width() * 24 // 25), min(size.height(), room.height() * 23 // 25))
