"""Lines of pixels: made as thin as they can be, and joined where a gap broke them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

__all__ = ["joined", "thinned"]

Mask = npt.NDArray[np.bool_]

_EDGE = 4  # px that lines are drawn on beyond the border, so that they reach it
_CLOSE = 4.0  # px that an end is joined over, whatever its direction
_BEHIND = 8.0  # px of a line that tell where it is going
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
    """Return lines with the pixels added that join their ends to other parts at most `gap` pixels away.

    An end is joined to the nearest pixel of another part, farther than four pixels only straight on, within
    60° of where the line was going. Parts side by side get nothing: no shore is changed.

    Parameters
    ----------
    where
        bool, (height, width); parts are 8-connected.
    gap
        Pixels.
    """
    parts, count = ndimage.label(where, structure=_EIGHT)
    if count < 2:
        return where
    whole, middle = where.copy(), thinned(where)
    inside = ndimage.distance_transform_edt(where)
    neighbours = ndimage.convolve(middle.astype(np.int8), _EIGHT.astype(np.int8), mode="constant") - 1
    for row, column in np.argwhere(middle & (neighbours <= 1)):
        own, end = parts[row, column], np.array((row, column))
        within = inside[row, column]  # an end of a middle line lies so far within
        reach = gap + int(np.ceil(within)) + 1
        corner = np.maximum(end - reach, 0)
        window = np.s_[corner[0] : row + reach + 1, corner[1] : column + reach + 1]
        others = np.argwhere((parts[window] > 0) & (parts[window] != own)) + (corner - end)
        distance = np.maximum(np.hypot(others[:, 0], others[:, 1]) - within, 0.0)
        back = np.argwhere(middle[window] & (parts[window] == own)) + (corner - end)
        back = back[np.hypot(back[:, 0], back[:, 1]) <= _BEHIND]
        ahead = -back.mean(axis=0)
        reached = (distance <= _CLOSE) | (
            (distance <= gap) & (others @ ahead >= 0.5 * np.hypot(*others.T) * np.hypot(*ahead))
        )
        if reached.any():
            nearest = others[reached][np.argmin(distance[reached])]
            steps = np.linspace(0.0, 1.0, int(np.abs(nearest).max()) + 1)[:, None]
            path = np.rint(steps * nearest).astype(np.intp) + end
            whole[path[:, 0], path[:, 1]] = True
    return whole
