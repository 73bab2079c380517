"""The menu of sketches that were open before."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PyQt6.QtWidgets import QMenu, QWidget

from sketchterrain.ui.files import Files
from sketchterrain.ui.models.recent import RecentFiles


class RecentMenu(QMenu):
    """Opens what was open before."""

    def __init__(self, recent: RecentFiles, files: Files, parent: QWidget) -> None:
        super().__init__("Open &recent", parent)
        self._recent, self._files = recent, files
        recent.changed.connect(self._fill)
        self._fill()

    def _fill(self) -> None:
        self.clear()
        for number, path in enumerate(self._recent.paths, start=1):
            mark = f"&{number} " if number < 10 else ""
            action = self.addAction(f"{mark}{_short(path)}")
            if action is not None:
                action.setStatusTip(f"Open {path}")
                action.triggered.connect(partial(self._open, path))
        self.addSeparator()
        forget = self.addAction("&Forget these")
        if forget is not None:
            forget.setStatusTip("Empty this list")
            forget.triggered.connect(self._recent.clear)
        self.setEnabled(bool(self._recent.paths))

    def _open(self, path: Path, _: bool = False) -> None:
        self._files.open(path)


def _short(path: Path) -> str:
    """Return a path with ``~`` for the home folder; an ampersand in it marks no key."""
    home = Path.home()
    shown = f"~/{path.relative_to(home)}" if path.is_relative_to(home) else str(path)
    return shown.replace("&", "&&")
