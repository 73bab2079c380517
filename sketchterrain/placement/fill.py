"""Fill: features of unpainted terrain by density, unbounded and independent of the query.

Each type has its own cells, aligned to the world's origin. A cell proposes candidates from hashes of its
index; a candidate survives unless one of an earlier type, or of its own type and of higher priority, is too
close. One round, comparing with candidates, not survivors: every decision reads a bounded neighbourhood, so
that a rectangle's features do not depend on which rectangle was queried.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array, StructuredArray
from sketchterrain.caching import IdentityKey, LRUCache
from sketchterrain.errors import InputError
from sketchterrain.placement.cache import PlacementCache
from sketchterrain.placement.density import PaintedDistance
from sketchterrain.placement.feature_types import (
    CLEARANCE,
    FEATURE,
    FEATURE_TYPES,
    FILL_BIT,
    SPACING,
    STYLE,
    TYPES,
    conifer_code,
    crest_offsets,
)
from sketchterrain.placement.hashing import hash_keys, hash_unit

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

    Box = tuple[float, float, float, float]

_MIN_RADIUS = 0.4  # of the largest
_MAX_CROWDING = 0.3  # expected rivals of a candidate within its spacing
_KM2 = 1e6  # m²
_MIN_CELL, _MAX_CELL = 16.0, 32768.0  # m
# Margin of the cached box around the sketch: the extensions of rivers, and features that influence them.
_CACHED_EXTENTS, _CACHED_RADII = 0.4, 2.0
_MAX_CACHED = 6000  # candidates


@dataclass(frozen=True)
class CandidateRule:
    """How candidates of one type are proposed: radii (m), cells (m), candidates per cell."""

    name: str
    low: float
    high: float
    cell: float
    per_cell: float


def candidate_rules(sketch: Sketch) -> dict[str, CandidateRule]:
    """Return a rule for each type whose density is not 0, in order of precedence."""
    rules: dict[str, CandidateRule] = {}
    preceding: dict[str, tuple[float, float, float]] = {}  # density (1/m²) and radii of preceding types
    for name, rule in TYPES.items():
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
        rules[name] = CandidateRule(name, low, high, cell, rate * cell * cell)
        preceding[name] = (rate, low, high)
    return rules


def _mean_square(factor: float, one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the mean of (factor · (R₁ + R₂))² for two radii, each log-uniform in its range."""
    (first, first_square), (second, second_square) = _moments(*one), _moments(*other)
    return factor**2 * (first_square + second_square + 2.0 * first * second)


def _moments(low: float, high: float) -> tuple[float, float]:
    span = math.log(high / low)
    return (high - low) / span, (high**2 - low**2) / (2.0 * span)


def _cached_box(sketch: Sketch, rules: dict[str, CandidateRule]) -> Box | None:
    """Return the box (m) around the sketch whose features are cached; None if too many candidates."""
    east, north = sketch.size
    margin = _CACHED_EXTENTS * sketch.extent + _CACHED_RADII * max(
        (rule.high for rule in rules.values()), default=0.0
    )
    rate = sum(rule.per_cell / (rule.cell * rule.cell) for rule in rules.values())
    if (east + 2.0 * margin) * (north + 2.0 * margin) * rate > _MAX_CACHED:
        return None
    return -margin, -margin, east + margin, north + margin


class PaintedClearance:
    """Painted shapes and features that the fill keeps clear of."""

    def __init__(
        self, sketch: Sketch, painted: StructuredArray, names: tuple[str, ...], cache: PlacementCache
    ) -> None:
        self._distances = {
            layer: cache.painted_distance(sketch, layer)
            for layer, image in sketch.layers.items()
            if any((name, layer) in CLEARANCE for name in names) and image.any()
        }
        self._placed = {name: painted[painted["type"] == code] for code, name in enumerate(FEATURE_TYPES)}

    def clearance_mask(self, name: str, features: StructuredArray, cache: LRUCache) -> BoolArray:
        """Return which features of a type are clear of paint and of placed features."""
        clear = np.ones(len(features), dtype=np.bool_)
        if len(features) == 0:
            return clear
        for layer, distance in self._distances.items():
            if (name, layer) in CLEARANCE:
                clear &= cache.get_or_compute(
                    ("clearance", name, layer, IdentityKey(features), IdentityKey(distance)),
                    partial(_clear_of_paint, features, distance, CLEARANCE[name, layer]),
                )
        for other, placed in self._placed.items():
            factor = SPACING.get((other, name), 0.0)
            if factor > 0.0 and len(placed):
                radius = factor * float(placed["radius"].max() + features["radius"].max())
                digest = blake2b(placed.tobytes()).digest()
                clear &= ~cache.get_or_compute(
                    ("spacing", name, other, IdentityKey(features), digest),
                    partial(suppressed_by, features, placed, factor, radius, same=False),
                )
        return clear


