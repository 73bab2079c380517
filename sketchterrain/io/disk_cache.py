"""Caches on disk of what takes long to compute and depends on the program, or on few settings, alone."""

from __future__ import annotations

import hashlib
import os
import secrets
import shutil
import sqlite3
import time
import weakref
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any, Final

from sketchterrain.errors import SketchterrainError
from sketchterrain.io.files import atomic_file, cache_folder

_DONE: Final = "complete"  # a file in a finished folder
_STALE: Final = 86400.0  # s after which an unfinished folder is abandoned
_SUFFIX: Final = ".cached"
_DIGEST: Final = hashlib.sha256().digest_size
_SCHEMA: Final = """
PRAGMA synchronous = OFF;
CREATE TABLE IF NOT EXISTS records (a INT, b INT, c INT, d INT, content BLOB, PRIMARY KEY (a, b, c, d));
"""


def cached_bytes(
    family: str,
    recipe: str,
    compute: Callable[[], bytes | memoryview],
    folder: Path | None = None,
    *,
    max_bytes: int = 0,
) -> bytes | memoryview:
    """Return bytes that depend on `recipe` alone, from the cache folder or computed and then stored.

    When they are written, other files of the family that were not read for longest are deleted as far as all
    exceed `max_bytes`.
    """
    folder = folder or cache_folder()
    path = folder / f"{_name(family, recipe)}{_SUFFIX}"
    cached = _read(path)
    if cached is not None:
        with suppress(OSError):
            os.utime(path)
        return cached
    computed = compute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as stream:
            stream.write(hashlib.sha256(computed).digest())
            stream.write(computed)
        delete_old(folder.glob(f"{family}-*{_SUFFIX}"), max_bytes)
    except (OSError, SketchterrainError):
        pass  # a full or read-only disk costs time, no more
    return computed


def is_cached(family: str, recipe: str) -> bool:
    """Return whether the cache folder has bytes of `cached_bytes`, which may be corrupt."""
    return (cache_folder() / f"{_name(family, recipe)}{_SUFFIX}").is_file()


def _name(family: str, recipe: str) -> str:
    return f"{family}-{hashlib.blake2b(recipe.encode(), digest_size=12).hexdigest()}"


def _read(path: Path) -> memoryview | None:
    """Return the content after its SHA-256, or None if the file is missing or corrupt."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    body = memoryview(content)[_DIGEST:]
    return body if hashlib.sha256(body).digest() == content[:_DIGEST] else None


def stored_folder(
    family: str, recipe: str, build: Callable[[Path], None], *, max_bytes: int = 8 << 30
) -> Path:
    """Return a folder of files that depend on `recipe` alone, which `build` writes if it is missing.

    Before, those of the family that were not asked for for longest are deleted as far as they exceed
    `max_bytes`.
    """
    parent = cache_folder()
    parent.mkdir(parents=True, exist_ok=True)
    folder = parent / _name(family, recipe)

    def build_whole(temporary: Path) -> None:
        build(temporary)
        (temporary / _DONE).touch()

    if not (folder / _DONE).is_file():
        delete_old([*parent.glob(f"{family}-*/"), *parent.glob(f".{family}-*/")], max_bytes)
        write_folder(folder, build_whole, (folder / _DONE).is_file)
    os.utime(folder)
    return folder


def write_folder(folder: Path, build: Callable[[Path], None], is_done: Callable[[], bool]) -> None:
    """Have `build` write a folder that appears as a whole, unless another process has done it meanwhile."""
    temporary = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}")
    temporary.mkdir(parents=True)
    try:
        build(temporary)
        if not is_done():
            shutil.rmtree(folder, ignore_errors=True)
            temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def delete_old(paths: Iterable[Path], max_bytes: int) -> None:
    """Delete files or folders opened longest ago, beyond so many bytes of all, and abandoned ones."""
    total, now = 0, time.time()
    with suppress(OSError):
        for number, path in enumerate(sorted(paths, key=_opened, reverse=True)):
            total += sum(each.stat().st_size for each in (path.iterdir() if path.is_dir() else [path]))
            is_unfinished = path.name.startswith(".")
            if now - _opened(path) > _STALE if is_unfinished else number and total > max_bytes:
                shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)


class RecordCache:
    """Byte strings by four integers, in one SQLite file for each `recipe`; thread-safe.

    A file holds at most a quarter of `max_bytes`; of the files of a family, those that were not opened for
    longest are deleted when they exceed it. Without a usable file nothing is cached.
    """

    def __init__(
        self, family: str, recipe: str, *, max_bytes: int = 1 << 28, folder: Path | None = None
    ) -> None:
        self._lock, self._left = Lock(), max_bytes // 4
        self._database: sqlite3.Connection | None = None
        try:
            folder = folder or cache_folder()
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / f"{_name(family, recipe)}.sqlite"
            database = sqlite3.connect(path, check_same_thread=False)
            weakref.finalize(self, database.close)
            database.executescript(_SCHEMA)
            self._left -= path.stat().st_size
            os.utime(path)
            delete_old(folder.glob(f"{family}-*.sqlite"), max_bytes)
            self._database = database
        except (OSError, sqlite3.Error):
            pass

    def get(self, key: tuple[int, int, int, int]) -> bytes | None:
        """Return what was added, or None."""
        select = "SELECT content FROM records WHERE (a, b, c, d) = (?, ?, ?, ?)"
        row = self._run(lambda database: database.execute(select, key).fetchone())
        return row[0] if row else None

    def add(self, contents: Mapping[tuple[int, int, int, int], bytes]) -> None:
        """Add byte strings, as far as there is room."""
        self._left -= sum(map(len, contents.values()))
        if self._left > 0:
            insert = "INSERT OR IGNORE INTO records VALUES (?, ?, ?, ?, ?)"
            rows = [(*key, content) for key, content in contents.items()]
            self._run(lambda database: database.executemany(insert, rows))

    def _run(self, work: Callable[[sqlite3.Connection], Any]) -> Any:
        """Return the result of a transaction, or None without a usable file."""
        with self._lock:
            if self._database is not None:
                try:
                    with self._database:
                        return work(self._database)
                except sqlite3.Error:  # a damaged file, or a full disk
                    self._database = None
            return None


def _opened(path: Path) -> float:
    return path.stat().st_mtime
