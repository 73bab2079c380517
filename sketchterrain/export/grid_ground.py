"""The ground as a program has it that knows a grid's vertices alone: what stands there must not float."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.sampled import Sampled

    Reals = npt.NDArray[np.float64]

__all__ = ["ground_at"]


def ground_at(sampled: Sampled, east: Reals, north: Reals) -> Reals:
    """Return the ground between the vertices of a grid, by bilinear interpolation.

    A program's two triangles in a quad differ from that by a quarter of the quad's twist
    |h00 + h11 − h01 − h10| at most.

    Parameters
    ----------
    sampled
    east, north
        m of the world, (n,) each; outside the grid the nearest place on its edge counts.

    Returns
    -------
    (n,) float64
        m.
    """
    grid = sampled.grid
    dx, dy = grid.spacing
    left, across = _quad((east - grid.west) / dx, grid.columns)
    top, down = _quad((grid.north - north) / dy, grid.rows)
    height = sampled.height
    upper = _between(height[top, left], height[top, left + 1], across)
    lower = _between(height[top + 1, left], height[top + 1, left + 1], across)
    return _between(upper, lower, down)


def _quad(place: Reals, vertices: int) -> tuple[npt.NDArray[np.intp], Reals]:
    """Return the quad along one axis in which places lie, and how far in it, 0 … 1."""
    inside = np.clip(place, 0.0, vertices - 1.0)
    first = np.minimum(inside.astype(np.intp), vertices - 2)
    return first, inside - first


def _between(
    a: npt.NDArray[np.floating], b: npt.NDArray[np.floating], share: Reals
) -> npt.NDArray[np.float64]:
    return np.asarray(a * (1.0 - share) + b * share, np.float64)
