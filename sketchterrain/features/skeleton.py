"""The skeleton of what was painted as a river, as a graph of pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra
from skimage.morphology import skeletonize

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.features.shapes import find_regions

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sketchterrain.features.shapes import Region


@dataclass(frozen=True, eq=False)
class Skeleton:
    """One connected skeleton.

    Attributes
    ----------
    rows, columns : (n,) int64
        Its pixels in the image, in reading order.
    depth : (n,) float64
        Distance (px) from each to the painted border: half the painted width. The sketch's edge is no border.
    weight : (n,) float64
        How much a pixel of length counts when the main stem is sought.
    graph : (n, n) sparse float64
        Length (px) of each step between neighbouring pixels, both ways. A diagonal step is left out where
        two straight ones lead to the same place, so that a bend is no junction.
    """

    rows: Int64Array
    columns: Int64Array
    depth: Float64Array
    weight: Float64Array
    graph: sparse.csr_array

    def ends(self) -> Int64Array:
        """Pixels with one neighbour, or the only pixel."""
        degree = np.diff(self.graph.indptr)
        return np.flatnonzero(degree <= 1)

    def paths_from(self, root: int) -> tuple[Float64Array, Int64Array]:
        """Length (px) of the shortest path from a pixel to each, and each one's next pixel back (or < 0)."""
        length, before = dijkstra(self.graph, indices=np.array([root]), return_predecessors=True)
        return np.asarray(length[0]), np.asarray(before[0], dtype=np.int64)


def skeletons(painted: npt.NDArray[np.bool_], weight: Float64Array | None = None) -> tuple[Skeleton, ...]:
    """Thin what was painted to lines one pixel wide, one skeleton for each 8-connected region.

    Parameters
    ----------
    painted : (height, width) bool
        True where a river was painted.
    weight : (height, width) float64, optional
        How much a pixel of length counts when the main stem is sought; 1 by default.

    Returns
    -------
    tuple of Skeleton, in reading order of their first pixels.
    """
    weight = np.ones(painted.shape) if weight is None else weight
    return sort_skeletons(
        thin_region(region, weight[region.rows, region.columns], painted.shape)
        for region in find_regions(painted.astype(np.uint8))
    )


def sort_skeletons(found: Iterable[Skeleton]) -> tuple[Skeleton, ...]:
    """Return skeletons in reading order of their first pixels."""
    return tuple(sorted(found, key=lambda each: (int(each.rows[0]), int(each.columns[0]))))


def thin_region(region: Region, weight: Float64Array, size: tuple[int, ...]) -> Skeleton:
    """Thin one 8-connected region.

    Parameters
    ----------
    region : Region
    weight : (h, w) float64
        As for `skeletons`, in the region's bounding box.
    size : (height, width)
        Of the whole image.
    """
    thin = _thinned(region.mask)
    at_row, at_column = np.nonzero(thin)
    return Skeleton(
        rows=at_row + int(region.rows.start),
        columns=at_column + int(region.columns.start),
        depth=_depth(region, size)[at_row, at_column],
        weight=weight[at_row, at_column].astype(np.float64),
        graph=_graph(thin, at_row, at_column),
    )


def _thinned(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Thin to lines; at least the first pixel is kept (thinning can eat a 2x2 dab whole)."""
    thin = np.asarray(skeletonize(np.pad(mask, 1)))[1:-1, 1:-1].astype(np.bool_)
    if not thin.any():
        thin.flat[int(np.argmax(mask))] = True
    return thin


def _depth(region: Region, size: tuple[int, ...]) -> Float64Array:
    """Distance (px) to the border; the image's edge is none."""
    rows, columns = region.rows, region.columns
    sides = ((rows.start == 0, rows.stop == size[0]), (columns.start == 0, columns.stop == size[1]))
    padding = tuple((int(not low), int(not high)) for low, high in sides)
    padded = np.pad(region.mask, padding)
    if padded.all():
        return np.full(region.mask.shape, 0.5 * min(size))
    distance = np.asarray(ndimage.distance_transform_edt(padded), dtype=np.float64) - 0.5
    return distance[padding[0][0] :, padding[1][0] :][: region.mask.shape[0], : region.mask.shape[1]]


def _graph(thin: npt.NDArray[np.bool_], rows: Int64Array, columns: Int64Array) -> sparse.csr_array:
    number = np.full((thin.shape[0] + 2, thin.shape[1] + 2), -1, dtype=np.int64)
    number[rows + 1, columns + 1] = np.arange(len(rows))
    starts, stops, lengths = [], [], []
    for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = number[rows + 1 + down, columns + 1 + across]
        joined = other >= 0
        if down and across:
            joined &= (number[rows + 1 + down, columns + 1] < 0) & (
                number[rows + 1, columns + 1 + across] < 0
            )
        starts.append(np.flatnonzero(joined))
        stops.append(other[joined])
        lengths.append(np.full(int(joined.sum()), float(np.hypot(down, across))))
    start, stop, length = (np.concatenate(each) for each in (starts, stops, lengths))
    both = (np.concatenate([length, length]), (np.concatenate([start, stop]), np.concatenate([stop, start])))
    graph = sparse.csr_array(both, shape=(len(rows), len(rows)))
    graph.sort_indices()
    return graph
