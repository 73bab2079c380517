"""Caches on disk of what takes long to compute and depends on the program, or on few settings, alone."""

from __future__ import annotations

import atexit
import hashlib
import os
import secrets
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from threading import Lock, Timer
from typing import Final

from sketchterrain.errors import SketchterrainError
from sketchterrain.io.files import cache_folder, write_atomic

_SUFFIX: Final = ".cached"
_DIGEST: Final = hashlib.sha256().digest_size
_HEAD: Final = struct.Struct("<4qI")  # a record's key and CRC-32; those of a file precede its records
_DELAY: Final = 3.0  # s


def cached_bytes(
    family: str, recipe: str, compute: Callable[[], bytes], folder: Path | None = None
) -> bytes | memoryview:
    """Return bytes that depend on `recipe` alone, from the cache folder or computed and then stored.

    Other cache files of the same family are of older recipes and are deleted when this one is written.
    """
    try:
        folder = folder or cache_folder()
    except RuntimeError:  # no home directory
        return compute()
    path = folder / f"{_name(family, recipe)}{_SUFFIX}"
    cached = _read(path)
    if cached is not None:
        return cached
    computed = compute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, hashlib.sha256(computed).digest() + computed)
        for old in folder.glob(f"{family}-*"):
            if old != path:
                old.unlink(missing_ok=True)
    except (OSError, SketchterrainError):
        pass  # a full or read-only disk costs time, no more
    return computed


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


class RecordCache:
    """Records of one size that depend on `recipe` and a key of four integers, in few files; thread-safe.

    A thread writes what is added during some seconds into one file. When the family's files exceed
    `max_bytes`, those that were not opened for longest are deleted; a process writes at most a quarter of
    it. Records that cannot be read or written are as if they were not cached.
    """

    def __init__(
        self, family: str, recipe: str, size: int, *, max_bytes: int = 1 << 28, folder: Path | None = None
    ) -> None:
        self._family, self._name, self._size = family, _name(family, recipe), size
        self._max_bytes, self._left = max_bytes, max_bytes // 4
        self._index: dict[tuple[int, ...], tuple[Path, int, int]] = {}
        self._pending: dict[tuple[int, ...], bytes] = {}
        self._lock, self._writing = Lock(), Lock()
        try:
            self._folder = folder or cache_folder()
            for path in self._files(self._name):
                self._open(path)
                os.utime(path)  # the most recently used
        except (OSError, RuntimeError):  # or no home directory
            self._left = 0
        atexit.register(self.flush)

    def get(self, key: tuple[int, int, int, int]) -> bytes | None:
        """Return a record, or None if it is missing or corrupt."""
        try:
            path, start, check = self._index[key]
            with path.open("rb") as stream:
                stream.seek(start)
                content = stream.read(self._size)
        except (KeyError, OSError):
            return None
        return content if _check(key, content) == check else None

    def add(self, key: tuple[int, int, int, int], content: bytes) -> None:
        """Write a record soon."""
        with self._lock:
            self._left -= self._size
            if self._left >= 0 and not self._pending:
                timer = Timer(_DELAY, self.flush)
                timer.daemon = True
                timer.start()
            if self._left >= 0:
                self._pending[key] = content

    def flush(self) -> None:
        """Write what was added."""
        with self._writing:
            with self._lock:
                records, self._pending = self._pending, {}
            if not records:
                return
            heads = (_HEAD.pack(*key, _check(key, content)) for key, content in records.items())
            path, total = self._folder / f"{self._name}-{secrets.token_hex(4)}{_SUFFIX}", 0
            try:
                self._folder.mkdir(parents=True, exist_ok=True)
                self._open(write_atomic(path, b"".join((*heads, *records.values()))))
                for old in reversed(self._files(self._family)):
                    total += old.stat().st_size
                    if total > self._max_bytes:
                        old.unlink()
            except (OSError, SketchterrainError):
                pass  # a full or read-only disk costs time, no more

    def _files(self, name: str) -> list[Path]:
        """Return the files of a name, those opened last at the end."""
        return sorted(self._folder.glob(f"{name}-*{_SUFFIX}"), key=lambda path: path.stat().st_mtime)

    def _open(self, path: Path) -> None:
        """Read where a file has which records."""
        count = path.stat().st_size // (_HEAD.size + self._size)
        with path.open("rb") as stream:
            heads = stream.read(count * _HEAD.size)
        for number, (*key, check) in enumerate(_HEAD.iter_unpack(heads)):
            self._index[tuple(key)] = path, len(heads) + number * self._size, check


def _check(key: tuple[int, ...], content: bytes) -> int:
    return zlib.crc32(content, zlib.crc32(struct.pack("<4q", *key)))
