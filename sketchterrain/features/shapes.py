"""Shapes: the 8-connected regions of one label, each measured inside its own bounding box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from skimage.measure import label as connected_regions

EDGE_OVERHANG = 0.125
"""A shape that touches the sketch's edge is taken to go on beyond it, by this share of the longer side."""


@dataclass(frozen=True, eq=False)
class Shape:
    """One connected region of one label.

    Attributes
    ----------
    layer : str
        Name of its layer.
    label : int
        Value of its pixels.
    id : int
        Index (row · image width + column) of its first pixel in reading order.
    rows, columns : slice
        Its bounding box in the image.
    mask : (h, w) bool
        True on its pixels, inside the bounding box.
    area : int
        Pixels.
    centre : (row, column)
        Centre of its pixels weighted by their depth, in pixel indices of the image.
    depth : (h, w) float64
        Distance from a pixel's centre to the shape's border, in pixels; 0 outside the mask. A lone pixel
        is 0.5 deep. The sketch's edge is no border: the world goes on there, and so does the shape, for an
        eighth of the sketch's longer side.
    image_width : int
        Columns of the whole image.
    """

    layer: str
    label: int
    id: int
    rows: slice
    columns: slice
    mask: npt.NDArray[np.bool_]
    area: int
    centre: tuple[float, float]
    depth: npt.NDArray[np.float64]
    image_width: int

    def pixels(self, where: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Rows and columns, in the image, of the True pixels of a mask of the bounding box's size."""
        rows, columns = np.nonzero(where)
        return rows + int(self.rows.start), columns + int(self.columns.start)


class Region(NamedTuple):
    """A connected region of one label, not yet measured: its label, its bounding box, its pixels in it."""

    label: int
    rows: slice
    columns: slice
    mask: npt.NDArray[np.bool_]


def label_shapes(layer: str, image: npt.NDArray[np.uint8]) -> tuple[Shape, ...]:
    """Find the shapes of a layer.

    Parameters
    ----------
    layer : str
        Name of the layer, kept in the shapes.
    image : (height, width) uint8
        Label image; 0 is empty.

    Returns
    -------
    tuple of Shape, in reading order of their first pixels. Empty for an empty image.
    """
    return tuple(measured(layer, image, region) for region in regions_of(image))


def regions_of(image: npt.NDArray[np.uint8]) -> tuple[Region, ...]:
    """Find the connected regions of a label image, in reading order of their first pixels."""
    numbers = np.asarray(connected_regions(image, background=0, connectivity=2))
    found = []
    for number, box in enumerate(ndimage.find_objects(numbers), 1):
        if box:
            rows, columns = box
            mask = numbers[box] == number
            first = int(np.argmax(mask[0])) + int(columns.start)
            region = Region(int(image[rows.start, first]), rows, columns, mask)
            found.append((int(rows.start), first, region))
    return tuple(region for _, _, region in sorted(found, key=lambda each: each[:2]))


def measured(layer: str, image: npt.NDArray[np.uint8], region: Region) -> Shape:
    """Measure a region of a layer's image."""
    _, rows, columns, mask = region
    depth = _depth(mask, rows, columns, image.shape)
    first = int(np.argmax(mask[0]))
    total = float(depth.sum())
    along_rows = depth.sum(axis=1) @ np.arange(rows.start, rows.stop)
    along_columns = depth.sum(axis=0) @ np.arange(columns.start, columns.stop)
    return Shape(
        layer=layer,
        label=region.label,
        id=int(rows.start) * image.shape[1] + int(columns.start) + first,
        rows=rows,
        columns=columns,
        mask=mask,
        area=int(np.count_nonzero(mask)),
        centre=(float(along_rows) / total, float(along_columns) / total),
        depth=depth,
        image_width=image.shape[1],
    )


def _depth(
    mask: npt.NDArray[np.bool_], rows: slice, columns: slice, size: tuple[int, ...]
) -> npt.NDArray[np.float64]:
    """Exact distance to the nearest unpainted pixel of the image, or to the end of the overhang."""
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
