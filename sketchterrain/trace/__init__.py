"""A starting sketch from what people have: coloured maps, layers of a paint program, vectors of a GIS."""
