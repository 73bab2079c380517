"""Which colour of a picture each of its pixels is: itself where that is plain, else as what is beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.sketch.label_colours import to_oklab
from sketchterrain.trace.mixtures import mixtures, uneven

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sketchterrain.trace.found_colours import FoundColour

__all__ = ["CLEAR", "UNKNOWN", "SortedPixels", "sort_pixels"]

CLEAR: Final = 254
"""Instead of a colour's index: the pixel is transparent."""
UNKNOWN: Final = 255
"""Instead of a colour's index: no colour is near, in the picture or beside it."""

_SURE = 0.065  # Oklab; JPEG's noise around a colour lies within
_PLAIN = 0.7  # of the distance to the next colour, at most: else it may be either
_MARGIN = 0.02  # Oklab, nearer than the next colour where not all around is of one colour
_DARKER = 0.04  # Oklab lightness: darker than all around by this is ink, and no paler colour of theirs
_BESIDE = 3  # px around a pixel in which colours are looked for
_ROWS = 256  # done together
_COLOURS = 65536  # looked at together
_HALO = 2  # px that `mixtures` looks at
_OFFSETS = tuple(
    (down, right)
    for down in range(-_BESIDE, _BESIDE + 1)
    for right in range(-_BESIDE, _BESIDE + 1)
    if 0 < down**2 + right**2 <= _BESIDE**2 + 1
)


@dataclass(frozen=True, eq=False)
class SortedPixels:
    """A picture as indices of its colours.

    Attributes
    ----------
    index : numpy.ndarray
        uint8, (height, width): of a colour, or `CLEAR` or `UNKNOWN`.
    sure, taken, unknown : float
        Shares of the picture: plainly one colour or transparent; taken from what is beside; left.
    """

    index: npt.NDArray[np.uint8]
    sure: float
    taken: float
    unknown: float


def sort_pixels(rgba: npt.NDArray[np.uint8], colours: Sequence[FoundColour]) -> SortedPixels:
    """Return which colour each pixel is.

    A pixel is sure if one colour is near and no other nearly as near, all the more where not all around is of
    one colour, and it is no mixture of its neighbours.
    Any other takes the nearest colour among those that are sure within three pixels of it, so that a border
    gets no rim of a third colour. What is darker than all of these, an outline, stays unknown.

    Parameters
    ----------
    rgba
        uint8, (height, width, 4).
    colours
        Of the picture, at most `MOST_FOUND`.
    """
    height, width = rgba.shape[:2]
    centres = to_oklab(np.array([each.rgb for each in colours]).reshape(-1, 3) / 255.0).astype(np.float32)
    there = _colours_there(rgba)
    lab = _oklab_of(there)
    plain, strict = (np.full(1 << 24, UNKNOWN, dtype=np.uint8) for _ in range(2))
    plain[there], strict[there] = _plain_colours(lab, centres)
    sure = np.empty((height, width), dtype=np.uint8)
    for top, bottom in _bands(height):
        first = max(0, top - _HALO)
        around = rgba[first : min(height, bottom + _HALO)]
        rough = uneven(around[..., :3])
        mixed = mixtures(around[..., :3], rough)
        inner = np.s_[top - first : top - first + bottom - top]
        packed = _packed(rgba[top:bottom])
        sure[top:bottom] = np.where(rough[inner], strict[packed], plain[packed])
        sure[top:bottom][mixed[inner]] = UNKNOWN
        sure[top:bottom][rgba[top:bottom, :, 3] < 128] = CLEAR
    del plain, strict
    index = sure.copy()
    for top, bottom in _bands(height):
        rows, columns = np.nonzero(sure[top:bottom] == UNKNOWN)
        rows += top
        if len(rows):
            own = lab[np.searchsorted(there, _packed(rgba[rows, columns]))]
            index[rows, columns] = _beside(sure, rows, columns, own, centres)
    unsure, unknown = int((sure == UNKNOWN).sum()), int((index == UNKNOWN).sum())
    size = height * width
    return SortedPixels(index, 1.0 - unsure / size, (unsure - unknown) / size, unknown / size)


def _bands(height: int) -> Iterator[tuple[int, int]]:
    for top in range(0, height, _ROWS):
        yield top, min(height, top + _ROWS)


def _packed(rgba: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
    """Return colours as numbers of 24 bits."""
    wide = rgba[..., :3].astype(np.int32)
    return (wide[..., 0] << 16) | (wide[..., 1] << 8) | wide[..., 2]


def _colours_there(rgba: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
    seen = np.zeros(1 << 24, dtype=bool)
    for top, bottom in _bands(len(rgba)):
        seen[_packed(rgba[top:bottom])] = True
    return np.flatnonzero(seen).astype(np.int32)


def _oklab_of(packed: npt.NDArray[np.int32]) -> npt.NDArray[np.float32]:
    lab = np.empty((len(packed), 3), dtype=np.float32)
    for start in range(0, len(packed), _COLOURS):
        part = packed[start : start + _COLOURS]
        rgb = np.stack([part >> 16, (part >> 8) & 255, part & 255], axis=1)
        lab[start : start + _COLOURS] = to_oklab(rgb / 255.0)
    return lab


def _plain_colours(
    lab: npt.NDArray[np.float32], centres: npt.NDArray[np.float32]
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Return the index of the one colour that each is plainly, or `UNKNOWN`; and the same strictly."""
    plain, strict = (np.full(len(lab), UNKNOWN, dtype=np.uint8) for _ in range(2))
    if not len(centres):
        return plain, strict
    for start in range(0, len(lab), _COLOURS):
        part = lab[start : start + _COLOURS]
        squares = np.stack([((part - centre) ** 2).sum(axis=1) for centre in centres])
        nearest = np.argmin(squares, axis=0)
        columns = np.arange(len(part))
        first = squares[nearest, columns]
        squares[nearest, columns] = np.inf
        second = squares.min(axis=0)
        sure = (first <= _SURE**2) & (first <= _PLAIN**2 * second)
        plain[start : start + _COLOURS][sure] = nearest[sure]
        sure &= np.sqrt(first) + _MARGIN <= np.sqrt(second)
        strict[start : start + _COLOURS][sure] = nearest[sure]
    return plain, strict


def _beside(
    sure: npt.NDArray[np.uint8],
    rows: npt.NDArray[np.intp],
    columns: npt.NDArray[np.intp],
    own: npt.NDArray[np.float32],
    centres: npt.NDArray[np.float32],
) -> npt.NDArray[np.uint8]:
    """Return for each pixel which of the colours that are sure around it is nearest to its own."""
    height, width = sure.shape
    # What is beside but no colour is infinitely far from any.
    all_centres = np.full((256, 3), np.inf, dtype=np.float32)
    all_centres[: len(centres)] = centres
    best = np.full(len(rows), UNKNOWN, dtype=np.uint8)
    least, darkest = (np.full(len(rows), np.inf, dtype=np.float32) for _ in range(2))
    for down, right in _OFFSETS:
        there = sure[np.clip(rows + down, 0, height - 1), np.clip(columns + right, 0, width - 1)]
        distance = ((own - all_centres[there]) ** 2).sum(axis=1)
        nearer = distance < least
        best[nearer], least[nearer] = there[nearer], distance[nearer]
        darkest = np.minimum(darkest, all_centres[there, 0])
    best[own[:, 0] < darkest - _DARKER] = UNKNOWN
    return best
