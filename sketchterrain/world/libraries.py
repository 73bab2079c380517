"""Libraries of the extra ``world``, which need not be installed."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from sketchterrain.errors import SketchterrainError

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["require"]


def require(what: str, modules: Iterable[str]) -> None:
    """Check that all modules that a task needs are installed, without importing them.

    Raises
    ------
    SketchterrainError
        Naming the task, the missing modules and how to install them.
    """
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        raise SketchterrainError(
            f"{what} needs {' and '.join(missing)}: not installed, "
            "get it with pip install 'sketchterrain[world]'"
        )
