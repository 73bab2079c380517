"""A window that shows a written world: its picture, messages, where one is."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QKeySequence, QShortcut
from PyQt6.QtWidgets import QFileDialog, QLabel, QMainWindow

from sketchterrain.errors import SketchterrainError
from sketchterrain.ui.banner import Banner, Message
from sketchterrain.ui.look.icons import app_icon
from sketchterrain.ui.models.background import Background
from sketchterrain.ui.view3d.projection import length_text
from sketchterrain.ui.worlds.link import WorldLink
from sketchterrain.ui.worlds.view import WorldView

if TYPE_CHECKING:
    from PyQt6.QtGui import QCloseEvent, QImage, QResizeEvent

    from sketchterrain.ui.engine.protocol import FrameFacts, Trouble
    from sketchterrain.ui.worlds.messages import WorldFacts

__all__ = ["WorldWindow"]

_OFTEN: Final = 200
"""ms between two looks at what the status line says."""


class WorldWindow(QMainWindow):
    """Shows a world until it is closed.

    Parameters
    ----------
    path
        Of the world; it is opened by another process, which tells what is wrong with it.
    device
        Selector of the OpenCL device; None: the best one.
    """

    closed = pyqtSignal()

    def __init__(self, path: Path, *, device: str | None = None) -> None:
        super().__init__()
        self.setWindowIcon(app_icon())
        self.setWindowTitle(path.name)
        self.setMinimumSize(480, 320)
        self.link = WorldLink(path, device=device)
        self.view = WorldView(self.link)
        self.setCentralWidget(self.view)
        self._where, self._what = QLabel(), QLabel()
        status = self.statusBar()
        assert status is not None  # noqa: S101 # a QMainWindow makes one
        status.setSizeGripEnabled(False)
        status.addWidget(self._where, 1)
        status.addPermanentWidget(self._what)
        self.banner = Banner(self, below=self.view.bar)
        self._lost = 0
        self._background = Background(self)
        self.link.world_known.connect(self._tell_world)
        self.link.frame_shown.connect(self._tell_place)
        self.link.trouble.connect(self._tell_trouble)
        self.view.picture_wanted.connect(self.save_picture)
        for keys, act in (
            (QKeySequence.StandardKey.Close, self.close),
            (QKeySequence("Ctrl+Q"), self.close),
            (QKeySequence("F11"), self._use_screen),
            (QKeySequence("Ctrl+Shift+P"), self.save_picture),
        ):
            QShortcut(QKeySequence(keys), self).activated.connect(act)
        self.resize(self.view.sizeHint())
        self.view.setFocus(Qt.FocusReason.OtherFocusReason)
        self._refining = QTimer(self)
        self._refining.setInterval(_OFTEN)
        self._refining.timeout.connect(self._tell_place)
        self._refining.start()
        self.link.start()

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
        self._refining.stop()
        self.link.stop()
        self.closed.emit()
        super().closeEvent(event)

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Keep messages in the middle."""
        super().resizeEvent(event)
        self.banner.place()

    def _use_screen(self) -> None:
        self.setWindowState(self.windowState() ^ Qt.WindowState.WindowFullScreen)

    def _tell_world(self, world: WorldFacts) -> None:
        east, north = (length_text(side) for side in world.size)
        self._what.setText(f"{east} × {north}, {world.cell:g} m between vertices")
        for line in world.lacks:
            self.banner.tell(Message("info", f"{line[:1].upper()}{line[1:]}.", line))

    def _tell_place(self, _: FrameFacts | None = None) -> None:
        frame, world = self.link.frame, self.link.world
        if frame is None or world is None:
            return
        x, y, z = frame.pose.eye
        text = f"Eye at {x + world.corner[0]:.0f}, {y + world.corner[1]:.0f} m, {z:.0f} m high"
        self._where.setText(f"{text} · refining" if self.view.refines else text)

    def _tell_trouble(self, trouble: Trouble) -> None:
        """Tell of a part that cannot be read; where nothing is drawn any more the view tells itself."""
        if trouble.what == "world":
            self._lost += 1
            others = f" ({self._lost} parts so far)" if self._lost > 1 else ""
            line = f"{trouble.line}{others}. What is known more coarsely is shown there."
            self.banner.tell(Message("warning", line, "world"))

    def _written(self, path: Path, problem: str) -> None:
        kind, line = ("error", problem) if problem else ("good", f"The picture is saved: {path}")
        self.banner.tell(Message(kind, line, "picture"))


def _write(picture: QImage, path: Path) -> None:
    if not picture.save(str(path), "PNG"):
        raise SketchterrainError(f"{path}: cannot be written")
