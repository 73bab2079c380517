"""Rivers and lakes of one blue told apart by how wide they are."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

__all__ = ["narrow_waters", "parted_waters"]

Mask = npt.NDArray[np.bool_]

_EIGHT = np.ones((3, 3), dtype=bool)
_LONG = 2.0  # times as long as it may be wide, at least: what is shorter is a bay


def narrow_waters(water: Mask, width: float) -> Mask:
    """Return the parts of waters that are narrower than a width, and long.

    Parameters
    ----------
    water
        bool, (height, width).
    width
        Pixels. A disc of this diameter fits in where it is a lake; bays of a lake belong to it.
    """
    core = ndimage.distance_transform_edt(water) > 0.5 * width
    lakes = np.zeros_like(water)
    if core.any():  # grown back by one pixel more, for the corners that a disc does not reach
        lakes = water & (ndimage.distance_transform_edt(~core) <= 0.5 * width + 1.0)
    parts, _ = ndimage.label(water & ~lakes, structure=_EIGHT)
    narrow = np.zeros_like(water)
    for number, box in enumerate(ndimage.find_objects(parts), start=1):
        if not box:  # no pixel has this number
            continue
        height, breadth = (side.stop - side.start for side in box)
        if np.hypot(height, breadth) >= _LONG * width:
            narrow[box] |= parts[box] == number
    return narrow


def parted_waters(
    river: npt.NDArray[np.uint8], lake: npt.NDArray[np.uint8], width: float
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Return layers of rivers and lakes in which each water is on the one that its width asks for.

    Parameters
    ----------
    river, lake
        uint8, (height, width). What comes from the other layer gets label 1.
    width
        Pixels: narrower ones are rivers.
    """
    water = (river > 0) | (lake > 0)
    narrow = narrow_waters(water, width)
    one = np.uint8(1)
    rivers = np.where(narrow, np.where(river > 0, river, one), 0)
    lakes = np.where(water & ~narrow, np.where(lake > 0, lake, one), 0)
    return rivers.astype(np.uint8), lakes.astype(np.uint8)
