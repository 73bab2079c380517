"""The rules between types of feature: who stands where, in one place to read and edit.

Zaaijer 2013 §4.4 asks for rules that "can be specified and adjusted"; these are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

LAYER_CODES: Final = {"mountain": 0, "hill": 1, "dune": 2, "forest": 3, "river": 4, "lake": 5, "material": 6}
"""Codes that ids and hashes carry. Never renumber: every terrain would change."""


@dataclass(frozen=True)
class TypeRule:
    """How one type of feature takes its size and strength from what was painted.

    Attributes
    ----------
    reach : float
        Where the ground shows a quarter of the label's strength, over the radius of the painted disc: 1 puts
        that on the painted border, if nothing else stands there.
    support : (low, high)
        Strength of the features between the summits, as a share of a summit of the same size.
    held : float
        Least share of the label's strength that a feature has at fidelity 1, so that all of the shape shows.
    size_power : float
        A smaller disc's strength goes with (its radius / the shape's largest) to this power.
    variation : float
        Hashed variation of a summit's strength, as a share to either side, but never above its label's.
    most_slope : float
        Strength is at most this times the disc's radius; tan 70° for what rises from the ground.
    fill_radius : float
        Largest ground radius (m) where nothing was painted; the smallest is 0.4 of it.
    fill_extent : float
        … and never more than this share of the sketch's extent.
    fill_slope : float
        Strength where nothing was painted is at most this times the ground radius.
    """

    reach: float
    support: tuple[float, float]
    held: float
    size_power: float
    variation: float
    most_slope: float
    fill_radius: float
    fill_extent: float
    fill_slope: float


_TAN_70 = 2.7474774194546216
_ANY = float("inf")

TYPES: Final[dict[str, TypeRule]] = {
    #                    reach  support      held  size  var.  slope    fill: radius extent slope
    "mountain": TypeRule(1.14, (0.55, 0.85), 0.36, 0.50, 0.00, _TAN_70, 2500.0, 0.30, 0.60),
    "hill": TypeRule(1.10, (0.45, 0.70), 0.36, 0.50, 0.25, _TAN_70, 350.0, 0.12, 0.40),
    "dune": TypeRule(1.03, (0.85, 1.00), 0.85, 0.25, 0.10, _TAN_70, 900.0, 0.20, 0.20),
    "forest": TypeRule(1.14, (0.90, 1.00), 0.90, 0.00, 0.05, _ANY, 260.0, 0.10, _ANY),
}
"""In the order in which they are placed: earlier types do not give way to later ones."""


@dataclass(frozen=True)
class Preference:
    """What a feature looks for, or away from, when it chooses its place near where it was painted.

    `what` says in which set `of` is looked up: ``'user'`` features (what was painted), ``'final'`` features
    (already placed), or the painted pixels of a ``'layer'``. Positive weights attract. `reach` is the
    distance at which the effect ends, in radii of the feature's disc.
    """

    feature: str
    what: Literal["user", "final", "layer"]
    of: str
    weight: float
    reach: float


PREFERENCES: Final = (
    Preference("mountain", "user", "mountain", +1.0, 2.0),
    Preference("mountain", "layer", "river", -2.0, 1.5),
    Preference("hill", "user", "hill", +1.0, 2.0),
    Preference("hill", "layer", "river", -1.5, 1.5),
    Preference("hill", "final", "mountain", -0.5, 2.0),
    Preference("dune", "user", "dune", +1.0, 2.0),
    Preference("dune", "layer", "river", -1.5, 1.5),
    Preference("dune", "final", "mountain", -0.5, 1.0),
    Preference("forest", "user", "forest", +1.0, 2.0),
    Preference("forest", "layer", "river", -0.5, 0.5),
    Preference("forest", "final", "dune", -1.0, 1.0),
)

SUMMIT_SHUNS_SUMMIT: Final = -1.5
"""Weight with which summits of one type keep apart (reach: two radii of the disc)."""

SPACING: Final[dict[tuple[str, str], float]] = {
    ("mountain", "mountain"): 0.60,
    ("mountain", "hill"): 0.50,
    ("mountain", "dune"): 0.80,
    ("hill", "hill"): 0.45,
    ("hill", "dune"): 0.70,
    ("dune", "dune"): 0.50,
    ("dune", "forest"): 0.80,
    ("forest", "forest"): 0.40,
}
"""Where nothing was painted, two features conflict when nearer than this times the sum of their radii."""

CLEARANCE: Final[dict[tuple[str, str], float]] = {
    ("mountain", "mountain"): 0.80,
    ("mountain", "hill"): 0.80,
    ("mountain", "river"): 1.00,
    ("mountain", "dune"): 0.90,
    ("mountain", "forest"): 0.60,
    ("hill", "mountain"): 0.40,
    ("hill", "hill"): 0.80,
    ("hill", "river"): 0.90,
    ("hill", "dune"): 0.90,
    ("hill", "forest"): 0.20,
    ("dune", "mountain"): 0.90,
    ("dune", "hill"): 0.90,
    ("dune", "river"): 1.20,
    ("dune", "dune"): 0.80,
    ("dune", "forest"): 1.00,
    ("forest", "mountain"): 0.00,
    ("forest", "hill"): 0.00,
    ("forest", "river"): 0.00,
    ("forest", "dune"): 1.00,
    ("forest", "forest"): 0.50,
}
"""What fills unpainted ground (first) keeps this many of its radii away from pixels of a painted layer
(second). Zero: only off the painted pixels themselves."""
