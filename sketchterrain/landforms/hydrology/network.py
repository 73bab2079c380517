"""River networks: skeletons of painted strokes, reaches, and closed gaps between strokes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra
from skimage.morphology import skeletonize

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.landforms.placement.shapes import Region, border_distance, find_regions


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Connected skeleton of a painted river, as a pixel graph."""

    rows: Int64Array  # (n,) pixels in the image, in reading order
    columns: Int64Array
    # (n,) px to the painted border, half the painted width; the sketch's edge is no border
    depth: Float64Array
    weight: Float64Array  # (n,) weight of a pixel's length in the search for the main stem
    # px between neighbours, both ways; no diagonal where two straight steps lead to the same pixel
    graph: sparse.csr_array

    def digest_parts(self) -> tuple[object, ...]:
        """Return what its digest is of."""
        graph = self.graph.indptr, self.graph.indices, self.graph.data
        return self.rows, self.columns, self.depth, self.weight, *graph

    def ends(self) -> Int64Array:
        """Return pixels with one neighbour, or the only pixel."""
        degree = np.diff(self.graph.indptr)
        return np.flatnonzero(degree <= 1)

    def paths_from(self, root: int) -> tuple[Float64Array, Int64Array]:
        """Return length (px) and predecessor (< 0: none) of the shortest path from a pixel to each."""
        length, predecessor = dijkstra(self.graph, indices=np.array([root]), return_predecessors=True)
        return np.asarray(length[0]), np.asarray(predecessor[0], dtype=np.int64)


def skeletons(painted: npt.NDArray[np.bool_]) -> tuple[Skeleton, ...]:
    """Thin painted pixels to one skeleton per 8-connected region, in reading order of their first pixels."""
    return sort_skeletons(
        thin_region(region, np.ones(region.mask.shape), painted.shape)
        for region in find_regions(painted.astype(np.uint8))
    )


def sort_skeletons(found: Iterable[Skeleton]) -> tuple[Skeleton, ...]:
    """Return skeletons in reading order of their first pixels."""
    return tuple(sorted(found, key=lambda each: (int(each.rows[0]), int(each.columns[0]))))


def thin_region(region: Region, weight: Float64Array, size: tuple[int, ...]) -> Skeleton:
    """Thin one 8-connected region; `weight` is in its bounding box, `size` the whole image's."""
    thin, (_, rows, columns, mask) = _thinned(region.mask), region
    at_row, at_column = np.nonzero(thin)
    return Skeleton(
        rows=at_row + int(rows.start),
        columns=at_column + int(columns.start),
        depth=border_distance(mask, rows, columns, size, whole=0.5 * min(size))[at_row, at_column],
        weight=weight[at_row, at_column].astype(np.float64),
        graph=_graph(thin, at_row, at_column),
    )


