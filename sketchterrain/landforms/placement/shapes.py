"""Shapes: 8-connected regions of one label, each measured inside its own bounding box."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components

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
    """Return the connected regions of a label image, in reading order of their first pixels.

    Joins runs of one label along rows, not pixels: a painted image has few.
    """
    row, start, end = _runs(image)
    if len(row) == 0:
        return ()
    label = image[row, start]
    count, member = connected_components(_touching(row, start, end, label, image.shape[1]), directed=False)
    order = np.argsort(member, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(member, minlength=count))])
    row, start, end = row[order], start[order], end[order]
    left, right = np.minimum.reduceat(start, bounds[:-1]), np.maximum.reduceat(end, bounds[:-1])
    found = []
    # Runs of a region are in reading order, and regions in the order of their first runs.
    for number in np.argsort(order[bounds[:-1]]).tolist():
        own = slice(int(bounds[number]), int(bounds[number + 1]))
        top, west, east = int(row[own.start]), int(left[number]), int(right[number])
        edges = np.zeros((int(row[own.stop - 1]) + 1 - top, east - west + 1), dtype=np.int8)
        edges[row[own] - top, start[own] - west] = 1
        edges[row[own] - top, end[own] - west] = -1
        mask = np.cumsum(edges, axis=1, dtype=np.int8)[:, :-1].astype(np.bool_)
        box = slice(top, top + len(edges)), slice(west, east)
        found.append(Region(int(label[order[own.start]]), *box, mask))
    return tuple(found)


def _runs(image: npt.NDArray[np.uint8]) -> tuple[Int64Array, Int64Array, Int64Array]:
    """Return row, first column and end column of each run of one label, in reading order."""
    turns = np.ones(image.shape, dtype=np.bool_)
    np.not_equal(image[:, 1:], image[:, :-1], out=turns[:, 1:])
    first = np.flatnonzero(turns)
    row, start = np.divmod(first, image.shape[1])
    end = np.append(first[1:], image.size) - row * image.shape[1]
    painted = image[row, start] > 0
    return row[painted], start[painted], end[painted]


def _touching(
    row: Int64Array, start: Int64Array, end: Int64Array, label: npt.NDArray[np.uint8], width: int
) -> sparse.coo_array:
    """Return pairs of runs of one label in adjacent rows whose pixels touch at least at a corner."""
    span = width + 1
    low = np.searchsorted(row * span + end, (row + 1) * span + start, side="left")
    high = np.searchsorted(row * span + start, (row + 1) * span + end, side="right")
    count = np.maximum(high - low, 0)
    upper = np.repeat(np.arange(len(row)), count)
    lower = np.arange(len(upper)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(low, count)
    same = label[upper] == label[lower]
    ones = np.ones(int(same.sum()), dtype=np.bool_)
    return sparse.coo_array((ones, (upper[same], lower[same])), shape=(len(row), len(row)))


def measure_shape(layer: str, size: tuple[int, ...], region: Region) -> Shape:
    """Measure a region of a layer's image, of a size (rows, columns; px)."""
    _, rows, columns, mask = region
    depth = _depth(mask, rows, columns, size)
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


def _depth(
    mask: npt.NDArray[np.bool_], rows: slice, columns: slice, size: tuple[int, ...]
) -> npt.NDArray[np.float64]:
    """Return the distance to the nearest unpainted pixel of the image, or to the end of the overhang."""
    height, width = size
    sides = ((rows.start == 0, rows.stop == height), (columns.start == 0, columns.stop == width))
    padding = tuple((int(not low), int(not high)) for low, high in sides)
    padded = np.pad(mask, padding)
    if padded.all():
        distance = np.full(mask.shape, np.inf)
    else:
        distance = np.asarray(ndimage.distance_transform_edt(padded), dtype=np.float64)
        distance = distance[padding[0][0] :, padding[1][0] :][: mask.shape[0], : mask.shape[1]] - 0.5
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
