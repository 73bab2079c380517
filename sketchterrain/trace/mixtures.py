"""Pixels that are a mixture of their neighbours: what antialiasing, scaling and JPEG leave along borders."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

__all__ = ["mixtures", "uneven"]

_FLAT = 10  # levels of sRGB, 0 to 255, within which a neighbourhood is one colour
_APART = 36  # levels that two sides differ by at least, where something can be a mixture of them
_OWN = 14  # levels by which a mixture differs from both sides
_SLACK = 6  # levels that a mixture may lie outside of its sides: JPEG
_REACH = (1, 2)  # px to each side
_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))


def mixtures(rgb: npt.NDArray[np.uint8], rough: npt.NDArray[np.bool_] | None = None) -> npt.NDArray[np.bool_]:
    """Return which pixels have, in each channel, a value between those of two pixels opposite one another.

    Whoever blends two colours, in sRGB or in light, gives each channel a value in between. A thin line, a
    river, has the same on both sides, and is no mixture of it.

    Parameters
    ----------
    rgb
        uint8, (height, width, 3).
    rough
        What `uneven` says of it, if that is known already.

    Returns
    -------
    numpy.ndarray
        bool, (height, width).
    """
    height, width = rgb.shape[:2]
    mixed = np.zeros((height, width), dtype=bool)
    rows, columns = np.nonzero(uneven(rgb) if rough is None else rough)
    own = rgb[rows, columns].astype(np.int16)
    for down, right in _DIRECTIONS:
        for reach in _REACH:
            one = _at(rgb, rows - reach * down, columns - reach * right)
            other = _at(rgb, rows + reach * down, columns + reach * right)
            low, high = np.minimum(one, other), np.maximum(one, other)
            found = ((own >= low - _SLACK) & (own <= high + _SLACK)).all(axis=1)
            found &= (high - low).max(axis=1) >= _APART
            found &= np.abs(own - one).max(axis=1) > _OWN
            found &= np.abs(own - other).max(axis=1) > _OWN
            mixed[rows[found], columns[found]] = True
            left = ~found
            rows, columns, own = rows[left], columns[left], own[left]
    return mixed


def uneven(rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
    """Return which pixels have neighbours of another colour: uint8 (height, width, 3) to bool."""
    rough = np.zeros(rgb.shape[:2], dtype=bool)
    for channel in range(3):
        values = rgb[..., channel]
        high = ndimage.maximum_filter(values, size=3, mode="nearest")
        low = ndimage.minimum_filter(values, size=3, mode="nearest")
        rough |= high - low > _FLAT
    return rough


def _at(
    rgb: npt.NDArray[np.uint8], rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]
) -> npt.NDArray[np.int16]:
    height, width = rgb.shape[:2]
    inside = rgb[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    return inside.astype(np.int16)
