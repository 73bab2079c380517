"""The colours that a picture is painted in: peaks of its histogram, in order of how much they cover."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.sketch.label_colours import to_oklab
from sketchterrain.trace.mixtures import mixtures

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["MOST_FOUND", "FoundColour", "find_colours"]

MOST_FOUND = 64
"""The most colours that are told apart in one picture."""

_BITS = 5  # a channel, of the histogram
_RADIUS = 0.045  # Oklab: what JPEG makes of one colour lies within
_LEAST = 4e-4  # share of the picture
_FEWEST = 12  # px
_ROWS = 128  # looked at together
_ENOUGH = 4_000_000  # px that tell the colours of a larger picture


@dataclass(frozen=True)
class FoundColour:
    """A colour of a picture.

    Attributes
    ----------
    rgb : tuple of int
        sRGB, 0 to 255: the mean of what is like it.
    share : float
        Of the picture's pixels that are no mixtures, 0 to 1.
    """

    rgb: tuple[int, int, int]
    share: float

    @property
    def code(self) -> str:
        """As ``#rrggbb``."""
        return "#{:02x}{:02x}{:02x}".format(*self.rgb)


def find_colours(
    rgba: npt.NDArray[np.uint8], *, sought: Iterable[tuple[int, int, int]] = ()
) -> tuple[FoundColour, ...]:
    """Return the colours of a picture, the most common first.

    Parameters
    ----------
    rgba
        uint8, (height, width, 4); what is more than half transparent is not looked at.
    sought
        Colours, sRGB, that are told apart from others like them if they are there.
    """
    counts, sums = _histogram(rgba)
    total = int(counts.sum())
    if not total:
        return ()
    side = 1 << _BITS
    filled = np.flatnonzero(counts)
    weight = counts[filled].astype(np.float64)
    colours = sums[filled] / weight[:, None]
    lab = to_oklab(colours / 255.0)
    cube = counts.reshape(side, side, side)
    peaks = (cube == ndimage.maximum_filter(cube, size=3, mode="constant")).ravel()[filled]
    least = max(_LEAST * total, _FEWEST)
    given = np.array(list(sought), dtype=np.float64).reshape(-1, 3)
    centres = _centres(lab, weight, peaks, least, to_oklab(given / 255.0))
    if not len(centres):
        return ()
    nearest = np.argmin(((lab[:, None] - centres[None]) ** 2).sum(axis=2), axis=1)
    found = []
    for index in range(len(centres)):
        mine = nearest == index
        close = mine & (((lab - centres[index]) ** 2).sum(axis=1) <= _RADIUS**2)
        if weight[mine].sum() and close.any():
            mean = np.average(colours[close], axis=0, weights=weight[close])
            red, green, blue = (int(value) for value in np.rint(mean))
            found.append(FoundColour((red, green, blue), float(weight[mine].sum() / total)))
    return tuple(sorted(found, key=lambda each: (-each.share, each.rgb)))


def _centres(
    lab: npt.NDArray[np.float64],
    weight: npt.NDArray[np.float64],
    peaks: npt.NDArray[np.bool_],
    least: float,
    sought: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Return the colours of peaks, the highest first, none within the radius of one before it."""
    centres: list[npt.NDArray[np.float64]] = []
    for each in sought:
        near = ((lab - each) ** 2).sum(axis=1) <= (0.3 * _RADIUS) ** 2
        if weight[near].sum() >= least and len(centres) < MOST_FOUND:
            centres.append(np.average(lab[near], axis=0, weights=weight[near]))
    free = np.ones(len(lab), dtype=bool)
    for each in centres:
        free &= ((lab - each) ** 2).sum(axis=1) > _RADIUS**2
    while len(centres) < MOST_FOUND:
        heights = np.where(free & peaks, weight, 0.0)
        top = int(np.argmax(heights))
        if not heights[top]:
            break
        near = free & (((lab - lab[top]) ** 2).sum(axis=1) <= _RADIUS**2)
        if weight[near].sum() >= least:
            centres.append(np.average(lab[near], axis=0, weights=weight[near]))
        free &= ~near
    return np.array(centres).reshape(-1, 3)


def _histogram(rgba: npt.NDArray[np.uint8]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Return how many pixels fall into each cell of colours, and the sums of their channels."""
    height, width = rgba.shape[:2]
    cells = 1 << (3 * _BITS)
    counts, sums = np.zeros(cells, dtype=np.int64), np.zeros((cells, 3))
    bands = range(0, height, _ROWS)
    step = max(1, -(-len(bands) * _ROWS * width // _ENOUGH))
    for top in bands[::step]:
        band = rgba[top : top + _ROWS]
        rgb = band[..., :3]
        seen = rgb[(band[..., 3] >= 128) & ~mixtures(rgb)]
        high = (seen >> (8 - _BITS)).astype(np.int32)
        cell = (high[:, 0] << (2 * _BITS)) | (high[:, 1] << _BITS) | high[:, 2]
        counts += np.bincount(cell, minlength=cells)
        for channel in range(3):
            sums[:, channel] += np.bincount(cell, weights=seen[:, channel], minlength=cells)
    return counts, sums
