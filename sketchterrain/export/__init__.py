"""Writers of terrains for engines, GIS and image programs: atomic and deterministic."""
