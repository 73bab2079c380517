"""The colours that a picture is painted in, and which of them each of its pixels has."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array, UInt8Array
from sketchterrain.document.label_layers import to_oklab

Packed = npt.NDArray[np.int32]

CLEAR: Final = 254  # instead of a colour's index: the pixel is transparent
UNKNOWN: Final = 255  # instead of a colour's index: no colour is near, in the picture or beside it

# Finding colours
_MOST_FOUND = 64  # colours that are told apart in one picture
_BITS = 5  # a channel, of the histogram
_RADIUS = 0.045  # Oklab: what JPEG makes of one colour lies within
_PLAIN_RADIUS = 0.02  # the same where areas are flat
_PLAIN_SHARE = 0.002  # share of the picture that is flat in a colour which is told from others so near
_SOLID = 0.1  # share of a colour's pixels in flat surroundings, below which it is one of lines only
_BETWEEN = 0.035  # Oklab: so near to a mixture of two others, a colour of lines only is one
_LEAST = 4e-4  # share of the picture
_FEWEST = 12  # px
_ENOUGH = 4_000_000  # px that tell the colours of a larger picture
# Sorting pixels
_SURE = 0.065  # Oklab; JPEG's noise around a colour lies within
_PLAIN = 0.7  # of the distance to the next colour, at most: else it may be either
_MARGIN = 0.02  # Oklab, nearer than the next colour where not all around is of one colour
_DARKER = 0.04  # Oklab lightness: darker than all around by this is ink, and no paler colour of theirs
_BESIDE = 3  # px around a pixel in which colours are looked for
_OFFSETS = tuple(
    (down, right)
    for down in range(-_BESIDE, _BESIDE + 1)
    for right in range(-_BESIDE, _BESIDE + 1)
    if 0 < down**2 + right**2 <= _BESIDE**2 + 1
)
# Mixtures: levels of sRGB, 0 to 255
_FLAT = 10  # within which a neighbourhood is one colour
_APART = 36  # that two sides differ by at least, where something can be a mixture of them
_OWN = 14  # by which a mixture differs from both sides
_SLACK = 6  # that a mixture may lie outside of its sides: JPEG
_REACH = (1, 2)  # px to each side
_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
# Rows and colours that are looked at together
_HISTOGRAM_ROWS = 128
_ROWS = 256
_COLOURS = 65536


@dataclass(frozen=True)
class FoundColour:
    """A colour of a picture (sRGB, 0 to 255) and its share of the pixels that are no mixtures."""

    rgb: tuple[int, int, int]
    share: float

    @property
    def code(self) -> str:
        """As ``#rrggbb``."""
        return "#{:02x}{:02x}{:02x}".format(*self.rgb)


@dataclass(frozen=True, eq=False)
class SortedPixels:
    """A picture as indices of its colours, `CLEAR` or `UNKNOWN`: uint8, (height, width).

    `sure`, `taken` and `unknown` are shares of the picture: plainly one colour or transparent; taken from
    what is beside; neither.
    """

    index: UInt8Array
    sure: float
    taken: float
    unknown: float


def find_colours(rgba: UInt8Array, *, sought: Iterable[tuple[int, int, int]] = ()) -> tuple[FoundColour, ...]:
    """Return the colours of a picture, the most common first: peaks of the histogram of unmixed pixels.

    `rgba` is uint8, (height, width, 4); what is more than half transparent does not count. Colours in
    `sought`, sRGB, are told apart from others like them if they are there.
    """
    counts, flats, sums = _histogram(rgba)
    total = int(counts.sum())
    if not total:
        return ()
    filled = np.flatnonzero(counts)
    weight, flat = (each[filled].astype(np.float64) for each in (counts, flats))
    colours = sums[filled] / weight[:, None]
    lab = to_oklab(colours / 255.0)
    given = np.array(list(sought), dtype=np.float64).reshape(-1, 3)
    cube = counts.reshape((1 << _BITS,) * 3)
    peaks = (cube == ndimage.maximum_filter(cube, size=3, mode="constant")).ravel()[filled]
    centres = _centres(lab, weight, flat, peaks, to_oklab(given / 255.0))
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
    lab: Float64Array, weight: Float64Array, flat: Float64Array, peaks: BoolArray, sought: Float64Array
) -> Float64Array:
    """Return the colours of peaks: those sought, then the highest first, none too near to one before it."""
    total = weight.sum()
    least = max(_LEAST * total, _FEWEST)
    centres: list[Float64Array] = []
    free = np.ones(len(lab), dtype=bool)

    def take(middle: Float64Array, radius: float, weights: Float64Array, enough: float) -> None:
        near = free & (((lab - middle) ** 2).sum(axis=1) <= radius**2)
        if weights[near].sum() >= enough and len(centres) < _MOST_FOUND:
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
        while len(centres) < _MOST_FOUND:
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
    rgb = np.array([each.rgb for each in found], dtype=np.float64)
    parts = np.linspace(0.15, 0.85, 15)[:, None]
    kept = []
    for index, each in enumerate(found):
        others = (other for other in range(len(found)) if other != index)
        larger = [other for other in others if solid[other] or found[other].share > each.share]
        pairs = [(rgb[one], rgb[other]) for one in larger for other in larger if one < other]
        if solid[index] or not pairs:
            kept.append(each)
            continue
        blends = to_oklab(np.concatenate([one + parts * (other - one) for one, other in pairs]) / 255.0)
        if ((blends - to_oklab(rgb[index] / 255.0)) ** 2).sum(axis=1).min() > _BETWEEN**2:
            kept.append(each)
    return kept


