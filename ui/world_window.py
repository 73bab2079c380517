"""The window of a stored world: the editor's 3-D view, its engine and actions, without a sketch to edit."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Final

from PyQt6.QtCore import QSize, Qt, pyqtSignal
from PyQt6.QtGui import QCloseEvent, QImage, QResizeEvent
from PyQt6.QtWidgets import QFileDialog, QLabel, QMainWindow, QMenu

from sketchterrain.errors import SketchterrainError
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.banner import Banner, Message
from sketchterrain.ui.dialogs.help import KeysDialog
from sketchterrain.ui.engine.link import EngineProcesses, ViewSource
from sketchterrain.ui.engine.protocol import ErrorReport, FrameFacts, Look, ViewState, WorldFacts
from sketchterrain.ui.layout import Dock, FullScreenActions, fitting_size
from sketchterrain.ui.look.theme import app_icon
from sketchterrain.ui.menus import add_menus
from sketchterrain.ui.models.background import BackgroundQueue
from sketchterrain.ui.models.bookmarks import Bookmarks
from sketchterrain.ui.models.preferences import state_folder
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.view3d.bookmarks import BookmarksPanel
from sketchterrain.ui.view3d.projection import length_text
from sketchterrain.ui.view3d.view import View3D
from sketchterrain.ui.window_actions import ViewActions

_VISITS: Final = tuple(f"bookmark-{number}" for number in range(1, 10))
_ACTIONS: Final = (
    *("save-picture", "quit", "full-screen", "leave", "mode-orbit", "mode-fly", "mode-walk", "look-all"),
    *("look-best", "bookmark", *_VISITS, "play", "restart", "keys"),
)
"""What can be done where there is no sketch."""


class WorldLink(ViewSource):
    """Renders a stored world; reports errors of the ``engine``, the ``view`` or a part of the ``world``."""

    world_known = pyqtSignal(object)
    """`WorldFacts`."""

    def __init__(self, path: Path, *, device: str | None = None) -> None:
        super().__init__(ViewState(mode="fly"))
        self.path, self.device = path, device
        self.world: WorldFacts | None = None

    def area(self) -> tuple[tuple[float, float, float, float], float] | None:
        """Return the rectangle (m) of the world, and the height of its middle; None until they are known."""
        return None if self.world is None else (self.world.bounds, self.world.middle)

    def start(self) -> None:
        """Start or restart the process."""
        self._run(EngineProcesses(device=self.device, world=self.path))
        if self.frame is None:
            self.send(Look())

    def _handle_other(self, message: Any) -> None:
        if isinstance(message, WorldFacts):
            self.world = message
            self.world_known.emit(message)


class WorldWindow(QMainWindow):
    """Shows a world until it is closed; the engine's process opens it and tells what is wrong with it."""

    closed = pyqtSignal()

    def __init__(self, path: Path, *, device: str | None = None) -> None:
        super().__init__()
        self.setWindowIcon(app_icon())
        self.setWindowTitle(path.name)
        self.setMinimumSize(480, 320)
        self.link, self._workspace = WorldLink(path, device=device), Workspace()
        self.view = View3D(None, self._workspace, self.link)
        self.setCentralWidget(self.view)
        self._bookmarks = Bookmarks(None, state_folder() / "bookmarks", path)
        self._panel = BookmarksPanel(self.link, self._bookmarks)
        self._dock = Dock("bookmarks", "Bookmarks", self._panel, self)
        self.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, self._dock)
        self._dock.hide()
        self.actions_by_name = Actions(self, _ACTIONS)
        self._add_menus()
        self._where, self._what = QLabel(), QLabel()
        status = self.statusBar()
        assert status is not None  # noqa: S101 # a QMainWindow makes one
        status.setSizeGripEnabled(False)
        status.addWidget(self._where, 1)
        status.addPermanentWidget(self._what)
        self.banner = Banner(self, below=self.view.bar)
        self._lost = 0
        self._background = BackgroundQueue(self)
        self.link.world_known.connect(self._show_world)
        self.link.frame_shown.connect(self._show_place)
        self.link.error_reported.connect(self._report_trouble)
        self.view.picture_requested.connect(self.save_picture)
        self.resize(fitting_size(QSize(1180, 760), self.screen()))
        self.view.setFocus(Qt.FocusReason.OtherFocusReason)
        self.link.start()

    def _add_menus(self) -> None:
        actions, views = self.actions_by_name, QMenu("Go to &view", self)
        for name in _VISITS:
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
                **{name: partial(self._panel.go_to, place) for place, name in enumerate(_VISITS)},
                "restart": self.link.start,
                "keys": self._show_keys,
            }
        )

    def save_picture(self) -> None:
        """Save what is shown as a PNG."""
        picture = self.link.picture
        if picture is None:
            return
        start = str(Path.home() / f"{self.link.path.stem}.png")
        name, _ = QFileDialog.getSaveFileName(self, "Save the picture", start, "Pictures (*.png)")
        if name:
            path = Path(name if name.lower().endswith(".png") else f"{name}.png")
            self._background.do("picture", partial(_write, picture, path), partial(self._written, path))

    def closeEvent(self, event: QCloseEvent | None) -> None:
        """End the process that draws."""
        self.link.stop()
        self.closed.emit()
        super().closeEvent(event)

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Keep messages in the middle."""
        super().resizeEvent(event)
        self.banner.update_position()

    def _add_bookmark(self) -> None:
        self._panel.add()
        self._dock.show()

    def _show_keys(self) -> None:
        dialog = KeysDialog(self, _ACTIONS)
        dialog.exec()
        dialog.deleteLater()

    def _show_world(self, world: WorldFacts) -> None:
        west, south, east, north = world.bounds
        size = f"{length_text(east - west)} × {length_text(north - south)}"
        self._what.setText(f"{size}, {world.cell:g} m between vertices")
        for line in world.missing:
            self.banner.show_message(Message("info", f"{line[:1].upper()}{line[1:]}.", line))

    def _show_place(self, frame: FrameFacts) -> None:
        corner = (0.0, 0.0) if self.link.world is None else self.link.world.corner
        x, y, z = frame.pose.eye
        self._where.setText(f"Eye at {x + corner[0]:.0f}, {y + corner[1]:.0f} m, {z:.0f} m high")

    def _report_trouble(self, trouble: ErrorReport) -> None:
        """Report a part that cannot be read; the view itself says why nothing is drawn."""
        if trouble.source == "world":
            self._lost += 1
            others = f" ({self._lost} parts so far)" if self._lost > 1 else ""
            line = f"{trouble.line.rstrip('.')}{others}. What is known more coarsely is shown there."
            self.banner.show_message(Message("warning", line, "world"))

    def _written(self, path: Path, problem: str) -> None:
        kind, line = ("error", problem) if problem else ("good", f"The picture is saved: {path}")
        self.banner.show_message(Message(kind, line, "picture"))


def _write(picture: QImage, path: Path) -> None:
    if not picture.save(str(path), "PNG"):
        raise SketchterrainError(f"{path}: cannot be written")
