"""Colours of a map image, and the classification of its pixels by them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array, UInt8Array
from sketchterrain.document.label_layers import to_oklab

Packed = npt.NDArray[np.int32]

CLEAR: Final = 254  # index of transparent pixels
UNKNOWN: Final = 255  # index of pixels without a similar colour in the image or next to them

# Detecting colours
_MAX_COLOURS = 64
_BITS = 5  # of a channel, in the histogram
_RADIUS = 0.045  # Oklab, of JPEG noise around a colour
_FLAT_RADIUS = 0.02  # the same in flat areas
_FLAT_SHARE = 0.002  # of the image, least flat area of a colour within `_RADIUS` of another
_SOLID = 0.1  # least share of a colour's pixels in flat surroundings, unless it occurs in lines only
_BLEND_RADIUS = 0.035  # Oklab, of a blend of two others within which a colour of lines only is one
_MIN_SHARE = 4e-4  # of the image
_MIN_PIXELS = 12
_MAX_SAMPLES = 4_000_000  # px of a large image
# Classifying pixels
_CERTAIN = 0.065  # Oklab, of JPEG noise around a colour
_MAX_RATIO = 0.7  # of the distances to the nearest and the second nearest colour
_MARGIN = 0.02  # Oklab, least difference of these distances in uneven surroundings
_DARKER = 0.04  # Oklab lightness: darker than all neighbours by this is ink, not one of their colours
_BESIDE = 3  # px, radius of neighbours
_OFFSETS = tuple(
    (down, right)
    for down in range(-_BESIDE, _BESIDE + 1)
    for right in range(-_BESIDE, _BESIDE + 1)
    if 0 < down**2 + right**2 <= _BESIDE**2 + 1
)
# Blends: levels of sRGB, 0 to 255
_FLAT = 10  # range of a flat neighbourhood
_APART = 36  # least difference of two sides that are blended
_OWN = 14  # least difference of a blend from both sides
_SLACK = 6  # JPEG noise of a blend beyond its sides
_DISTANCES = (1, 2)  # px to each side
_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
# Bounds of memory
_HISTOGRAM_ROWS = 128
_ROWS = 256
_COLOURS = 65536


@dataclass(frozen=True)
class DetectedColour:
    """A colour of an image (sRGB, 0 to 255) and its share of the unblended pixels."""

    rgb: tuple[int, int, int]
    share: float

    @property
    def code(self) -> str:
        """``#rrggbb``."""
        return "#{:02x}{:02x}{:02x}".format(*self.rgb)


@dataclass(frozen=True, eq=False)
class ClassifiedPixels:
    """An image as indices of its colours, and shares of its pixels."""

    index: UInt8Array  # (height, width), or `CLEAR` or `UNKNOWN`
    certain: float  # clearly one colour, or transparent
    inferred: float  # from neighbours
    unknown: float


def detect_colours(
    rgba: UInt8Array, *, sought: Iterable[tuple[int, int, int]] = ()
) -> tuple[DetectedColour, ...]:
    """Return the colours of an image, (height, width, 4), the most common first.

    They are peaks of the histogram of opaque, unblended pixels. Colours in `sought`, sRGB, are distinguished
    from similar ones if they occur.
    """
    counts, flats, sums = _histogram(rgba)
    total = int(counts.sum())
    if not total:
        return ()
    filled = np.flatnonzero(counts)
    weight, flat = (histogram[filled].astype(np.float64) for histogram in (counts, flats))
    colours = sums[filled] / weight[:, None]
    lab = to_oklab(colours / 255.0)
    targets = np.array(list(sought), dtype=np.float64).reshape(-1, 3)
    cube = counts.reshape((1 << _BITS,) * 3)
    peaks = (cube == ndimage.maximum_filter(cube, size=3, mode="constant")).ravel()[filled]
    centres = _centres(lab, weight, flat, peaks, to_oklab(targets / 255.0))
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
            found.append(DetectedColour((red, green, blue), float(weight[mine].sum() / total)))
            solid.append(bool(flat[close].sum() >= _SOLID * weight[close].sum()))
    distinct = _without_blends(found, solid)
    return tuple(sorted(distinct, key=lambda colour: (-colour.share, colour.rgb)))


