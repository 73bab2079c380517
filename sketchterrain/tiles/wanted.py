"""The tree that a view wants, balanced so that tiles that touch differ by one level at most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.tiles.codes import (
    children_of,
    code_of,
    contains,
    neighbours_of,
    parent_of,
    place_of,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.tiles.codes import Boxes, Codes
    from sketchterrain.tiles.metrics import Metric
    from sketchterrain.tiles.pool import TilePool
    from sketchterrain.tiles.view import View

    Floats = npt.NDArray[np.float64]
    Slots = npt.NDArray[np.int64]

__all__ = ["ROOT_LEVEL", "Selection", "Wanted"]

ROOT_LEVEL: Final = -6
"""Roots are 64 extents wide: wider than any draw distance."""
ROOTS_AROUND: Final = 2
"""Roots come in this many of their widths before they are needed; so no neighbour is split when one does."""

_ASIDE: Final = 0.25
"""What an error counts for out of the picture: turning round shows something at once."""
_MARGIN: Final = 0.15
"""Out of the picture begins so far beyond its edges, in distances."""
_STEEP: Final = 1.5
"""Excess from which on a tile's neighbours are split too. Along a coarser one its
children show the parent's surface, which would be seen to be too coarse there."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """What a view wants.

    Attributes
    ----------
    splits : sorted codes
        Tiles whose children are wanted.
    missing : codes
        Tiles that are not held and whose parents are: most visible first.
    urgency : (missing,) float64
        Excess of what each of them is to replace; infinite for roots.
    """

    splits: Codes
    missing: Codes
    urgency: Floats


@dataclass(frozen=True)
class Selection:
    """How tiles are chosen: pure functions of a view and of what is held.

    Attributes
    ----------
    extent : float
        Width of a tile of level 0, m.
    quads : int
        Along a tile's side.
    metric : Metric
        Which tiles are too coarse.
    finest : int
        Level at which splitting ends.
    """

    extent: float
    quads: int
    metric: Metric
    finest: int

    def roots(self, view: View) -> Codes:
        """Return the codes of the coarsest tiles about the eye."""
        col, row = (int(np.floor(place / (self.extent * 2.0**-ROOT_LEVEL))) for place in view.eye[:2])
        around = np.arange(-ROOTS_AROUND, ROOTS_AROUND + 1)
        east, north = np.meshgrid(col + around, row + around)
        return np.sort(code_of(ROOT_LEVEL, east.ravel(), north.ravel()))

    def excess(self, view: View, codes: Codes, pool: TilePool) -> Floats:
        """Return how much too coarse tiles are, 0 for those that are not held; shape (n,)."""
        slots = pool.find(codes)
        held = slots >= 0
        result = np.zeros(len(codes))
        if held.any():
            known, slots = codes[held], slots[held]
            boxes = pool.boxes(known, slots, self.extent)
            cells = (boxes.high[:, 0] - boxes.low[:, 0]) / self.quads
            excess = self.metric.excess(view, boxes, pool.error[slots], cells)
            distance = _apart(view, boxes)
            excess = np.where(view.sees(boxes, margin=_MARGIN * distance), excess, _ASIDE * excess)
            result[held] = np.where(distance <= view.draw_distance, excess, 0.0)
        return result

    def wanted(self, view: View, pool: TilePool) -> Wanted:
        """Return the tree that a view wants, as far as what is held says."""
        roots = self.roots(view)
        own = self._descend(view, pool, roots)
        splits, urgency = self._balanced(own, roots)
        children = children_of(splits).ravel()
        needed, urgent = np.concatenate([roots, children]), np.repeat(urgency, 4)
        urgent = np.concatenate([np.full(len(roots), np.inf), urgent])
        ready = np.concatenate([np.ones(len(roots), np.bool_), np.repeat(pool.find(splits) >= 0, 4)])
        lacking = np.flatnonzero(ready & (pool.find(needed) < 0))
        order = lacking[np.lexsort((needed[lacking], -urgent[lacking]))]
        return Wanted(splits, needed[order], urgent[order])

    def reachable(self, view: View, splits: Codes, pool: TilePool) -> Codes:
        """Return those splits that can be shown with what is held, in balance; sorted."""
        roots = self.roots(view)
        ready = splits[(pool.find(children_of(splits)) >= 0).all(axis=1) & (pool.find(splits) >= 0)]
        level = place_of(ready)[0]
        shown = roots[:0]
        for at in range(ROOT_LEVEL, self.finest):
            here = ready[level == at]
            if at > ROOT_LEVEL:
                around = neighbours_of(here)
                beside = ~_within(roots, around) | contains(shown, parent_of(around))
                here = here[contains(shown, parent_of(here)) & beside.all(axis=1)]
            shown = np.sort(np.concatenate([shown, here]))
        return shown

    def _descend(self, view: View, pool: TilePool, roots: Codes) -> dict[int, tuple[Codes, Floats]]:
        """Return the tiles of each level that are too coarse themselves, and by how much."""
        found = {}
        nodes = roots
        for level in range(ROOT_LEVEL, self.finest):
            excess = self.excess(view, nodes, pool)
            coarse = excess > 1
            found[level] = nodes[coarse], excess[coarse]
            nodes = children_of(nodes[coarse]).ravel()
        return found

    def _balanced(self, own: dict[int, tuple[Codes, Floats]], roots: Codes) -> tuple[Codes, Floats]:
        """Return all tiles to be split so that no two that touch differ by more than a level; sorted."""
        parts = []
        forced, urgency = roots[:0], np.zeros(0)
        for level in range(self.finest - 1, ROOT_LEVEL - 1, -1):
            codes, excess = own[level]
            steep = excess > _STEEP
            beside, beside_excess = _around(codes[steep], excess[steep], roots)
            codes, excess = _merged(
                np.concatenate([codes, forced, beside]), np.concatenate([excess, urgency, beside_excess])
            )
            parts.append((codes, excess))
            if level > ROOT_LEVEL:
                beside, beside_excess = _around(codes, excess, roots)
                forced, urgency = _merged(
                    parent_of(np.concatenate([codes, beside])), np.concatenate([excess, beside_excess])
                )
        splits = np.concatenate([codes for codes, _ in parts[::-1]])
        return splits, np.concatenate([excess for _, excess in parts[::-1]])


def _around(codes: Codes, excess: Floats, roots: Codes) -> tuple[Codes, Floats]:
    """Return the neighbours of tiles that lie within the roots, with the tiles' excess."""
    around = neighbours_of(codes).ravel()
    inside = _within(roots, around)
    return around[inside], np.repeat(excess, 8)[inside]


def _within(roots: Codes, codes: Codes) -> npt.NDArray[np.bool_]:
    """Tell which tiles lie in one of the roots, which fill a square."""
    level, col, row = place_of(codes)
    _, root_col, root_row = place_of(roots[[0, -1]])
    up = level - ROOT_LEVEL
    col, row = col >> up, row >> up
    return np.asarray(
        (col >= root_col[0]) & (col <= root_col[1]) & (row >= root_row[0]) & (row <= root_row[1])
    )


def _merged(codes: Codes, excess: Floats) -> tuple[Codes, Floats]:
    """Return each tile once, with its greatest excess; sorted."""
    each, at = np.unique(codes, return_inverse=True)
    most = np.zeros(len(each))
    np.maximum.at(most, at, excess)
    return each, most


def _apart(view: View, boxes: Boxes) -> Floats:
    """Return the horizontal distance from the eye to boxes (m)."""
    eye = np.asarray(view.eye[:2])
    apart = np.maximum(np.maximum(boxes.low[:, :2] - eye, eye - boxes.high[:, :2]), 0.0)
    return np.asarray(np.linalg.norm(apart, axis=1))
