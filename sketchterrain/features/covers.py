"""Covers: what the material layer paints over the ground."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sketchterrain.features.catalogue import Cover
from sketchterrain.features.recent import IdentityKey, LRUCache
from sketchterrain.features.rules import LAYER_CODES
from sketchterrain.features.shape_fields import shape_field
from sketchterrain.features.shapes import label_shapes
from sketchterrain.sketch import MATERIALS

if TYPE_CHECKING:
    from sketchterrain.features.memory import PlacementCache
    from sketchterrain.sketch import Sketch

# Pixels around a cover that its border may take, at fidelity 1 and at 0 (``terrain/field_packing.py``).
_MARGIN = (1.0, 7.0)


@dataclass(frozen=True)
class CoverMemory:
    """Covers by what they were made from."""

    known: LRUCache = field(default_factory=lambda: LRUCache(4))


def create_covers(sketch: Sketch, *, memory: PlacementCache | None = None) -> tuple[Cover, ...]:
    """Return the material layer's shapes that show at all, in reading order of their first pixels.

    Shapes of one layer do not overlap; where two borders meet, the later one lies on top.

    Parameters
    ----------
    sketch : Sketch
    memory : PlacementCache, optional
        From the last time. What was not painted since is the very same object.
    """
    if memory is None:
        return _laid(sketch)
    labels = tuple((key, tuple(each.items())) for key, each in sketch.labels.items() if key[0] == "material")
    key = (IdentityKey(sketch.layers["material"]), sketch.extent, sketch.fidelity, labels)
    covers: tuple[Cover, ...] = memory.part(CoverMemory).known.of(key, lambda: _laid(sketch))
    return covers


def _laid(sketch: Sketch) -> tuple[Cover, ...]:
    sharp, loose = _MARGIN
    margin = (loose + (sharp - loose) * sketch.fidelity) * sketch.pixel_size
    covers = []
    for shape in label_shapes("material", sketch.layers["material"]):
        properties = sketch.properties("material", shape.label)
        strength = float(properties["strength"])
        if strength <= 0:
            continue
        shown = shape_field(sketch, shape, margin=margin)
        material = MATERIALS.index(str(properties["material"]))
        name = LAYER_CODES["material"] << 48 | shape.id
        covers.append(Cover(name, shape.label, shown, material, strength))
    return tuple(covers)
