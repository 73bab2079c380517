"""Places to look from that a person keeps, by sketch: in a file of their own beside the program's state."""

from __future__ import annotations

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

_LONGEST = 80  # letters of a name


@dataclass(frozen=True)
class Bookmark:
    """A place to look from.

    Attributes
    ----------
    name : str
    pose : Pose
    mode : str
        One of `MODES`.
    picture : bytes
        A small JPEG of what was seen; empty: none.
    """

    name: str
    pose: Pose
    mode: str = "orbit"
    picture: bytes = b""


class Bookmarks(QObject):
    """The bookmarks of the sketch that is open.

    They are kept by the sketch's path, for a sketch is about the terrain and not about who looks at it. Those
    of a sketch that was never saved are kept with it as soon as it is. A file that cannot be read counts as
    none.
    """

    changed = pyqtSignal()
    """There are other ones."""
    failed = pyqtSignal(str)
    """They cannot be written: why."""

    def __init__(self, document: Document | None, folder: Path, path: Path | None = None) -> None:
        super().__init__()
        self._document, self._folder = document, folder
        self._path = path if document is None else document.path
        self._all = self._read()
        if document is not None:
            document.opened.connect(self._open)
            document.saved_changed.connect(self._follow)

    @property
    def all(self) -> tuple[Bookmark, ...]:
        """In their order."""
        return self._all

    def free_name(self) -> str:
        """Return a name that none has: ``View 3``."""
        names = {each.name for each in self._all}
        return next(name for number in range(1, len(names) + 2) if (name := f"View {number}") not in names)

    def add(self, bookmark: Bookmark) -> None:
        """Keep one more, as the last."""
        self._set((*self._all, bookmark))

    def rename(self, index: int, name: str) -> None:
        """Give one another name; an empty one changes nothing."""
        name = " ".join(name.split())[:_LONGEST]
        if name and name != self._all[index].name:
            self._set(self._with(index, replace(self._all[index], name=name)))

    def renew(self, index: int, bookmark: Bookmark) -> None:
        """Let one be about another place, under its own name."""
        self._set(self._with(index, replace(bookmark, name=self._all[index].name)))

    def delete(self, index: int) -> None:
        """Keep one no longer."""
        self._set(self._all[:index] + self._all[index + 1 :])

    def _with(self, index: int, bookmark: Bookmark) -> tuple[Bookmark, ...]:
        return (*self._all[:index], bookmark, *self._all[index + 1 :])

    def _set(self, bookmarks: tuple[Bookmark, ...]) -> None:
        self._all = bookmarks
        self._write()
        self.changed.emit()

    def _open(self) -> None:
        self._path = None if self._document is None else self._document.path
        self._all = self._read()
        self.changed.emit()

    def _follow(self) -> None:
        """Keep them by another path, after the sketch was saved there."""
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
        if file is None or not (self._all or file.exists()):
            return
        table = {"sketch": str(self._path), "bookmarks": [_table(each) for each in self._all]}
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, json.dumps(table, indent=1).encode())
        except (OSError, SketchterrainError) as error:
            self.failed.emit(f"bookmarks cannot be kept: {error}")


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
    """Return what a table says."""
    numbers = [float(each) for each in (*table["eye"], *table["target"], table["fov"])]
    if len(numbers) != 7 or not all(math.isfinite(each) for each in numbers) or numbers[:3] == numbers[3:6]:
        raise ValueError("expected an eye and a target of three numbers each, and a field of view")
    if table["mode"] not in MODES or not 1.0 <= numbers[6] <= 160.0:
        raise ValueError(f"expected one of {', '.join(MODES)} and a field of view from 1 to 160 degrees")
    x, y, z, to_x, to_y, to_z, fov = numbers
    picture = base64.b64decode(table["picture"], validate=True)
    return Bookmark(str(table["name"]), Pose((x, y, z), (to_x, to_y, to_z), fov), table["mode"], picture)
