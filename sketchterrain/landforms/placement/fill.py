"""Fill: dunes and forests of unpainted terrain by density, unbounded and independent of the query.

Each type has its own cells, aligned to the world's origin. A cell proposes candidates from hashes of its
index; a candidate survives unless one of an earlier type, or of its own type and of higher priority, is too
close. One round, comparing with candidates, not survivors: every decision reads a bounded neighbourhood, so
that a rectangle's features do not depend on which rectangle was queried.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, StructuredArray
from sketchterrain.errors import InputError
from sketchterrain.geometry.box_index import merge_boxes, repainted_boxes, rows_only_in, widened
from sketchterrain.geometry.hashing import hash_keys, hash_unit
from sketchterrain.landforms.placement.feature_types import (
    CLEARANCE,
    FEATURE,
    FEATURE_TYPES,
    FILL_BIT,
    SPACING,
    TYPES,
    stored_style,
)
from sketchterrain.landforms.placement.heights import unpainted_height
from sketchterrain.landforms.placement.placement import painted_distance
from sketchterrain.schema.layers import LAYERS, PATCH_LAYERS
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.label_layers import LabelImage
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.schema.parameters import Properties

_MIN_RADIUS = 0.4  # of the largest
_MAX_CROWDING = 0.3  # expected rivals of a candidate within its spacing
_KM2 = 1e6  # m²
_MIN_CELL, _MAX_CELL = 16.0, 32768.0  # m
# Margin of the box around the sketch that is computed once: the extensions of rivers, and features that
# influence them.
_NEAR_EXTENTS, _NEAR_RADII = 0.4, 2.0
_MAX_NEAR = 6000  # candidates


@dataclass(frozen=True)
class CandidateRule:
    """How candidates of one type are proposed: radii (m), cells (m), candidates per cell, properties."""

    name: str
    low: float
    high: float
    cell: float
    per_cell: float
    properties: Properties = field(hash=False)  # of the layer's label 1


def candidate_rules(sketch: Sketch) -> dict[str, CandidateRule]:
    """Return a rule for each type of patches whose density is not 0, in order of precedence."""
    rules: dict[str, CandidateRule] = {}
    preceding: dict[str, tuple[float, float, float]] = {}  # density (1/m²) and radii of preceding types
    for name in PATCH_LAYERS:
        rule = TYPES[name]
        density = float(sketch.density.get(name, 0.0)) / _KM2
        if density <= 0.0:
            continue
        factor = SPACING.get((name, name), 0.0)
        high = min(rule.fill_radius, rule.fill_extent * sketch.extent)
        crowding = density * math.pi * _mean_square(factor, (_MIN_RADIUS, 1.0), (_MIN_RADIUS, 1.0))
        high = float(np.float32(min(high, math.sqrt(_MAX_CROWDING / crowding))))
        low = _MIN_RADIUS * high
        # Conflicting candidates are removed (Matérn): propose as many more as will be lost.
        lost = density * math.pi * _mean_square(factor, (low, high), (low, high))
        rate = density * -math.log1p(-lost) / lost
        for other, (density_of, low_of, high_of) in preceding.items():
            of_other = _mean_square(SPACING.get((other, name), 0.0), (low_of, high_of), (low, high))
            rate *= math.exp(min(density_of * math.pi * of_other, 1.0))
        cell = 2.0 ** round(math.log2(1.0 / math.sqrt(rate)))
        cell = min(max(cell, _MIN_CELL), _MAX_CELL)
        properties = dict(sketch.properties(name, 1))
        if LAYERS[name].kind == "summits":
            properties[LAYERS[name].main.name] = unpainted_height(sketch, name)
        rules[name] = CandidateRule(name, low, high, cell, rate * cell * cell, properties)
        preceding[name] = (rate, low, high)
    return rules


def _mean_square(factor: float, one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the mean of (factor · (R₁ + R₂))² for two radii, each log-uniform in its range."""
    (first, first_square), (second, second_square) = _moments(*one), _moments(*other)
    return factor**2 * (first_square + second_square + 2.0 * first * second)


def _moments(low: float, high: float) -> tuple[float, float]:
    span = math.log(high / low)
    return (high - low) / span, (high**2 - low**2) / (2.0 * span)


def _clear_of_paint(
    features: StructuredArray, image: LabelImage, pixel_size: float, factor: float
) -> BoolArray:
    away = painted_distance(image, pixel_size)(features["x"], features["y"])
    return np.asarray(away > factor * features["radius"].astype(np.float64))


