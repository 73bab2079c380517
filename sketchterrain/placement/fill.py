"""Fill: features of unpainted terrain by density, unbounded and independent of the query.

Each type has its own cells, aligned to the world's origin. A cell proposes candidates from hashes of its
index; a candidate survives unless one of an earlier type, or of its own type and of higher priority, is too
close. One round, comparing with candidates, not survivors: every decision reads a bounded neighbourhood, so
that a rectangle's features do not depend on which rectangle was queried.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array, StructuredArray
from sketchterrain.errors import InputError
from sketchterrain.placement.cache import IdentityKey, LRUCache, PlacementCache
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
    from collections.abc import Callable, Sequence

    from sketchterrain.document.sketch import Sketch


_SMALLEST = 0.4  # least radius over largest
_MAX_CROWDING = 0.3  # expected rivals of a candidate within its spacing
_KM2 = 1e6  # m²
_MIN_CELL, _MAX_CELL = 16.0, 32768.0  # m


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
    proposals: dict[str, CandidateRule] = {}
    kept: dict[str, tuple[float, float, float]] = {}  # density (1/m²) and radii of preceding types
    for name, rule in TYPES.items():
        density = float(sketch.density.get(name, 0.0)) / _KM2
        if density <= 0.0:
            continue
        factor = SPACING.get((name, name), 0.0)
        high = min(rule.fill_radius, rule.fill_extent * sketch.extent)
        crowding = density * math.pi * _mean_square(factor, (_SMALLEST, 1.0), (_SMALLEST, 1.0))
        high = float(np.float32(min(high, math.sqrt(_MAX_CROWDING / crowding))))
        low = _SMALLEST * high
        # Conflicting candidates are removed (Matérn): propose as many more as will be lost.
        lost = density * math.pi * _mean_square(factor, (low, high), (low, high))
        rate = density * -math.log1p(-lost) / lost
        for other, (density_of, low_of, high_of) in kept.items():
            of_other = _mean_square(SPACING.get((other, name), 0.0), (low_of, high_of), (low, high))
            rate *= math.exp(min(density_of * math.pi * of_other, 1.0))
        cell = 2.0 ** round(math.log2(1.0 / math.sqrt(rate)))
        cell = min(max(cell, _MIN_CELL), _MAX_CELL)
        proposals[name] = CandidateRule(name, low, high, cell, rate * cell * cell)
        kept[name] = (rate, low, high)
    return proposals


def _mean_square(factor: float, one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the mean of (factor · (R₁ + R₂))² for two radii, each log-uniform in its range."""
    (first, first_square), (second, second_square) = _moments(*one), _moments(*other)
    return factor**2 * (first_square + second_square + 2.0 * first * second)


def _moments(low: float, high: float) -> tuple[float, float]:
    span = math.log(high / low)
    return (high - low) / span, (high**2 - low**2) / (2.0 * span)


_EXTENTS, _RADII = (
    0.4,
    2.0,
)  # margin around the sketch: the extensions of rivers, and features that influence them
_MAX_CANDIDATES = 6000


def cached_bounds(
    sketch: Sketch, proposals: Sequence[CandidateRule]
) -> tuple[float, float, float, float] | None:
    """Return the box (m) around the sketch whose features are cached; None if too many candidates."""
    east, north = sketch.size
    wide = _EXTENTS * sketch.extent + _RADII * max((each.high for each in proposals), default=0.0)
    rate = sum(each.per_cell / (each.cell * each.cell) for each in proposals)
    if (east + 2.0 * wide) * (north + 2.0 * wide) * rate > _MAX_CANDIDATES:
        return None
    return -wide, -wide, east + wide, north + wide


def distances_to_layers(
    sketch: Sketch, cache: PlacementCache, fills: tuple[str, ...]
) -> dict[str, Callable[[Float64Array, Float64Array], Float64Array]]:
    """Return the distance functions of painted layers that any of these types keeps clear of."""
    return {
        layer: cache.painted_distance(sketch, layer)
        for layer, image in sketch.layers.items()
        if any((name, layer) in CLEARANCE for name in fills) and image.any()
    }


