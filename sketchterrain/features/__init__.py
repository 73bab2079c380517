"""From a sketch to placed features: shapes, user features, placement, the fill, rivers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.lazily import lazy_attributes

if TYPE_CHECKING:
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

_MODULE = {
    **dict.fromkeys(
        ("FEATURE", "FEATURE_TYPES", "FILL_BIT", "Cover", "Lake", "River", "ShapeField"), "catalogue"
    ),
    "Fill": "fill",
    "PaintedDistance": "painted_distance",
    "place": "placement",
    "trace_rivers": "rivers",
    **dict.fromkeys(("Shape", "label_shapes"), "shapes"),
    "sample_catmull_rom": "splines",
}

__getattr__ = lazy_attributes(__name__, _MODULE)