def suppressed_by(
    own: StructuredArray, rivals: StructuredArray, factor: float, radius: float, same: bool
) -> BoolArray:
    """Return which features have a rival within `factor` times the sum of radii (if `same`: of lower id).

    No pair is farther apart than `radius` (m). Ids of the fill are hashes, so a lower id is an arbitrary
    priority.
    """
    suppressed = np.zeros(len(own), dtype=np.bool_)
    if len(own) == 0 or len(rivals) == 0:
        return suppressed
    centre = np.array([own["x"][0], own["y"][0]])
    at = np.stack([own["x"], own["y"]], axis=-1) - centre
    others = np.stack([rivals["x"], rivals["y"]], axis=-1) - centre
    # The tree only proposes pairs, from slightly farther than needed; the decision is made on plain numbers
    # that do not depend on the queried rectangle.
    pairs = cKDTree(at).sparse_distance_matrix(cKDTree(others), radius * 1.001 + 0.01, output_type="ndarray")
    i, j = pairs["i"], pairs["j"]
    across, along = own["x"][i] - rivals["x"][j], own["y"][i] - rivals["y"][j]
    radii = own["radius"][i].astype(np.float64) + rivals["radius"][j].astype(np.float64)
    near = across * across + along * along < (factor * radii) ** 2
    if same:
        near &= rivals["id"][j] < own["id"][i]
    suppressed[i[near]] = True
    return suppressed


