"""Shapes: 8-connected regions of one label, each measured inside its own bounding box."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from skimage.measure import label as label_regions

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.geometry.hashing import hash_keys
from sketchterrain.landforms.placement.feature_types import LAYER_CODES

EDGE_OVERHANG = 0.125
"""Extension of a shape beyond the sketch's edge that it touches, as a share of the longer side."""


@dataclass(frozen=True, eq=False)
class Shape:
    """One connected region of one label."""

    layer: str
    label: int
    id: int  # index (row · image width + column) of its first pixel in reading order
    rows: slice  # bounding box in the image
    columns: slice
    mask: npt.NDArray[np.bool_]  # (h, w) inside the bounding box
    area: int  # pixels
    # row, column; depth-weighted centre of its pixels, pixel indices of the image
    centre: tuple[float, float]
    # (h, w) distance to the border, px, 0 outside; extended beyond the sketch's edge
    depth: npt.NDArray[np.float64]
    image_width: int

    def pixels(self, where: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return rows and columns, in the image, of the True pixels of a mask of the bounding box's size."""
        rows, columns = np.nonzero(where)
        return rows + int(self.rows.start), columns + int(self.columns.start)


class Region(NamedTuple):
    """A connected region of one label, not yet measured: its bounding box and mask."""

    label: int
    rows: slice
    columns: slice
    mask: npt.NDArray[np.bool_]


def label_shapes(layer: str, image: npt.NDArray[np.uint8]) -> tuple[Shape, ...]:
    """Return the shapes of a label image (0 is empty), in reading order of their first pixels."""
    return tuple(measure_shape(layer, image.shape, region) for region in find_regions(image))


def region_numbers(image: npt.NDArray[np.uint8], regions: Iterable[Region]) -> npt.NDArray[np.int64]:
    """Return the number of the region at each pixel, −1 where nothing is painted."""
    number = np.full(image.shape, -1, np.int64)
    for index, region in enumerate(regions):
        number[region.rows, region.columns][region.mask] = index
    return number


def find_regions(image: npt.NDArray[np.uint8]) -> tuple[Region, ...]:
    """Return the connected regions of a label image, in reading order of their first pixels."""
    number = label_regions(image, background=0, connectivity=2)
    found = []
    for own, box in enumerate(ndimage.find_objects(number), start=1):
        mask = number[box] == own
        found.append(Region(int(image[box].flat[np.argmax(mask)]), box[0], box[1], mask))
    return tuple(found)


def measure_shape(
    layer: str, size: tuple[int, ...], region: Region, depth: Float64Array | None = None
) -> Shape:
    """Measure a region of a layer's image, of a size (rows, columns; px); `depth` may be known."""
    _, rows, columns, mask = region
    depth = shape_depth(region, size) if depth is None else depth
    first = int(np.argmax(mask[0]))
    total = float(depth.sum())
    along_rows = depth.sum(axis=1) @ np.arange(rows.start, rows.stop)
    along_columns = depth.sum(axis=0) @ np.arange(columns.start, columns.stop)
    return Shape(
        layer=layer,
        label=region.label,
        id=int(rows.start) * size[1] + int(columns.start) + first,
        rows=rows,
        columns=columns,
        mask=mask,
        area=int(np.count_nonzero(mask)),
        centre=(float(along_rows) / total, float(along_columns) / total),
        depth=depth,
        image_width=size[1],
    )


def border_distance(
    mask: npt.NDArray[np.bool_], rows: slice, columns: slice, size: tuple[int, ...], *, whole: float
) -> Float64Array:
    """Return the distance (px) to the border, which the image's edge is not; `whole` without any."""
    sides = ((rows.start == 0, rows.stop == size[0]), (columns.start == 0, columns.stop == size[1]))
    padding = tuple((int(not low), int(not high)) for low, high in sides)
    padded = np.pad(mask, padding)
    if padded.all():
        return np.full(mask.shape, whole)
    distance = np.asarray(ndimage.distance_transform_edt(padded), dtype=np.float64) - 0.5
    return distance[padding[0][0] :, padding[1][0] :][: mask.shape[0], : mask.shape[1]]


def shape_depth(region: Region, size: tuple[int, ...]) -> Float64Array:
    """Return the distance to the nearest unpainted pixel of the image, or to the end of the overhang."""
    (_, rows, columns, mask), (height, width) = region, size
    distance = border_distance(mask, rows, columns, size, whole=np.inf)
    overhang = EDGE_OVERHANG * max(height, width)
    row, column = np.arange(rows.start, rows.stop) + 0.5, np.arange(columns.start, columns.stop) + 0.5
    to_end = np.minimum.outer(np.minimum(row, height - row), np.minimum(column, width - column)) + overhang
    return np.where(mask, np.minimum(distance, to_end), 0.0)


MIN_DISC = 1.0
"""Radius (px) of the smallest disc: a single pixel must be visible."""


@dataclass(frozen=True, eq=False)
class ShapePixels:
    """A shape's pixels as columns, one entry per pixel in reading order."""

    row: Int64Array  # in the bounding box
    column: Int64Array
    depth: Float64Array  # px
    disc: Float64Array  # px, radius of the user feature centred here
    priority: npt.NDArray[np.uint64]  # lowest first

    @classmethod
    def from_shape(cls, shape: Shape, *, most: float, seed: int) -> ShapePixels:
        """Measure a shape's pixels; no disc exceeds the radius `most` (px)."""
        row, column = np.nonzero(shape.mask)
        depth = shape.depth[row, column]
        index = (row + int(shape.rows.start)).astype(np.int64) * shape.image_width
        index += column + int(shape.columns.start)
        return cls(
            row=row,
            column=column,
            depth=depth,
            disc=np.maximum(np.minimum(depth, most), MIN_DISC),
            priority=hash_keys(seed, "dart", LAYER_CODES[shape.layer], shape.label, index),
        )
