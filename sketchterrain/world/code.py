"""Which code it is that a world's bytes follow from."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from importlib.resources import files
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator
    from importlib.resources.abc import Traversable

__all__ = ["code_digest"]

_ROOMS: Final = ("sketch", "features", "compute", "terrain", "export", "world", "kernels")
_ENDINGS = (".py", ".cl", ".clh")


@cache
def code_digest() -> str:
    """Return the SHA-256 of the code and the kernels that a world's bytes follow from."""
    digest = sha256()
    for room in _ROOMS:
        for each in sorted(_sources(files(f"sketchterrain.{room}")), key=lambda found: found.name):
            digest.update(f"{room}/{each.name}\n".encode())
            digest.update(each.read_bytes())
    return digest.hexdigest()


def _sources(folder: Traversable) -> Iterator[Traversable]:
    return (each for each in folder.iterdir() if each.name.endswith(_ENDINGS) and each.is_file())
