"""Kinds of rock: a declaration each of its colour, beds and joints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

Colour = tuple[float, float, float]

_DIGITS: Final = 9


@dataclass(frozen=True)
class Rock:
    """A kind of rock. Colours are of weathered faces: linear albedo over that of the rock texture, 0.22."""

    name: str
    tint: Colour
    bed: float  # m, thickness of a bed
    bedding: float  # how much its beds differ in hardness, 0 to 1
    banding: float  # how much their colours differ, 0 to 1
    joints: float  # how open its joints across the beds are, 0 to 1


_DECLARED: Final = (
    Rock("gneiss", (0.70, 0.68, 0.65), 34.0, 0.8, 0.6, 0.5),
    Rock("granite", (0.98, 0.90, 0.82), 60.0, 0.35, 0.15, 1.0),
    Rock("limestone", (1.02, 0.99, 0.91), 44.0, 1.0, 0.5, 0.6),
    Rock("sandstone", (1.05, 0.92, 0.76), 38.0, 1.0, 0.8, 0.6),
    Rock("slate", (0.50, 0.52, 0.55), 16.0, 0.8, 0.5, 0.3),
    Rock("basalt", (0.42, 0.40, 0.39), 28.0, 0.8, 0.35, 1.0),
)

ROCKS: Final[Mapping[str, Rock]] = {rock.name: rock for rock in _DECLARED}
"""Kinds of rock by name."""


@dataclass(frozen=True)
class Strata:
    """Beds of a rock: a position's coordinate across them is its product with ``across``, in beds."""

    rock: Rock
    across: tuple[float, float, float]  # beds per m eastward, northward and upward
    strike: tuple[float, float]  # the level direction along the beds: east, north

    @classmethod
    def from_settings(cls, geology: Mapping[str, Any]) -> Strata:
        """Return the strata of the values of ``[geology]``."""
        rock = ROCKS[geology["rock"]]
        (rise, level), (east, north) = (_unit(geology[name]) for name in ("dip", "dip_direction"))
        across = (rise * east / rock.bed, rise * north / rock.bed, level / rock.bed)
        return cls(rock, across, (north, -east))


def _unit(degrees: float) -> tuple[float, float]:
    """Return sine and cosine, rounded: their last bits differ between C libraries."""
    angle = math.radians(degrees)
    return round(math.sin(angle), _DIGITS), round(math.cos(angle), _DIGITS)