@dataclass(frozen=True, eq=False)
class Fill:
    """Dunes and forests of unpainted terrain: a pure function of position, seed and the densities."""

    seed: int
    extent: float  # m, the sketch's longer side
    size: tuple[float, float]  # m, of the sketch
    pixel_size: float  # m
    rules: Mapping[str, CandidateRule]  # by type, in order of precedence
    conifers: float  # share in its forests, 0 … 1 or `BY_ELEVATION`
    painted: StructuredArray  # placed features that it keeps its distance from
    images: Mapping[str, LabelImage]  # painted layers that it keeps clear of
    near: StructuredArray | None = None  # the features around the sketch, unless they are too many
    replaced: StructuredArray = field(default_factory=lambda: np.zeros(0, dtype=FEATURE))  # by edits

    @classmethod
    def from_sketch(
        cls, sketch: Sketch, painted: StructuredArray, *, seed: int, run: Runner | None = None
    ) -> Fill:
        """Return the fill at a sketch's densities around `painted` features (`place`)."""
        rules = candidate_rules(sketch)
        avoided = {layer for name, layer in CLEARANCE if name in rules}
        fill = cls(
            seed,
            sketch.extent,
            sketch.size,
            sketch.pixel_size,
            rules,
            float(sketch.properties("forest", 1)["conifers"]),
            painted,
            {name: image for name, image in sketch.layers.items() if name in avoided and image.any()},
        )
        box = fill._near_box()
        if box is None:
            return fill
        # Most candidates near the sketch are those of the sketch before.
        return replace(fill, near=fill._compute(box, 0.0, Runner() if run is None else run))

    @property
    def max_radius(self) -> float:
        """Radius that no feature exceeds, m; 0 if every density is 0."""
        return max((rule.high for rule in self.rules.values()), default=0.0)

    def influence_radii(self, name: str, radius: float | None = None) -> dict[str, float]:
        """Return the invalidation radius (m) per type around a changed feature (or pixels: no `radius`).

        `name` is the type of the changed feature or the painted layer. A feature too close is suppressed, and
        then those that it had suppressed may survive.
        """
        direct: dict[str, float] = {}
        for own, rule in self.rules.items():
            if radius is not None:
                factor = SPACING.get((name, own), 0.0)
                if factor > 0.0:
                    direct[own] = factor * (radius + rule.high)
            elif (own, name) in CLEARANCE:
                # Beyond the sketch's edge a distance may be underestimated by a factor of up to √2.
                clearance = math.sqrt(2.0) * CLEARANCE[own, name] * rule.high
                direct[own] = clearance + 2.0 * self.pixel_size
        radii = dict(direct)
        for (rival, own), factor in SPACING.items():
            if rival in direct and own in self.rules:
                indirect = direct[rival] + factor * (self.rules[rival].high + self.rules[own].high)
                radii[own] = max(radii.get(own, 0.0), indirect)
        return radii

    @property
    def dune_styles(self) -> frozenset[tuple[float, float]]:
        """Distinct (wavelength in m, wind in degrees) of its dunes, rounded as in ``FEATURE``."""
        if "dune" not in self.rules:
            return frozenset()
        properties = self.rules["dune"].properties
        style = (float(np.float32(properties["wavelength"])), float(np.float32(properties["wind"])))
        return frozenset([style])

    def within(
        self, west: float, south: float, east: float, north: float, *, min_radius: float = 0.0
    ) -> StructuredArray:
        """Return the features of at least `min_radius` (m) centred in a rectangle, sorted by id.

        The west and south borders belong to the rectangle, the others do not. Raises InputError for bad
        bounds.
        """
        box = (float(west), float(south), float(east), float(north))
        if not all(math.isfinite(side) for side in box) or east < west or north < south:
            raise InputError(f"expected finite bounds with west <= east and south <= north, got {box}")
        features = self._within(box, min_radius)
        remaining: StructuredArray = features[~np.isin(features["id"], self.replaced["id"])]
        return remaining

    def difference(self, other: Fill) -> tuple[StructuredArray, StructuredArray] | None:
        """Return the features that only this and only the other has; None if they may differ anywhere."""
        if self._settings() != other._settings():
            return None
        removed = [rows_only_in(other.replaced, self.replaced)]
        added = [rows_only_in(self.replaced, other.replaced)]
        for area in self._changed_areas(other):
            before, after = self._within(area, 0.0), other._within(area, 0.0)
            removed.append(rows_only_in(before, after))
            added.append(rows_only_in(after, before))
        return np.unique(np.concatenate(removed)), np.unique(np.concatenate(added))

    def _settings(self) -> tuple[object, ...]:
        """Return everything that it depends on everywhere."""
        return self.seed, self.extent, self.size, self.pixel_size, list(self.rules.items())

    def _changed_areas(self, other: Fill) -> list[Bounds]:
        """Return rectangles outside of which two fills of equal settings are the same, edits aside."""
        areas = []
        if self.painted is not other.painted:
            one, two = self.painted, other.painted
            for point in np.concatenate([rows_only_in(one, two), rows_only_in(two, one)]):
                x, y, radius = (float(point[key]) for key in ("x", "y", "radius"))
                distances = self.influence_radii(FEATURE_TYPES[point["type"]], radius).values()
                if distances:
                    areas.append(widened((x, y, x, y), max(distances)))
        for name in {**self.images, **other.images}:
            distance = max(self.influence_radii(name).values())
            boxes = repainted_boxes(self.images.get(name), other.images.get(name), self.pixel_size)
            areas += [widened(box, distance) for box in boxes]
        return merge_boxes(areas)

    def _near_box(self) -> Bounds | None:
        """Return the box (m) around the sketch whose features are in `near`; None if too many candidates."""
        east, north = self.size
        margin = _NEAR_EXTENTS * self.extent + _NEAR_RADII * self.max_radius
        rate = sum(rule.per_cell / (rule.cell * rule.cell) for rule in self.rules.values())
        if (east + 2.0 * margin) * (north + 2.0 * margin) * rate > _MAX_NEAR:
            return None
        return -margin, -margin, east + margin, north + margin

    def _within(self, box: Bounds, min_radius: float) -> StructuredArray:
        near = self._near_box()
        if (
            near is None
            or self.near is None
            or (box[0] < near[0] or box[1] < near[1] or box[2] > near[2] or box[3] > near[3])
        ):
            return self._compute(box, min_radius, lambda function, *inputs: function(*inputs))
        selected: StructuredArray = self.near[_inside(self.near, box) & (self.near["radius"] >= min_radius)]
        return selected

    def _compute(self, box: Bounds, min_radius: float, run: Callable[..., Any]) -> StructuredArray:
        rules = [rule for rule in self.rules.values() if rule.high >= min_radius]
        candidates = self._candidates_around(box, rules, run)
        parts = [np.zeros(0, dtype=FEATURE)]
        for rule in rules:
            own = candidates[rule.name]
            own = own[_inside(own, box) & (own["radius"] >= min_radius)]
            survives = np.ones(len(own), dtype=np.bool_)
            for rival in self.rules.values():
                factor = SPACING.get((rival.name, rule.name), 0.0)
                if factor > 0.0 and len(own):
                    radius = factor * (rival.high + rule.high)
                    rivals = candidates[rival.name]
                    survives &= ~suppressed_by(own, rivals, factor, radius, rival is rule)
            parts.append(own[survives])
        found = np.concatenate(parts)
        ordered: StructuredArray = found[np.argsort(found["id"], kind="stable")]
        return ordered

    def _candidates_around(
        self, box: Bounds, rules: list[CandidateRule], run: Callable[..., Any]
    ) -> dict[str, StructuredArray]:
        """Return candidates of each type in a rectangle, and around it as far as they may suppress others."""
        found = {}
        for rival in self.rules.values():
            distances = [SPACING.get((rival.name, own.name), 0.0) * (rival.high + own.high) for own in rules]
            margin = max(distances, default=0.0)
            if margin > 0.0 or rival in rules:
                proposed = run(_candidates, rival, widened(box, margin), self.seed)
                found[rival.name] = proposed[self._clearance_mask(rival.name, proposed, run)]
        return found

    def _clearance_mask(self, name: str, features: StructuredArray, run: Callable[..., Any]) -> BoolArray:
        """Return which features of a type are clear of paint and of placed features."""
        clear = np.ones(len(features), dtype=np.bool_)
        if len(features) == 0:
            return clear
        for layer, image in self.images.items():
            if (name, layer) in CLEARANCE:
                clear &= run(_clear_of_paint, features, image, self.pixel_size, CLEARANCE[name, layer])
        for code, other in enumerate(FEATURE_TYPES):
            factor = SPACING.get((other, name), 0.0)
            placed = self.painted[self.painted["type"] == code] if factor > 0.0 else self.painted[:0]
            if len(placed):
                radius = factor * float(placed["radius"].max() + features["radius"].max())
                clear &= ~run(suppressed_by, features, placed, factor, radius, False)
        return clear


