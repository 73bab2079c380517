"""Placement of user features (Zaaijer 2013 §4.3-4.4): from painted to final positions.

At fidelity 1 features stay where they were painted. Below, each compares nearby positions by its preferences.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.caching import LRUCache
from sketchterrain.document.label_layers import LabelImage
from sketchterrain.geometry.hashing import hash_unit
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
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.parameters import Properties
from sketchterrain.stages.digests import digest_of
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
_MARGIN = 1 + 1e-9  # so that rounding drops no pair of features; an extra one has weight 0


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


class PaintedDistance:
    """Distance (m) to the nearest painted pixel of a mask (row 0 north).

    Exact at pixel centres inside the sketch, elsewhere taken from the pixel's centre. Beyond the edge it is
    √(outside² + inside²) via the nearest point of the sketch, which is never more than the true distance.
    """

    def __init__(self, mask: npt.NDArray[np.bool_], pixel_size: float) -> None:
        self._mask, self._pixel_size = mask, pixel_size
        self._tree = cKDTree(np.argwhere(_border(mask)))

    def __call__(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the distance (m) at positions (m); infinite if nothing is painted, 0 on painted pixels."""
        height, width = self._mask.shape
        column = np.asarray(x, dtype=np.float64) / self._pixel_size
        row = height - np.asarray(y, dtype=np.float64) / self._pixel_size
        inside_column, inside_row = np.clip(column, 0.0, width), np.clip(row, 0.0, height)
        columns = np.minimum(inside_column.astype(np.intp), width - 1)
        rows = np.minimum(inside_row.astype(np.intp), height - 1)
        outside = np.hypot(column - inside_column, row - inside_row) * self._pixel_size
        pixels = np.zeros(rows.shape, dtype=np.float32)
        bare = ~self._mask[rows, columns]
        pixels[bare] = self._tree.query(np.stack([rows[bare], columns[bare]], axis=-1))[0]
        return np.asarray(np.hypot(outside, pixels * np.float32(self._pixel_size)))


_distances = LRUCache(8)
"""By the image's digest: a recipe needs those of several layers, and the next one shares most of them."""


def painted_distance(image: LabelImage, pixel_size: float) -> PaintedDistance:
    """Return the distance to the painted pixels of a label image, which must not change."""
    return _distances.get_or_compute(
        (digest_of(image), pixel_size), lambda: PaintedDistance(image > 0, pixel_size)
    )


def _border(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return painted pixels with an unpainted row or column neighbour: the nearest to any pixel outside."""
    inner = mask.copy()
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    inner[:, 1:] &= mask[:, :-1]
    inner[:, :-1] &= mask[:, 1:]
    return mask & ~inner


def cubic(t: Float64Array) -> Float64Array:
    """2t³ - 3t² + 1 for t in [0, 1], 0 beyond."""
    t = np.clip(t, 0.0, 1.0)
    return (2.0 * t - 3.0) * t * t + 1.0


def density_around(
    features: Float64Array, sizes: Float64Array, positions: Float64Array, radius: Float64Array
) -> Float64Array:
    """Return the sum of features' sizes, weighted by the cubic kernel of a radius, at positions, (m, k).

    Parameters
    ----------
    features, sizes : (n, 2), m, and (n,) weights, usually radii (m)
    positions, radius : (m, k, 2), m, in groups that have one radius (m,), m
    """
    groups, count = positions.shape[:2]
    if not (len(features) and groups):
        return np.zeros((groups, count))
    # Features beyond a position's own radius count nothing, to the bit: cubic(1) is 0. Sorted, so that the
    # summation order does not depend on how the tree was built.
    spread = np.sqrt(((positions - positions[:, :1]) ** 2).sum(axis=-1).max(axis=1))
    near = cKDTree(features).query_ball_point(
        positions[:, 0], (radius + spread) * _MARGIN, return_sorted=True
    )
    group = np.repeat(np.arange(groups), [len(each) for each in near])
    feature = np.fromiter(chain.from_iterable(near), dtype=np.intp, count=len(group))
    offset = positions[group] - features[feature][:, None]
    distance = np.sqrt(offset[..., 0] ** 2 + offset[..., 1] ** 2)
    weight = cubic(distance / np.maximum(radius[group], 1e-9)[:, None]) * sizes[feature][:, None]
    index = group[:, None] * count + np.arange(count)
    total = np.bincount(index.ravel(), weight.ravel(), minlength=groups * count)
    return total.astype(np.float64).reshape(groups, count)
