"""Libraries that are not always there: each has an extra of ours that brings it."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from sketchterrain.errors import SketchterrainError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sketchterrain.export.target import Library

__all__ = ["missing", "require"]


def missing(libraries: Iterable[Library]) -> tuple[Library, ...]:
    """Return those that are not installed; nothing is loaded."""
    return tuple(each for each in libraries if find_spec(each.module) is None)


def require(what: str, libraries: Iterable[Library]) -> None:
    """Refuse work whose libraries are not all installed.

    Parameters
    ----------
    what
        That needs them, as a person knows it.
    libraries

    Raises
    ------
    SketchterrainError
        Naming them, and the extras that bring them.
    """
    lacking = missing(libraries)
    if lacking:
        names = " and ".join(each.module for each in lacking)
        extras = ",".join(sorted({each.extra for each in lacking}))
        raise SketchterrainError(
            f"{what} needs {names}: not installed, get it with pip install 'sketchterrain[{extras}]'"
        )
