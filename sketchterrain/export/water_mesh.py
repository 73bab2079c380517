"""Rivers and lakes as triangles of their own, as they are drawn: they end inside their banks."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.export.grid import Grid
    from sketchterrain.terrain import TerrainFeatures

__all__ = ["Water", "waters"]

_SHOWN = 0.5  # of a river, less is the lake's or the wider river's that it runs into
_DIVE = 0.3  # m that it goes below them there: two surfaces in one plane flicker


class Water(NamedTuple):
    """One river or lake.

    Attributes
    ----------
    name : str
        "river 7": what it is, and its id.
    place : (n, 3) float64
        x east, y north, z up, m.
    triangles : (k, 3) uint32
        Counter-clockwise from above.
    """

    name: str
    place: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.uint32]


def waters(features: TerrainFeatures, grid: Grid) -> Iterator[Water]:
    """Return each water as far as it lies in a grid's rectangle, lakes first."""
    from sketchterrain.look.water_surfaces import surfaces  # SciPy: not for a list of targets

    rivers = [river for river in features.rivers if len(river.centreline) > 1]
    names = [f"lake {lake.id}" for lake in features.lakes] + [f"river {river.id}" for river in rivers]
    for name, surface in zip(names, surfaces(features), strict=True):
        triangles = surface.triangles.reshape(-1, 3)
        x, y = surface.place[:, 0], surface.place[:, 1]
        inside = (x >= grid.west) & (x <= grid.east) & (y >= grid.south) & (y <= grid.north)
        shown = surface.nature[triangles, 2].mean(axis=1) >= _SHOWN
        place = surface.place.copy()
        # What reaches over the edge ends there.
        np.clip(place[:, :2], (grid.west, grid.south), (grid.east, grid.north), out=place[:, :2])
        place[:, 2] -= _DIVE * (1.0 - surface.nature[:, 2])
        kept = triangles[shown & inside[triangles].any(axis=1) & _has_area(place, triangles)]
        if len(kept):
            used, index = np.unique(kept, return_inverse=True)
            yield Water(name, place[used], index.reshape(-1, 3).astype(np.uint32))


def _has_area(place: npt.NDArray[np.float64], triangles: npt.NDArray[np.uint32]) -> npt.NDArray[np.bool_]:
    (ax, ay), (bx, by), (cx, cy) = (place[triangles[:, k], :2].T for k in range(3))
    return np.asarray((bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0.0)
