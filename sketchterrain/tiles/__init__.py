"""Tiles: quadtree, level of detail, streaming."""
