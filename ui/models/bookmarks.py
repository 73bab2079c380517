"""Camera bookmarks by sketch, stored beside the program's state."""

import base64
import hashlib
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.errors import SketchterrainError
from sketchterrain.io.files import write_atomic
from sketchterrain.ui.engine.protocol import MODES, Pose
from sketchterrain.ui.models.document import Document

_MAX_NAME = 80  # characters


@dataclass(frozen=True)
class Bookmark:
    """A named camera pose, its mode (one of `MODES`) and a thumbnail (JPEG, may be empty)."""

    name: str
    pose: Pose
    mode: str = "orbit"
    picture: bytes = b""


class Bookmarks(QObject):
    """The bookmarks of the open sketch, stored by its path; an unreadable file counts as empty.

    They are not part of the sketch, which describes the terrain. An unsaved sketch's are stored on saving.
    """

    changed = pyqtSignal()
    failed = pyqtSignal(str)  # error of writing

    def __init__(self, document: Document | None, folder: Path, path: Path | None = None) -> None:
        super().__init__()
        self._document, self._folder = document, folder
        self._path = path if document is None else document.path
        self.all = self._read()
        if document is not None:
            document.opened.connect(self._on_opened)
            document.saved_changed.connect(self._on_saved)

    def free_name(self) -> str:
        """Return an unused name: ``View 3``."""
        names = {each.name for each in self.all}
        return next(name for number in range(1, len(names) + 2) if (name := f"View {number}") not in names)

    def add(self, bookmark: Bookmark) -> None:
        self._set((*self.all, bookmark))

    def rename(self, index: int, name: str) -> None:
        """Rename a bookmark; an empty name changes nothing."""
        name = " ".join(name.split())[:_MAX_NAME]
        if name and name != self.all[index].name:
            self._replace(index, replace(self.all[index], name=name))

    def renew(self, index: int, bookmark: Bookmark) -> None:
        """Replace a bookmark's pose and thumbnail."""
        self._replace(index, replace(bookmark, name=self.all[index].name))

    def delete(self, index: int) -> None:
        self._set(self.all[:index] + self.all[index + 1 :])

    def _replace(self, index: int, bookmark: Bookmark) -> None:
        self._set((*self.all[:index], bookmark, *self.all[index + 1 :]))

    def _set(self, bookmarks: tuple[Bookmark, ...]) -> None:
        self.all = bookmarks
        self._write()
        self.changed.emit()

    def _on_opened(self) -> None:
        self._path = None if self._document is None else self._document.path
        self.all = self._read()
        self.changed.emit()

    def _on_saved(self) -> None:
        """Store the bookmarks under the path that the sketch was saved at."""
        if self._document is not None and self._document.path != self._path:
            self._path = self._document.path
            self._write()

    def _file(self) -> Path | None:
        if self._path is None:
            return None
        name = hashlib.blake2b(str(self._path.absolute()).encode(), digest_size=12).hexdigest()
        return self._folder / f"{name}.json"

    def _read(self) -> tuple[Bookmark, ...]:
        file = self._file()
        try:
            table = json.loads(file.read_bytes()) if file is not None else {}
            return tuple(_bookmark(each) for each in table.get("bookmarks", []))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return ()

    def _write(self) -> None:
        file = self._file()
        if file is None or not (self.all or file.exists()):
            return
        table = {"sketch": str(self._path), "bookmarks": [_table(each) for each in self.all]}
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, json.dumps(table, indent=1).encode())
        except (OSError, SketchterrainError) as error:
            self.failed.emit(f"bookmarks cannot be saved: {error}")


def _table(bookmark: Bookmark) -> dict[str, Any]:
    pose = bookmark.pose
    return {
        "name": bookmark.name,
        "eye": pose.eye,
        "target": pose.target,
        "fov": pose.fov,
        "mode": bookmark.mode,
        "picture": base64.b64encode(bookmark.picture).decode(),
    }


def _bookmark(table: dict[str, Any]) -> Bookmark:
    """Return the bookmark of a table; raise ValueError if it is invalid."""
    numbers = [float(each) for each in (*table["eye"], *table["target"], table["fov"])]
    x, y, z, to_x, to_y, to_z, fov = numbers
    if not all(map(math.isfinite, numbers)) or (x, y, z) == (to_x, to_y, to_z) or not 1.0 <= fov <= 160.0:
        raise ValueError(f"invalid pose: {numbers}")
    if table["mode"] not in MODES:
        raise ValueError(f"expected one of {', '.join(MODES)}, got {table['mode']!r}")
    picture = base64.b64decode(table["picture"], validate=True)
    return Bookmark(str(table["name"]), Pose((x, y, z), (to_x, to_y, to_z), fov), table["mode"], picture)
