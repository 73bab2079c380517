"""What went wrong, told in one line each: the engine's troubles, and errors nobody foresaw."""

from __future__ import annotations

import sys
import threading
import traceback
from typing import TYPE_CHECKING

from PyQt6.QtCore import QObject, pyqtSignal
from PyQt6.QtGui import QGuiApplication
from PyQt6.QtWidgets import QDialog, QDialogButtonBox, QLabel, QPlainTextEdit, QVBoxLayout

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.ui.banner import Message
from sketchterrain.ui.look.theme import MARGIN, SPACING

if TYPE_CHECKING:
    from types import TracebackType

    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.banner import Banner
    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.engine.messages import Trouble

__all__ = ["Surprises", "Troubles"]


class Troubles(QObject):
    """Tells the engine's troubles in the banner, and takes them back when they are over.

    Parameters
    ----------
    banner, link
    """

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

    def _tell(self, trouble: Trouble) -> None:
        if trouble.what == "engine":
            buttons = (("Start again", self._link.start),)
            self._banner.tell(Message("error", trouble.line, "engine", buttons))
        else:
            kind = "warning" if trouble.what in ("sketch", "view") else "error"
            self._banner.tell(Message(kind, trouble.line, trouble.what))


class Surprises(QObject):
    """Catches errors that nothing else caught: a line in the banner, the rest on request.

    The window stays, and what was painted stays in it.

    Parameters
    ----------
    banner
    window
        Whose dialog shows the details.
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
