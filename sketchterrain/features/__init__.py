"""From a sketch to placed features: shapes, user features, placement, the fill, rivers."""

from __future__ import annotations

from sketchterrain.features.catalogue import (
    FEATURE,
    FEATURE_TYPES,
    FILL_BIT,
    Cover,
    Lake,
    River,
    ShapeField,
)
from sketchterrain.features.fill import Fill
from sketchterrain.features.painted_distance import PaintedDistance
from sketchterrain.features.placement import place
from sketchterrain.features.rivers import trace_rivers
from sketchterrain.features.shapes import Shape, label_shapes
from sketchterrain.features.splines import sample_catmull_rom

__all__ = [
    "FEATURE",
    "FEATURE_TYPES",
    "FILL_BIT",
    "Cover",
    "Fill",
    "Lake",
    "PaintedDistance",
    "River",
    "Shape",
    "ShapeField",
    "label_shapes",
    "place",
    "sample_catmull_rom",
    "trace_rivers",
]
