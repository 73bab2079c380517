"""Made textures kept on disk between runs: a cache that may be lost, broken or forbidden without harm."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Final

from sketchterrain.disk import cache_folder
from sketchterrain.errors import SketchterrainError
from sketchterrain.whole_files import write_atomic

_SUFFIX: Final = ".textures"
_DIGEST: Final = hashlib.sha256().digest_size
"""Bytes of the checksum in front of what is kept."""


def kept(
    family: str, recipe: str, size: int, make: Callable[[], bytes], folder: Path | None = None
) -> bytes | memoryview:
    """Return bytes that follow from a recipe: from the disk if they are there and whole, else made.

    Parameters
    ----------
    family
        Of what they are one. Others of the family are of older recipes, and are deleted when this is written.
    recipe
        All that they follow from.
    size
        How many they are.
    make
        Makes them.
    folder
        By default `cache_folder`.
    """
    try:
        folder = folder or cache_folder()
    except RuntimeError:  # there is no home
        return make()
    name = hashlib.blake2b(recipe.encode(), digest_size=12).hexdigest()
    path = folder / f"{family}-{name}{_SUFFIX}"
    found = _read(path, size)
    if found is not None:
        return found
    made = make()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, _checksum(made) + made)
        for old in folder.glob(f"{family}-*{_SUFFIX}"):
            if old != path:
                old.unlink(missing_ok=True)
    except (OSError, SketchterrainError):
        pass  # a disk that is full or read-only costs time, no more
    return made


def _read(path: Path, size: int) -> memoryview | None:
    try:
        if path.stat().st_size != _DIGEST + size:
            return None
        content = path.read_bytes()
    except OSError:
        return None
    body = memoryview(content)[_DIGEST:]
    return body if _checksum(body) == content[:_DIGEST] else None


def _checksum(content: bytes | memoryview) -> bytes:
    return hashlib.sha256(content).digest()
