"""Hatches that tell layers apart without colour: small patterns that repeat."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["HATCHES", "PERIOD", "hatch", "hatch_period"]

Floats = npt.NDArray[np.float32]

PERIOD: Final = 16
"""Pixels, at a device pixel ratio of 1, after which every hatch repeats."""

_LINE = 1.15  # px, width of a hatch's lines


def hatch_period(ratio: float) -> int:
    """Return the device pixels after which hatches repeat at a device pixel ratio."""
    return max(round(PERIOD * ratio), 4)


def hatch(kind: str, period: int) -> Floats:
    """Return a hatch.

    Parameters
    ----------
    kind : str
        One of `HATCHES`.
    period : int
        Pixels along its side; see `hatch_period`.

    Returns
    -------
    (period, period) float32
        How much of each pixel its lines cover, 0 … 1. It goes on without a seam; read-only.

    Raises
    ------
    ValueError
        If there is no such hatch.
    """
    if kind not in HATCHES:
        raise ValueError(f"expected a hatch, one of {', '.join(HATCHES)}, got {kind!r}")
    return _drawn(kind, period)


@lru_cache(maxsize=64)
def _drawn(kind: str, period: int) -> Floats:
    middles = ((np.arange(period) + 0.5) * (PERIOD / period)).astype(np.float32)
    x, y = np.meshgrid(middles, middles)
    distance, half_width = HATCHES[kind](x, y)
    covered: Floats = np.clip((half_width - distance) * (period / PERIOD) + 0.5, 0.0, 1.0).astype(np.float32)
    covered.flags.writeable = False
    return covered


def _from_line(across: Floats, spacing: float) -> Floats:
    """Distance from the nearest of parallel lines, from a coordinate across them."""
    return np.asarray(np.abs((across + 0.5 * spacing) % spacing - 0.5 * spacing), np.float32)


def _peaks(x: Floats, y: Floats) -> tuple[Floats, float]:
    tooth: Floats = np.abs((x % np.float32(8.0)) - np.float32(4.0))
    return _from_line(y + np.float32(0.9) * tooth, 8.0) * np.float32(0.743), 0.5 * _LINE


def _waves(x: Floats, y: Floats) -> tuple[Floats, float]:
    swing = np.float32(1.9) * np.sin(np.float32(2.0 * np.pi / PERIOD) * x)
    return _from_line(y + swing, 8.0) * np.float32(0.88), 0.5 * _LINE


def _falling(x: Floats, y: Floats) -> tuple[Floats, float]:
    return _from_line(x - y, 5.0 + 1.0 / 3.0) * np.float32(np.sqrt(0.5)), 0.45 * _LINE


def _level(x: Floats, y: Floats) -> tuple[Floats, float]:
    return _from_line(y + 0.0 * x, 5.0 + 1.0 / 3.0), 0.5 * _LINE


def _crossed(x: Floats, y: Floats) -> tuple[Floats, float]:
    slope = np.float32(np.sqrt(0.5))
    return np.minimum(_from_line(x - y, 8.0), _from_line(x + y, 8.0)) * slope, 0.42 * _LINE


def _nearest(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Offsets from the nearest point of a staggered grid, 8 px apart."""
    best = np.full(x.shape, np.inf, np.float32)
    east, south = np.zeros_like(x), np.zeros_like(y)
    for shift_x, shift_y in ((2.0, 2.0), (6.0, 6.0)):
        dx = (x - shift_x + 4.0) % 8.0 - 4.0
        dy = (y - shift_y + 4.0) % 8.0 - 4.0
        nearer = np.hypot(dx, dy) < best
        best = np.where(nearer, np.hypot(dx, dy), best)
        east, south = np.where(nearer, dx, east), np.where(nearer, dy, south)
    return east, south


def _dots(x: Floats, y: Floats) -> tuple[Floats, float]:
    return np.hypot(*_nearest(x, y)), 1.15


def _trees(x: Floats, y: Floats) -> tuple[Floats, float]:
    dx, dy = _nearest(x, y)
    upright = np.maximum(np.abs(dx), np.abs(dy) - 2.0)
    across = np.maximum(np.abs(dy), np.abs(dx) - 2.0)
    return np.minimum(upright, across), 0.5 * _LINE


HATCHES: Final[dict[str, Callable[[Floats, Floats], tuple[Floats, float]]]] = {
    "peaks": _peaks,
    "waves": _waves,
    "falling": _falling,
    "level": _level,
    "crossed": _crossed,
    "dots": _dots,
    "trees": _trees,
}
"""Each one's distance from its lines (px of `PERIOD`), and half the width of those."""
