"""Places all over the world, strewn by hashed cells: which of them an eye needs, and in which detail.

A cell's places follow from the cell alone, in an order of which every beginning is spread evenly (Roberts
2018). So an eye that moves finds each place where it was, and farther cells take a shorter beginning. Where a
place lies and what stands there is found out on the GPU: kernels/render/scatter.glsl.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.camera import Camera


BAND: Final = 0.3
"""Over this share of the number of places shown at a distance the last ones come up; as in scatter.glsl."""
STEEPEST: Final = 1.5
"""Rise over run of the ground between an eye and what stands near it."""
HIGHEST: Final = 1.0
"""m that what stands in a cell is high."""
BEST_REACH: Final = 110.0
"""m, of the grass at the best quality; all other distances go with it."""
SEED: Final = np.dtype([("corner", "<f4", 2), ("seed", "<u4"), ("rank", "<u4")])
"""A place: its cell's corner from the eye (m), its cell's hash, and its place in the cell's order."""


@dataclass(frozen=True)
class Strewing:
    """How densely something is strewn.

    Attributes
    ----------
    salt : int
        Sets its places apart from those of other things.
    density : float
        Places a m², near the eye.
    full : float
        m from the eye up to which all places are taken; beyond, as many as the distance's inverse asks for.
    reach : float
        m from the eye at which the last are gone.
    cell : float
        m, side of a cell.
    details : tuple of float
        m from the eye at which each coarser mesh takes over, nearest first.
    """

    salt: int
    density: float
    full: float
    reach: float
    cell: float
    details: tuple[float, ...]

    @property
    def room(self) -> int:
        """Places a cell has at most."""
        return max(round(self.density * self.cell**2), 1)

    def as_far(self, grass: float, *, share: float) -> Strewing:
        """Return a share of it, scaled to where grass reaches so far (m) instead of `BEST_REACH`."""
        scale = grass / BEST_REACH
        return replace(
            self,
            density=self.density * share,
            reach=self.reach * scale,
            details=tuple(scale * each for each in self.details),
        )


class Places(NamedTuple):
    """Places of some cells, by the detail in which they are drawn.

    Attributes
    ----------
    rows : (n,) of SEED
        Nearest cells first.
    counts : (details,) int64
        How many of them belong to each detail, in this order.
    """

    rows: npt.NDArray[np.void]
    counts: npt.NDArray[np.int64]


def hashed(x: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """Scramble 32 bits (Wellons' lowbias32); the same in kernels/render/scatter.glsl."""
    h = np.asarray(x, dtype=np.uint32)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B), (16, 1)):
        h = (h ^ (h >> np.uint32(shift))) * np.uint32(factor)
    return np.asarray(h, dtype=np.uint32)


def cells_within(eye: Sequence[float], reach: float, cell: float) -> npt.NDArray[np.int64]:
    """Return (n, 2) columns and rows of the cells that lie within a distance (m) of an eye, nearest first."""
    low, high = (np.floor((np.asarray(eye[:2]) + side * reach) / cell) for side in (-1.0, 1.0))
    cols, rows = np.meshgrid(*(np.arange(low[k], high[k] + 1) for k in range(2)))
    cells = np.stack([cols.ravel(), rows.ravel()], axis=1).astype(np.int64)
    away = away_from(eye, cells, cell)
    order = np.argsort(away, kind="stable")
    return cells[order[away[order] < reach]]


def away_from(eye: Sequence[float], cells: npt.NDArray[np.int64], cell: float) -> Float64Array:
    """Return the horizontal distance (m) of cells' nearest points from an eye."""
    beside = np.maximum(np.abs(cell * (cells + 0.5) - np.asarray(eye[:2])) - 0.5 * cell, 0.0)
    return np.asarray(np.hypot(beside[:, 0], beside[:, 1]))


def in_sight(
    planes: Float64Array, cells: npt.NDArray[np.int64], cell: float, eye: Sequence[float], above: float
) -> npt.NDArray[np.bool_]:
    """Tell which cells a view may show, where the ground is no steeper than `STEEPEST` on the way there.

    Parameters
    ----------
    planes
        (k, 4) of the view, see `Camera.frustum`.
    cells
        (n, 2) columns and rows.
    cell
        m, their side.
    eye
        m.
    above
        m of the eye over the ground.
    """
    off = STEEPEST * (away_from(eye, cells, cell) + 1.5 * cell)
    foot = eye[2] - above
    low = np.column_stack([cells * cell, foot - off])
    high = np.column_stack([(cells + 1) * cell, foot + off + HIGHEST])
    seen = np.ones(len(cells), np.bool_)
    for plane in planes:
        seen &= np.where(plane[:3] >= 0.0, high, low) @ plane[:3] + plane[3] >= 0.0
    return seen


def places_of(strewing: Strewing, cells: npt.NDArray[np.int64], eye: Sequence[float], above: float) -> Places:
    """Return the places of some cells that an eye may need.

    Parameters
    ----------
    strewing
        What is strewn.
    cells
        (n, 2) columns and rows, nearest first.
    eye
        m.
    above
        m of the eye over the ground: nothing is nearer than that.
    """
    away = np.hypot(away_from(eye, cells, strewing.cell), above)
    shown = strewing.room * np.minimum((1.0 + BAND) * strewing.full / np.maximum(away, strewing.full), 1.0)
    many = np.where(away < strewing.reach, np.ceil(shown), 0.0).astype(np.int64)
    detail = np.searchsorted(strewing.details, away, side="right")
    counts = np.bincount(detail, many, minlength=len(strewing.details) + 1).astype(np.int64)
    ends = np.cumsum(many)
    rows = np.empty(int(ends[-1]) if len(ends) else 0, SEED)
    corner = strewing.cell * cells - np.asarray(eye[:2])
    salted = hashed(cells[:, 1].astype(np.uint32) ^ np.uint32(strewing.salt))
    seeds = hashed(cells[:, 0].astype(np.uint32) ^ salted)
    rows["corner"] = np.repeat(corner, many, axis=0)
    rows["seed"] = np.repeat(seeds, many)
    rows["rank"] = np.arange(len(rows)) - np.repeat(ends - many, many)
    return Places(rows, counts)


class Nearby:
    """The places of a strewing that a view needs: found anew only where it is not the view before.

    Parameters
    ----------
    strewing
        What is strewn.
    sort
        Puts its places into the order in which they are drawn.
    """

    def __init__(self, strewing: Strewing, *, sort: Callable[[Places], Places] | None = None) -> None:
        self._strewing, self._sort = strewing, sort
        self._view: tuple[Camera, float, float] | None = None
        self._places = Places(np.zeros(0, SEED), np.zeros(len(strewing.details) + 1, np.int64))

    def seen(self, camera: Camera, aspect: float, above: float) -> Places:
        """Return the places in a picture of this width over height, by an eye so high (m) over the ground."""
        if self._view != (camera, aspect, above):
            self._view = (camera, aspect, above)
            strewing, eye = self._strewing, camera.eye
            cells = cells_within(eye, strewing.reach, strewing.cell)
            cells = cells[in_sight(camera.frustum(aspect), cells, strewing.cell, eye, above)]
            places = places_of(strewing, cells, eye, above)
            self._places = self._sort(places) if self._sort else places
        return self._places