def _centres(
    lab: Float64Array, weight: Float64Array, flat: Float64Array, peaks: BoolArray, sought: Float64Array
) -> Float64Array:
    """Return the centres of peaks, those sought first, then by height, none too near to an earlier one."""
    total = weight.sum()
    least = max(_MIN_SHARE * total, _MIN_PIXELS)
    centres: list[Float64Array] = []
    free = np.ones(len(lab), dtype=bool)

    def add_centre(middle: Float64Array, radius: float, weights: Float64Array, enough: float) -> None:
        near = free & (((lab - middle) ** 2).sum(axis=1) <= radius**2)
        if weights[near].sum() >= enough and len(centres) < _MAX_COLOURS:
            centres.append(np.average(lab[near], axis=0, weights=weights[near]))

    for colour in sought:  # a small flat area is enough, or many lines
        before = len(centres)
        add_centre(colour, 0.3 * _RADIUS, flat, _MIN_PIXELS)
        if len(centres) == before:
            add_centre(colour, 0.3 * _RADIUS, weight, least)
    # Flat areas have little noise: there, near peaks are different colours.
    for radius, weights, enough in (
        (_FLAT_RADIUS, flat, max(_FLAT_SHARE * total, _MIN_PIXELS)),
        (_RADIUS, weight, least),
    ):
        for centre in centres:
            free &= ((lab - centre) ** 2).sum(axis=1) > radius**2
        while len(centres) < _MAX_COLOURS:
            heights = np.where(free & peaks, weights, 0.0)
            top = int(np.argmax(heights))
            if not heights[top]:
                break
            add_centre(lab[top], radius, weights, enough)
            free &= ((lab - lab[top]) ** 2).sum(axis=1) > radius**2
        free[...] = True
    return np.array(centres).reshape(-1, 3)


def _without_blends(found: list[DetectedColour], solid: list[bool]) -> list[DetectedColour]:
    """Remove colours of lines only that are blends of two others, such as thin ink."""
    rgb = np.array([colour.rgb for colour in found], dtype=np.float64)
    parts = np.linspace(0.15, 0.85, 15)[:, None]
    distinct = []
    for index, colour in enumerate(found):
        others = (other for other in range(len(found)) if other != index)
        larger = [other for other in others if solid[other] or found[other].share > colour.share]
        pairs = [(rgb[one], rgb[other]) for one in larger for other in larger if one < other]
        if solid[index] or not pairs:
            distinct.append(colour)
            continue
        blends = to_oklab(np.concatenate([one + parts * (other - one) for one, other in pairs]) / 255.0)
        if ((blends - to_oklab(rgb[index] / 255.0)) ** 2).sum(axis=1).min() > _BLEND_RADIUS**2:
            distinct.append(colour)
    return distinct


