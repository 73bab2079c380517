"""Candidates that fill unpainted ground: how many of each type, how large, so that densities are reached."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features.rules import SPACING, TYPES

if TYPE_CHECKING:
    from sketchterrain.sketch.document import Sketch

_SMALLEST = 0.4  # least radius over largest
_MOST_CROWDING = 0.3  # expected rivals of its own type that a candidate has within its spacing
_KM2 = 1e6  # m²
_LEAST_CELL, _MOST_CELL = 16.0, 32768.0  # m


@dataclass(frozen=True)
class CandidateRule:
    """How candidates of one type are proposed: radii (m), cells (m), candidates a cell."""

    name: str
    low: float
    high: float
    cell: float
    per_cell: float


def candidate_rules(sketch: Sketch) -> dict[str, CandidateRule]:
    """One for each type whose density is not 0, in the order in which types give way."""
    proposals: dict[str, CandidateRule] = {}
    kept: dict[str, tuple[float, float, float]] = {}  # density (1/m²) and radii of the types before
    for name, rule in TYPES.items():
        density = float(sketch.density.get(name, 0.0)) / _KM2
        if density <= 0.0:
            continue
        factor = SPACING.get((name, name), 0.0)
        high = min(rule.fill_radius, rule.fill_extent * sketch.extent)
        crowding = density * math.pi * _mean_square(factor, (_SMALLEST, 1.0), (_SMALLEST, 1.0))
        high = float(np.float32(min(high, math.sqrt(_MOST_CROWDING / crowding))))
        low = _SMALLEST * high
        # Proposals that conflict thin out (Matérn): propose as many more as will be lost.
        lost = density * math.pi * _mean_square(factor, (low, high), (low, high))
        rate = density * -math.log1p(-lost) / lost
        for other, (density_of, low_of, high_of) in kept.items():
            of_other = _mean_square(SPACING.get((other, name), 0.0), (low_of, high_of), (low, high))
            rate *= math.exp(min(density_of * math.pi * of_other, 1.0))
        cell = 2.0 ** round(math.log2(1.0 / math.sqrt(rate)))
        cell = min(max(cell, _LEAST_CELL), _MOST_CELL)
        proposals[name] = CandidateRule(name, low, high, cell, rate * cell * cell)
        kept[name] = (rate, low, high)
    return proposals


def _mean_square(factor: float, one: tuple[float, float], other: tuple[float, float]) -> float:
    """Mean of (factor · (R₁ + R₂))² for two radii, each log-uniform in its range."""
    (first, first_square), (second, second_square) = _moments(*one), _moments(*other)
    return factor**2 * (first_square + second_square + 2.0 * first * second)


def _moments(low: float, high: float) -> tuple[float, float]:
    span = math.log(high / low)
    return (high - low) / span, (high**2 - low**2) / (2.0 * span)
