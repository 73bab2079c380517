"""Window of a written world, and the actions that both windows have on the view."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from PyQt6.QtCore import QObject, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QCloseEvent, QResizeEvent
from PyQt6.QtWidgets import QLabel, QMainWindow, QMenu

from sketchterrain.document.sketch import Sketch
from sketchterrain.ui import commands
from sketchterrain.ui.actions import CLIPBOARD_COMMANDS, Actions, add_menus
from sketchterrain.ui.banner import Banner, Message, PictureFile, ask_picture_path
from sketchterrain.ui.dialogs.form import run_dialog
from sketchterrain.ui.dialogs.help import KeysDialog
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.link import EngineLink, EngineProcesses, ViewSource
from sketchterrain.ui.layout import Dock, FullScreenActions, PaneFocus, fitting_size
from sketchterrain.ui.look.theme import app_icon
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.features import FEATURE_COMMANDS, SelectedFeature
from sketchterrain.ui.models.selection import delete, lock, reset, unlock
from sketchterrain.ui.models.workspace import OVERLAYS, TOOLS, Bookmarks, Selection, Workspace, state_folder
from sketchterrain.ui.panels.lists import BookmarksPanel
from sketchterrain.ui.view3d.camera import length_text
from sketchterrain.ui.view3d.view import View3D


class ViewActions(QObject):
    """Binds actions to a source's view and, for a sketch, to the workspace's overlays."""

    def __init__(self, actions: Actions, link: ViewSource, workspace: Workspace | None = None) -> None:
        super().__init__(actions)
        self._actions, self._link, self._workspace = actions, link, workspace
        actions.bind({f"mode-{mode}": partial(link.change_view, mode=mode) for mode in msg.MODES})
        actions.bind_checked({"play": lambda on: link.change_view(plays=on)})
        if workspace is not None:
            actions.bind({"measure": partial(self._measure, workspace)})
            actions.bind_checked(
                {f"overlay-{name}": partial(workspace.show_overlay, name) for name in OVERLAYS}
            )
            workspace.overlays_changed.connect(self.refresh)
        link.view_changed.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        if self._workspace is not None:
            for name in OVERLAYS:
                self._actions[f"overlay-{name}"].setChecked(name in self._workspace.overlays)
        self._actions[f"mode-{self._link.view.mode}"].setChecked(True)
        self._actions["play"].setChecked(self._link.view.plays)

    def _measure(self, workspace: Workspace) -> None:
        workspace.show_overlay("adherence", True)
        self._link.send(msg.MeasureAdherence())


_BRUSH_STEP = 1.25


class SketchActions(QObject):
    """Binds actions to commands on the sketch and updates their state."""

    def __init__(
        self, actions: Actions, document: Document, workspace: Workspace, link: EngineLink, banner: Banner
    ) -> None:
        super().__init__(actions)
        self._actions, self._banner = actions, banner
        self._document, self._workspace, self._link = document, workspace, link
        actions.bind(
            {
                "undo": document.undo,
                "redo": document.redo,
                **{
                    name: partial(self._apply_to_feature, command)
                    for name, command in {**FEATURE_COMMANDS, **CLIPBOARD_COMMANDS}.items()
                },
                "delete-selection": partial(self._apply, delete),
                "reset-selection": partial(self._apply, reset),
                "select-none": partial(setattr, workspace, "selection", None),
                "brush-smaller": partial(self._scale_brush, 1.0 / _BRUSH_STEP),
                "brush-larger": partial(self._scale_brush, _BRUSH_STEP),
                "random-seed": self.set_random_seed,
                **{f"tool-{name}": partial(setattr, workspace, "tool", name) for name in TOOLS},
            }
        )
        actions.bind_checked(
            {
                "lock-selection": lambda on: self._apply(lock if on else unlock),
                "show-layer": lambda on: workspace.set_look(workspace.layer, visible=on),
                "lock-layer": lambda on: workspace.set_look(workspace.layer, locked=on),
                "only-layer": lambda _: workspace.show_only(workspace.layer),
            }
        )
        for signal in (
            *(document.history_changed, document.sketch_changed, document.opened, link.placed_changed),
            *(workspace.tool_changed, workspace.label_changed, workspace.look_changed),
            workspace.selection_changed,
        ):
            signal.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        """Update texts, enabled and checked states."""
        actions, history, workspace = self._actions, self._document.history, self._workspace
        actions["undo"].setEnabled(history.position > 0)
        actions["redo"].setEnabled(history.position < len(history.titles) - 1)
        undone = history.titles[history.position] if history.position > 0 else ""
        redone = history.titles[history.position + 1] if actions["redo"].isEnabled() else ""
        actions["undo"].setText(f"&Undo {undone[:1].lower()}{undone[1:]}".rstrip())
        actions["redo"].setText(f"&Redo {redone[:1].lower()}{redone[1:]}".rstrip())
        actions[f"tool-{workspace.tool}"].setChecked(True)
        actions[f"layer-{workspace.layer}"].setChecked(True)
        look = workspace.look(workspace.layer)
        actions["show-layer"].setChecked(look.visible)
        actions["lock-layer"].setChecked(look.locked)
        actions["only-layer"].setChecked(workspace.is_alone(workspace.layer))
        self._refresh_selection()

    def set_random_seed(self) -> None:
        sketch = self._document.sketch
        seed = commands.random_seed(sketch.seed)
        change = partial(commands.set_setting, sketch, commands.WORLD, "seed", seed)
        self._try(lambda: self._document.do(f"Seed {seed}", change()))

    def _refresh_selection(self) -> None:
        selection, placed, sketch = self._workspace.selection, self._link.placed, self._document.sketch
        is_placed = can_lock = locked = edited = False
        if selection is not None and commands.exists(placed, selection):
            is_placed = True
            can_lock = commands.find_point(placed, selection) is not None
            locked = can_lock and commands.is_locked(sketch, selection)
            edited = commands.is_edited(sketch, placed, selection)
        is_feature = SelectedFeature.find(self._document, selection) is not None
        for name, enabled in (
            *((name, is_feature) for name in ("copy", *FEATURE_COMMANDS)),
            ("select-none", selection is not None),
            ("delete-selection", is_placed or is_feature),
            ("look-selection", is_placed or is_feature),
            ("lock-selection", can_lock),
            ("reset-selection", edited),
        ):
            self._actions[name].setEnabled(enabled)
        self._actions["lock-selection"].setChecked(locked)

    def _try(self, change: Callable[[], None]) -> None:
        with commands.reported(lambda line: self._banner.show_message(Message("warning", line, "command"))):
            change()

    def _apply_to_feature(self, command: Callable[[Document, Workspace], None]) -> None:
        self._try(lambda: command(self._document, self._workspace))

    def _apply(self, command: Callable[[Document, Workspace, msg.Placement, Selection], None]) -> None:
        selection, placed = self._workspace.selection, self._link.placed
        if selection is not None:
            self._try(lambda: command(self._document, self._workspace, placed, selection))
            self.refresh()

    def _scale_brush(self, factor: float) -> None:
        self._workspace.brush *= factor


_BOOKMARKS: Final = tuple(f"bookmark-{number}" for number in range(1, 10))
_ACTIONS: Final = (
    *("save-picture", "quit", "full-screen", "leave", "mode-orbit", "mode-fly", "mode-walk", "look-all"),
    *("look-best", "bookmark", *_BOOKMARKS, "play", "restart", "keys"),
)
"""Actions that need no sketch."""


class WorldLink(ViewSource):
    """Renders a stored world; reports errors of the ``engine``, the ``view`` or a part of the ``world``."""

    world_known = pyqtSignal(object)  # `WorldFacts`

    def __init__(self, path: Path, sketch: Sketch | None = None, *, device: str | None = None) -> None:
        super().__init__(msg.ViewState(mode="fly"))
        self.path, self.device = path, device
        self._sketch = sketch  # with draped layers, in viewing coordinates
        self.world: msg.WorldFacts | None = None
        self._routes[msg.WorldFacts] = ("world", self.world_known)

    def area(self) -> tuple[tuple[float, float, float, float], float] | None:
        """Return the world's rectangle (m) and the height of its centre; None until they are known."""
        return None if self.world is None else (self.world.bounds, self.world.middle)

    def start(self) -> None:
        self._run(EngineProcesses(device=self.device, world=self.path))
        if (sketch := self._sketch) is not None and sketch.drapes:
            self.send(msg.SetDrapes(sketch.drapes, sketch.frame, sketch.size, sketch.extent))
        if self.frame is None:
            self.send(msg.Look())