def _histogram(rgba: UInt8Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Float64Array]:
    """Return per cell of the histogram its unblended pixels, those in flat areas, and sums of channels."""
    height, width = rgba.shape[:2]
    size = 1 << (3 * _BITS)
    counts, flat, sums = np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.int64), np.zeros((size, 3))
    bands = range(0, height, _HISTOGRAM_ROWS)
    step = max(1, -(-len(bands) * _HISTOGRAM_ROWS * width // _MAX_SAMPLES))
    for top in bands[::step]:
        band = rgba[top : top + _HISTOGRAM_ROWS]
        rough = uneven(band)
        counted = (band[..., 3] >= 128) & ~mixtures(band, rough)
        pixels = band[counted]
        high = (pixels >> (8 - _BITS)).astype(np.int32)
        cell = (high[:, 0] << (2 * _BITS)) | (high[:, 1] << _BITS) | high[:, 2]
        counts += np.bincount(cell, minlength=size)
        flat += np.bincount(cell[~rough[counted]], minlength=size)
        for channel in range(3):
            sums[:, channel] += np.bincount(cell, weights=pixels[:, channel], minlength=size)
    return counts, flat, sums


def classify_pixels(rgba: UInt8Array, colours: Sequence[DetectedColour]) -> ClassifiedPixels:
    """Classify each pixel by the colours of an image.

    A pixel is certain if one colour is near and no other nearly as near, more strictly in uneven areas, and
    it is not a blend of its neighbours. Any other gets the nearest colour among certain pixels within three
    pixels, so that borders have no fringe of a third colour, unless it is darker than these: an outline.
    """
    height, width = rgba.shape[:2]
    centres = to_oklab(np.array([colour.rgb for colour in colours]).reshape(-1, 3) / 255.0).astype(np.float32)
    present, lab = _distinct_colours(rgba)
    plain, strict = (np.full(1 << 24, UNKNOWN, dtype=np.uint8) for _ in range(2))
    plain[present], strict[present] = _nearest_colours(lab, centres)
    certain = np.empty((height, width), dtype=np.uint8)
    halo = max(_DISTANCES)
    for top, bottom in _bands(height):
        first = max(0, top - halo)
        around = rgba[first : min(height, bottom + halo)]
        rough = uneven(around)
        mixed = mixtures(around, rough)
        inner = np.s_[top - first : top - first + bottom - top]
        packed = _packed(rgba[top:bottom])
        certain[top:bottom] = np.where(rough[inner], strict[packed], plain[packed])
        certain[top:bottom][mixed[inner]] = UNKNOWN
        certain[top:bottom][rgba[top:bottom, :, 3] < 128] = CLEAR
    del plain, strict
    index = certain.copy()
    for top, bottom in _bands(height):
        rows, columns = np.nonzero(certain[top:bottom] == UNKNOWN)
        rows += top
        if len(rows):
            own = lab[np.searchsorted(present, _packed(rgba[rows, columns]))]
            index[rows, columns] = _neighbouring_colours(certain, rows, columns, own, centres)
    unsure, unknown = float((certain == UNKNOWN).mean()), float((index == UNKNOWN).mean())
    return ClassifiedPixels(index, 1.0 - unsure, unsure - unknown, unknown)


def _bands(height: int) -> Iterator[tuple[int, int]]:
    for top in range(0, height, _ROWS):
        yield top, min(height, top + _ROWS)


def _packed(rgba: UInt8Array) -> Packed:
    """Return colours as 24-bit integers."""
    wide = rgba[..., :3].astype(np.int32)
    return (wide[..., 0] << 16) | (wide[..., 1] << 8) | wide[..., 2]


def _distinct_colours(rgba: UInt8Array) -> tuple[Packed, npt.NDArray[np.float32]]:
    """Return the distinct colours of an image, sorted, packed and in Oklab."""
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


def _nearest_colours(
    lab: npt.NDArray[np.float32], centres: npt.NDArray[np.float32]
) -> tuple[UInt8Array, UInt8Array]:
    """Return the index of each colour's certain centre, or `UNKNOWN`; and with the stricter margin."""
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
        certain = (first <= _CERTAIN**2) & (first <= _MAX_RATIO**2 * second)
        plain[start : start + _COLOURS][certain] = nearest[certain]
        certain &= np.sqrt(first) + _MARGIN <= np.sqrt(second)
        strict[start : start + _COLOURS][certain] = nearest[certain]
    return plain, strict


def _neighbouring_colours(
    certain: UInt8Array,
    rows: npt.NDArray[np.intp],
    columns: npt.NDArray[np.intp],
    own: npt.NDArray[np.float32],
    centres: npt.NDArray[np.float32],
) -> UInt8Array:
    """Return for each pixel the certain colour among its neighbours that is nearest to its own."""
    # `CLEAR` and `UNKNOWN` are infinitely far from any colour.
    all_centres = np.full((256, 3), np.inf, dtype=np.float32)
    all_centres[: len(centres)] = centres
    best = np.full(len(rows), UNKNOWN, dtype=np.uint8)
    least, darkest = (np.full(len(rows), np.inf, dtype=np.float32) for _ in range(2))
    for down, right in _OFFSETS:
        neighbour = _at(certain, rows + down, columns + right)
        distance = ((own - all_centres[neighbour]) ** 2).sum(axis=1)
        nearer = distance < least
        best[nearer], least[nearer] = neighbour[nearer], distance[nearer]
        darkest = np.minimum(darkest, all_centres[neighbour, 0])
    best[own[:, 0] < darkest - _DARKER] = UNKNOWN
    return best


def mixtures(rgb: UInt8Array, rough: BoolArray | None = None) -> BoolArray:
    """Return the pixels of an image (height, width, 3 or 4) that blend two pixels on opposite sides.

    Antialiasing, scaling and JPEG leave blends along borders: each channel is in between, whether blended in
    sRGB or linearly. A thin line has the same colour on both sides and is not a blend.
    """
    mixed = np.zeros(rgb.shape[:2], dtype=bool)
    rows, columns = np.nonzero(uneven(rgb) if rough is None else rough)
    rgb = rgb[..., :3]
    own = rgb[rows, columns].astype(np.int16)
    for down, right in _DIRECTIONS:
        for step in _DISTANCES:
            before = _at(rgb, rows - step * down, columns - step * right).astype(np.int16)
            after = _at(rgb, rows + step * down, columns + step * right).astype(np.int16)
            low, high = np.minimum(before, after), np.maximum(before, after)
            blended = ((own >= low - _SLACK) & (own <= high + _SLACK)).all(axis=1)
            blended &= (high - low).max(axis=1) >= _APART
            blended &= np.abs(own - before).max(axis=1) > _OWN
            blended &= np.abs(own - after).max(axis=1) > _OWN
            mixed[rows[blended], columns[blended]] = True
            unblended = ~blended
            rows, columns, own = rows[unblended], columns[unblended], own[unblended]
    return mixed


def uneven(rgb: UInt8Array) -> BoolArray:
    """Return the pixels of an image (height, width, 3 or 4) with neighbours of another colour."""
    rough = np.zeros(rgb.shape[:2], dtype=bool)
    for channel in range(3):
        values = rgb[..., channel]
        high = ndimage.maximum_filter(values, size=3, mode="nearest")
        low = ndimage.minimum_filter(values, size=3, mode="nearest")
        rough |= high - low > _FLAT
    return rough


def _at(image: UInt8Array, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> UInt8Array:
    """Return the pixels at rows and columns, clamped to the border."""
    height, width = image.shape[:2]
    return np.asarray(image[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)])
