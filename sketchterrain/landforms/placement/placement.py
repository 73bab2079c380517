"""Placement of user features (Zaaijer 2013 §4.3-4.4): from painted to final positions.

At fidelity 1 features stay where they were painted. Below, each compares nearby positions by its preferences.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.document.layers import LAYERS
from sketchterrain.document.parameters import Properties
from sketchterrain.geometry.hashing import hash_unit
from sketchterrain.landforms.placement.density import cubic, density_around, painted_distance
from sketchterrain.landforms.placement.feature_types import (
    FEATURE,
    FEATURE_TYPES,
    PREFERENCES,
    SUMMIT_REPULSION,
    TYPES,
    stored_style,
    visible_radius,
)
from sketchterrain.landforms.placement.heights import shape_height
from sketchterrain.landforms.placement.user_features import layer_user_features
from sketchterrain.stages.parts import part_of
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
            layer_user_features, part_of(sketch, f"layers.{name}", f"labels.{name}", "fidelity"), name, seed
        )
        for name in FEATURE_TYPES
    }
    placed: dict[str, StructuredArray] = {}
    for name in TYPES:
        positions = _painted_positions(sketch, users[name])
        if sketch.fidelity < 1.0 and len(positions):
            positions = _preferred(sketch, name, users, placed, seed)
        placed[name] = _features(sketch, name, users[name], positions)
    everything = np.concatenate(list(placed.values()))
    ordered: StructuredArray = everything[np.argsort(everything["id"], kind="stable")]
    return ordered


def _painted_positions(sketch: Sketch, users: npt.NDArray[np.void]) -> Float64Array:
    x = (users["column"] + 0.5) * sketch.pixel_size
    y = (sketch.height_px - users["row"] - 0.5) * sketch.pixel_size
    return np.stack([x, y], axis=-1)


def _preferred(
    sketch: Sketch,
    name: str,
    users: Mapping[str, npt.NDArray[np.void]],
    placed: Mapping[str, StructuredArray],
    seed: int,
) -> Float64Array:
    """Return the best of some positions (m) of each user feature of a type."""
    own, pixel = users[name], sketch.pixel_size
    painted, disc = _painted_positions(sketch, own), own["disc"] * pixel
    number = np.arange(_CANDIDATES)
    angle = 2.0 * np.pi * hash_unit(seed, "place angle", own["id"][:, None], number)
    distance = np.sqrt(hash_unit(seed, "place distance", own["id"][:, None], number)) * (number > 0)
    distance *= MAX_DISPLACEMENT * (1.0 - sketch.fidelity) * disc[:, None]
    offset = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)
    candidates = painted[:, None, :] + offset

    score = np.zeros(candidates.shape[:2])
    for preference in PREFERENCES:
        if preference.feature != name:
            continue
        radius = preference.range * disc
        if preference.what == "layer":
            away = painted_distance(sketch.layers[preference.of], pixel)(*np.moveaxis(candidates, -1, 0))
            presence = cubic(away / radius[:, None])
        elif preference.what == "user":
            others = users[preference.of]
            at = _painted_positions(sketch, others), others["disc"] * pixel
            presence = density_around(*at, candidates, radius) / disc[:, None]
        else:
            final = placed[preference.of]
            at = np.stack([final["x"], final["y"]], axis=-1), final["radius"].astype(np.float64)
            presence = density_around(*at, candidates, radius) / disc[:, None]
        score += preference.weight * presence
    score += SUMMIT_REPULSION * _other_summits(np.flatnonzero(own["summit"]), painted, disc, candidates)
    best = np.argmax(score, axis=1)
    return np.asarray(candidates[np.arange(len(best)), best])


def _other_summits(
    summit: npt.NDArray[np.intp], painted: Float64Array, disc: Float64Array, candidates: Float64Array
) -> Float64Array:
    """Return the density of the other summits of this type, as painted; 0 for support features."""
    radius, result = _SUMMIT_RADIUS * disc[summit], np.zeros(candidates.shape[:2])
    itself = np.hypot(*np.moveaxis(candidates[summit] - painted[summit][:, None], -1, 0))
    density = density_around(painted[summit], disc[summit], candidates[summit], radius)
    result[summit] = density / disc[summit][:, None] - cubic(itself / radius[:, None])
    return result


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
