"""Placement of user features (Zaaijer 2013 §4.3-4.4): from painted to final positions.

At fidelity 1 features stay where they were painted. Below, each compares nearby positions by its preferences.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.document.layers import LAYERS
from sketchterrain.document.parameters import Properties
from sketchterrain.placement.density import DensityField, FeatureSet, cubic, painted_distance
from sketchterrain.placement.feature_types import (
    FEATURE,
    FEATURE_TYPES,
    PREFERENCES,
    SUMMIT_REPULSION,
    TYPES,
    Preference,
    stored_style,
    visible_radius,
)
from sketchterrain.placement.hashing import hash_unit
from sketchterrain.placement.heights import shape_height
from sketchterrain.placement.user_features import layer_user_features
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

MAX_DISPLACEMENT = 0.5
"""Greatest displacement of a feature at fidelity 0, in radii of its disc."""

_CANDIDATES = 8  # positions that a feature compares; the first is the painted one
_SUMMIT_RADIUS = 2.0  # discs; range of the repulsion between summits of one type
_MIN_RADIUS = 1.5  # px
_MIN_SHARE = 0.36  # of its label's strength: lower features do not get larger radii


def place(sketch: Sketch, *, seed: int, run: Runner | None = None) -> StructuredArray:
    """Place all painted features but rivers: an array of ``FEATURE``, sorted by id, at least one per shape.

    The sketch's own seed is ignored. Nothing painted farther away than two of a feature's discs changes it.
    Results with and without a runner are bit-equal.
    """
    run = Runner() if run is None else run
    users = {
        name: run(
            layer_user_features, sketch.part(f"layers.{name}", f"labels.{name}", "fidelity"), name, seed
        )
        for name in FEATURE_TYPES
    }
    placed: dict[str, StructuredArray] = {}
    context = _PlacementContext(sketch, users, placed)
    for name in TYPES:
        positions = _painted_positions(sketch, users[name])
        if sketch.fidelity < 1.0 and len(positions):
            positions = _preferred(context, name, seed)
        placed[name] = _features(sketch, name, users[name], positions)
    everything = np.concatenate(list(placed.values()))
    ordered: StructuredArray = everything[np.argsort(everything["id"], kind="stable")]
    return ordered


def _painted_positions(sketch: Sketch, users: npt.NDArray[np.void]) -> Float64Array:
    x = (users["column"] + 0.5) * sketch.pixel_size
    y = (sketch.height_px - users["row"] - 0.5) * sketch.pixel_size
    return np.stack([x, y], axis=-1)


class _PlacementContext:
    """Everything a position is judged by: user features, placed features, painted pixels."""

    def __init__(
        self,
        sketch: Sketch,
        users: dict[str, npt.NDArray[np.void]],
        placed: dict[str, StructuredArray],
    ) -> None:
        self.sketch = sketch
        self.users = users
        self._placed = placed

    def presence(self, preference: Preference, queries: FeatureSet) -> Float64Array:
        """Return how much of a preference's target is near each position: about 1 for one of like size."""
        disc = queries.sizes
        radius = preference.range * disc
        if preference.what == "layer":
            away = painted_distance(self.sketch.layers[preference.of], self.sketch.pixel_size)(
                *np.moveaxis(queries.positions, -1, 0)
            )
            return cubic(away / radius[:, None])
        if preference.what == "user":
            features = self.painted(preference.of)
        else:
            final = self._placed[preference.of]
            at = np.stack([final["x"], final["y"]], axis=-1)
            features = FeatureSet(final["id"], at, final["radius"].astype(np.float64))
        return _density(features, queries, radius)

    def painted(self, name: str) -> FeatureSet:
        """Return the user features of a type: painted positions and discs (m)."""
        own = self.users[name]
        return FeatureSet(
            own["id"], _painted_positions(self.sketch, own), own["disc"] * self.sketch.pixel_size
        )


