"""Terrain evaluation: recipe to heights, normals, materials and plants, on a device and in float64."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.lazily import lazy_attributes

if TYPE_CHECKING:
    from sketchterrain.terrain.adherence import Adherence, measure_adherence
    from sketchterrain.terrain.answers import Raster, TerrainFeatures, Tile
    from sketchterrain.terrain.changes import changed_areas, touches
    from sketchterrain.terrain.device_verdict import Verdict, self_test
    from sketchterrain.terrain.from_sketch import build, make_recipe, rebuild
    from sketchterrain.terrain.materials import MATERIALS
    from sketchterrain.terrain.plant import SPECIES
    from sketchterrain.terrain.recipe import TerrainRecipe
    from sketchterrain.terrain.surfaces import SurfaceStore
    from sketchterrain.terrain.terrain import Terrain
    from sketchterrain.terrain.vertices import VertexStore

__all__ = [
    "MATERIALS",
    "SPECIES",
    "Adherence",
    "Raster",
    "SurfaceStore",
    "Terrain",
    "TerrainFeatures",
    "TerrainRecipe",
    "Tile",
    "Verdict",
    "VertexStore",
    "build",
    "changed_areas",
    "make_recipe",
    "measure_adherence",
    "rebuild",
    "self_test",
    "touches",
]

_MODULE = {
    **dict.fromkeys(("Adherence", "measure_adherence"), "adherence"),
    **dict.fromkeys(("Raster", "TerrainFeatures", "Tile"), "answers"),
    **dict.fromkeys(("changed_areas", "touches"), "changes"),
    **dict.fromkeys(("Verdict", "self_test"), "device_verdict"),
    **dict.fromkeys(("build", "make_recipe", "rebuild"), "from_sketch"),
    "MATERIALS": "materials",
    "SPECIES": "plant",
    "TerrainRecipe": "recipe",
    "SurfaceStore": "surfaces",
    "Terrain": "terrain",
    "VertexStore": "vertices",
}

__getattr__ = lazy_attributes(__name__, _MODULE)
