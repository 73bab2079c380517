"""A card in the middle of the view: why there is no picture, and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from PyQt6.QtCore import QRectF, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QPainter
from PyQt6.QtWidgets import QFrame, QLabel, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from sketchterrain.ui.look.icons import draw_icon
from sketchterrain.ui.look.theme import MARGIN, SPACING, looks, theme

if TYPE_CHECKING:
    from PyQt6.QtGui import QPaintEvent

    from sketchterrain.ui.engine.messages import Trouble
    from sketchterrain.ui.picture_source import PictureSource

__all__ = ["Card", "Notice", "notice_of"]

_PATIENCE = 2  # s, after which it says how long it has been


@dataclass(frozen=True)
class Notice:
    """What a card says.

    Attributes
    ----------
    icon : str
        Of `ui.look.icons`; empty: one waits, and is told for how long.
    title, line : str
    button : str
        Empty where there is nothing to press.
    """

    icon: str
    title: str
    line: str = ""
    button: str = ""


def notice_of(link: PictureSource, trouble: Trouble | None) -> Notice | None:
    """Return why there is no picture, or none that is worth looking at; None if all is well.

    Parameters
    ----------
    link
    trouble
        Of the engine or the view, since the last picture.
    """
    if trouble is not None and trouble.what == "engine":
        return Notice("error", "The 3-D view stopped", trouble.line, "Start again")
    if link.facts.no_picture:
        line = f"{link.facts.no_picture}\nYou can paint and export all the same."
        return Notice("warning", "There is no 3-D view", line, "Try again")
    if link.picture is not None:
        return None
    if link.facts.no_device:
        return Notice("warning", "There is no device for the terrain", link.facts.no_device, "Try again")
    if trouble is not None:
        return Notice("error", "The 3-D view cannot be drawn", trouble.line, "Start again")
    return Notice("", "Preparing the terrain", link.working or "Starting")


class Card(QFrame):
    """Shows a `Notice`, or hides."""

    pressed = pyqtSignal()
    """Its button was pressed."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._notice: Notice | None = None
        self._seconds = 0
        self._mark = _Mark(self)
        self._title = QLabel(self)
        self._line = QLabel(self)
        self._line.setTextFormat(Qt.TextFormat.PlainText)
        self._line.setWordWrap(True)
        self._line.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._line.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.MinimumExpanding)
        self._button = QPushButton(self)
        self._button.setAutoDefault(False)
        self._button.clicked.connect(self.pressed)
        for label in (self._title, self._line):
            label.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        rows = QVBoxLayout(self)
        rows.setContentsMargins(2 * MARGIN, 2 * MARGIN, 2 * MARGIN, 2 * MARGIN)
        rows.setSpacing(SPACING)
        rows.addWidget(self._mark, 0, Qt.AlignmentFlag.AlignHCenter)
        rows.addWidget(self._title)
        rows.addWidget(self._line)
        rows.addWidget(self._button, 0, Qt.AlignmentFlag.AlignHCenter)
        font = self._title.font()
        font.setPointSizeF(font.pointSizeF() * 1.15)
        font.setBold(True)
        self._title.setFont(font)
        self._clock = QTimer(self)
        self._clock.setInterval(1000)
        self._clock.timeout.connect(self._tick)
        looks.changed.connect(self.update)
        self.hide()

    @property
    def notice(self) -> Notice | None:
        """What it says."""
        return self._notice

    def tell(self, notice: Notice | None) -> None:
        """Say something else, or hide."""
        if notice == self._notice:
            return
        before, self._notice = self._notice, notice
        if notice is None:
            self._clock.stop()
            self.hide()
            return
        waits = not notice.icon
        if waits and (before is None or before.icon):
            self._seconds = 0
            self._clock.start()
        elif not waits:
            self._clock.stop()
        self._mark.name = notice.icon
        self._mark.setVisible(bool(notice.icon))
        self._title.setText(notice.title)
        self._button.setText(notice.button)
        self._button.setVisible(bool(notice.button))
        self.setAccessibleName(notice.title)
        self._write()
        self.show()
        self.place()

    def place(self) -> None:
        """Come to the middle of the parent."""
        parent = self.parentWidget()
        if parent is None or self.isHidden():
            return
        width = min(380, parent.width() - 2 * MARGIN)
        self.setFixedWidth(max(width, 120))
        self.adjustSize()
        layout = self.layout()
        height = layout.totalHeightForWidth(self.width()) if layout is not None else self.height()
        self.resize(self.width(), min(max(height, 60), max(parent.height() - 2 * MARGIN, 60)))
        self.move((parent.width() - self.width()) // 2, (parent.height() - self.height()) // 2)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw a plate with a thin border."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        colours = theme()
        painter.setPen(colours.line)
        painter.setBrush(colours.window)
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5), 8.0, 8.0)

    def _tick(self) -> None:
        self._seconds += 1
        self._write()

    def _write(self) -> None:
        if self._notice is None:
            return
        line = self._notice.line
        if not self._notice.icon:
            line = line.rstrip(" .…") + " …"
            line += f" {self._seconds} s" if self._seconds >= _PATIENCE else ""
        self._line.setText(line)
        self._line.setVisible(bool(line))


class _Mark(QWidget):
    """What kind of notice it is, by shape and colour."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.name = ""
        self.setFixedSize(32, 32)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the icon in the colour of what it means."""
        if self.name:
            colours = theme()
            colour = {"error": colours.error, "warning": colours.warning}.get(self.name, colours.text)
            draw_icon(QPainter(self), self.name, QRectF(self.rect()), colour)
