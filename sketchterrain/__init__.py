"""Sketchterrain: paint a rough sketch, get a seamless terrain that does what the sketch says.

>>> import sketchterrain as st
>>> terrain = st.build(st.load_sketch("valley_river"), seed=7)  # doctest: +SKIP
>>> terrain.heights(1000.0, 2000.0)  # doctest: +SKIP
"""

import atexit
import importlib
import os
import shutil
import tempfile
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from sketchterrain.io.files import cache_folder
from sketchterrain.schema.materials import MATERIALS

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.document.store import load_sketch, new_sketch, save_sketch
    from sketchterrain.generation.building import build
    from sketchterrain.generation.terrain import Terrain
    from sketchterrain.terrain.surfaces import Tile
    from sketchterrain.vegetation.plants import SPECIES

_MODULES = {
    "MATERIALS": "document.materials",
    "SPECIES": "vegetation.plants",
    "Sketch": "document.sketch",
    "Terrain": "generation.terrain",
    "Tile": "terrain.surfaces",
    "build": "generation.building",
    "load_sketch": "document.store",
    "new_sketch": "document.store",
    "save_sketch": "document.store",
}

__all__ = [
    "MATERIALS",
    "SPECIES",
    "Sketch",
    "Terrain",
    "Tile",
    "build",
    "load_sketch",
    "new_sketch",
    "save_sketch",
]


def _ensure_writable_cache() -> None:
    """Set ``XDG_CACHE_HOME`` to a temporary folder where the user's is missing, read-only or full."""
    # Drivers and pyopencl follow the variable too, and raise there; child processes inherit it.
    with suppress(OSError, RuntimeError):  # RuntimeError: no home folder
        folder = cache_folder().parent
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):  # by its permissions root may write anywhere
            if shutil.disk_usage(folder).free >= 1 << 26:  # bytes, for programs of all drivers
                if "XDG_CACHE_HOME" in os.environ:  # libraries also take a relative path
                    os.environ["XDG_CACHE_HOME"] = str(folder)
                return
    with suppress(OSError):  # not even temporary files: commands tell
        temporary = os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="sketchterrain-cache-")
        atexit.register(shutil.rmtree, temporary, ignore_errors=True)


_ensure_writable_cache()


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562), so that importing the package loads no driver."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