def _histogram(rgba: UInt8Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Float64Array]:
    """Return of each cell of colours the unmixed pixels, those in flat surroundings, sums of channels."""
    height, width = rgba.shape[:2]
    size = 1 << (3 * _BITS)
    counts, flat, sums = np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.int64), np.zeros((size, 3))
    bands = range(0, height, _HISTOGRAM_ROWS)
    step = max(1, -(-len(bands) * _HISTOGRAM_ROWS * width // _ENOUGH))
    for top in bands[::step]:
        band = rgba[top : top + _HISTOGRAM_ROWS]
        rough = uneven(band)
        kept = (band[..., 3] >= 128) & ~mixtures(band, rough)
        seen = band[kept]
        high = (seen >> (8 - _BITS)).astype(np.int32)
        cell = (high[:, 0] << (2 * _BITS)) | (high[:, 1] << _BITS) | high[:, 2]
        counts += np.bincount(cell, minlength=size)
        flat += np.bincount(cell[~rough[kept]], minlength=size)
        for channel in range(3):
            sums[:, channel] += np.bincount(cell, weights=seen[:, channel], minlength=size)
    return counts, flat, sums


def sort_pixels(rgba: UInt8Array, colours: Sequence[FoundColour]) -> SortedPixels:
    """Return which colour each pixel is.

    A pixel is sure if one colour is near and no other nearly as near, all the more where not all around is of
    one colour, and it is no mixture of its neighbours.
    Any other takes the nearest colour among those that are sure within three pixels of it, so that a border
    gets no rim of a third colour. What is darker than all of these, an outline, stays unknown.
    """
    height, width = rgba.shape[:2]
    centres = to_oklab(np.array([each.rgb for each in colours]).reshape(-1, 3) / 255.0).astype(np.float32)
    there, lab = _colours_there(rgba)
    plain, strict = (np.full(1 << 24, UNKNOWN, dtype=np.uint8) for _ in range(2))
    plain[there], strict[there] = _plain_colours(lab, centres)
    sure = np.empty((height, width), dtype=np.uint8)
    halo = max(_REACH)
    for top, bottom in _bands(height):
        first = max(0, top - halo)
        around = rgba[first : min(height, bottom + halo)]
        rough = uneven(around)
        mixed = mixtures(around, rough)
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
    unsure, unknown = float((sure == UNKNOWN).mean()), float((index == UNKNOWN).mean())
    return SortedPixels(index, 1.0 - unsure, unsure - unknown, unknown)


def _bands(height: int) -> Iterator[tuple[int, int]]:
    for top in range(0, height, _ROWS):
        yield top, min(height, top + _ROWS)


def _packed(rgba: UInt8Array) -> Packed:
    """Return colours as numbers of 24 bits."""
    wide = rgba[..., :3].astype(np.int32)
    return (wide[..., 0] << 16) | (wide[..., 1] << 8) | wide[..., 2]


def _colours_there(rgba: UInt8Array) -> tuple[Packed, npt.NDArray[np.float32]]:
    """Return the colours of a picture, in order, and the same in Oklab."""
    seen = np.zeros(1 << 24, dtype=bool)
    for top, bottom in _bands(len(rgba)):
        seen[_packed(rgba[top:bottom])] = True
    packed = np.flatnonzero(seen).astype(np.int32)
    lab = np.empty((len(packed), 3), dtype=np.float32)
    for start in range(0, len(packed), _COLOURS):
        part = packed[start : start + _COLOURS]
        rgb = np.stack([part >> 16, (part >> 8) & 255, part & 255], axis=1)
        lab[start : start + _COLOURS] = to_oklab(rgb / 255.0)
    return packed, lab


def _plain_colours(
    lab: npt.NDArray[np.float32], centres: npt.NDArray[np.float32]
) -> tuple[UInt8Array, UInt8Array]:
    """Return the index of the one colour that each is plainly, or `UNKNOWN`; and the same strictly."""
    plain, strict = (np.full(len(lab), UNKNOWN, dtype=np.uint8) for _ in range(2))
    if not len(centres):
        return plain, strict
    for start in range(0, len(lab), _COLOURS):
        part = lab[start : start + _COLOURS]
        squares = np.stack([((part - centre) ** 2).sum(axis=1) for centre in centres])
        nearest, columns = np.argmin(squares, axis=0), np.arange(len(part))
        first = squares[nearest, columns]
        squares[nearest, columns] = np.inf
        second = squares.min(axis=0)
        sure = (first <= _SURE**2) & (first <= _PLAIN**2 * second)
        plain[start : start + _COLOURS][sure] = nearest[sure]
        sure &= np.sqrt(first) + _MARGIN <= np.sqrt(second)
        strict[start : start + _COLOURS][sure] = nearest[sure]
    return plain, strict


def _beside(
    sure: UInt8Array,
    rows: npt.NDArray[np.intp],
    columns: npt.NDArray[np.intp],
    own: npt.NDArray[np.float32],
    centres: npt.NDArray[np.float32],
) -> UInt8Array:
    """Return for each pixel which of the colours that are sure around it is nearest to its own."""
    # What is beside but no colour is infinitely far from any.
    all_centres = np.full((256, 3), np.inf, dtype=np.float32)
    all_centres[: len(centres)] = centres
    best = np.full(len(rows), UNKNOWN, dtype=np.uint8)
    least, darkest = (np.full(len(rows), np.inf, dtype=np.float32) for _ in range(2))
    for down, right in _OFFSETS:
        there = _at(sure, rows + down, columns + right)
        distance = ((own - all_centres[there]) ** 2).sum(axis=1)
        nearer = distance < least
        best[nearer], least[nearer] = there[nearer], distance[nearer]
        darkest = np.minimum(darkest, all_centres[there, 0])
    best[own[:, 0] < darkest - _DARKER] = UNKNOWN
    return best


def mixtures(rgb: UInt8Array, rough: BoolArray | None = None) -> BoolArray:
    """Return which pixels have, in each channel, a value between those of two pixels opposite one another.

    Antialiasing, scaling and JPEG leave such along borders: who blends two colours, in sRGB or in light,
    gives each channel a value in between. A thin line, a river, has the same on both sides, and is no mixture
    of it.

    `rgb` is uint8, (height, width, 3 or 4), `rough` the result of `uneven`, if that is known already.
    """
    mixed = np.zeros(rgb.shape[:2], dtype=bool)
    rows, columns = np.nonzero(uneven(rgb) if rough is None else rough)
    rgb = rgb[..., :3]
    own = rgb[rows, columns].astype(np.int16)
    for down, right in _DIRECTIONS:
        for reach in _REACH:
            one = _at(rgb, rows - reach * down, columns - reach * right).astype(np.int16)
            other = _at(rgb, rows + reach * down, columns + reach * right).astype(np.int16)
            low, high = np.minimum(one, other), np.maximum(one, other)
            found = ((own >= low - _SLACK) & (own <= high + _SLACK)).all(axis=1)
            found &= (high - low).max(axis=1) >= _APART
            found &= np.abs(own - one).max(axis=1) > _OWN
            found &= np.abs(own - other).max(axis=1) > _OWN
            mixed[rows[found], columns[found]] = True
            left = ~found
            rows, columns, own = rows[left], columns[left], own[left]
    return mixed


def uneven(rgb: UInt8Array) -> BoolArray:
    """Return which pixels have neighbours of another colour: uint8 (height, width, 3 or 4) to bool."""
    rough = np.zeros(rgb.shape[:2], dtype=bool)
    for channel in range(3):
        values = rgb[..., channel]
        high = ndimage.maximum_filter(values, size=3, mode="nearest")
        low = ndimage.minimum_filter(values, size=3, mode="nearest")
        rough |= high - low > _FLAT
    return rough


def _at(image: UInt8Array, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> UInt8Array:
    """Return the pixels at rows and columns, of the border for those beyond it."""
    height, width = image.shape[:2]
    return np.asarray(image[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)])