def _density(features: FeatureSet, queries: FeatureSet, radius: Float64Array) -> Float64Array:
    """Return the density of features within `radius` (m) of each position, relative to its disc."""
    density = DensityField(features.positions, features.sizes).around(queries.positions, radius)
    return density / queries.sizes[:, None]


def _preferred(context: _PlacementContext, name: str, seed: int) -> Float64Array:
    own = context.painted(name)
    number = np.arange(_CANDIDATES)
    angle = 2.0 * np.pi * hash_unit(seed, "place angle", own.ids[:, None], number)
    distance = np.sqrt(hash_unit(seed, "place distance", own.ids[:, None], number)) * (number > 0)
    distance *= MAX_DISPLACEMENT * (1.0 - context.sketch.fidelity) * own.sizes[:, None]
    offset = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)
    candidates = replace(own, positions=own.positions[:, None, :] + offset)

    score = np.zeros(candidates.positions.shape[:2])
    for preference in PREFERENCES:
        if preference.feature == name:
            score += preference.weight * context.presence(preference, candidates)
    score += SUMMIT_REPULSION * _other_summits(context, name, own, candidates)
    best = np.argmax(score, axis=1)
    return np.asarray(candidates.positions[np.arange(len(best)), best])


def _other_summits(
    context: _PlacementContext, name: str, own: FeatureSet, candidates: FeatureSet
) -> Float64Array:
    """Return the density of the other summits of this type, as painted; 0 for support features."""
    summit = np.flatnonzero(context.users[name]["summit"])
    summits, queries = _rows(own, summit), _rows(candidates, summit)
    radius = _SUMMIT_RADIUS * summits.sizes
    itself = np.hypot(*np.moveaxis(queries.positions - summits.positions[:, None], -1, 0))
    result = np.zeros(candidates.positions.shape[:2])
    density = _density(summits, queries, radius)
    result[summit] = density - cubic(itself / radius[:, None])
    return result


def _rows(of: FeatureSet, indices: npt.NDArray[np.intp]) -> FeatureSet:
    return FeatureSet(of.ids[indices], of.positions[indices], of.sizes[indices])


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
        if LAYERS[name].kind == "summits":
            strength = _summit_heights(name, properties, users[of_label], sketch)
        else:
            strength = properties[LAYERS[name].main.name] * users["share"][of_label]
            strength = np.minimum(strength, rule.max_slope * disc[of_label])
        result["strength"][of_label] = strength
        for field, value in stored_style(name, properties).items():
            result[field][of_label] = value
    if LAYERS[name].kind == "summits":
        # Ridges between summits have no tips.
        result["peakiness"][~users["summit"]] = 0.0
    share = np.maximum(users["share"], _MIN_SHARE)
    visible = visible_radius(name, share, result["peakiness"].astype(np.float64), sketch.fidelity)
    result["radius"] = np.maximum(disc * rule.radius_ratio / visible, _MIN_RADIUS * sketch.pixel_size)
    if LAYERS[name].is_share:
        result["strength"] = np.minimum(result["strength"], 1.0)
    return result


def _summit_heights(
    name: str, properties: Properties, users: npt.NDArray[np.void], sketch: Sketch
) -> Float64Array:
    """Return the built heights (m) of user features of one label: the highest of a shape has the shape's."""
    _, first, shape = np.unique(users["shape"], return_index=True, return_inverse=True)
    inradii = users["inradius"][first] * sketch.pixel_size
    heights = [shape_height(properties, each, sketch.fidelity) for each in inradii.tolist()]
    asked, built = np.array(heights).reshape(-1, 2).T
    lowered = np.minimum(
        asked[shape] * users["share"], TYPES[name].max_slope * users["disc"] * sketch.pixel_size
    )
    highest = np.zeros(len(first))
    np.maximum.at(highest, shape, lowered)
    return np.asarray(lowered * (built / highest)[shape])