def _clear_of_paint(features: StructuredArray, distance: PaintedDistance, factor: float) -> BoolArray:
    away = distance(features["x"], features["y"])
    return np.asarray(away > factor * features["radius"].astype(np.float64))


def suppressed_by(
    own: StructuredArray, rivals: StructuredArray, factor: float, radius: float, *, same: bool
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


class Fill:
    """Features of unpainted terrain: a pure function of position and seed, at the sketch's densities.

    The fill keeps its distance from painted layers and from `painted` features (`place`). No feature exceeds
    `max_radius` (m), 0 when every density is 0.
    """

    def __init__(
        self, sketch: Sketch, painted: StructuredArray, *, seed: int, cache: PlacementCache | None = None
    ) -> None:
        cache = PlacementCache() if cache is None else cache
        self.sketch = sketch
        self.painted = painted
        self.seed = seed
        self._rules = candidate_rules(sketch)
        self.max_radius = max((rule.high for rule in self._rules.values()), default=0.0)
        self._clearance = PaintedClearance(sketch, painted, tuple(self._rules), cache)
        self._cached_box = _cached_box(sketch, self._rules)
        self._cached_features: StructuredArray | None = None
        self._cache = cache.candidates

    def __reduce__(self) -> tuple[Callable[..., Fill], tuple[object, ...]]:
        """Pickle the arguments and the cached features."""
        return _rebuild, (self.sketch, self.painted, self.seed, self._cached_features)

    @property
    def rules(self) -> tuple[object, ...]:
        """Everything that it depends on everywhere: fills with equal rules differ only near changed paint."""
        own = [tuple(self.sketch.properties(name, 1).items()) for name in self._rules]
        size = (self.sketch.extent, self.sketch.width_px, self.sketch.height_px)
        return self.seed, size, tuple(self._rules.values()), tuple(own)

    def max_strength(self, name: str, radius: float) -> float:
        """Return an upper bound of the strength of a type's features up to a ground radius (m); 0 if none."""
        rule = self._rules.get(name)
        if rule is None or radius <= rule.low:
            return 0.0
        properties = self.sketch.properties(name, 1)
        strength = properties["density"] if name == "forest" else properties["height"]
        return float(min(strength, TYPES[name].fill_slope * min(radius, rule.high)))

    def influence_radii(self, name: str, radius: float | None = None) -> dict[str, float]:
        """Return the invalidation radius (m) per type around a changed feature (or pixels: no `radius`).

        `name` is the type of the changed feature or the painted layer. A feature too close is suppressed, and
        then those that it had suppressed may survive.
        """
        direct: dict[str, float] = {}
        for own, rule in self._rules.items():
            if radius is not None:
                factor = SPACING.get((name, own), 0.0)
                if factor > 0.0:
                    direct[own] = factor * (radius + rule.high)
            elif (own, name) in CLEARANCE:
                # Beyond the sketch's edge a distance may be underestimated by a factor of up to √2.
                clearance = math.sqrt(2.0) * CLEARANCE[own, name] * rule.high
                direct[own] = clearance + 2.0 * self.sketch.pixel_size
        radii = dict(direct)
        for (rival, own), factor in SPACING.items():
            if rival in direct and own in self._rules:
                indirect = direct[rival] + factor * (self._rules[rival].high + self._rules[own].high)
                radii[own] = max(radii.get(own, 0.0), indirect)
        return radii

    @property
    def dune_styles(self) -> frozenset[tuple[float, float]]:
        """Distinct (wavelength in m, wind in degrees) of its dunes, rounded as in ``FEATURE``."""
        if "dune" not in self._rules:
            return frozenset()
        properties = self.sketch.properties("dune", 1)
        style = (float(np.float32(properties["wavelength"])), float(np.float32(properties["wind"])))
        return frozenset([style])

    @property
    def conifers(self) -> float:
        """Share of conifers in its forests, 0 … 1 or ``BY_ELEVATION``."""
        return float(self.sketch.properties("forest", 1)["conifers"])

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
        near = self._cached_box
        if near is None or box[0] < near[0] or box[1] < near[1] or box[2] > near[2] or box[3] > near[3]:
            return self._compute(box, min_radius)
        if self._cached_features is None:
            self._cached_features = self._compute(near, 0.0)
        features = self._cached_features
        selected: StructuredArray = features[_inside(features, box) & (features["radius"] >= min_radius)]
        return selected

    def _compute(self, box: Box, min_radius: float) -> StructuredArray:
        rules = [rule for rule in self._rules.values() if rule.high >= min_radius]
        candidates = self._candidates_around(box, rules)
        parts = [np.zeros(0, dtype=FEATURE)]
        for rule in rules:
            own = candidates[rule.name]
            own = own[_inside(own, box) & (own["radius"] >= min_radius)]
            survives = np.ones(len(own), dtype=np.bool_)
            for rival in self._rules.values():
                factor = SPACING.get((rival.name, rule.name), 0.0)
                if factor > 0.0 and len(own):
                    radius = factor * (rival.high + rule.high)
                    rivals = candidates[rival.name]
                    survives &= ~suppressed_by(own, rivals, factor, radius, same=rival is rule)
            parts.append(own[survives])
        found = np.concatenate(parts)
        ordered: StructuredArray = found[np.argsort(found["id"], kind="stable")]
        return ordered

    def _candidates_around(self, box: Box, rules: list[CandidateRule]) -> dict[str, StructuredArray]:
        """Return candidates of each type in a rectangle, and around it as far as they may suppress others."""
        found = {}
        # Most candidates near the sketch are those of the sketch before.
        cache = self._cache if box is self._cached_box else LRUCache(0)
        for rival in self._rules.values():
            distances = [SPACING.get((rival.name, own.name), 0.0) * (rival.high + own.high) for own in rules]
            margin = max(distances, default=0.0)
            if margin > 0.0 or rival in rules:
                wide = (box[0] - margin, box[1] - margin, box[2] + margin, box[3] + margin)
                proposed = self._propose(rival, wide, cache)
                found[rival.name] = proposed[self._clearance.clearance_mask(rival.name, proposed, cache)]
        return found

    def _propose(self, rule: CandidateRule, box: Box, cache: LRUCache) -> StructuredArray:
        """Return candidates of a type in a rectangle, ignoring paint."""
        properties = tuple(self.sketch.properties(rule.name, 1).items())
        return cache.get_or_compute(
            ("proposed", self.seed, rule, box, properties), lambda: self._hash_candidates(rule, box)
        )

    def _hash_candidates(self, rule: CandidateRule, box: Box) -> StructuredArray:
        name, cell, code = rule.name, rule.cell, FEATURE_TYPES.index(rule.name)
        column = np.arange(math.floor(box[0] / cell), math.floor(box[2] / cell) + 1)[None, :, None]
        row = np.arange(math.floor(box[1] / cell), math.floor(box[3] / cell) + 1)[:, None, None]
        number = np.arange(math.ceil(rule.per_cell))[None, None, :]
        count = np.floor(rule.per_cell + hash_unit(self.seed, f"{name} count", column, row))
        rows, columns, numbers = np.nonzero(number < count)
        keys = (column[0, columns, 0], row[rows, 0, 0], numbers)

        x = (keys[0] + hash_unit(self.seed, f"{name} x", *keys)) * cell
        y = (keys[1] + hash_unit(self.seed, f"{name} y", *keys)) * cell
        inside = (box[0] <= x) & (x < box[2]) & (box[1] <= y) & (y < box[3])
        keys = (keys[0][inside], keys[1][inside], keys[2][inside])
        result = np.zeros(int(inside.sum()), dtype=FEATURE)
        result["id"] = FILL_BIT | np.uint64(code << 60) | (hash_keys(self.seed, name, *keys) >> np.uint64(4))
        result["type"], result["x"], result["y"] = code, x[inside], y[inside]
        size = hash_unit(self.seed, f"{name} size", *keys)
        result["radius"] = rule.low * (rule.high / rule.low) ** size
        self._set_strength(result, rule, hash_unit(self.seed, f"{name} strength", *keys))
        return result

    def _set_strength(self, features: StructuredArray, rule: CandidateRule, chance: Float64Array) -> None:
        """Set strength and style from the properties of the layer's label 1, lower where it is smaller."""
        properties = self.sketch.properties(rule.name, 1)
        radius = features["radius"].astype(np.float64)
        if rule.name == "forest":
            strength = properties["density"] * (0.7 + 0.3 * chance)
        else:
            strength = properties["height"] * (radius / rule.high) ** 0.8 * (0.8 + 0.2 * chance)
        # A crest shortens the flanks.
        flank = 1.0 - np.hypot(*crest_offsets(features).T)
        features["strength"] = np.minimum(strength, TYPES[rule.name].fill_slope * radius) * flank
        for key in STYLE:
            features[key] = properties.get(key, 0.0)
        if rule.name == "forest":
            features["peakiness"] = conifer_code(float(properties["conifers"]))


def _inside(features: StructuredArray, box: Box) -> BoolArray:
    x, y = features["x"], features["y"]
    return np.asarray((box[0] <= x) & (x < box[2]) & (box[1] <= y) & (y < box[3]))


def _rebuild(
    sketch: Sketch, painted: StructuredArray, seed: int, cached_features: StructuredArray | None
) -> Fill:
    fill = Fill(sketch, painted, seed=seed)
    fill._cached_features = cached_features
    return fill
