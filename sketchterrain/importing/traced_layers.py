"""Label image operations for tracing, and the options and result of a traced sketch."""

import io
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy import ndimage, sparse

from sketchterrain.array_types import BoolArray, UInt8Array
from sketchterrain.document.label_layers import MAX_LABELS, MAX_SIDE, label_rgb, labels_in
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, one_line
from sketchterrain.features.table import FeatureTable
from sketchterrain.schema.layers import DRAW_ORDER, LAYERS, VECTOR_ORDER
from sketchterrain.schema.parameters import SKETCH, Value

UNASSIGNED: Final = 255  # value of pixels without a label

_PIXELS_AT_ONCE = 4_000_000  # bounds the memory
_EDGE = 4  # px that lines are extended beyond the border before skeletonising, so that they end at it
_CLOSE = 4.0  # px, a gap that is closed in any direction
_BEHIND = 8.0  # px of a line that determine its direction
_MIN_ASPECT = 2.0  # length of narrow water over the width limit; shorter parts are bays
_EIGHT = np.ones((3, 3), dtype=bool)


def scaled_size(width: int, height: int, longest: int) -> tuple[int, int]:
    """Return (width, height) in px of the same aspect ratio with a longer side of `longest`."""
    scale = longest / max(width, height)
    return max(1, round(width * scale)), max(1, round(height * scale))


