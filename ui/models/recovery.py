"""Sketches kept in case of a crash: a file each, and a lock that its program holds while it lives."""

from __future__ import annotations

import json
import os
import secrets
import zipfile
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from sketchterrain.sketch import Sketch, packed_sketch
from sketchterrain.system import lock_file
from sketchterrain.whole_files import write_whole

_ABOUT = "recovery.json"


@dataclass(frozen=True)
class Recovery:
    """A sketch that a program kept, and did not come to save.

    Attributes
    ----------
    path : Path
        A ``*.sketch`` file that can be loaded.
    name : str
        What the sketch is called.
    when : datetime
        When it was kept.
    original : Path or None
        Where it had been saved before.
    """

    path: Path
    name: str
    when: datetime
    original: Path | None

    @property
    def was_saved_since(self) -> bool:
        """Whether the sketch that it had been saved as was written to later: it may hold all of this."""
        if self.original is None:
            return False
        try:
            files = self.original.iterdir() if self.original.is_dir() else [self.original]
            times = [each.stat().st_mtime for each in files if each.is_file()]
        except OSError:  # it is out of reach now
            return False
        return max(times, default=0.0) > self.when.timestamp()


class Lock:
    """Held by one program at a time; it goes with the program, however that ends."""

    def __init__(self, path: Path) -> None:
        self._path = path.with_suffix(".lock")
        self._file = self._opened()
        while not self._is_there():  # whoever held it removed it meanwhile
            self._file.close()
            self._file = self._opened()

    def release(self) -> None:
        """Let others have it."""
        self._file.close()

    def remove(self) -> None:
        """Let it go, for what it guarded is no more."""
        self._path.unlink(missing_ok=True)
        self._file.close()

    def _opened(self) -> IO[bytes]:
        file = self._path.open("ab")
        try:
            lock_file(file.fileno())
        except OSError:
            file.close()
            raise
        return file

    def _is_there(self) -> bool:
        try:
            return self._path.stat().st_ino == os.fstat(self._file.fileno()).st_ino
        except FileNotFoundError:
            return False


def new_place(folder: Path) -> Path:
    """Return a name in a folder under which no other program keeps a sketch."""
    return folder / f"{os.getpid()}-{secrets.token_hex(4)}.sketch"


def write_recovery(path: Path, sketch: Sketch, original: Path | None) -> None:
    """Keep a sketch, whole or not at all."""
    about = {
        "name": sketch.name,
        "when": datetime.now(UTC).isoformat(),
        "original": None if original is None else str(original.absolute()),
    }
    write_whole(path, packed_sketch(sketch, beside={_ABOUT: json.dumps(about).encode("utf-8")}))


def read_recovery(path: Path) -> Recovery | None:
    """Return what is known of a sketch that was kept; None if it is none of ours, or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            about = json.loads(archive.read(_ABOUT))
        original = about["original"]
        when = datetime.fromisoformat(about["when"])
        return Recovery(path, str(about["name"]), when, None if original is None else Path(original))
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
        return None


def places_in(folder: Path) -> list[Path]:
    """Return where programs keep sketches in a folder, or were about to; dead ones and living ones."""
    return sorted(
        {path.with_suffix(".sketch") for kind in ("sketch", "lock") for path in folder.glob(f"*.{kind}")}
    )
