"""Messages that float at the top of the window: one at a time, and nothing moves to make room."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from PyQt6.QtCore import Qt, QTimer
from PyQt6.QtGui import QColor, QPainter
from PyQt6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QSizePolicy, QWidget

from sketchterrain.ui.look.icons import draw_icon
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, looks, theme
from sketchterrain.ui.look.tool_buttons import tool_button

if TYPE_CHECKING:
    from collections.abc import Callable

    from PyQt6.QtGui import QPaintEvent

__all__ = ["Banner", "Message"]

_LONG = 8000  # ms that good news stay
_MOST = 8  # messages that wait
_WIDE = 640  # px


@dataclass(frozen=True)
class Message:
    """One line for a person.

    Attributes
    ----------
    kind : {'info', 'good', 'warning', 'error'}
    line : str
    about : str
        What it is about; `Banner.withdraw` takes it back by that.
    buttons : tuple of (str, callable)
        What a person can do about it.
    """

    kind: str
    line: str
    about: str = ""
    buttons: tuple[tuple[str, Callable[[], object]], ...] = field(default=(), compare=False)


class Banner(QFrame):
    """Shows the last of the messages that were not dismissed; hidden when there is none.

    Parameters
    ----------
    window
        Over which it floats.
    below
        The bar under which it does so.
    """

    def __init__(self, window: QWidget, *, below: QWidget) -> None:
        super().__init__(window)
        self._window, self._below = window, below
        self._messages: list[Message] = []
        self.setObjectName("banner")
        self.setAutoFillBackground(True)
        self._mark = _Mark(self)
        self._line = QLabel(self)
        self._line.setTextFormat(Qt.TextFormat.PlainText)
        self._line.setWordWrap(True)
        self._line.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._line.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        self._buttons: list[QPushButton] = []
        close = tool_button("close", "Dismiss this message", tip="Dismiss", side=14, parent=self)
        close.clicked.connect(self.dismiss)
        self._row = QHBoxLayout(self)
        self._row.setContentsMargins(MARGIN, SMALL, SPACING, SMALL)
        self._row.setSpacing(SPACING)
        self._row.addWidget(self._mark)
        self._row.addWidget(self._line, 1)
        self._row.addWidget(close)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(_LONG)
        self._timer.timeout.connect(self.dismiss)
        self.setAccessibleName("Messages")
        self.hide()

    @property
    def message(self) -> Message | None:
        """The one that is shown."""
        return self._messages[-1] if self._messages else None

    def tell(self, message: Message) -> None:
        """Show a message; one that says the same, or is about the same thing, gives way to it."""
        self._messages = [
            each
            for each in self._messages
            if each != message and not (message.about and each.about == message.about)
        ][1 - _MOST :]
        self._messages.append(message)
        self._show()

    def withdraw(self, about: str) -> None:
        """Take back what is about something: it is over."""
        kept = [each for each in self._messages if each.about != about]
        if len(kept) != len(self._messages):
            self._messages = kept
            self._show()

    def dismiss(self) -> None:
        """Take away the message that is shown; the one before it is seen again."""
        if self._messages:
            self._messages.pop()
            self._show()

    def place(self) -> None:
        """Keep to the middle of the window; it calls this when its size is another one."""
        width = min(_WIDE, self._window.width() - 2 * MARGIN)
        bar = self._below
        top = bar.geometry().bottom() + 1 if bar.isVisible() else 0
        self._row.activate()
        height = max(self._row.heightForWidth(width), self._row.minimumSize().height())
        self.setGeometry((self._window.width() - width) // 2, top + SPACING, width, height)

    def _show(self) -> None:
        for button in self._buttons:
            self._row.removeWidget(button)
            button.hide()
            button.deleteLater()
        self._buttons.clear()
        self._timer.stop()
        message = self.message
        if message is not None:
            self._mark.kind = message.kind
            self._mark.update()
            self._line.setText(message.line)
            for place, (title, _) in enumerate(message.buttons):
                button = QPushButton(title, self)
                button.setAutoDefault(False)
                button.clicked.connect(self._press)
                self._row.insertWidget(2 + place, button)
                self._buttons.append(button)
            if message.kind in ("info", "good"):
                self._timer.start()
        self.place()
        self.setVisible(message is not None)
        self.raise_()

    def _press(self) -> None:
        message = self.message
        pressed = [place for place, button in enumerate(self._buttons) if button is self.sender()]
        if message is not None and pressed:
            self.dismiss()
            message.buttons[pressed[0]][1]()


class _Mark(QWidget):
    """What kind of message it is, by shape and colour."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.kind = "info"
        self.setFixedSize(20, 20)
        looks.changed.connect(self.update)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        colours = theme()
        name, colour = {
            "good": ("check", colours.good),
            "warning": ("warning", colours.warning),
            "error": ("error", colours.error),
        }.get(self.kind, ("info", colours.accent))
        painter = QPainter(self)
        draw_icon(painter, name, self.rect().toRectF(), QColor(colour))
        painter.end()
