"""The reference of all blue noise: darts thrown one after another until none fits any more, in float64.

A dart lands anywhere with the same chance and stays if no earlier one is nearer than 1 (random sequential
addition). Most late darts would land where they can't stay; so they are thrown only at squares that no single
disc covers, which changes nothing in the order of those that stay: each still lands anywhere in the free
ground with the same chance. The squares are cut in four again and again until none is left (after Ebeida et
al. 2012, "A simple algorithm for maximal Poisson-disk sampling in high dimensions").
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    Points = npt.NDArray[np.float64]

_FINEST = 1e-7  # of the distance: free ground that is narrower is as good as none


def throw_darts(side: float, *, seed: int) -> Points:
    """Throw darts at a square whose opposite edges are one, until no other fits."""
    rng = np.random.default_rng(seed)
    count = int(np.ceil(side * np.sqrt(2.0)))
    squares = np.stack(np.divmod(np.arange(count * count), count), axis=-1).astype(np.int64)
    width = side / count
    points = np.empty((0, 2))
    while len(squares) and width > _FINEST:
        darts = (squares[rng.integers(len(squares), size=len(squares))] + rng.random(squares.shape)) * width
        points = np.concatenate([points, _staying(darts, points, side)])
        squares = (2 * squares[:, None] + ((0, 0), (0, 1), (1, 0), (1, 1))).reshape(-1, 2)
        width /= 2
        middle = np.asarray((squares + 0.5) * width, np.float64)
        covered = 1.0 - width / np.sqrt(2.0)
        # A square whose middle is nearer to a point than this lies within its disc.
        squares = squares[~_near(middle, points, side, covered)]
    return points


def _staying(darts: Points, points: Points, side: float) -> Points:
    """Return the darts that stay, thrown in this order after the points."""
    darts = darts[~_near(darts, points, side, 1.0)] % side
    stays = np.ones(len(darts), np.bool_)
    pairs = cKDTree(darts, boxsize=np.full(2, side)).query_pairs(1.0, output_type="ndarray")
    for first, second in pairs[np.argsort(pairs[:, 0], kind="stable")].tolist():
        if stays[first]:
            stays[second] = False
    return darts[stays]


def _near(places: Points, points: Points, side: float, distance: float) -> npt.NDArray[np.bool_]:
    """Return which places are nearer than a distance to a point."""
    if not len(points) or distance <= 0.0:
        return np.zeros(len(places), np.bool_)
    found, _ = cKDTree(points, boxsize=np.full(2, side)).query(places % side, distance_upper_bound=distance)
    return np.asarray(np.isfinite(found))
