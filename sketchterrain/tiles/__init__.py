"""Which tile at what level: pure logic, no GPU and no terrain."""

from sketchterrain.tiles.quadtree import QUADS, TileKey, inside_frustum, select_tiles

__all__ = ["QUADS", "TileKey", "inside_frustum", "select_tiles"]
