"""Placement of user features (Zaaijer 2013 §4.3-4.4): from painted to final positions.

At fidelity 1 features stay where they were painted. Below, each compares nearby positions by its preferences.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.placement.cache import PlacementCache
from sketchterrain.placement.density import FeatureSet, cubic
from sketchterrain.placement.feature_types import (
    FEATURE,
    FEATURE_TYPES,
    PREFERENCES,
    STYLE,
    SUMMIT_SHUNS_SUMMIT,
    TYPES,
    Preference,
    conifer_code,
    visible_radius,
)
from sketchterrain.placement.hashing import hash_unit

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.document.sketch import Sketch

MAX_DISPLACEMENT = 0.5
"""How far a feature may move at fidelity 0, in radii of its disc."""

_PLACES = 8  # places that a feature compares; the first is where it was painted
_SUMMIT_REACH = 2.0  # discs at which summits of one type keep apart
_LEAST_RADIUS = 1.5  # px
_LEAST_SHARE = 0.36  # of its label's strength: a lower feature does not reach farther for being low


def place(
    sketch: Sketch,
    *,
    seed: int,
    cache: PlacementCache | None = None,
    checkpoint: Callable[[], None] | None = None,
) -> StructuredArray:
    """Place all painted features but rivers: an array of ``FEATURE``, sorted by id, at least one per shape.

    The sketch's own seed is ignored. `checkpoint` is called between steps and may raise to cancel. Nothing
    painted farther away than two of a feature's discs changes it. Results with and without a cache are
    bit-equal.
    """
    cache = PlacementCache() if cache is None else cache
    users = {}
    for name in FEATURE_TYPES:
        if checkpoint is not None:
            checkpoint()
        users[name] = cache.user_features(sketch, name, seed=seed)
    placed: dict[str, StructuredArray] = {}
    around = _Around(sketch, users, placed, cache)
    for name in TYPES:
        if checkpoint is not None:
            checkpoint()
        positions = _painted_positions(sketch, users[name])
        if sketch.fidelity < 1.0 and len(positions):
            positions = _preferred(around, name, seed)
        placed[name] = _features(sketch, name, users[name], positions)
    everything = np.concatenate(list(placed.values()))
    ordered: StructuredArray = everything[np.argsort(everything["id"], kind="stable")]
    return ordered


def _painted_positions(sketch: Sketch, users: npt.NDArray[np.void]) -> Float64Array:
    x = (users["column"] + 0.5) * sketch.pixel_size
    y = (sketch.height_px - users["row"] - 0.5) * sketch.pixel_size
    return np.stack([x, y], axis=-1)


class _Around:
    """Everything a position is judged by: user features, placed features, painted pixels."""

    def __init__(
        self,
        sketch: Sketch,
        users: dict[str, npt.NDArray[np.void]],
        placed: dict[str, StructuredArray],
        cache: PlacementCache,
    ) -> None:
        self.sketch = sketch
        self.users = users
        self._placed = placed
        self._memory = cache

    def presence(self, preference: Preference, asked: FeatureSet) -> Float64Array:
        """Return how much of a preference's target is near each position: about 1 for one of like size."""
        disc = asked.sizes
        reach = preference.reach * disc
        if preference.what == "layer":
            away = self._memory.distance_to_paint(self.sketch, preference.of, asked.positions)
            return cubic(away / reach[:, None])
        if preference.what == "user":
            features = self.painted(preference.of)
        else:
            final = self._placed[preference.of]
            at = np.stack([final["x"], final["y"]], axis=-1)
            features = FeatureSet(final["id"], at, final["radius"].astype(np.float64))
        return self.density(preference.feature, f"{preference.what} {preference.of}", features, asked, reach)

    def painted(self, name: str) -> FeatureSet:
        """Return the user features of a type: painted positions and discs (m)."""
        own = self.users[name]
        return FeatureSet(
            own["id"], _painted_positions(self.sketch, own), own["disc"] * self.sketch.pixel_size
        )

    def density(
        self, feature: str, term: str, features: FeatureSet, asked: FeatureSet, reach: Float64Array
    ) -> Float64Array:
        """Return the density of features within `reach` (m) of each position, relative to its disc."""
        cache = self._memory.density(feature, term)
        return cache.around(features, replace(asked, sizes=reach)) / asked.sizes[:, None]


def _preferred(around: _Around, name: str, seed: int) -> Float64Array:
    own = around.painted(name)
    number = np.arange(_PLACES)
    angle = 2.0 * np.pi * hash_unit(seed, "place angle", own.ids[:, None], number)
    distance = np.sqrt(hash_unit(seed, "place distance", own.ids[:, None], number)) * (number > 0)
    distance *= MAX_DISPLACEMENT * (1.0 - around.sketch.fidelity) * own.sizes[:, None]
    offset = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)
    places = replace(own, positions=own.positions[:, None, :] + offset)

    score = np.zeros(places.positions.shape[:2])
    for preference in PREFERENCES:
        if preference.feature == name:
            score += preference.weight * around.presence(preference, places)
    score += SUMMIT_SHUNS_SUMMIT * _other_summits(around, name, own, places)
    best = np.argmax(score, axis=1)
    return np.asarray(places.positions[np.arange(len(best)), best])


def _other_summits(around: _Around, name: str, own: FeatureSet, places: FeatureSet) -> Float64Array:
    """Return the density of the other summits of this type, as painted; 0 for support features."""
    summit = np.flatnonzero(around.users[name]["summit"])
    summits, asked = _rows(own, summit), _rows(places, summit)
    reach = _SUMMIT_REACH * summits.sizes
    itself = np.hypot(*np.moveaxis(asked.positions - summits.positions[:, None], -1, 0))
    result = np.zeros(places.positions.shape[:2])
    density = around.density(name, "other summits", summits, asked, reach)
    result[summit] = density - cubic(itself / reach[:, None])
    return result


def _rows(of: FeatureSet, chosen: npt.NDArray[np.intp]) -> FeatureSet:
    return FeatureSet(of.ids[chosen], of.positions[chosen], of.sizes[chosen])


def _features(
    sketch: Sketch, name: str, users: npt.NDArray[np.void], positions: Float64Array
) -> StructuredArray:
    rule = TYPES[name]
    disc = users["disc"] * sketch.pixel_size
    result = np.zeros(len(users), dtype=FEATURE)
    result["id"], result["type"], result["painted"] = users["id"], users["type"], True
    result["x"], result["y"] = positions[:, 0], positions[:, 1]
    for label in np.unique(users["label"]):
        of_label = users["label"] == label
        properties = sketch.properties(name, int(label))
        strength = properties["density" if name == "forest" else "height"] * users["share"][of_label]
        result["strength"][of_label] = np.minimum(strength, rule.most_slope * disc[of_label])
        for field in STYLE:
            result[field][of_label] = properties.get(field, 0.0)
        if name == "forest":
            result["peakiness"][of_label] = conifer_code(float(properties["conifers"]))
    if name != "forest":
        # A ridge between summits has no tips of its own.
        result["peakiness"][~users["summit"]] = 0.0
    share = np.maximum(users["share"], _LEAST_SHARE)
    shown = visible_radius(name, share, result["peakiness"].astype(np.float64), sketch.fidelity)
    result["radius"] = np.maximum(disc * rule.reach / shown, _LEAST_RADIUS * sketch.pixel_size)
    if name == "forest":
        result["strength"] = np.minimum(result["strength"], 1.0)
    return result