def _thinned(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Thin to lines; at least the first pixel stays (thinning can remove a 2x2 dab entirely)."""
    thin = np.asarray(skeletonize(np.pad(mask, 1)))[1:-1, 1:-1].astype(np.bool_)
    if not thin.any():
        thin.flat[int(np.argmax(mask))] = True
    return thin


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


EDGE_GAP = 2.5  # px between a river's painted end and the sketch's edge that is unintended
_OUTWARD = ((0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0))  # east, north: normals of the edges
_LEAST_EXIT = 0.2  # cosine between a river's heading and the edge's normal


@dataclass(frozen=True, eq=False)
class Reach:
    """Path of skeleton pixels from a source or mouth to its confluence."""

    pixels: Int64Array  # (n,) indices into the skeleton, upstream first; the last is on the parent, if any
    parent: int  # index of the reach that it joins; -1 for a main stem


def split_into_reaches(skeleton: Skeleton, root: int) -> tuple[Reach, ...]:
    """Split a connected skeleton into reaches that lead to the mouth `root`; parents first, never empty.

    The longest, weighted, is the main stem; each further one is the longest remaining. A branch shorter than
    the river's width at its joint is a spur of the skeleton, not a river. Loops are cut where both paths to
    the root are equally long, and so become two arms.
    """
    length, predecessor = skeleton.paths_from(root)
    weighted = length
    if (skeleton.weight != skeleton.weight[0]).any():
        weighted = weighted_lengths(length, predecessor, skeleton.weight)
    return split_paths(length, predecessor, weighted, 2.0 * skeleton.depth + 2.0)


def split_paths(
    length: Float64Array, predecessor: Int64Array, weighted: Float64Array, spur: Float64Array
) -> tuple[Reach, ...]:
    """Split a tree of paths to mouths into reaches, the longest by `weighted` first; parents first.

    A reach that is shorter than `spur` at its joint is left out. All arrays are by pixel.
    """
    has_successor = np.zeros(len(length), dtype=np.bool_)
    has_successor[predecessor[predecessor >= 0]] = True
    leaves = np.flatnonzero(~has_successor)
    owner = np.full(len(length), -1, dtype=np.int64)
    reaches: list[Reach] = []
    for leaf in leaves[np.lexsort((leaves, -weighted[leaves]))]:
        path = _path_to_root(int(leaf), predecessor, owner)
        joint = path[-1]
        parent = int(owner[joint])
        if parent >= 0 and length[leaf] - length[joint] < spur[joint]:
            continue
        owner[path if parent < 0 else path[:-1]] = len(reaches)
        reaches.append(Reach(np.asarray(path, dtype=np.int64), parent))
    return tuple(reaches)


@dataclass(frozen=True, eq=False)
class RiverEnd:
    """Potential source or mouth of a network."""

    pixel: int  # index into the skeleton
    lead: Int64Array  # (n,) pixels of the reach that leads there; the last one is `pixel`
    length: float  # px of the longest path from there


def longest_path(skeleton: Skeleton) -> Int64Array:
    """Return the pixels of the longest path through a skeleton, or nearly so if it has loops."""
    ends = skeleton.ends()
    length, _ = skeleton.paths_from(int(ends[0]) if len(ends) else 0)
    return split_into_reaches(skeleton, int(np.argmax(length)))[0].pixels


def river_ends(skeleton: Skeleton) -> tuple[RiverEnd, ...]:
    """Return potential sources and mouths of a network: ends without spurs; every pixel of a pure loop."""
    ends = skeleton.ends()
    if len(ends) == 0:
        return tuple(RiverEnd(pixel, np.array([pixel]), 0.0) for pixel in range(len(skeleton.rows)))
    length, _ = skeleton.paths_from(int(ends[0]))
    root = int(np.argmax(length))
    length, _ = skeleton.paths_from(root)
    reaches = split_into_reaches(skeleton, root)
    starts = [
        RiverEnd(int(each.pixels[0]), each.pixels[::-1], float(length[each.pixels[0]])) for each in reaches
    ]
    return (RiverEnd(root, reaches[0].pixels, starts[0].length), *starts)


def exit_normal(skeleton: Skeleton, pixels: Int64Array, size: tuple[int, int]) -> tuple[float, float] | None:
    """Return the unit vector (east, north) out of the sketch where a path leaves it; None if it does not.

    The last pixel of `pixels` is the end in question; it must be near the edge of the image (`size`) and not
    run along it.
    """
    end = int(pixels[-1])
    row, column = float(skeleton.rows[end]) + 0.5, float(skeleton.columns[end]) + 0.5
    back = int(pixels[max(len(pixels) - 1 - max(6, round(2.0 * skeleton.depth[end])), 0)])
    east, north = column - 0.5 - skeleton.columns[back], skeleton.rows[back] + 0.5 - row
    gaps = size[0] - row, size[1] - column, row, column
    return edge_normal(gaps, east, north, float(skeleton.depth[end]) + EDGE_GAP)


def edge_normal(
    gaps: tuple[float, float, float, float], east: float, north: float, limit: float
) -> tuple[float, float] | None:
    """Return the normal of the edge that a heading (east, north) leaves through; None if it does not.

    `gaps` are the distances to the south, east, north and west edge, `limit` the greatest that counts.
    """
    run = max(float(np.hypot(east, north)), 1e-9)
    towards = [
        ((normal[0] * east + normal[1] * north) / run, normal)
        for gap, normal in zip(gaps, _OUTWARD, strict=True)
        if gap <= limit
    ]
    steepest = max(towards, default=(0.0, None), key=lambda each: each[0])
    return steepest[1] if steepest[0] > _LEAST_EXIT else None


def weighted_lengths(length: Float64Array, predecessor: Int64Array, weight: Float64Array) -> Float64Array:
    """Return the weighted length of the path from each node of a graph to a mouth."""
    total = np.zeros(len(length))
    for node in np.argsort(length, kind="stable"):
        if (towards := predecessor[node]) >= 0:
            total[node] = total[towards] + weight[node] * (length[node] - length[towards])
    return total


def _path_to_root(leaf: int, predecessor: Int64Array, owner: Int64Array) -> list[int]:
    """Return pixels from a leaf to the root, or to the first pixel that belongs to a reach."""
    path = [leaf]
    while owner[path[-1]] < 0 and predecessor[path[-1]] >= 0:
        path.append(int(predecessor[path[-1]]))
    return path


_AHEAD = 0.8  # least cosine between an end's heading and the direction of the stem
_LEAD = 8  # px of a reach that define the heading of its end
_MIDDLE = 4.0  # px that both rivers must extend beyond the length of a spur


def close_gaps(
    painted: npt.NDArray[np.uint8],
    rivers: Sequence[tuple[Skeleton, Sequence[RiverEnd]]],
    gap: float,
) -> npt.NDArray[np.uint8] | None:
    """Paint one-pixel lines over small gaps between river ends and the middle of another river; None if none.

    Only ends are joined, and only rivers that are not connected yet: so none joins both ways, and parallel
    rivers stay apart. `rivers` are the networks without dabs; `gap` is the largest unintended gap between
    strokes (px).
    """
    labelled, count = ndimage.label(painted > 0, structure=np.ones((3, 3)))
    regions = np.asarray(labelled, dtype=np.int64)
    of = {int(regions[skeleton.rows[0], skeleton.columns[0]]): (skeleton, ends) for skeleton, ends in rivers}
    component = np.arange(count + 1)
    closed = None
    for region, (skeleton, ends) in of.items():
        for end in ends:
            at = np.array([skeleton.rows[end.pixel], skeleton.columns[end.pixel]], dtype=np.int64)
            found = _ahead(
                regions, region, at, _heading(skeleton, end), float(skeleton.depth[end.pixel]) + gap + 1.0
            )
            if found is None:
                continue
            other = int(regions[tuple(found)])
            if other not in of or component[other] == component[region]:
                continue
            if not _in_the_middle(*of[other], found, end.length):
                continue
            component[component == component[other]] = component[region]
            closed = painted.copy() if closed is None else closed
            steps = int(np.abs(found - at).max())
            line = np.rint(np.linspace(at, found, steps + 1)).astype(np.int64)
            line = line[painted[line[:, 0], line[:, 1]] == 0]
            closed[line[:, 0], line[:, 1]] = painted[tuple(at)]
    return closed


def _heading(skeleton: Skeleton, end: RiverEnd) -> Float64Array | None:
    """Return the direction (rows, columns) of an end, a unit vector; None if it is too short."""
    back = end.lead[-min(max(_LEAD, int(2.0 * skeleton.depth[end.pixel])), len(end.lead))]
    run = np.array(
        [skeleton.rows[end.pixel] - skeleton.rows[back], skeleton.columns[end.pixel] - skeleton.columns[back]]
    )
    length = float(np.hypot(*run))
    return run / length if length >= 2.0 else None


def _ahead(
    regions: Int64Array, own: int, at: Int64Array, heading: Float64Array | None, distance: float
) -> Int64Array | None:
    """Return the nearest pixel of another region ahead, if any."""
    if heading is None:
        return None
    low = np.maximum(at - int(distance) - 1, 0)
    window = regions[low[0] : at[0] + int(distance) + 2, low[1] : at[1] + int(distance) + 2]
    there = np.argwhere((window > 0) & (window != own)) + low
    away = np.hypot(*(there - at).T)
    candidate = (away <= distance) & ((there - at) @ heading >= _AHEAD * away)
    if not candidate.any():
        return None
    return np.asarray(there[candidate][int(np.argmin(away[candidate]))])


def _in_the_middle(skeleton: Skeleton, ends: Sequence[RiverEnd], at: Int64Array, length: float) -> bool:
    """Return whether both the river at a place and what joins it there are longer than a spur."""
    away = np.hypot(skeleton.rows - at[0], skeleton.columns - at[1])
    least = 2.0 * float(skeleton.depth[int(np.argmin(away))]) + 2.0 + _MIDDLE
    return length >= least and min(float(away[end.pixel]) for end in ends) >= least