def _candidates(rule: CandidateRule, box: Bounds, seed: int) -> StructuredArray:
    """Return candidates of a type in a rectangle, ignoring paint."""
    name, cell, code = rule.name, rule.cell, FEATURE_TYPES.index(rule.name)
    column = np.arange(math.floor(box[0] / cell), math.floor(box[2] / cell) + 1)[None, :, None]
    row = np.arange(math.floor(box[1] / cell), math.floor(box[3] / cell) + 1)[:, None, None]
    number = np.arange(math.ceil(rule.per_cell))[None, None, :]
    count = np.floor(rule.per_cell + hash_unit(seed, f"{name} count", column, row))
    rows, columns, numbers = np.nonzero(number < count)
    keys = (column[0, columns, 0], row[rows, 0, 0], numbers)

    x = (keys[0] + hash_unit(seed, f"{name} x", *keys)) * cell
    y = (keys[1] + hash_unit(seed, f"{name} y", *keys)) * cell
    inside = (box[0] <= x) & (x < box[2]) & (box[1] <= y) & (y < box[3])
    keys = (keys[0][inside], keys[1][inside], keys[2][inside])
    result = np.zeros(int(inside.sum()), dtype=FEATURE)
    result["id"] = FILL_BIT | np.uint64(code << 60) | (hash_keys(seed, name, *keys) >> np.uint64(4))
    result["type"], result["x"], result["y"] = code, x[inside], y[inside]
    size = hash_unit(seed, f"{name} size", *keys)
    result["radius"] = rule.low * (rule.high / rule.low) ** size
    _set_strength(result, rule, hash_unit(seed, f"{name} strength", *keys))
    return result


def _set_strength(features: StructuredArray, rule: CandidateRule, chance: Float64Array) -> None:
    """Set strength and style from the properties of the layer's label 1, lower where it is smaller."""
    properties = rule.properties
    radius = features["radius"].astype(np.float64)
    strength = properties[LAYERS[rule.name].main.name]
    if LAYERS[rule.name].is_share:
        strength = strength * (0.7 + 0.3 * chance)
    else:
        strength = strength * (radius / rule.high) ** 0.8 * (0.8 + 0.2 * chance)
    features["strength"] = np.minimum(strength, TYPES[rule.name].fill_slope * radius)
    for key, value in stored_style(rule.name, properties).items():
        features[key] = value


def _inside(features: StructuredArray, box: Bounds) -> BoolArray:
    x, y = features["x"], features["y"]
    return np.asarray((box[0] <= x) & (x < box[2]) & (box[1] <= y) & (y < box[3]))
