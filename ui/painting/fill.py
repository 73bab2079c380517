"""Filling a connected region, and picking the paint at a pixel."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from sketchterrain.sketch.box import Box
from sketchterrain.sketch.document import LabelImage

_Integers = npt.NDArray[np.int64]


_ROWS = 256  # looked at together: what is compared stays in the cache


def flood_fill(image: LabelImage, row: int, column: int, label: int) -> Box | None:
    """Give the region around a pixel a label.

    Empty ground is bounded by any paint, also by a line that is one pixel wide and goes along a diagonal; a
    painted region is the whole shape, pixels that touch at a corner included, as the terrain knows it.

    Parameters
    ----------
    image : (height, width) uint8
        Painted into.
    row, column
        The pixel.
    label
        0 … 255.

    Returns
    -------
    Box or None
        Around the region; None if nothing changes, or the pixel lies outside of the image.
    """
    if not (0 <= row < image.shape[0] and 0 <= column < image.shape[1]) or image[row, column] == label:
        return None
    starts, ends, rows = _runs(image, int(image[row, column]))
    of = _components(starts, ends, rows, touch=int(image[row, column] != 0))
    first = np.searchsorted(rows, row)
    mine = first + np.searchsorted(
        ends[first : np.searchsorted(rows, row, side="right")], column, side="right"
    )
    chosen = np.flatnonzero(of == of[mine])
    rows, starts, ends = rows[chosen], starts[chosen], ends[chosen]
    for each, begin, stop in zip(rows.tolist(), starts.tolist(), ends.tolist(), strict=True):
        image[each, begin:stop] = label
    return int(rows[0]), int(starts.min()), int(rows[-1]) + 1, int(ends.max())


def _runs(image: LabelImage, label: int) -> tuple[_Integers, _Integers, _Integers]:
    """Return the runs of a label, row by row: first columns, columns after the last, rows."""
    height, width = image.shape
    found = []
    # A column of other labels on either side, so that each run begins and ends.
    inside = np.zeros((min(_ROWS, height), width + 2), dtype=np.bool_)
    changes = np.empty((len(inside), width + 1), dtype=np.bool_)
    for top in range(0, height, _ROWS):
        count = min(_ROWS, height - top)
        np.equal(image[top : top + count], label, out=inside[:count, 1:-1])
        np.not_equal(inside[:count, 1:], inside[:count, :-1], out=changes[:count])
        rows, columns = np.divmod(np.flatnonzero(changes[:count]), width + 1)
        found.append((columns[::2], columns[1::2], rows[::2] + top))
    starts, ends, rows = (np.concatenate(part) for part in zip(*found, strict=True))
    return starts, ends, rows


def _components(starts: _Integers, ends: _Integers, rows: _Integers, *, touch: int) -> _Integers:
    """Return a number for each run, equal where runs are connected; `touch` 1: also by corners."""
    stride = int(ends.max()) + 2  # so that no run reaches into the next row
    begin, stop = rows * stride + starts, rows * stride + ends
    first = np.searchsorted(stop, begin + stride - touch, side="right")
    last = np.searchsorted(begin, stop + stride + touch, side="left")
    counts = np.maximum(last - first, 0)
    above = np.repeat(np.arange(len(starts)), counts)
    below = np.arange(len(above)) + np.repeat(first - (np.cumsum(counts) - counts), counts)
    return _roots(len(starts), above, below)


def _roots(count: int, above: _Integers, below: _Integers) -> _Integers:
    """Return the least run that each run is connected with, by the pairs that touch.

    Each round hangs every tree of runs that touches another one onto one of less number, so that there are at
    most half as many trees of those after it.
    """
    root = np.arange(count)
    while True:
        one, other = root[above], root[below]
        apart = one != other
        if not apart.any():
            return root
        above, below, one, other = above[apart], below[apart], one[apart], other[apart]
        np.minimum.at(root, np.maximum(one, other), np.minimum(one, other))
        while ((higher := root[root]) != root).any():
            root = higher


def pick(layers: Iterable[tuple[str, LabelImage]], row: int, column: int) -> tuple[str, int] | None:
    """Return the layer and the label of the paint that is seen at a pixel.

    Parameters
    ----------
    layers
        Names and images, the topmost first.
    row, column
        The pixel; it may lie outside of the images.
    """
    for name, image in layers:
        if 0 <= row < image.shape[0] and 0 <= column < image.shape[1] and image[row, column]:
            return name, int(image[row, column])
    return None
