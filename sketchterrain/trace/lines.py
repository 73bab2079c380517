"""Lines of pixels: made as thin as they can be, and joined where a gap broke them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

__all__ = ["joined", "thinned"]

Mask = npt.NDArray[np.bool_]

_EDGE = 4  # px that lines are drawn on beyond the border, so that they reach it
_EIGHT = np.ones((3, 3), dtype=bool)


def thinned(where: Mask) -> Mask:
    """Return the middle lines, a pixel wide and as connected as what is given, out to the image's border."""
    from skimage.morphology import skeletonize

    if not where.any():
        return where
    line = skeletonize(np.pad(where, _EDGE, mode="edge"))
    kept: Mask = line[_EDGE:-_EDGE, _EDGE:-_EDGE]
    return kept


def joined(where: Mask, gap: int) -> Mask:
    """Return lines with the pixels added that join parts of them at most `gap` pixels apart.

    Parts that hang together already get nothing, so no loop is made and no shore is changed.

    Parameters
    ----------
    where
        bool, (height, width); parts are 8-connected.
    gap
        Pixels, even.
    """
    parts, count = ndimage.label(where, structure=_EIGHT)
    if count < 2:
        return where
    near = ndimage.distance_transform_edt(~where) <= gap / 2 + 0.5
    bridges, found = ndimage.label(thinned(near) & ~where, structure=_EIGHT)
    added = np.zeros_like(where)
    boxes = ndimage.find_objects(bridges)
    for number in range(1, found + 1):
        rows, columns = boxes[number - 1]
        box = (
            slice(max(0, rows.start - 1), rows.stop + 1),
            slice(max(0, columns.start - 1), columns.stop + 1),
        )
        bridge = bridges[box] == number
        meets = np.unique(parts[box][ndimage.binary_dilation(bridge, structure=_EIGHT)])
        if np.count_nonzero(meets) > 1:
            added[box] |= bridge
    return where | added
