"""Label layers of an imported sketch."""

from __future__ import annotations

import io
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy import ndimage, sparse

from sketchterrain.array_types import BoolArray, UInt8Array
from sketchterrain.document.label_layers import DRAW_ORDER, MAX_LABELS, MAX_SIDE, label_rgb, labels_in
from sketchterrain.document.parameter_types import Value
from sketchterrain.document.parameters import LAYERS, SKETCH
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError

NO_VOTE: Final = 255  # an unknown value: it does not vote, and stands where nothing voted

_PIXELS = 4_000_000  # voting together
_EDGE = 4  # px that lines are extended beyond the border before thinning, so that they reach it
_CLOSE = 4.0  # px that an end is joined over, whatever its direction
_BEHIND = 8.0  # px of a line that give its direction
_LONG = 2.0  # times as long as it may be wide, at least: what is shorter is a bay
_EIGHT = np.ones((3, 3), dtype=bool)


def scaled_size(width: int, height: int, longest: int) -> tuple[int, int]:
    """Return (width, height), px, of the same shape with a longer side of `longest`, and at least 1."""
    scale = longest / max(width, height)
    return max(1, round(width * scale)), max(1, round(height * scale))


def majority(values: UInt8Array, size: tuple[int, int], *, thin: Collection[int] = ()) -> UInt8Array:
    """Return a label image scaled to (width, height): of each pixel the value that covers most of it.

    Of those that cover as much it is the lowest. Values in `thin` are lines, of which a pixel's width remains
    at least, 8-connected if it was.
    """
    height, width = values.shape
    if (width, height) == size:
        return values.copy()
    across, down = _overlaps(width, size[0]), _overlaps(height, size[1])
    scaled = np.empty((size[1], size[0]), dtype=np.uint8)
    touched = {value: np.zeros(scaled.shape, dtype=bool) for value in thin}
    step = max(1, _PIXELS * size[1] // (width * height))
    for top in range(0, size[1], step):
        rows = down[top : top + step]
        first, last = int(rows.indices.min()), int(rows.indices.max()) + 1
        band = values[first:last]
        most = np.zeros((rows.shape[0], size[0]), dtype=np.float32)
        part = np.full(most.shape, NO_VOTE, dtype=np.uint8)
        for value in map(int, np.flatnonzero(np.bincount(band.ravel(), minlength=256)[:NO_VOTE])):
            mask = (band == value).astype(np.float32)
            votes = rows[:, first:last] @ (across @ mask.T).T
            won = votes > most
            most[won], part[won] = votes[won], value
            if value in touched:
                touched[value][top : top + step] = votes > 0.0
        scaled[top : top + step] = part
    if size[0] < width or size[1] < height:
        for value, where in touched.items():
            scaled[thinned(where)] = value
    return scaled


def _overlaps(old: int, new: int) -> sparse.csr_array:
    """Return how much of each old pixel lies in each new one, float32, (new, old)."""
    edges = np.unique(np.concatenate([np.arange(old + 1) * new, np.arange(new + 1) * old]))  # in 1/(old·new)
    middles = edges[:-1] + np.diff(edges) // 2
    lengths = np.diff(edges) / old
    places = (middles // old, middles // new)
    return sparse.csr_array((lengths.astype(np.float32), places), shape=(new, old))


def thinned(where: BoolArray) -> BoolArray:
    """Return the middle lines, a pixel wide and as connected as the mask, out to the image's border."""
    from skimage.morphology import skeletonize

    if not where.any():
        return where
    line = skeletonize(np.pad(where, _EDGE, mode="edge"))
    return np.asarray(line[_EDGE:-_EDGE, _EDGE:-_EDGE])


def joined(where: BoolArray, gap: int) -> BoolArray:
    """Return lines with the pixels added that join their ends to other parts at most `gap` pixels away.

    An end is joined to the nearest pixel of another part, farther than four pixels only straight on, within
    60° of the line's direction. Parts side by side get nothing: no shore is changed.
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
        straight = others @ ahead >= 0.5 * np.hypot(*others.T) * np.hypot(*ahead)
        reached = (distance <= _CLOSE) | ((distance <= gap) & straight)
        if reached.any():
            nearest = others[reached][np.argmin(distance[reached])]
            steps = np.linspace(0.0, 1.0, int(np.abs(nearest).max()) + 1)[:, None]
            whole[tuple((np.rint(steps * nearest).astype(np.intp) + end).T)] = True
    return whole


def fill_gaps(values: UInt8Array, *, reach: float, beyond: int) -> UInt8Array:
    """Return an image in which `NO_VOTE` is the nearest known value up to `reach` px, else `beyond`."""
    gaps = values == NO_VOTE
    if not gaps.any():
        return values
    if gaps.all():
        return np.full_like(values, beyond)
    distance, (rows, columns) = ndimage.distance_transform_edt(gaps, return_indices=True)
    return np.where(distance <= reach, values[rows, columns], beyond).astype(np.uint8)


def without_specks(values: UInt8Array, least: int) -> UInt8Array:
    """Return an image in which no 8-connected area has fewer than `least` pixels, unless all have.

    A smaller one takes the values beside it.
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


def without_threads(values: UInt8Array, areas: Iterable[int]) -> UInt8Array:
    """Return an image in which parts of some values thinner than 3 px are `NO_VOTE`: rims of outlines.

    A value that is nowhere wider stays as it is.
    """
    kept = values.copy()
    for value in areas:
        mask = values == value
        wide = ndimage.binary_opening(mask, structure=_EIGHT)
        if wide.any():
            kept[mask & ~ndimage.binary_dilation(wide, structure=_EIGHT)] = NO_VOTE
    return kept


def narrow_waters(water: BoolArray, width: float) -> BoolArray:
    """Return the parts of waters that are narrower than `width` px, and long; bays of a lake belong to it."""
    core = ndimage.distance_transform_edt(water) > 0.5 * width
    lakes = np.zeros_like(water)
    if core.any():  # grown back by one pixel more, for the corners that a disc does not reach
        lakes = water & (ndimage.distance_transform_edt(~core) <= 0.5 * width + 1.0)
    parts, _ = ndimage.label(water & ~lakes, structure=_EIGHT)
    narrow = np.zeros_like(water)
    for number, box in enumerate(ndimage.find_objects(parts), start=1):
        if box and np.hypot(*(side.stop - side.start for side in box)) >= _LONG * width:
            narrow[box] |= parts[box] == number
    return narrow


def parted_waters(river: UInt8Array, lake: UInt8Array, width: float) -> tuple[UInt8Array, UInt8Array]:
    """Return layers of rivers and lakes in which waters narrower than `width` px are rivers, the rest lakes.

    Pixels from the other layer get label 1.
    """
    water = (river > 0) | (lake > 0)
    narrow = narrow_waters(water, width)
    rivers = np.where(narrow, np.maximum(river, 1), 0)
    lakes = np.where(water & ~narrow, np.maximum(lake, 1), 0)
    return rivers.astype(np.uint8), lakes.astype(np.uint8)


LONGEST: Final = 1024  # px along the longer side at most, unless more are asked for

_GAP = 8  # px between a sketch's picture and its source's
_TALLEST = 1024  # px of the picture


@dataclass(frozen=True)
class Sheet:
    """Options of a traced sketch; raise `InputError` for values that no sketch can have."""

    size_px: int | None = None
    extent: float | None = None
    name: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.size_px is not None and not 1 <= self.size_px <= MAX_SIDE:
            raise InputError(f"size: expected 1 to {MAX_SIDE} px, got {self.size_px}")
        for key in ("extent", "name", "seed"):
            value = getattr(self, key)
            if value is not None:
                SKETCH[key].check(value)

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Return the sketch's (width, height), px, for something of another size."""
        longest = max(width, height)
        return scaled_size(width, height, self.size_px or min(longest, LONGEST))

    def sketch(self, layers: Mapping[str, npt.NDArray[np.uint8]], called: str) -> tuple[Sketch, list[str]]:
        """Return the sketch of layers' images, uint8 (height, width) of one size, and notes on it."""
        there = {name: image for name, image in layers.items() if image.any()}
        labels: dict[tuple[str, int], dict[str, Value]] = {}
        for name, image in there.items():
            found = labels_in(image)
            if len(found) > MAX_LABELS:
                raise InputError(f"{len(found)} labels on layer {name}: expected at most {MAX_LABELS}")
            table = LAYERS[name].parameters
            labels |= {(name, label): {key: table[key].default for key in table} for label in found}
        longest = SKETCH["name"].high
        sketch = Sketch(
            name=self.name if self.name is not None else called[: int(longest)],
            seed=self.seed,
            layers=layers,
            labels=labels,
            extent=float(SKETCH["extent"].default) if self.extent is None else self.extent,
        )
        told = []
        if self.extent is None:
            told.append(f"extent: {sketch.extent:g} m along the longer side, for none was given")
        told.append(
            f"{sketch.width_px}×{sketch.height_px} px, {sketch.pixel_size:.4g} m each: "
            + (
                ", ".join(f"{name} {'+'.join(map(str, labels_in(image)))}" for name, image in there.items())
                or "nothing"
            )
        )
        return sketch, told


@dataclass(frozen=True, eq=False)
class Traced:
    """A sketch made from something else, and notes: what was taken, left out and guessed, one line each."""

    sketch: Sketch
    notes: tuple[str, ...]


def sketch_picture(sketch: Sketch) -> npt.NDArray[np.uint8]:
    """Return what a sketch looks like on white paper: uint8, (height, width, 3), sRGB."""
    shown = np.full((sketch.height_px, sketch.width_px, 3), 255, dtype=np.uint8)
    for layer in DRAW_ORDER:
        image = sketch.layers[layer]
        for label in labels_in(image):
            shown[image == label] = label_rgb(layer, label)
    return shown


def preview_png(sketch: Sketch, source: npt.NDArray[np.uint8] | None = None) -> bytes:
    """Return a PNG of a sketch, at the right of its source if one is given: uint8, (height, width, 4)."""
    traced = Image.fromarray(sketch_picture(sketch))
    height = min(traced.height, _TALLEST)
    size = max(1, round(traced.width * height / traced.height)), height
    traced = traced.resize(size, Image.Resampling.NEAREST)
    if source is not None:
        beside = Image.new("RGB", (2 * size[0] + _GAP, height), (128, 128, 128))
        original = Image.fromarray(source).resize(size, Image.Resampling.BOX)
        beside.paste(original, (0, 0), original)
        beside.paste(traced, (size[0] + _GAP, 0))
        traced = beside
    stream = io.BytesIO()
    traced.save(stream, format="PNG")
    return stream.getvalue()
