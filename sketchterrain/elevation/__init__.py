"""Real elevation: overlapping DEM grids as one smooth surface (patchwork terrain)."""
