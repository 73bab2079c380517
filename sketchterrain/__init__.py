"""Sketchterrain: paint a rough sketch, get a seamless terrain that does what the sketch says.

>>> import sketchterrain as st
>>> terrain = st.build(st.load_sketch("valley_river"), seed=7)  # doctest: +SKIP
>>> terrain.heights(1000.0, 2000.0)  # doctest: +SKIP
"""

import importlib
from typing import TYPE_CHECKING, Any

from sketchterrain.document.materials import MATERIALS

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.document.store import load_sketch, new_sketch, save_sketch
    from sketchterrain.terrain.building import build
    from sketchterrain.terrain.surfaces import Tile
    from sketchterrain.terrain.terrain import Terrain
    from sketchterrain.vegetation.plants import SPECIES

_MODULES = {
    "MATERIALS": "document.materials",
    "SPECIES": "vegetation.plants",
    "Sketch": "document.sketch",
    "Terrain": "terrain.terrain",
    "Tile": "terrain.surfaces",
    "build": "terrain.building",
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


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562), so that importing the package loads no driver."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
