"""Lines and areas as pixels: lines as wide as they are and never torn, areas by the middles of pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from sketchterrain.trace.vector_clip import segments_in

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    Mask = npt.NDArray[np.bool_]
    Places = npt.NDArray[np.float64]

__all__ = ["paint_areas", "paint_lines"]

_STEP = 0.5  # px between places along a line: pixels of neighbouring ones touch
_AT_ONCE = 2_000_000  # places
_GRID = 8  # places a pixel that a thick line's course is known to


def paint_lines(shape: tuple[int, int], segments: Places, width: float) -> Mask:
    """Return the pixels of lines: those whose middles the line covers, and all that its course runs through.

    So it is 8-connected however thin it is.

    Parameters
    ----------
    shape
        Rows and columns.
    segments
        (n, 2, 2): from column, row to column, row, px.
    width
        px.
    """
    rows, columns = shape
    # What is farther outside than the raster is long could only cover it as a whole.
    half = min(max(0.5 * width, 0.5), float(max(shape)))
    near = (-half, -half, columns + half, rows + half)
    painted = np.zeros(shape, dtype=np.bool_)
    cut = segments_in(segments, near)
    course = []
    for places in _along(cut) if len(cut) else ():
        column, row = np.floor(places).astype(np.intp).T
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        painted[row[inside], column[inside]] = True
        if width > 1.0:
            course.append(np.unique(np.rint(places * _GRID).astype(np.int32), axis=0))
    if course:
        places = np.unique(np.concatenate(course), axis=0) / _GRID
        painted |= _covered(shape, places, half)
    return painted


def _along(segments: Places) -> Iterator[Places]:
    """Return places along segments, both ends too, in parts of bounded size."""
    counts = np.ceil(np.hypot(*(segments[:, 1] - segments[:, 0]).T) / _STEP).astype(np.int64) + 1
    cuts = np.flatnonzero(np.diff(np.cumsum(counts) // _AT_ONCE)) + 1
    for part, count in zip(np.split(segments, cuts), np.split(counts, cuts), strict=True):
        yield _places(part, count)


def _places(segments: Places, counts: npt.NDArray[np.int64]) -> Places:
    of = np.repeat(np.arange(len(segments)), counts)
    number = np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = number / np.maximum(counts[of] - 1, 1)
    start = segments[of, 0]
    return np.asarray(start + share[:, None] * (segments[of, 1] - start))


def _covered(shape: tuple[int, int], course: Places, half: float) -> Mask:
    """Return the pixels whose middles are nearer to a course than half a width."""
    reach = int(np.ceil(half)) + 2
    # Only around the course, and on a raster that has all of it, though some of it is outside.
    first = np.floor(course.min(axis=0)).astype(np.intp) - reach
    last = np.floor(course.max(axis=0)).astype(np.intp) + reach
    away = np.ones((last - first + 1)[::-1], dtype=np.bool_)
    column, row = (np.floor(course).astype(np.intp) - first).T
    away[row, column] = False
    distance = np.asarray(ndimage.distance_transform_edt(away))
    covered = distance < half - 1.5  # for it tells the distance to a pixel, not to a place in it
    rows, columns = np.nonzero(~covered & (distance <= half + 1.5))
    middles = np.stack([columns, rows], axis=-1) + first + 0.5
    found, _ = cKDTree(course).query(middles, distance_upper_bound=half)
    hit = np.isfinite(found)
    covered[rows[hit], columns[hit]] = True
    result = np.zeros(shape, dtype=np.bool_)
    low = np.maximum(first, 0)
    high = np.minimum(last + 1, (shape[1], shape[0]))
    if np.all(low < high):
        at = [slice(a, b) for a, b in zip(low - first, high - first, strict=True)]
        result[low[1] : high[1], low[0] : high[0]] = covered[at[1], at[0]]
    return result


def paint_areas(shape: tuple[int, int], areas: Sequence[Sequence[Places]], *, touched: bool) -> Mask:
    """Return the pixels of areas: those whose middles lie in one, or all that one touches.

    Parameters
    ----------
    shape
        Rows and columns.
    areas
        The closed rings of each, (n, 2) of column and row, px.
    touched
        Whether what an area touches belongs to it: slim ones hold together then.
    """
    from rasterio.features import rasterize

    burnt = [
        ({"type": "Polygon", "coordinates": [ring.tolist() for ring in rings]}, 1) for rings in areas if rings
    ]
    if not burnt:
        return np.zeros(shape, dtype=np.bool_)
    return np.asarray(rasterize(burnt, out_shape=shape, dtype="uint8", all_touched=touched), dtype=np.bool_)
