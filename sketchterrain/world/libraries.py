"""Libraries of the extra ``world``, which need not be installed."""

from collections.abc import Iterable
from importlib.util import find_spec

from sketchterrain.errors import SketchterrainError


def require(what: str, modules: Iterable[str]) -> None:
    """Raise SketchterrainError if a module that a task needs is not installed; none is imported."""
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        raise SketchterrainError(
            f"{what} needs {' and '.join(missing)}: not installed, "
            "get it with pip install 'sketchterrain[world]'"
        )
