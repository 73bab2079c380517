"""Message banner at the top of the window; engine errors, uncaught exceptions and saved pictures in it."""

import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import TracebackType

from PyQt6.QtCore import QObject, Qt, QUrl, pyqtSignal
from PyQt6.QtGui import QDesktopServices, QGuiApplication, QImage
from PyQt6.QtWidgets import QFileDialog, QFrame, QLabel, QMessageBox, QPushButton, QSizePolicy, QWidget

from sketchterrain.document.store import reject_sketch_folder
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import ErrorReport
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, active_theme, icon, row, theme, tool_button
from sketchterrain.ui.models.background import BackgroundQueue, single_shot

_DURATION = 8000  # ms until information disappears
_MAX_MESSAGES = 8
_WIDTH = 640  # px


@dataclass(frozen=True)
class Message:
    """One line for the user; `kind` is good, info, warning or error."""

    kind: str
    line: str
    topic: str = ""  # A newer message of the topic replaces it; `Banner.withdraw` removes it
    buttons: tuple[tuple[str, Callable[[], object]], ...] = field(default=(), compare=False)


class Banner(QFrame):
    """Shows the newest message that was not dismissed; hidden without one."""

    def __init__(self, window: QWidget, *, below: QWidget) -> None:
        super().__init__(window)
        self._window, self._below = window, below
        self._messages: list[Message] = []
        self._buttons = row(None)
        self.setObjectName("banner")
        self.setAutoFillBackground(True)
        self._symbol, self._line = QLabel(), QLabel()
        self._symbol.setFixedSize(20, 20)
        self._line.setTextFormat(Qt.TextFormat.PlainText)
        self._line.setWordWrap(True)
        self._line.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._line.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        close = tool_button("close", "Dismiss this message", self.dismiss, tip="Dismiss", side=14)
        items = self._symbol, (self._line, 1), self._buttons, close
        self._row = row(self, *items, margins=(MARGIN, SMALL, SPACING, SMALL))
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._timer = single_shot(self, _DURATION, self.dismiss)
        self.setAccessibleName("Messages")
        active_theme.changed.connect(self._show_symbol)
        self.hide()

    @property
    def message(self) -> Message | None:
        return self._messages[-1] if self._messages else None

    def show_message(self, message: Message) -> None:
        """Show a message in place of an equal one and of one with the same topic."""
        others = [each for each in self._messages if each != message]
        others = [each for each in others if not message.topic or each.topic != message.topic]
        self._messages = [*others[1 - _MAX_MESSAGES :], message]
        self._refresh()

    def withdraw(self, topic: str) -> None:
        remaining = [each for each in self._messages if each.topic != topic]
        if len(remaining) != len(self._messages):
            self._messages = remaining
            self._refresh()

    def dismiss(self) -> None:
        """Remove the visible message; the one before it is shown again."""
        if self._messages:
            self._messages.pop()
            self._refresh()

    def update_position(self) -> None:
        """Centre the banner in its window after the window was resized."""
        width = min(_WIDTH, self._window.width() - 2 * MARGIN)
        bar = self._below
        top = bar.mapTo(self._window, bar.rect().bottomLeft()).y() + 1 if bar.isVisible() else 0
        self._row.activate()
        height = max(self.heightForWidth(width), self._row.totalMinimumSize().height())
        self.setGeometry((self._window.width() - width) // 2, top + SPACING, width, height)

    def _refresh(self) -> None:
        for button in self.findChildren(QPushButton):
            button.hide()
            button.deleteLater()
        self._timer.stop()
        message = self.message
        if message is not None:
            self._show_symbol()
            self._line.setText(message.line)
            for title, action in message.buttons:
                button = QPushButton(title)
                button.clicked.connect(partial(self._press, action))
                self._buttons.addWidget(button)
            if message.kind in ("info", "good"):
                self._timer.start()
        self.update_position()
        self.setVisible(message is not None)
        self.raise_()

    def _show_symbol(self) -> None:
        colours, kind = theme(), "info" if self.message is None else self.message.kind
        symbols = {
            "good": ("check", colours.good),
            "warning": ("warning", colours.warning),
            "error": ("error", colours.error),
        }
        self._symbol.setPixmap(icon(*symbols.get(kind, ("info", colours.accent))).pixmap(20, 20))

    def _press(self, action: Callable[[], object], _: bool) -> None:
        self.dismiss()
        action()


class ErrorReporter(QObject):
    """Shows the engine's errors in the banner and withdraws them once resolved."""

    def __init__(self, banner: Banner, link: EngineLink) -> None:
        super().__init__(banner)
        self._banner, self._link = banner, link
        link.error_reported.connect(self._report)
        for signal, topic in (
            (link.placed_changed, "sketch"),
            (link.frame_shown, "view"),
            (link.facts_changed, "engine"),
        ):
            signal.connect(partial(self._resolve, topic))

    def _resolve(self, topic: str, _: object = None) -> None:
        self._banner.withdraw(topic)

    def _report(self, error: ErrorReport) -> None:
        kind = "warning" if error.source in ("sketch", "view") else "error"
        buttons = (("Start again", self._link.start),) if error.source == "engine" else ()
        self._banner.show_message(Message(kind, error.line, error.source, buttons))


class UncaughtExceptions(QObject):
    """Reports exceptions that nothing caught in the banner, with details on request."""

    _caught = pyqtSignal(str, str)

    def __init__(self, banner: Banner, window: QWidget) -> None:
        super().__init__(banner)
        self._banner, self._window = banner, window
        self._caught.connect(self._report)  # from any thread to the window's

    def install(self) -> None:
        """Report every uncaught exception of this process."""
        sys.excepthook = self.handle
        threading.excepthook = lambda args: self.handle(
            args.exc_type, args.exc_value or args.exc_type(), args.exc_traceback
        )

    def uninstall(self) -> None:
        sys.excepthook = sys.__excepthook__
        threading.excepthook = threading.__excepthook__

    def handle(self, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        """Report an exception; KeyboardInterrupt and SystemExit quit the program."""
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
            line = f"Unexpected error ({kind.__name__}: {one_line(error)}). Your sketch is unchanged."
        self._caught.emit(line, details)

    def _report(self, line: str, details: str) -> None:
        button = ("Details…", partial(self.show_details, details))
        self._banner.show_message(Message("error", line, "exception", (button,)))

    def show_details(self, details: str) -> None:
        box = QMessageBox(self._window)
        box.setWindowTitle("Error details")
        box.setText("Please include these details when you report this error.")
        box.setDetailedText(details)
        box.exec()
        box.deleteLater()


class PictureFile(QObject):
    """Writes pictures as PNG in the background and reports each in a banner."""

    def __init__(self, banner: Banner, parent: QObject) -> None:
        super().__init__(parent)
        self._banner, self._background = banner, BackgroundQueue(self)

    def write(self, picture: QImage, path: Path) -> None:
        self._background.do("picture", partial(_write_png, picture, path), partial(self.report, path))

    def report(self, path: Path, error: str = "") -> None:
        if error:
            self._banner.show_message(Message("error", error, "picture"))
        else:
            folder = QUrl.fromLocalFile(str(path.parent))
            button = ("Open folder", partial(QDesktopServices.openUrl, folder))
            self._banner.show_message(Message("good", f"The picture is saved: {path}", "picture", (button,)))


def ask_picture_path(parent: QWidget, title: str, start: Path) -> Path | None:
    """Ask for the path of a PNG; None if cancelled."""
    name, _ = QFileDialog.getSaveFileName(parent, title, str(start), "Pictures (*.png)")
    return Path(name if name.lower().endswith(".png") else f"{name}.png") if name else None


def _write_png(picture: QImage, path: Path) -> None:
    reject_sketch_folder(path.parent)
    if not picture.save(str(path), "PNG"):
        raise SketchterrainError(f"{path}: cannot be written")
