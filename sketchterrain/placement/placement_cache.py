"""What placing worked out before, so that after a stroke only what it changed is worked out anew."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from hashlib import blake2b
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.placement.cache import IdentityKey, LRUCache
from sketchterrain.placement.density import DensityCache, PaintedDistance
from sketchterrain.placement.shapes import Region, find_regions, measure_shape
from sketchterrain.placement.user_features import USER_FEATURE, user_features

if TYPE_CHECKING:
    from sketchterrain.document.label_layers import LabelImage
    from sketchterrain.document.sketch import Sketch

Part = TypeVar("Part")


@dataclass(frozen=True, eq=False)
class _Seen:
    """A layer as it was last, and what came of it."""

    image: LabelImage
    settings: tuple[object, ...]
    users: StructuredArray


class PlacementCache:
    """Remembers shapes' user features, distances and densities, so that they need not be worked out again.

    The bits are those that would be worked out. Several threads may use it at once: what it holds is never
    written to, only replaced. A shape is known by its pixels, their place and all that its features depend
    on. A layer whose image is the very same array, which sketches never write to, is not even looked at.
    """

    def __init__(self, *, most: int = 16384) -> None:
        self._most = most
        self._shapes: OrderedDict[bytes, StructuredArray] = OrderedDict()
        self._layers: dict[str, _Seen] = {}
        self._distances: dict[str, tuple[LabelImage, float, PaintedDistance]] = {}
        self._densities: dict[tuple[str, str], DensityCache] = {}
        self._parts: dict[type, Any] = {}
        self._images = LRUCache(16)
        self._away = LRUCache(32)

    def __len__(self) -> int:
        return len(self._shapes)

    def painted_distance(self, sketch: Sketch, layer: str) -> PaintedDistance:
        """Return the distance to what is painted in a layer."""
        image = sketch.layers[layer]
        known = self._distances.get(layer)
        if known is None or known[0] is not image or known[1] != sketch.pixel_size:
            known = (image, sketch.pixel_size, PaintedDistance(image > 0, sketch.pixel_size))
            self._distances[layer] = known
        return known[2]

    def regions(self, image: LabelImage) -> tuple[Region, ...]:
        """Return the connected regions of a layer's image."""
        regions: tuple[Region, ...] = self._images.of(IdentityKey(image), lambda: find_regions(image))
        return regions

    def away_from_paint(self, sketch: Sketch, layer: str, positions: Float64Array) -> Float64Array:
        """Return the distance (m) from positions (..., 2) to what is painted in a layer."""
        distance = self.painted_distance(sketch, layer)
        key = (IdentityKey(distance), positions.shape, blake2b(positions.tobytes()).digest())
        away: Float64Array = self._away.of(key, lambda: distance(positions[..., 0], positions[..., 1]))
        return away

    def density(self, feature: str, term: str) -> DensityCache:
        """Return the memory of one term of what a type of feature judges its places by."""
        return self._densities.setdefault((feature, term), DensityCache())

    def part(self, kind: type[Part]) -> Part:
        """Return what another stage remembers: one thing of a kind, made when it is first asked for."""
        found: Part = self._parts.setdefault(kind, kind())
        return found

    def user_features(self, sketch: Sketch, layer: str, *, seed: int) -> StructuredArray:
        """Return the user features of a layer, sorted by id."""
        image = sketch.layers[layer]
        declared = tuple((key, _multitude(sketch, *key)) for key in sketch.labels if key[0] == layer)
        settings = (seed, sketch.fidelity, declared)
        seen = self._layers.get(layer)
        if seen is not None and seen.image is image and seen.settings == settings:
            return seen.users
        parts = [np.zeros(0, dtype=USER_FEATURE)]
        for region in self.regions(image):
            multitude = _multitude(sketch, layer, region.label)
            parts.append(self._of(layer, image, region, multitude, sketch.fidelity, seed))
        users = np.concatenate(parts)
        users = users[np.argsort(users["id"], kind="stable")]
        self._layers[layer] = _Seen(image, settings, users)
        return users

    def _of(
        self, layer: str, image: LabelImage, region: Region, multitude: int, fidelity: float, seed: int
    ) -> StructuredArray:
        box = (region.rows.start, region.rows.stop, region.columns.start, region.columns.stop)
        named = repr((layer, region.label, box, image.shape, multitude, fidelity, seed))
        key = blake2b(
            np.packbits(region.mask).tobytes(), digest_size=16, key=blake2b(named.encode()).digest()
        ).digest()
        users = self._shapes.pop(key, None)
        if users is None:
            shape = measure_shape(layer, image, region)
            users = user_features(shape, multitude=multitude, fidelity=fidelity, seed=seed)
        self._shapes[key] = users
        if len(self._shapes) > self._most:
            self._shapes.popitem(last=False)
        return users


def _multitude(sketch: Sketch, layer: str, label: int) -> int:
    return max(int(sketch.properties(layer, label)["multitude"]), 1)
