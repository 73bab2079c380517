"""The colours that a picture is painted in: peaks of its histogram, in order of how much they cover."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.sketch.label_colours import to_oklab
from sketchterrain.trace.mixtures import mixtures, uneven

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["MOST_FOUND", "FoundColour", "find_colours"]

Floats = npt.NDArray[np.float64]

MOST_FOUND = 64
"""The most colours that are told apart in one picture."""

_BITS = 5  # a channel, of the histogram
_RADIUS = 0.045  # Oklab: what JPEG makes of one colour lies within
_PLAIN_RADIUS = 0.02  # the same where areas are flat
_PLAIN_SHARE = 0.002  # share of the picture that is flat in a colour which is told from others so near
_SOLID = 0.1  # share of a colour's pixels in flat surroundings, below which it is one of lines only
_BETWEEN = 0.035  # Oklab: so near to a mixture of two others, a colour of lines only is one
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
    cells = _histogram(rgba)
    total = int(cells.counts.sum())
    if not total:
        return ()
    filled = np.flatnonzero(cells.counts)
    weight, flat = (each[filled].astype(np.float64) for each in (cells.counts, cells.flat))
    colours = cells.sums[filled] / weight[:, None]
    lab = to_oklab(colours / 255.0)
    given = np.array(list(sought), dtype=np.float64).reshape(-1, 3)
    centres = _centres(lab, weight, flat, _peaks(cells.counts)[filled], to_oklab(given / 255.0))
    nearest = np.full(len(lab), -1)
    if len(centres):
        nearest = np.argmin(((lab[:, None] - centres[None]) ** 2).sum(axis=2), axis=1)
    found, solid = [], []
    for index in range(len(centres)):
        mine = nearest == index
        close = mine & (((lab - centres[index]) ** 2).sum(axis=1) <= _RADIUS**2)
        if weight[close].sum():
            mean = np.average(colours[close], axis=0, weights=weight[close])
            red, green, blue = (int(value) for value in np.rint(mean))
            found.append(FoundColour((red, green, blue), float(weight[mine].sum() / total)))
            solid.append(bool(flat[close].sum() >= _SOLID * weight[close].sum()))
    kept = _without_blends(found, solid)
    return tuple(sorted(kept, key=lambda each: (-each.share, each.rgb)))


def _centres(
    lab: Floats, weight: Floats, flat: Floats, peaks: npt.NDArray[np.bool_], sought: Floats
) -> Floats:
    """Return the colours of peaks: those sought, then the highest first, none too near to one before it."""
    total = weight.sum()
    least = max(_LEAST * total, _FEWEST)
    centres: list[Floats] = []
    free = np.ones(len(lab), dtype=bool)

    def take(middle: Floats, radius: float, weights: Floats, enough: float) -> None:
        near = free & (((lab - middle) ** 2).sum(axis=1) <= radius**2)
        if weights[near].sum() >= enough and len(centres) < MOST_FOUND:
            centres.append(np.average(lab[near], axis=0, weights=weights[near]))

    for each in sought:  # a small area is enough, or many lines
        before = len(centres)
        take(each, 0.3 * _RADIUS, flat, _FEWEST)
        if len(centres) == before:
            take(each, 0.3 * _RADIUS, weight, least)
    # What is flat has no noise to speak of: there, two peaks are two colours even if they are near.
    for radius, weights, enough in (
        (_PLAIN_RADIUS, flat, max(_PLAIN_SHARE * total, _FEWEST)),
        (_RADIUS, weight, least),
    ):
        for each in centres:
            free &= ((lab - each) ** 2).sum(axis=1) > radius**2
        while len(centres) < MOST_FOUND:
            heights = np.where(free & peaks, weights, 0.0)
            top = int(np.argmax(heights))
            if not heights[top]:
                break
            take(lab[top], radius, weights, enough)
            free &= ((lab - lab[top]) ** 2).sum(axis=1) > radius**2
        free[...] = True
    return np.array(centres).reshape(-1, 3)


def _without_blends(found: list[FoundColour], solid: list[bool]) -> list[FoundColour]:
    """Leave out colours of lines only that are mixtures of two others, as ink on a ground is."""
    if not found:
        return found
    rgb = np.array([each.rgb for each in found], dtype=np.float64)
    parts = np.linspace(0.15, 0.85, 15)[:, None]
    kept = []
    for index, each in enumerate(found):
        larger = [
            other
            for other in range(len(found))
            if other != index and (solid[other] or found[other].share > each.share)
        ]
        pairs = [(rgb[one], rgb[other]) for one in larger for other in larger if one < other]
        if solid[index] or not pairs:
            kept.append(each)
            continue
        blends = to_oklab(np.concatenate([one + parts * (other - one) for one, other in pairs]) / 255.0)
        own = to_oklab(rgb[index] / 255.0)
        if ((blends - own) ** 2).sum(axis=1).min() > _BETWEEN**2:
            kept.append(each)
    return kept


def _peaks(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Return which cells have no fuller one beside them."""
    cube = counts.reshape((1 << _BITS,) * 3)
    peaks: npt.NDArray[np.bool_] = cube == ndimage.maximum_filter(cube, size=3, mode="constant")
    return peaks.ravel()


@dataclass(frozen=True, eq=False)
class _Cells:
    """Pixels by cells of colours: how many, how many in flat surroundings, and sums of their channels."""

    counts: npt.NDArray[np.int64]
    flat: npt.NDArray[np.int64]
    sums: Floats


def _histogram(rgba: npt.NDArray[np.uint8]) -> _Cells:
    """Return the pixels that are no mixtures by cells of colours."""
    height, width = rgba.shape[:2]
    size = 1 << (3 * _BITS)
    cells = _Cells(np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.int64), np.zeros((size, 3)))
    bands = range(0, height, _ROWS)
    step = max(1, -(-len(bands) * _ROWS * width // _ENOUGH))
    for top in bands[::step]:
        band = rgba[top : top + _ROWS]
        rgb = band[..., :3]
        rough = uneven(rgb)
        kept = (band[..., 3] >= 128) & ~mixtures(rgb, rough)
        seen = rgb[kept]
        high = (seen >> (8 - _BITS)).astype(np.int32)
        cell = (high[:, 0] << (2 * _BITS)) | (high[:, 1] << _BITS) | high[:, 2]
        cells.counts[...] += np.bincount(cell, minlength=size)
        cells.flat[...] += np.bincount(cell[~rough[kept]], minlength=size)
        for channel in range(3):
            cells.sums[:, channel] += np.bincount(cell, weights=seen[:, channel], minlength=size)
    return cells