class WorldWindow(QMainWindow):
    """Shows a stored world; the engine process opens it and reports errors."""

    closed = pyqtSignal()

    def __init__(self, path: Path, sketch: Sketch | None = None, *, device: str | None = None) -> None:
        super().__init__()
        self.setWindowIcon(app_icon())
        self.setWindowTitle(path.name)
        self.setMinimumSize(480, 320)
        self.link, self._workspace = WorldLink(path, sketch, device=device), Workspace()
        document = Document()
        document.path = path  # of which the bookmarks are
        self.view = View3D(document, self._workspace, self.link)
        self.setCentralWidget(self.view)
        self._bookmarks = Bookmarks(document, state_folder() / "bookmarks")
        self._panel = BookmarksPanel(self.link, self._bookmarks)
        self._dock = Dock("bookmarks", "Bookmarks", self._panel, self)
        self.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, self._dock)
        self._dock.hide()
        self.actions_by_name = Actions(self, _ACTIONS)
        self._add_menus()
        self._position, self._extent = QLabel(), QLabel()
        status = self.statusBar()
        assert status is not None  # noqa: S101 # a QMainWindow creates one
        status.setSizeGripEnabled(False)
        status.addWidget(self._position, 1)
        status.addPermanentWidget(self._extent)
        self.banner = Banner(self, below=self.view.bar)
        self._picture_file = PictureFile(self.banner, self)
        self._missing_parts = 0
        self.link.world_known.connect(self._show_world)
        self.link.frame_shown.connect(self._show_position)
        self.link.error_reported.connect(self._report_error)
        self.view.picture_requested.connect(self.save_picture)
        self.resize(fitting_size(QSize(1180, 760), self.screen()))
        PaneFocus(self, (self.view,), (self._dock,))
        self.link.start()

    def _add_menus(self) -> None:
        actions, views = self.actions_by_name, QMenu("Go to &view", self)
        for name in _BOOKMARKS:
            views.addAction(actions[name])
        add_menus(self, actions, {"Go to &view": views})
        FullScreenActions(self, actions)
        ViewActions(actions, self.link)
        actions.bind(
            {
                "save-picture": self.save_picture,
                "quit": self.close,
                "look-all": self.view.see_all,
                "look-best": self.view.see_best,
                "bookmark": self._add_bookmark,
                **{name: partial(self._panel.go_to, index) for index, name in enumerate(_BOOKMARKS)},
                "restart": self.link.start,
                "keys": self._show_keys,
            }
        )

    def save_picture(self) -> None:
        picture = self.link.picture
        if picture is None:
            return
        path = ask_picture_path(self, "Save the picture", Path.home() / f"{self.link.path.stem}.png")
        if path is not None:
            self._picture_file.write(picture, path)

    def closeEvent(self, event: QCloseEvent | None) -> None:
        self.link.stop()
        self.closed.emit()
        super().closeEvent(event)

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        super().resizeEvent(event)
        self.banner.update_position()

    def _add_bookmark(self) -> None:
        self._panel.add()
        self._dock.show()

    def _show_keys(self) -> None:
        run_dialog(KeysDialog(self, _ACTIONS))

    def _show_world(self, world: msg.WorldFacts) -> None:
        west, south, east, north = world.bounds
        size = f"{length_text(east - west)} × {length_text(north - south)}"
        self._extent.setText(f"{size}, {world.cell:g} m between vertices")
        for line in world.missing:
            self.banner.show_message(Message("info", f"{line[:1].upper()}{line[1:]}.", line))

    def _show_position(self, frame: msg.FrameFacts) -> None:
        corner = (0.0, 0.0) if self.link.world is None else self.link.world.corner
        x, y, z = frame.pose.eye
        self._position.setText(f"Eye at {x + corner[0]:.0f}, {y + corner[1]:.0f} m, {z:.0f} m high")

    def _report_error(self, error: msg.ErrorReport) -> None:
        """Report an unreadable part; the view itself shows why it has no picture."""
        if error.source == "world":
            self._missing_parts += 1
            count = f" ({self._missing_parts} parts so far)" if self._missing_parts > 1 else ""
            line = f"{error.line.rstrip('.')}{count}. A coarser level is shown there."
            self.banner.show_message(Message("warning", line, "world"))
