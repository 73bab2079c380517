"""The skeleton of what was painted as a river, as a graph of pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from skimage.morphology import skeletonize

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


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

    rows: Ints
    columns: Ints
    depth: Floats
    weight: Floats
    graph: sparse.csr_array

    def ends(self) -> Ints:
        """Pixels with one neighbour, or the only pixel."""
        degree = np.diff(self.graph.indptr)
        return np.flatnonzero(degree <= 1)

    def paths_from(self, root: int) -> tuple[Floats, Ints]:
        """Length (px) of the shortest path from a pixel to each, and each one's next pixel back (or < 0)."""
        length, before = dijkstra(self.graph, indices=np.array([root]), return_predecessors=True)
        return np.asarray(length[0]), np.asarray(before[0], dtype=np.int64)


def skeletons(painted: npt.NDArray[np.bool_], weight: Floats | None = None) -> tuple[Skeleton, ...]:
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
    if not painted.any():
        return ()
    rows, columns = (np.flatnonzero(painted.any(axis=axis)) for axis in (1, 0))
    top, left = int(rows[0]), int(columns[0])
    window = painted[top : int(rows[-1]) + 1, left : int(columns[-1]) + 1]
    thin = _thinned(window)
    at_row, at_column = np.nonzero(thin)
    depth = _depth(painted)[at_row + top, at_column + left]
    importance = (
        np.ones(len(depth)) if weight is None else weight[at_row + top, at_column + left].astype(np.float64)
    )
    graph = _graph(thin, at_row, at_column)
    count, member = connected_components(graph, directed=False)
    by_member = np.argsort(member, kind="stable")
    groups = np.split(by_member, np.cumsum(np.bincount(member, minlength=count))[:-1])
    return tuple(
        Skeleton(
            rows=at_row[group] + top,
            columns=at_column[group] + left,
            depth=depth[group],
            weight=importance[group],
            graph=graph[group][:, group],
        )
        for group in groups
    )


def _thinned(painted: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Thin to lines; every region keeps at least its first pixel (thinning can eat a 2x2 dab whole)."""
    thin = np.asarray(skeletonize(np.pad(painted, 1)))[1:-1, 1:-1].astype(np.bool_)
    regions, count = ndimage.label(painted, structure=np.ones((3, 3)))
    lost = np.bincount(regions[thin], minlength=count + 1)[1:] == 0
    if lost.any():
        numbers, first = np.unique(regions, return_index=True)
        thin.flat[first[(numbers > 0) & np.concatenate([[False] * (numbers[0] == 0), lost])]] = True
    return thin


def _depth(painted: npt.NDArray[np.bool_]) -> Floats:
    if painted.all():
        height, width = painted.shape
        return np.full(painted.shape, 0.5 * min(height, width))
    return np.asarray(ndimage.distance_transform_edt(painted), dtype=np.float64) - 0.5


def _graph(thin: npt.NDArray[np.bool_], rows: Ints, columns: Ints) -> sparse.csr_array:
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