class PaintedClearance:
    """Painted shapes and features that the fill keeps clear of."""

    def __init__(
        self,
        painted: StructuredArray,
        distances: dict[str, Callable[[Float64Array, Float64Array], Float64Array]],
    ) -> None:
        self._distance = distances
        self._placed = {name: painted[painted["type"] == code] for code, name in enumerate(FEATURE_TYPES)}

    def clearance_mask(self, name: str, features: StructuredArray, cache: LRUCache) -> BoolArray:
        """Return which features of a type are clear of paint and of placed features."""
        clear = np.ones(len(features), dtype=np.bool_)
        if len(features) == 0:
            return clear
        for layer, distance in self._distance.items():
            if (name, layer) in CLEARANCE:
                key = ("clearance", name, layer, IdentityKey(features), IdentityKey(distance))
                clear &= cache.get_or_compute(
                    key, partial(_clear, features, distance, CLEARANCE[name, layer])
                )
        for other, placed in self._placed.items():
            factor = SPACING.get((other, name), 0.0)
            if factor > 0.0 and len(placed):
                reach = factor * float(placed["radius"].max() + features["radius"].max())
                near = ("spacing", name, other, IdentityKey(features), blake2b(placed.tobytes()).digest())
                made = partial(suppressed_by, features, placed, factor, reach, same=False)
                clear &= ~cache.get_or_compute(near, made)
        return clear


def _clear(
    features: StructuredArray, distance: Callable[[Float64Array, Float64Array], Float64Array], factor: float
) -> BoolArray:
    away = distance(features["x"], features["y"])
    return np.asarray(away > factor * features["radius"].astype(np.float64))


def suppressed_by(
    mine: StructuredArray, rivals: StructuredArray, factor: float, reach: float, *, same: bool
) -> BoolArray:
    """Return which features have a rival within `factor` times the sum of radii (if `same`: of lower id).

    Ids of the fill are hashes, so a lower id is an arbitrary priority.
    """
    beaten = np.zeros(len(mine), dtype=np.bool_)
    if len(mine) == 0 or len(rivals) == 0:
        return beaten
    centre = np.array([mine["x"][0], mine["y"][0]])
    at = np.stack([mine["x"], mine["y"]], axis=-1) - centre
    others = np.stack([rivals["x"], rivals["y"]], axis=-1) - centre
    # The tree only proposes pairs, from slightly farther than needed; the decision is made on plain numbers
    # that do not depend on the queried rectangle.
    pairs = cKDTree(at).sparse_distance_matrix(cKDTree(others), reach * 1.001 + 0.01, output_type="ndarray")
    i, j = pairs["i"], pairs["j"]
    across, along = mine["x"][i] - rivals["x"][j], mine["y"][i] - rivals["y"][j]
    radii = mine["radius"][i].astype(np.float64) + rivals["radius"][j].astype(np.float64)
    near = across * across + along * along < (factor * radii) ** 2
    if same:
        near &= rivals["id"][j] < mine["id"][i]
    beaten[i[near]] = True
    return beaten


