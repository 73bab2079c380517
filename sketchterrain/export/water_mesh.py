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
        kept = triangles[shown & inside[triangles].all(axis=1)]
        if len(kept):
            used, index = np.unique(kept, return_inverse=True)
            yield Water(name, surface.place[used], index.reshape(-1, 3).astype(np.uint32))
