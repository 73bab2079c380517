"""Room for what fills unpainted ground: how far its candidates stand from paint, and from each other."""

from __future__ import annotations

from functools import partial
from hashlib import blake2b
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array, StructuredArray
from sketchterrain.features.catalogue import FEATURE_TYPES
from sketchterrain.features.recent import IdentityKey
from sketchterrain.features.rules import CLEARANCE, SPACING

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.features.memory import PlacementCache
    from sketchterrain.features.recent import LRUCache
    from sketchterrain.sketch.document import Sketch


def distances_to_layers(
    sketch: Sketch, memory: PlacementCache, fills: tuple[str, ...]
) -> dict[str, Callable[[Float64Array, Float64Array], Float64Array]]:
    """Distance to what is painted in each layer that any of these types keeps away from."""
    return {
        layer: memory.painted_distance(sketch, layer)
        for layer, image in sketch.layers.items()
        if any((name, layer) in CLEARANCE for name in fills) and image.any()
    }


class PaintedClearance:
    """What was painted, as the fill sees it: places to keep away from."""

    def __init__(
        self,
        painted: StructuredArray,
        distances: dict[str, Callable[[Float64Array, Float64Array], Float64Array]],
    ) -> None:
        self._distance = distances
        self._placed = {name: painted[painted["type"] == code] for code, name in enumerate(FEATURE_TYPES)}

    def clearance_mask(self, name: str, features: StructuredArray, answers: LRUCache) -> BoolArray:
        """Which features of a type keep their clearance from paint and their spacing from what it became.

        What is remembered of these very features is among the answers.
        """
        room = np.ones(len(features), dtype=np.bool_)
        if len(features) == 0:
            return room
        for layer, distance in self._distance.items():
            if (name, layer) in CLEARANCE:
                key = ("clear", name, layer, IdentityKey(features), IdentityKey(distance))
                room &= answers.of(key, partial(_clear, features, distance, CLEARANCE[name, layer]))
        for other, placed in self._placed.items():
            factor = SPACING.get((other, name), 0.0)
            if factor > 0.0 and len(placed):
                reach = factor * float(placed["radius"].max() + features["radius"].max())
                near = ("spaced", name, other, IdentityKey(features), blake2b(placed.tobytes()).digest())
                made = partial(suppressed_by, features, placed, factor, reach, same=False)
                room &= ~answers.of(near, made)
        return room


def _clear(
    features: StructuredArray, distance: Callable[[Float64Array, Float64Array], Float64Array], factor: float
) -> BoolArray:
    away = distance(features["x"], features["y"])
    return np.asarray(away > factor * features["radius"].astype(np.float64))


def suppressed_by(
    mine: StructuredArray, rivals: StructuredArray, factor: float, reach: float, *, same: bool
) -> BoolArray:
    """Which features have a rival nearer than `factor` times the sum of radii (and, if same, of lower id).

    Ids of the fill are hashes: a lower one is as good as a higher priority.
    """
    beaten = np.zeros(len(mine), dtype=np.bool_)
    if len(mine) == 0 or len(rivals) == 0:
        return beaten
    centre = np.array([mine["x"][0], mine["y"][0]])
    at = np.stack([mine["x"], mine["y"]], axis=-1) - centre
    others = np.stack([rivals["x"], rivals["y"]], axis=-1) - centre
    # The tree only proposes pairs, from a little farther than needed; the decision is made on plain numbers
    # that are the same whichever rectangle was asked for.
    pairs = cKDTree(at).sparse_distance_matrix(cKDTree(others), reach * 1.001 + 0.01, output_type="ndarray")
    i, j = pairs["i"], pairs["j"]
    across, along = mine["x"][i] - rivals["x"][j], mine["y"][i] - rivals["y"][j]
    radii = mine["radius"][i].astype(np.float64) + rivals["radius"][j].astype(np.float64)
    near = across * across + along * along < (factor * radii) ** 2
    if same:
        near &= rivals["id"][j] < mine["id"][i]
    beaten[i[near]] = True
    return beaten
