"""Quadtree of terrain tiles: level of detail, morphing and streaming. Pure logic, no GPU and no terrain."""

from sketchterrain.tiles.borders import tile_indices
from sketchterrain.tiles.codes import TileKey
from sketchterrain.tiles.metrics import QuadLength, ScreenError
from sketchterrain.tiles.morph import morph_weights
from sketchterrain.tiles.orders import Batch, DrawList
from sketchterrain.tiles.stream import QUADS, TileStream
from sketchterrain.tiles.view import CameraView, inside_frustum

__all__ = [
    "QUADS",
    "Batch",
    "CameraView",
    "DrawList",
    "QuadLength",
    "ScreenError",
    "TileKey",
    "TileStream",
    "inside_frustum",
    "morph_weights",
    "tile_indices",
]