def scale_labels(values: UInt8Array, size: tuple[int, int], *, thin: Collection[int] = ()) -> UInt8Array:
    """Scale a label image to (width, height) by majority: each pixel gets the value that covers most of it.

    The lowest wins a tie. Values in `thin` are lines, of which one pixel's width remains, as connected as
    before.
    """
    height, width = values.shape
    if (width, height) == size:
        return values.copy()
    across, down = _overlaps(width, size[0]), _overlaps(height, size[1])
    scaled = np.empty((size[1], size[0]), dtype=np.uint8)
    touched = {value: np.zeros(scaled.shape, dtype=bool) for value in thin}
    step = max(1, _PIXELS_AT_ONCE * size[1] // (width * height))
    for top in range(0, size[1], step):
        rows = down[top : top + step]
        first, last = int(rows.indices.min()), int(rows.indices.max()) + 1
        band = values[first:last]
        most = np.zeros((rows.shape[0], size[0]), dtype=np.float32)
        part = np.full(most.shape, UNASSIGNED, dtype=np.uint8)
        for value in map(int, np.flatnonzero(np.bincount(band.ravel(), minlength=256)[:UNASSIGNED])):
            mask = (band == value).astype(np.float32)
            votes = rows[:, first:last] @ (across @ mask.T).T
            won = votes > most
            most[won], part[won] = votes[won], value
            if value in touched:
                touched[value][top : top + step] = votes > 0.0
        scaled[top : top + step] = part
    if size[0] < width or size[1] < height:
        for value, where in touched.items():
            scaled[skeleton(where)] = value
    return scaled


def _overlaps(old: int, new: int) -> sparse.csr_array:
    """Return the overlap of each old pixel with each new one, float32 (new, old)."""
    edges = np.unique(np.concatenate([np.arange(old + 1) * new, np.arange(new + 1) * old]))  # in 1/(old·new)
    middles = edges[:-1] + np.diff(edges) // 2
    lengths = np.diff(edges) / old
    places = (middles // old, middles // new)
    return sparse.csr_array((lengths.astype(np.float32), places), shape=(new, old))


def skeleton(where: BoolArray) -> BoolArray:
    """Return the skeleton of a mask, continued to the image's border."""
    from skimage.morphology import skeletonize

    if not where.any():
        return where
    line = skeletonize(np.pad(where, _EDGE, mode="edge"))
    return np.asarray(line[_EDGE:-_EDGE, _EDGE:-_EDGE])


def join_line_ends(where: BoolArray, gap: int) -> BoolArray:
    """Join the ends of lines to the nearest other part within `gap` px.

    Beyond four pixels only within 60° of the line's direction. Sides of lines are unchanged.
    """
    parts, count = ndimage.label(where, structure=_EIGHT)
    if count < 2:
        return where
    result, middle = where.copy(), skeleton(where)
    inside = ndimage.distance_transform_edt(where)
    neighbours = ndimage.convolve(middle.astype(np.int8), _EIGHT.astype(np.int8), mode="constant") - 1
    for row, column in np.argwhere(middle & (neighbours <= 1)):
        own, end = parts[row, column], np.array((row, column))
        within = inside[row, column]  # distance of the skeleton's end from the border of its line
        radius = gap + int(np.ceil(within)) + 1
        corner = np.maximum(end - radius, 0)
        window = np.s_[corner[0] : row + radius + 1, corner[1] : column + radius + 1]
        others = np.argwhere((parts[window] > 0) & (parts[window] != own)) + (corner - end)
        distance = np.maximum(np.hypot(others[:, 0], others[:, 1]) - within, 0.0)
        back = np.argwhere(middle[window] & (parts[window] == own)) + (corner - end)
        back = back[np.hypot(back[:, 0], back[:, 1]) <= _BEHIND]
        ahead = -back.mean(axis=0)
        straight = others @ ahead >= 0.5 * np.hypot(*others.T) * np.hypot(*ahead)
        joinable = (distance <= _CLOSE) | ((distance <= gap) & straight)
        if joinable.any():
            nearest = others[joinable][np.argmin(distance[joinable])]
            steps = np.linspace(0.0, 1.0, int(np.abs(nearest).max()) + 1)[:, None]
            result[tuple((np.rint(steps * nearest).astype(np.intp) + end).T)] = True
    return result


def fill_gaps(values: UInt8Array, *, radius: float, default: int) -> UInt8Array:
    """Replace `UNASSIGNED` by the nearest value within `radius` px, else by a default."""
    gaps = values == UNASSIGNED
    if not gaps.any():
        return values
    if gaps.all():
        return np.full_like(values, default)
    distance, (rows, columns) = ndimage.distance_transform_edt(gaps, return_indices=True)
    return np.where(distance <= radius, values[rows, columns], default).astype(np.uint8)


def remove_specks(values: UInt8Array, least: int) -> UInt8Array:
    """Fill 8-connected areas of fewer than `least` pixels from their surroundings, unless all are small."""
    small = np.zeros(values.shape, dtype=bool)
    for value in np.flatnonzero(np.bincount(values.ravel(), minlength=256)):
        areas, count = ndimage.label(values == value, structure=_EIGHT)
        if count:
            few = np.bincount(areas.ravel(), minlength=count + 1) < least
            few[0] = False
            small |= few[areas]
    if not small.any() or small.all():
        return values
    return fill_gaps(np.where(small, UNASSIGNED, values).astype(np.uint8), radius=np.inf, default=0)


def unassign_thin_parts(values: UInt8Array, areas: Iterable[int]) -> UInt8Array:
    """Set parts of some values that are thinner than 3 px, fringes of outlines, to `UNASSIGNED`.

    A value that is thinner everywhere is unchanged.
    """
    result = values.copy()
    for value in areas:
        mask = values == value
        wide = ndimage.binary_opening(mask, structure=_EIGHT)
        if wide.any():
            result[mask & ~ndimage.binary_dilation(wide, structure=_EIGHT)] = UNASSIGNED
    return result


def narrow_water(water: BoolArray, width: float) -> BoolArray:
    """Return long parts of water narrower than `width` px; bays of a lake are not among them."""
    core = ndimage.distance_transform_edt(water) > 0.5 * width
    lakes = np.zeros_like(water)
    if core.any():  # one pixel more than the erosion, for corners outside a disc
        lakes = water & (ndimage.distance_transform_edt(~core) <= 0.5 * width + 1.0)
    parts, _ = ndimage.label(water & ~lakes, structure=_EIGHT)
    narrow = np.zeros_like(water)
    for number, box in enumerate(ndimage.find_objects(parts), start=1):
        if box and np.hypot(*(side.stop - side.start for side in box)) >= _MIN_ASPECT * width:
            narrow[box] |= parts[box] == number
    return narrow


def split_water(river: UInt8Array, lake: UInt8Array, width: float) -> tuple[UInt8Array, UInt8Array]:
    """Reassign water narrower than `width` px to rivers and other water to lakes, new pixels with label 1."""
    water = (river > 0) | (lake > 0)
    narrow = narrow_water(water, width)
    rivers = np.where(narrow, np.maximum(river, 1), 0)
    lakes = np.where(water & ~narrow, np.maximum(lake, 1), 0)
    return rivers.astype(np.uint8), lakes.astype(np.uint8)


DEFAULT_MAX_SIDE: Final = 1024  # px along the longer side, unless a size is given

_PREVIEW_GAP = 8  # px between the images of a sketch and its source
_PREVIEW_HEIGHT = 1024  # px, at most


@dataclass(frozen=True)
class TraceOptions:
    """Options of a traced sketch, validated."""

    size_px: int | None = None  # longer side; None: the source's, at most `DEFAULT_MAX_SIDE`
    extent: float | None = None  # m, longer side; None: a sketch's default
    name: str | None = None  # None: the source's
    seed: int = 0

    def __post_init__(self) -> None:
        if self.size_px is not None and not 1 <= self.size_px <= MAX_SIDE:
            raise InputError(f"size: expected 1 to {MAX_SIDE} px, got {self.size_px}")
        for key in ("extent", "name", "seed"):
            value = getattr(self, key)
            if value is not None:
                SKETCH[key].check(value)

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Return the sketch's (width, height) in px for a source of a size."""
        longest = max(width, height)
        return scaled_size(width, height, self.size_px or min(longest, DEFAULT_MAX_SIDE))

    def sketch(self, layers: Mapping[str, npt.NDArray[np.uint8]], source: str) -> tuple[Sketch, list[str]]:
        """Return the sketch of layer images, uint8 (height, width) of one size, and notes on it."""
        painted = {name: image for name, image in layers.items() if image.any()}
        labels: dict[tuple[str, int], dict[str, Value]] = {}
        for name, image in painted.items():
            found = labels_in(image)
            if len(found) > MAX_LABELS:
                raise InputError(f"{len(found)} labels on layer {name}: expected at most {MAX_LABELS}")
            table = LAYERS[name].parameters
            labels |= {(name, label): {key: table[key].default for key in table} for label in found}
        sketch = Sketch(
            name=self.name if self.name is not None else one_line(source)[: int(SKETCH["name"].high)],
            seed=self.seed,
            layers=layers,
            labels=labels,
            extent=float(SKETCH["extent"].default) if self.extent is None else self.extent,
        )
        notes = []
        if self.extent is None:
            notes.append(f"extent: {sketch.extent:g} m along the longer side, the default")
        contents = (f"{name} {'+'.join(map(str, labels_in(image)))}" for name, image in painted.items())
        size = f"{sketch.width_px}×{sketch.height_px} px, {sketch.pixel_size:.4g} m each"
        notes.append(f"{size}: {', '.join(contents) or 'nothing'}")
        return sketch, notes


@dataclass(frozen=True, eq=False)
class TraceResult:
    """A traced sketch, and notes on what was used, skipped and guessed, one line each."""

    sketch: Sketch
    notes: tuple[str, ...]


def sketch_picture(sketch: Sketch) -> npt.NDArray[np.uint8]:
    """Return an image of a sketch on white: uint8 (height, width, 3), sRGB."""
    picture = np.full((sketch.height_px, sketch.width_px, 3), 255, dtype=np.uint8)
    unpainted = np.zeros(picture.shape[:2], dtype=np.uint8)
    for layer in dict.fromkeys((VECTOR_ORDER[0], *DRAW_ORDER, *VECTOR_ORDER)):  # land use is the lowest
        image, vectors = sketch.layers.get(layer, unpainted), sketch.vectors.get(layer)
        if vectors:
            drawn = _rasterised(vectors, sketch)
            image = np.where(drawn, drawn, image)
        for label in labels_in(image):
            picture[image == label] = label_rgb(layer, label)
    return picture


def _rasterised(vectors: FeatureTable, sketch: Sketch) -> UInt8Array:
    """Return the labels of vectors at all pixels that they touch."""
    import shapely
    from rasterio.features import rasterize

    scale = np.array([1.0, -1.0]) / sketch.pixel_size
    shapes = shapely.transform(vectors.shapes(), lambda at: at * scale + (0.0, sketch.height_px))
    labelled = zip(shapes, vectors.labels.tolist(), strict=True)
    size = sketch.height_px, sketch.width_px
    return np.asarray(rasterize(labelled, size, all_touched=True, dtype="uint8"))


def preview_png(sketch: Sketch, source: npt.NDArray[np.uint8] | None = None) -> bytes:
    """Return a PNG of a sketch, to the right of its source if given: uint8 (height, width, 4)."""
    traced = Image.fromarray(sketch_picture(sketch))
    height = min(traced.height, _PREVIEW_HEIGHT)
    size = max(1, round(traced.width * height / traced.height)), height
    traced = traced.resize(size, Image.Resampling.NEAREST)
    if source is not None:
        both = Image.new("RGB", (2 * size[0] + _PREVIEW_GAP, height), (128, 128, 128))
        original = Image.fromarray(source).resize(size, Image.Resampling.BOX)
        both.paste(original, (0, 0), original)
        both.paste(traced, (size[0] + _PREVIEW_GAP, 0))
        traced = both
    stream = io.BytesIO()
    traced.save(stream, format="PNG")
    return stream.getvalue()
