"""Messages that float at the top of the window, and the errors that are reported there."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from types import TracebackType

from PyQt6.QtCore import QObject, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QColor, QGuiApplication, QPainter, QPaintEvent
from PyQt6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QPlainTextEdit,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import ErrorReport
from sketchterrain.ui.look.icons import draw_icon, tool_button
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, looks, theme

_LONG = 8000  # ms that good news stay
_MOST = 8  # messages that wait
_WIDE = 640  # px


@dataclass(frozen=True)
class Message:
    """One line for a person."""

    kind: str
    line: str
    about: str = ""  # What it is about; `Banner.withdraw` takes it back by that
    # What a person can do about it
    buttons: tuple[tuple[str, Callable[[], object]], ...] = field(default=(), compare=False)


class Banner(QFrame):
    """Shows the last of the messages that were not dismissed; hidden when there is none."""

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
        top = bar.mapTo(self._window, bar.rect().bottomLeft()).y() + 1 if bar.isVisible() else 0
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


class ErrorReporter(QObject):
    """Tells the engine's troubles in the banner, and takes them back when they are over."""

    def __init__(self, banner: Banner, link: EngineLink) -> None:
        super().__init__(banner)
        self._banner = banner
        self._link = link
        link.trouble.connect(self._tell)
        link.placed_changed.connect(self._placed)
        link.frame_shown.connect(self._drawn)
        link.facts_changed.connect(self._begun)

    def _placed(self, _: object) -> None:
        self._banner.withdraw("sketch")

    def _drawn(self, _: object) -> None:
        self._banner.withdraw("view")

    def _begun(self, _: object) -> None:
        self._banner.withdraw("engine")

    def _tell(self, trouble: ErrorReport) -> None:
        if trouble.what == "engine":
            buttons = (("Start again", self._link.start),)
            self._banner.tell(Message("error", trouble.line, "engine", buttons))
        else:
            kind = "warning" if trouble.what in ("sketch", "view") else "error"
            self._banner.tell(Message(kind, trouble.line, trouble.what))


class UncaughtExceptions(QObject):
    """Catches errors that nothing else caught: a line in the banner, the rest on request.

    The window stays, and what was painted stays in it.
    """

    _happened = pyqtSignal(str, str)

    def __init__(self, banner: Banner, window: QWidget) -> None:
        super().__init__(banner)
        self._banner = banner
        self._window = window
        self._happened.connect(self._tell)  # from any thread, told on the window's

    def catch_all(self) -> None:
        """Be told from now on of every error in this process that is not caught."""
        sys.excepthook = self.catch
        threading.excepthook = lambda given: self.catch(
            given.exc_type, given.exc_value or given.exc_type(), given.exc_traceback
        )

    def let_go(self) -> None:
        """Be told of no more."""
        sys.excepthook = sys.__excepthook__
        threading.excepthook = threading.__excepthook__

    def catch(self, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        """Tell an error; one that asks to end the program ends it."""
        if issubclass(kind, (KeyboardInterrupt, SystemExit)):
            app = QGuiApplication.instance()
            if app is not None:
                app.quit()
            return
        details = "".join(traceback.format_exception(kind, error, trace))
        sys.stderr.write(details)
        if issubclass(kind, SketchterrainError):
            line = str(error)
        else:
            line = f"Something went wrong ({kind.__name__}: {one_line(error)}). Your sketch is as it was."
        self._happened.emit(line, details)

    def _tell(self, line: str, details: str) -> None:
        buttons = (("Details…", lambda: self.show_details(details)),)
        self._banner.tell(Message("error", line, "surprise", buttons))

    def show_details(self, details: str) -> None:
        """Show where an error came from."""
        dialog = QDialog(self._window)
        dialog.setWindowTitle("What went wrong")
        text = QPlainTextEdit(details)
        text.setReadOnly(True)
        text.setAccessibleName("Where the error came from")
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        copy = buttons.addButton("Copy", QDialogButtonBox.ButtonRole.ActionRole)
        clipboard = QGuiApplication.clipboard()
        if copy is not None and clipboard is not None:
            copy.clicked.connect(lambda: clipboard.setText(details))
        buttons.rejected.connect(dialog.reject)
        column = QVBoxLayout(dialog)
        column.setContentsMargins(MARGIN, MARGIN, MARGIN, MARGIN)
        column.setSpacing(SPACING)
        column.addWidget(QLabel("If you report this, please send these lines with it."))
        column.addWidget(text)
        column.addWidget(buttons)
        dialog.resize(640, 360)
        dialog.exec()
        dialog.deleteLater()
