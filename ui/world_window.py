"""Window of a stored world: the 3-D view, its engine and actions, without a sketch."""

from functools import partial
from pathlib import Path
from typing import Final

from PyQt6.QtCore import QSize, Qt, pyqtSignal
from PyQt6.QtGui import QCloseEvent, QResizeEvent
from PyQt6.QtWidgets import QFileDialog, QLabel, QMainWindow, QMenu

from sketchterrain.ui.actions import Actions
from sketchterrain.ui.banner import Banner, Message
from sketchterrain.ui.dialogs.help import KeysDialog
from sketchterrain.ui.engine.link import EngineProcesses, ViewSource
from sketchterrain.ui.engine.protocol import ErrorReport, FrameFacts, Look, ViewState, WorldFacts
from sketchterrain.ui.layout import Dock, FullScreenActions, fitting_size
from sketchterrain.ui.look.theme import app_icon
from sketchterrain.ui.menus import add_menus
from sketchterrain.ui.models.bookmarks import Bookmarks
from sketchterrain.ui.models.preferences import state_folder
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.open_dialogs import PictureFile
from sketchterrain.ui.panels.lists import BookmarksPanel
from sketchterrain.ui.view3d.camera import length_text
from sketchterrain.ui.view3d.view import View3D
from sketchterrain.ui.window_actions import ViewActions

_BOOKMARKS: Final = tuple(f"bookmark-{number}" for number in range(1, 10))
_ACTIONS: Final = (
    *("save-picture", "quit", "full-screen", "leave", "mode-orbit", "mode-fly", "mode-walk", "look-all"),
    *("look-best", "bookmark", *_BOOKMARKS, "play", "restart", "keys"),
)
"""Actions that need no sketch."""


class WorldLink(ViewSource):
    """Renders a stored world; reports errors of the ``engine``, the ``view`` or a part of the ``world``."""

    world_known = pyqtSignal(object)
    """`WorldFacts`."""

    def __init__(self, path: Path, *, device: str | None = None) -> None:
        super().__init__(ViewState(mode="fly"))
        self.path, self.device = path, device
        self.world: WorldFacts | None = None
        self._routes[WorldFacts] = ("world", self.world_known)

    def area(self) -> tuple[tuple[float, float, float, float], float] | None:
        """Return the world's rectangle (m) and the height of its centre; None until they are known."""
        return None if self.world is None else (self.world.bounds, self.world.middle)

    def start(self) -> None:
        self._run(EngineProcesses(device=self.device, world=self.path))
        if self.frame is None:
            self.send(Look())


class WorldWindow(QMainWindow):
    """Shows a stored world; the engine process opens it and reports errors."""

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
        self.view.setFocus(Qt.FocusReason.OtherFocusReason)
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
        start = str(Path.home() / f"{self.link.path.stem}.png")
        name, _ = QFileDialog.getSaveFileName(self, "Save the picture", start, "Pictures (*.png)")
        if name:
            path = Path(name if name.lower().endswith(".png") else f"{name}.png")
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
        dialog = KeysDialog(self, _ACTIONS)
        dialog.exec()
        dialog.deleteLater()

    def _show_world(self, world: WorldFacts) -> None:
        west, south, east, north = world.bounds
        size = f"{length_text(east - west)} × {length_text(north - south)}"
        self._extent.setText(f"{size}, {world.cell:g} m between vertices")
        for line in world.missing:
            self.banner.show_message(Message("info", f"{line[:1].upper()}{line[1:]}.", line))

    def _show_position(self, frame: FrameFacts) -> None:
        corner = (0.0, 0.0) if self.link.world is None else self.link.world.corner
        x, y, z = frame.pose.eye
        self._position.setText(f"Eye at {x + corner[0]:.0f}, {y + corner[1]:.0f} m, {z:.0f} m high")

    def _report_error(self, error: ErrorReport) -> None:
        """Report an unreadable part; the view itself shows why it has no picture."""
        if error.source == "world":
            self._missing_parts += 1
            count = f" ({self._missing_parts} parts so far)" if self._missing_parts > 1 else ""
            line = f"{error.line.rstrip('.')}{count}. A coarser level is shown there."
            self.banner.show_message(Message("warning", line, "world"))
