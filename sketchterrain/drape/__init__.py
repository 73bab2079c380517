"""Draped layers: vectors and rasters shown on the terrain, in bounded memory."""
