"""A cache on disk of what takes long to compute and depends on the program alone."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Final

from sketchterrain.errors import SketchterrainError
from sketchterrain.io.files import cache_folder, write_atomic

_SUFFIX: Final = ".cached"
_DIGEST: Final = hashlib.sha256().digest_size


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
    name = hashlib.blake2b(recipe.encode(), digest_size=12).hexdigest()
    path = folder / f"{family}-{name}{_SUFFIX}"
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


def _read(path: Path) -> memoryview | None:
    """Return the content after its SHA-256, or None if the file is missing or corrupt."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    body = memoryview(content)[_DIGEST:]
    return body if hashlib.sha256(body).digest() == content[:_DIGEST] else None
