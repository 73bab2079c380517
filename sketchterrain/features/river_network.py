"""A skeleton as a river network: reaches that join on their way to a mouth, spurs left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array

if TYPE_CHECKING:
    from sketchterrain.features.skeleton import Skeleton


_EDGE_GAP = 2.5  # px between a river's painted end and the sketch's edge that a person does not mean


@dataclass(frozen=True, eq=False)
class Reach:
    """A run of skeleton pixels without a junction of its own making.

    Attributes
    ----------
    pixels : (n,) int64
        Indices into the skeleton, upstream first. The last one lies on the parent, if there is one.
    parent : int
        Index of the reach that it joins; -1 for a main stem.
    """

    pixels: Int64Array
    parent: int


def split_into_reaches(skeleton: Skeleton, root: int) -> tuple[Reach, ...]:
    """Break a skeleton into reaches that all lead to one pixel.

    The longest, weighted, is the main stem; each further one is the longest that is left. A branch
    shorter than the river is wide where it joins is a spur of the skeleton, not a river. Loops come apart
    where the two ways to the root are equally long, and so become two arms.

    Parameters
    ----------
    skeleton : Skeleton
        Connected.
    root : int
        The mouth.

    Returns
    -------
    tuple of Reach, parents before the reaches that join them; never empty.
    """
    length, before = skeleton.paths_from(root)
    leads_on = np.zeros(len(length), dtype=np.bool_)
    leads_on[before[before >= 0]] = True
    leaves = np.flatnonzero(~leads_on)
    owner = np.full(len(length), -1, dtype=np.int64)
    reaches: list[Reach] = []
    for leaf in leaves[np.lexsort((leaves, -_weighted(skeleton, length, before)[leaves]))]:
        path = _path_down(int(leaf), before, owner)
        joint = path[-1]
        parent = int(owner[joint])
        if parent >= 0 and length[leaf] - length[joint] < 2.0 * skeleton.depth[joint] + 2.0:
            continue
        owner[path if parent < 0 else path[:-1]] = len(reaches)
        reaches.append(Reach(np.asarray(path, dtype=np.int64), parent))
    return tuple(reaches)


@dataclass(frozen=True, eq=False)
class RiverEnd:
    """A place where a network may begin or end.

    Attributes
    ----------
    pixel : int
        Index into the skeleton.
    lead : (n,) int64
        Pixels of the reach that leads there; the last one is `pixel`.
    length : float
        Length (px) of the longest way from there.
    """

    pixel: int
    lead: Int64Array
    length: float


def longest_path(skeleton: Skeleton) -> Int64Array:
    """Pixels of the longest way through a skeleton, or nearly so (exactly, if it has no loops)."""
    ends = skeleton.ends()
    length, _ = skeleton.paths_from(int(ends[0]) if len(ends) else 0)
    return split_into_reaches(skeleton, int(np.argmax(length)))[0].pixels


def river_ends(skeleton: Skeleton) -> tuple[RiverEnd, ...]:
    """Find where a network may begin or end: its true ends, without spurs; every pixel of a pure loop."""
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
    """Find the sketch's edge that a path runs out over.

    Parameters
    ----------
    skeleton : Skeleton
        Where the path lies.
    pixels : (n,) int64
        The path; its last pixel is the end in question.
    size : (height, width)
        Of the image.

    Returns
    -------
    Unit vector (east, north) out of the sketch; None if the end stops short of the edge or runs along it.
    """
    end = int(pixels[-1])
    row, column = float(skeleton.rows[end]) + 0.5, float(skeleton.columns[end]) + 0.5
    back = int(pixels[max(len(pixels) - 1 - max(6, round(2.0 * skeleton.depth[end])), 0)])
    east, north = column - 0.5 - skeleton.columns[back], skeleton.rows[back] + 0.5 - row
    run = max(float(np.hypot(east, north)), 1e-9)
    limit = float(skeleton.depth[end]) + _EDGE_GAP
    edges = (
        (size[0] - row, (0.0, -1.0)),
        (size[1] - column, (1.0, 0.0)),
        (row, (0.0, 1.0)),
        (column, (-1.0, 0.0)),
    )
    towards = [
        ((normal[0] * east + normal[1] * north) / run, normal) for gap, normal in edges if gap <= limit
    ]
    steepest = max(towards, default=(0.0, None), key=lambda each: each[0])
    return steepest[1] if steepest[0] > 0.2 else None


def _weighted(skeleton: Skeleton, length: Float64Array, before: Int64Array) -> Float64Array:
    """Length of each pixel's way to the root with every step weighted."""
    if np.all(skeleton.weight == skeleton.weight[0]):
        return length
    total = np.zeros(len(length))
    for pixel in np.argsort(length, kind="stable")[1:]:
        step = length[pixel] - length[before[pixel]]
        total[pixel] = total[before[pixel]] + skeleton.weight[pixel] * step
    return total


def _path_down(leaf: int, before: Int64Array, owner: Int64Array) -> list[int]:
    """Pixels from a leaf to the root, or to the first pixel that is already some reach's."""
    path = [leaf]
    while owner[path[-1]] < 0 and before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return path
