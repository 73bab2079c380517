"""What nothing is known of takes the value beside it, and so do areas too small to mean anything."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.trace.majority import NO_VOTE

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

__all__ = ["fill_gaps", "without_specks", "without_threads"]

_EIGHT = np.ones((3, 3), dtype=bool)


def fill_gaps(values: NDArray[np.uint8], *, reach: float, beyond: int) -> NDArray[np.uint8]:
    """Return an image in which what is `NO_VOTE` has the nearest known value.

    Parameters
    ----------
    values
        uint8, (height, width).
    reach
        Pixels, as far as that goes.
    beyond
        The value farther away.
    """
    gaps = values == NO_VOTE
    if not gaps.any():
        return values
    if gaps.all():
        return np.full_like(values, beyond)
    distance, (rows, columns) = ndimage.distance_transform_edt(gaps, return_indices=True)
    return np.where(distance <= reach, values[rows, columns], beyond).astype(np.uint8)


def without_specks(values: npt.NDArray[np.uint8], least: int) -> npt.NDArray[np.uint8]:
    """Return an image in which no area has fewer than `least` pixels, unless all have.

    An area is what is 8-connected of one value; a smaller one takes the values beside it.
    """
    small = np.zeros(values.shape, dtype=bool)
    for value in np.flatnonzero(np.bincount(values.ravel(), minlength=256)):
        areas, count = ndimage.label(values == value, structure=_EIGHT)
        if count:
            few = np.bincount(areas.ravel(), minlength=count + 1) < least
            few[0] = False
            small |= few[areas]
    if not small.any() or small.all():
        return values
    return fill_gaps(np.where(small, NO_VOTE, values).astype(np.uint8), reach=np.inf, beyond=0)


def without_threads(values: NDArray[np.uint8], areas: Iterable[int]) -> NDArray[np.uint8]:
    """Return an image in which what is thinner than three pixels of some values is `NO_VOTE`.

    These are the rims of outlines. A value that is nowhere wider stays as it is.

    Parameters
    ----------
    values
        uint8, (height, width).
    areas
        Values that stand for areas.
    """
    kept = values.copy()
    for value in areas:
        mask = values == value
        wide = ndimage.binary_opening(mask, structure=_EIGHT)
        if wide.any():
            kept[mask & ~ndimage.binary_dilation(wide, structure=_EIGHT)] = NO_VOTE
    return kept
