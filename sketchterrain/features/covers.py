"""Covers: what the material layer paints over the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.features.catalogue import Cover
from sketchterrain.features.rules import LAYER_CODES
from sketchterrain.features.shape_fields import shape_field
from sketchterrain.features.shapes import label_shapes
from sketchterrain.sketch import MATERIALS

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch

__all__ = ["lay_covers"]

# Pixels around a cover that its border may take, at fidelity 1 and at 0 (``terrain/field_packing.py``).
_MARGIN = (1.0, 7.0)


def lay_covers(sketch: Sketch) -> tuple[Cover, ...]:
    """Return the material layer's shapes that show at all, in reading order of their first pixels.

    Shapes of one layer do not overlap; where two borders meet, the later one lies on top.
    """
    sharp, loose = _MARGIN
    margin = (loose + (sharp - loose) * sketch.fidelity) * sketch.pixel_size
    covers = []
    for shape in label_shapes("material", sketch.layers["material"]):
        properties = sketch.properties("material", shape.label)
        strength = float(properties["strength"])
        if strength <= 0:
            continue
        field = shape_field(sketch, shape, margin=margin)
        material = MATERIALS.index(str(properties["material"]))
        name = LAYER_CODES["material"] << 48 | shape.id
        covers.append(Cover(name, shape.label, field, material, strength))
    return tuple(covers)
