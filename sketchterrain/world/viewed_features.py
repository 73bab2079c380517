"""What was placed, as a stored world shows it: moved to its corner, and cut off at its ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features.catalogue import FEATURE

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.look.waters import Features, Field, Pool, Reach

    Bounds = tuple[float, float, float, float]
    Floats = npt.NDArray[np.float64]

__all__ = ["NOTHING", "ViewedFeatures"]


@dataclass(frozen=True, eq=False)
class _River:
    centreline: Floats
    centreline_width: npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class _Shape:
    west: float
    south: float
    spacing: float
    inside: npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class _Lake:
    shape: _Shape
    level: float


@dataclass(frozen=True, eq=False)
class ViewedFeatures:
    """Points, rivers and lakes; see `~sketchterrain.look.waters.Features`.

    Attributes
    ----------
    points : structured ndarray
    rivers : tuple
    lakes : tuple
    """

    points: npt.NDArray[np.void]
    rivers: tuple[Reach, ...]
    lakes: tuple[Pool, ...]

    @classmethod
    def of(cls, features: Features, west: float, north: float, bounds: Bounds) -> ViewedFeatures:
        """Return features with a place of theirs (m) as the origin, those within bounds about that (m)."""
        points = features.points.copy()
        points["x"] -= west
        points["y"] -= north
        reach = points["radius"]
        there = (points["x"] + reach > bounds[0]) & (points["x"] - reach < bounds[2])
        there &= (points["y"] + reach > bounds[1]) & (points["y"] - reach < bounds[3])
        moved = np.array([west, north, 0.0])
        rivers = [
            part
            for river in features.rivers
            for part in _parts(np.asarray(river.centreline) - moved, river.centreline_width, bounds)
        ]
        lakes = [_lake(lake, west, north, bounds) for lake in features.lakes]
        return cls(points[there], tuple(rivers), tuple(lake for lake in lakes if lake is not None))


NOTHING = ViewedFeatures(np.zeros(0, FEATURE), (), ())


def _parts(line: Floats, width: npt.NDArray[np.float32], bounds: Bounds) -> Iterator[_River]:
    """Return the parts of a river that lie within bounds: from the first point within to the last one."""
    x, y = line[:, 0], line[:, 1]
    inside = (x >= bounds[0]) & (y >= bounds[1]) & (x <= bounds[2]) & (y <= bounds[3])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if last - first > 1:
            yield _River(np.ascontiguousarray(line[first:last]), np.ascontiguousarray(width[first:last]))


def _lake(lake: Pool, west: float, north: float, bounds: Bounds) -> _Lake | None:
    """Return the part of a lake within bounds: where one is deeper inside the shape than beyond a border."""
    field: Field = lake.shape
    rows, columns = field.inside.shape
    x = field.west - west + np.arange(columns) * field.spacing
    y = field.south - north + np.arange(rows) * field.spacing
    room = np.minimum(
        np.minimum(x - bounds[0], bounds[2] - x)[None, :], np.minimum(y - bounds[1], bounds[3] - y)[:, None]
    )
    inside = np.minimum(field.inside, room).astype(np.float32)
    if not (inside > 0).any():
        return None
    return _Lake(_Shape(float(x[0]), float(y[0]), field.spacing, inside), lake.level)
