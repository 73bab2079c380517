"""Sketchterrain: paint a rough sketch, get a seamless terrain that does what the sketch says.

>>> import sketchterrain as st
>>> terrain = st.build(st.load_sketch("valley_river"), seed=7)  # doctest: +SKIP
>>> terrain.heights(1000.0, 2000.0)  # doctest: +SKIP
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.lazily import lazy_attributes

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch, load_sketch, new_sketch, save_sketch
    from sketchterrain.terrain import MATERIALS, SPECIES, Terrain, Tile, build

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

_ROOM = {
    **dict.fromkeys(("Sketch", "load_sketch", "new_sketch", "save_sketch"), "sketch"),
    **dict.fromkeys(("MATERIALS", "SPECIES", "Terrain", "Tile", "build"), "terrain"),
}

__getattr__ = lazy_attributes(__name__, _ROOM)
