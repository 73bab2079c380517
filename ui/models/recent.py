"""Which sketches were open lately."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.errors import SketchterrainError
from sketchterrain.whole_files import write_whole

_MOST = 12


class RecentFiles(QObject):
    """Paths of sketches, the newest first, kept in a file.

    Other programs of ours may write that file too: it is read before each change. Where it cannot be read or
    written, paths are known until the program ends.
    """

    changed = pyqtSignal()

    def __init__(self, file: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._file = file
        self._paths: tuple[Path, ...] = ()
        self._is_kept = True
        self._read()

    @property
    def paths(self) -> tuple[Path, ...]:
        """The newest first, twelve at most; some may be gone."""
        return self._paths

    def add(self, path: Path) -> None:
        """Put a path first."""
        self._read()
        whole = path.absolute()
        self._keep([whole, *(each for each in self._paths if each != whole)][:_MOST])

    def forget(self, path: Path) -> None:
        """Drop a path, if it is there."""
        self._read()
        whole = path.absolute()
        self._keep([each for each in self._paths if each != whole])

    def clear(self) -> None:
        """Drop all paths."""
        self._keep([])

    def _read(self) -> None:
        if not self._is_kept:
            return
        try:
            found = json.loads(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return
        if isinstance(found, list):
            self._paths = tuple(Path(each) for each in found if isinstance(each, str))[:_MOST]

    def _keep(self, paths: Sequence[Path]) -> None:
        if tuple(paths) == self._paths:
            return
        self._paths = tuple(paths)
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._file, json.dumps([str(path) for path in paths], indent=1).encode("utf-8"))
            self._is_kept = True
        except (OSError, SketchterrainError):
            self._is_kept = False  # not worth a message
        self.changed.emit()