class Fill:
    """Features of unpainted terrain: a pure function of position and seed, at the sketch's densities.

    The fill keeps its distance from `painted` features (`place`) and rivers: ``river_distance(x, y)`` returns
    the distance (m) to the nearest painted river up to at least 2.5 km, by default that of the river layer.
    No feature exceeds `max_radius` (m), 0 when every density is 0.
    """

    max_radius: float  # radius (m) that no feature of the fill exceeds; 0 when every density is 0

    def __init__(
        self,
        sketch: Sketch,
        painted: StructuredArray,
        *,
        seed: int,
        river_distance: Callable[[Float64Array, Float64Array], Float64Array] | None = None,
        cache: PlacementCache | None = None,
    ) -> None:
        self.sketch = sketch
        self.seed = seed
        self._rules = candidate_rules(sketch)
        self.max_radius = max((proposal.high for proposal in self._rules.values()), default=0.0)
        self.painted = painted
        cache = PlacementCache() if cache is None else cache
        distances = distances_to_layers(sketch, cache, tuple(self._rules))
        self._river_distance = river_distance
        if river_distance is not None:
            distances["river"] = river_distance
        self._painted = PaintedClearance(painted, distances)
        self._cached_box = cached_bounds(sketch, tuple(self._rules.values()))
        self._cached_features: StructuredArray | None = None
        self._cache = cache.candidates

    def __reduce__(self) -> tuple[Callable[..., Fill], tuple[object, ...]]:
        """Pickle the arguments and the features near the sketch."""
        return _rebuild, (
            self.sketch,
            self.painted,
            self.seed,
            self._river_distance,
            self._cached_features,
        )

    @property
    def rules(self) -> tuple[object, ...]:
        """Everything that it depends on everywhere: fills with equal rules differ only near changed paint."""
        own = [tuple(self.sketch.properties(name, 1).items()) for name in self._rules]
        size = (self.sketch.extent, self.sketch.width_px, self.sketch.height_px)
        return self.seed, size, tuple(self._rules.values()), tuple(own)

    @property
    def types(self) -> tuple[str, ...]:
        """Types that it has features of, in order of precedence."""
        return tuple(self._rules)

    def max_strength(self, name: str, radius: float) -> float:
        """Return an upper bound of the strength of a type's features up to a ground radius (m); 0 if none."""
        proposal = self._rules.get(name)
        if proposal is None or radius <= proposal.low:
            return 0.0
        properties = self.sketch.properties(name, 1)
        most = properties["density"] if name == "forest" else properties["height"]
        return float(min(most, TYPES[name].fill_slope * min(radius, proposal.high)))

    def influence_radii(self, name: str, radius: float | None = None) -> dict[str, float]:
        """Return the invalidation radius (m) per type around a changed feature (or pixels: no `radius`).

        `name` is the type of the changed feature or the painted layer. A feature too close is suppressed, and
        then those that it had suppressed may survive.
        """
        largest = {own: np.array([proposal.high]) for own, proposal in self._rules.items()}
        ways = {own: self.candidate_influence(own, name, high, radius) for own, high in largest.items()}
        direct = {own: float(way[0]) for own, way in ways.items() if way is not None}
        far = dict(direct)
        for (rival, own), factor in SPACING.items():
            if rival in direct and own in largest:
                after = direct[rival] + factor * float(largest[rival][0] + largest[own][0])
                far[own] = max(far.get(own, 0.0), after)
        return far

    def candidate_influence(
        self, own: str, name: str, radii: Float64Array, radius: float | None = None
    ) -> Float64Array | None:
        """Return how far (m) candidates of a type and radii (m) depend on `name`; None if they do not."""
        if radius is not None:
            factor = SPACING.get((name, own), 0.0)
            return factor * (radius + radii) if factor > 0.0 else None
        if (own, name) not in CLEARANCE:
            return None
        # Beyond the sketch's edge a distance may be underestimated by a factor of up to √2.
        return math.sqrt(2.0) * CLEARANCE[own, name] * radii + 2.0 * self.sketch.pixel_size

    def candidates(self, name: str, box: tuple[float, float, float, float]) -> StructuredArray:
        """Return candidates of a type in a rectangle (west, south, east, north, m), ignoring paint."""
        return self._proposed(self._rules[name], box)

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
        home = self._cached_box
        if home is None or box[0] < home[0] or box[1] < home[1] or box[2] > home[2] or box[3] > home[3]:
            return self._found(box, min_radius)
        if self._cached_features is None:
            self._cached_features = self._found(home, 0.0)
        near = self._cached_features
        inside = (box[0] <= near["x"]) & (near["x"] < box[2]) & (box[1] <= near["y"]) & (near["y"] < box[3])
        kept: StructuredArray = near[inside & (near["radius"] >= min_radius)]
        return kept

    def _found(self, box: tuple[float, float, float, float], min_radius: float) -> StructuredArray:
        asked = [proposal for proposal in self._rules.values() if proposal.high >= min_radius]
        near = self._candidates_around(box, asked)
        parts = [np.zeros(0, dtype=FEATURE)]
        parts.extend(self._survivors(proposal, near, box, min_radius) for proposal in asked)
        found = np.concatenate(parts)
        ordered: StructuredArray = found[np.argsort(found["id"], kind="stable")]
        return ordered

    def _candidates_around(
        self, box: tuple[float, float, float, float], asked: list[CandidateRule]
    ) -> dict[str, StructuredArray]:
        """Return candidates of each type in a rectangle, and around it as far as they may suppress others."""
        near = {}
        # Most candidates near the sketch are those of the sketch before.
        cache = self._cache if box is self._cached_box else LRUCache(0)
        for rival in self._rules.values():
            ways = [SPACING.get((rival.name, own.name), 0.0) * (rival.high + own.high) for own in asked]
            reach = max(ways, default=0.0)
            if reach > 0.0 or rival in asked:
                wide = (box[0] - reach, box[1] - reach, box[2] + reach, box[3] + reach)
                near[rival.name] = self._candidates(rival, wide, cache)
        return near

    def _survivors(
        self,
        proposal: CandidateRule,
        near: dict[str, StructuredArray],
        box: tuple[float, float, float, float],
        min_radius: float,
    ) -> StructuredArray:
        mine = near[proposal.name]
        inside = (box[0] <= mine["x"]) & (mine["x"] < box[2]) & (box[1] <= mine["y"]) & (mine["y"] < box[3])
        mine = mine[inside & (mine["radius"] >= min_radius)]
        alive = np.ones(len(mine), dtype=np.bool_)
        for rival in self._rules.values():
            factor = SPACING.get((rival.name, proposal.name), 0.0)
            if factor > 0.0 and len(mine):
                reach = factor * (rival.high + proposal.high)
                alive &= ~suppressed_by(mine, near[rival.name], factor, reach, same=rival is proposal)
        return mine[alive]

    def _candidates(
        self, proposal: CandidateRule, box: tuple[float, float, float, float], cache: LRUCache
    ) -> StructuredArray:
        """Return candidates of a type in a rectangle that are clear of paint."""
        properties = tuple(self.sketch.properties(proposal.name, 1).items())
        proposed: StructuredArray = cache.get_or_compute(
            ("proposed", self.seed, proposal, box, properties), lambda: self._proposed(proposal, box)
        )
        return proposed[self._painted.clearance_mask(proposal.name, proposed, cache)]

    def _proposed(self, proposal: CandidateRule, box: tuple[float, float, float, float]) -> StructuredArray:
        name, cell, code = proposal.name, proposal.cell, FEATURE_TYPES.index(proposal.name)
        most = math.ceil(proposal.per_cell)
        column = np.arange(math.floor(box[0] / cell), math.floor(box[2] / cell) + 1)[None, :, None]
        row = np.arange(math.floor(box[1] / cell), math.floor(box[3] / cell) + 1)[:, None, None]
        number = np.arange(most)[None, None, :]
        count = np.floor(proposal.per_cell + hash_unit(self.seed, f"{name} count", column, row))
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
        result["radius"] = proposal.low * (proposal.high / proposal.low) ** size
        self._set_strength(result, proposal, hash_unit(self.seed, f"{name} strength", *keys))
        return result

    def _set_strength(self, features: StructuredArray, proposal: CandidateRule, chance: Float64Array) -> None:
        """Set strength and style from the properties of the layer's label 1, lower where it is smaller."""
        properties = self.sketch.properties(proposal.name, 1)
        radius = features["radius"].astype(np.float64)
        if proposal.name == "forest":
            strength = properties["density"] * (0.7 + 0.3 * chance)
        else:
            strength = properties["height"] * (radius / proposal.high) ** 0.8 * (0.8 + 0.2 * chance)
        # A crest shortens the flanks.
        clear = 1.0 - np.hypot(*crest_offsets(features).T)
        features["strength"] = np.minimum(strength, TYPES[proposal.name].fill_slope * radius) * clear
        for key in STYLE:
            features[key] = properties.get(key, 0.0)
        if proposal.name == "forest":
            features["peakiness"] = conifer_code(float(properties["conifers"]))


def _rebuild(
    sketch: Sketch,
    painted: StructuredArray,
    seed: int,
    river_distance: Callable[[Float64Array, Float64Array], Float64Array] | None,
    cached_features: StructuredArray | None,
) -> Fill:
    fill = Fill(sketch, painted, seed=seed, river_distance=river_distance)
    fill._cached_features = cached_features
    return fill
