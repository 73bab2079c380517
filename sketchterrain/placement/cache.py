"""The cache of intermediate results of placement and hydrology."""

from __future__ import annotations

from hashlib import blake2b
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.caching import IdentityKey, LRUCache, Value
from sketchterrain.placement.density import DensityCache, painted_distance
from sketchterrain.placement.shapes import Region, find_regions, measure_shape
from sketchterrain.placement.user_features import USER_FEATURE, user_features

if TYPE_CHECKING:
    from sketchterrain.document.label_layers import LabelImage
    from sketchterrain.document.sketch import Sketch


class PlacementCache:
    """Intermediate results of placing features and tracing rivers, bit-equal to fresh ones.

    Thread-safe: values are never modified, only replaced. Shapes are keyed by their pixels, position and
    settings; layers by the identity of their image, which sketches never modify.
    """

    def __init__(self, *, shapes: int = 16384) -> None:
        self.shapes = LRUCache(shapes)
        self.layers = LRUCache(32)  # results of whole layers
        self.rivers = LRUCache(256)  # results of single rivers and of groups of them
        self.candidates = LRUCache(128)  # of the fill around the sketch
        self._paint_distances = LRUCache(32)
        self._densities: dict[tuple[str, str], DensityCache] = {}
        self._parts: dict[type, Any] = {}

    def part(self, kind: type[Value]) -> Value:
        """Return the cache of another stage, one instance per class."""
        found: Value = self._parts.setdefault(kind, kind())
        return found

    def density(self, feature: str, term: str) -> DensityCache:
        """Return the density cache of one term of a feature type's preferences."""
        return self._densities.setdefault((feature, term), DensityCache())

    def regions(self, image: LabelImage) -> tuple[Region, ...]:
        """Return the connected regions of a layer's image."""
        return self.layers.get_or_compute(("regions", IdentityKey(image)), lambda: find_regions(image))

    def distance_to_paint(self, sketch: Sketch, layer: str, positions: Float64Array) -> Float64Array:
        """Return the distance (m) from positions (..., 2) to a layer's painted pixels."""
        distance = painted_distance(sketch.layers[layer], sketch.pixel_size)
        key = (IdentityKey(distance), positions.shape, blake2b(positions.tobytes()).digest())
        return self._paint_distances.get_or_compute(
            key, lambda: distance(positions[..., 0], positions[..., 1])
        )

    def user_features(self, sketch: Sketch, layer: str, *, seed: int) -> StructuredArray:
        """Return the user features of a layer, sorted by id; the sketch's own seed is ignored."""
        image = sketch.layers[layer]
        declared = tuple((key, _multitude(sketch, *key)) for key in sketch.labels if key[0] == layer)

        def compute() -> StructuredArray:
            parts = [np.zeros(0, dtype=USER_FEATURE)]
            parts += [self._of_region(sketch, layer, region, seed) for region in self.regions(image)]
            users = np.concatenate(parts)
            ordered: StructuredArray = users[np.argsort(users["id"], kind="stable")]
            return ordered

        key = ("user features", layer, IdentityKey(image), seed, sketch.fidelity, declared)
        return self.layers.get_or_compute(key, compute)

    def _of_region(self, sketch: Sketch, layer: str, region: Region, seed: int) -> StructuredArray:
        image, fidelity = sketch.layers[layer], sketch.fidelity
        multitude = _multitude(sketch, layer, region.label)
        box = (region.rows.start, region.rows.stop, region.columns.start, region.columns.stop)
        pixels = blake2b(np.packbits(region.mask).tobytes(), digest_size=16).digest()
        key = (layer, region.label, box, image.shape, multitude, fidelity, seed, pixels)
        return self.shapes.get_or_compute(
            key,
            lambda: user_features(
                measure_shape(layer, image, region), multitude=multitude, fidelity=fidelity, seed=seed
            ),
        )


def _multitude(sketch: Sketch, layer: str, label: int) -> int:
    return max(int(sketch.properties(layer, label)["multitude"]), 1)
