"""Displayed tiles: transitions without popping, and replacement of stale tiles.

A tile splits only while it shows nothing of its parent, and its children start out showing only the parent:
the image does not change. Four siblings that show only their parent merge into it. In between, morph weights
change at a limited rate. A control that touches a coarser tile is held at 1 and one that touches a finer tile
at 0, so that both sides of a border agree; the tree is balanced over borders and corners, so no control
touches both.

A tile stores its own vertices and its parent's at the same positions. So a rewritten tile is valid if its
parent's own vertices are: those of a parent that is not stale, or that is written by the same batch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, Int64Array
from sketchterrain.tiles.quadtree import (
    EAST,
    NORTH,
    PARENT,
    SOUTH,
    WEST,
    children_of,
    code_of,
    contains,
    control_codes,
    decode,
    index_in,
    keys_of,
    neighbours_of,
    parent_of,
    touches_areas,
)
from sketchterrain.tiles.refinement import ROOT_LEVEL
from sketchterrain.tiles.tile_pool import Batch, TilePool

_MARGIN: Final = 2
"""Quads beyond a tile's border that its parent's normals read."""


def mark_stale(
    pool: TilePool, areas: Sequence[Bounds], *, extent: float, quads: int, protected: Int64Array
) -> int:
    """Mark tiles stale in `areas` (west, south, east, north, m); return the number removed.

    Tiles in `protected` (sorted) stay in the pool, stale until they are rewritten; other affected tiles are
    removed.
    """
    codes, slots = pool.tiles()
    touched = touches_areas(codes, extent, areas, _MARGIN / quads)
    stays = touched & contains(protected, codes)
    pool.stale[slots[stays]] = True
    removed = codes[touched & ~stays]
    pool.remove(removed)
    return len(removed)


def with_stale_parents(pool: TilePool, codes: Int64Array) -> Int64Array:
    """Return tiles, each with its parent before it if that is stale."""
    above = parent_of(codes)
    is_first = np.zeros(len(codes), np.bool_)
    is_first[np.unique(above, return_index=True)[1]] = True
    held = is_first & contains(_stale(pool, np.unique(above[decode(codes)[0] > ROOT_LEVEL])), above)
    return np.stack([above, codes], axis=1)[np.stack([held, np.ones_like(held)], axis=1)]


def rewrite_batch(pool: TilePool, codes: Int64Array) -> Batch:
    """Return the batch that rewrites cached tiles, with the stale parents that they read."""
    above = codes[decode(codes)[0] > ROOT_LEVEL]
    codes = np.union1d(codes, _stale(pool, np.unique(parent_of(above))))
    codes = codes[np.argsort(decode(codes)[0], kind="stable")]
    return create_batch(pool, codes, pool.find(codes))


def create_batch(pool: TilePool, codes: Int64Array, slots: Int64Array) -> Batch:
    """Return the batch that writes tiles into slots; their parents are in the pool."""
    parents = np.where(decode(codes)[0] > ROOT_LEVEL, pool.find(parent_of(codes)), -1)
    return Batch(tuple(keys_of(codes)), slots, parents)


def mark_written(pool: TilePool, batch: Batch) -> None:
    """Clear the stale flag of a batch's tiles, except those that read a stale parent."""
    parents = batch.parents
    wrong = (parents >= 0) & pool.stale[parents] & ~np.isin(parents, batch.slots)
    pool.stale[batch.slots] &= wrong


def _stale(pool: TilePool, codes: Int64Array) -> Int64Array:
    slots = pool.find(codes)
    held = slots >= 0
    return codes[held][pool.stale[slots[held]]]


# Neighbours (quadtree.AROUND) that a control touches, row 0 north, column 0 west.
_TOUCHED: Final = (((0, 1, 3), (1,), (1, 2, 4)), ((3,), (), (4,)), ((3, 5, 6), (6,), (4, 6, 7)))
_BORDERS: Final = ((1, NORTH), (6, SOUTH), (3, WEST), (4, EAST))
# Of each neighbour, the children (quadtree.children_of) that touch the tile; at a corner one, twice.
_NEAR_CHILDREN: Final = np.array([(1, 1), (0, 1), (0, 0), (1, 3), (0, 2), (3, 3), (2, 3), (2, 2)])


@dataclass(frozen=True, eq=False)
class MorphTargets:
    """Targets of the morph weights of displayed tiles."""

    splits: Int64Array  # sorted; tiles that the target tree splits
    weights: Float64Array  # (n,) share of the parent at each tile's middle, 0 … 1
    rates: Float64Array  # (n,) greatest rate of change, 1/s


class DisplayedTree:
    """Leaves that cover the roots, and the morph weights of their controls.

    `exists` returns which tiles have terrain: others are not drawn, no border is fitted to them. None: all.
    `codes` are the sorted leaves, `controls` (n, 3, 3) their parents' shares (row 0 north, column 0 west),
    `cases` (n,) their border cases; `moving` is true until all weights reach their targets and no step is
    left.
    """

    def __init__(self, exists: Callable[[Int64Array], BoolArray] | None = None) -> None:
        self._exists = exists
        self._set(np.zeros(0, np.int64))
        self.moving = False

    def _set(self, codes: Int64Array) -> None:
        self.codes = codes
        self.controls = np.zeros((len(codes), 3, 3))
        self.cases = np.zeros(len(codes), np.int64)
        self._known: tuple[Int64Array, Float64Array] = codes[:0], np.zeros(0)
        self._initial = np.zeros(len(codes))
        self._find_neighbours()

    def jump(self, roots: Int64Array, splits: Int64Array) -> None:
        """Show a tree at once; the next `advance` without a time limit sets its weights."""
        leaves = np.concatenate([roots, children_of(splits).ravel()])
        self._set(np.sort(leaves[~contains(splits, leaves)]))

    def step(self, roots: Int64Array, splits: Int64Array, pool: TilePool) -> None:
        """Split and merge what can be without a change to the image; follow the roots."""
        codes = self.codes
        may_split = self._may_split(splits)
        may_split[may_split] = (pool.find(children_of(codes[may_split])) >= 0).all(axis=1)
        merges = self._merges(splits, pool)
        removed = may_split | contains(merges, parent_of(codes))
        remaining = codes[~removed]
        inside = contains(roots, _root_of(remaining))
        missing = roots[~contains(np.unique(_root_of(codes)), roots)]
        missing = missing[pool.find(missing) >= 0]
        if not removed.any() and inside.all() and not missing.size:
            return
        children = children_of(codes[may_split]).ravel()
        parts = (remaining[inside], children, merges, missing)
        initial = (
            self._initial[~removed][inside],
            np.ones(len(children)),
            np.zeros(len(merges) + len(missing)),
        )
        leaves = np.concatenate(parts)
        order = np.argsort(leaves)
        self.codes, self._initial = leaves[order], np.concatenate(initial)[order]
        self._find_neighbours()

    def move(self, goals: MorphTargets, elapsed: float) -> None:
        """Move weights towards the targets of the current leaves; `elapsed` (s) may be infinite."""
        places, at = self._places
        target = _minimum(at, np.repeat(goals.weights[:, None], 9, axis=1), len(places), 1.0)
        rate = _minimum(at, np.repeat(goals.rates[:, None], 9, axis=1), len(places), np.inf)
        target[at[~self._in_target(goals.splits)].ravel()] = 1.0
        target[at[contains(goals.splits, self.codes)].ravel()] = 0.0
        coarser, finer = at[self._touching(self._coarser)], at[self._touching(self._finer)]
        target[coarser], target[finer] = 1.0, 0.0
        after = target.copy()
        if np.isfinite(elapsed):
            previous = self._previous_weights(places, at)
            after = previous + np.clip(target - previous, -rate * elapsed, rate * elapsed)
            after[coarser], after[finer] = 1.0, 0.0
        self.moving = bool(np.any(after != target)) or self._unfinished(goals.splits)
        self._known = places, after
        self.controls = after[at].reshape(-1, 3, 3)
        self.cases = self._border_cases()

    def _may_split(self, splits: Int64Array) -> BoolArray:
        """Return which leaves are to split and show nothing of their parent.

        A coarser neighbour that is to split goes first. One that is not lies outside the drawn area, and then
        the controls along it do not matter.
        """
        first = contains(splits, parent_of(self._around))
        as_own = (self.controls.reshape(-1, 9) == 0) | self._touching(self._coarser & ~first)
        waits = (self._coarser & first).any(axis=1)
        return np.asarray(contains(splits, self.codes) & as_own.all(axis=1) & ~waits)

    def _merges(self, splits: Int64Array, pool: TilePool) -> Int64Array:
        """Return the parents that four leaves showing nothing else can merge into; sorted.

        Finer neighbours merge first, unless they are to stay: then they lie in the drawn area and these
        outside.
        """
        stay = contains(splits, self._around)
        as_parent = (self.controls.reshape(-1, 9) == 1) | self._touching(self._finer & stay)
        still = as_parent.all(axis=1) & ~(self._finer & ~stay).any(axis=1)
        candidates = still & (decode(self.codes)[0] > ROOT_LEVEL)
        parents, count = np.unique(parent_of(self.codes[candidates]), return_counts=True)
        parents = parents[count == 4]
        return np.asarray(parents[~contains(splits, parents) & (pool.find(parents) >= 0)])

    def _in_target(self, splits: Int64Array) -> BoolArray:
        """Return which leaves the target tree contains or splits."""
        level, _, _ = decode(self.codes)
        return np.asarray(contains(splits, parent_of(self.codes)) | (level == ROOT_LEVEL))

    def _unfinished(self, splits: Int64Array) -> bool:
        return bool(np.any(contains(splits, self.codes)) or not np.all(self._in_target(splits)))

    def _previous_weights(self, places: Int64Array, at: npt.NDArray[np.intp]) -> Float64Array:
        """Return each control's weight in the last frame, or the initial one of its tile."""
        known, values = self._known
        previous = np.zeros(len(places))
        previous[at.ravel()] = np.repeat(self._initial, 9)
        slot = index_in(known, places)
        previous[slot >= 0] = values[slot[slot >= 0]]
        return previous

    def _find_neighbours(self) -> None:
        """Find coarser and finer neighbours."""
        self._places = _controls(self.codes)
        around = neighbours_of(self.codes)
        same = contains(self.codes, around)
        self._coarser = ~same & contains(self.codes, parent_of(around))
        near = children_of(around.ravel()).reshape(-1, 8, 4)[:, np.arange(8)[:, None], _NEAR_CHILDREN]
        finer = contains(self.codes, near)
        if self._exists is not None:
            self._coarser &= self._exists(around)
            finer &= self._exists(near)  # one of two may lie beyond the terrain's bounds
        self._finer = ~same & finer.any(axis=-1)
        self._around = around

    def _border_cases(self) -> npt.NDArray[np.int64]:
        """Return the border case of each tile; every other vertex where that shows the same."""
        as_parent = (self.controls.reshape(-1, 9) == 1).all(axis=1)
        along = self._coarser | contains(self.codes[as_parent], self._around)
        cases = np.zeros(len(self.codes), np.int64)
        for direction, bit in _BORDERS:
            cases[along[:, direction]] |= bit
        cases[as_parent] = PARENT
        return cases

    def _touching(self, neighbours: BoolArray) -> BoolArray:
        """Return which controls touch one of the given neighbours, shape (n, 9)."""
        flags = np.zeros((len(neighbours), 9), np.bool_)
        for i, row in enumerate(_TOUCHED):
            for j, directions in enumerate(row):
                flags[:, 3 * i + j] = neighbours[:, list(directions)].any(axis=1)
        return flags


def _controls(codes: Int64Array) -> tuple[Int64Array, npt.NDArray[np.intp]]:
    """Return the codes of all controls, sorted, and the indices of each leaf's, shape (n, 9)."""
    places, at = np.unique(control_codes(codes).ravel(), return_inverse=True)
    return places, at.reshape(-1, 9)


def _minimum(at: npt.NDArray[np.intp], values: Float64Array, count: int, start: float) -> Float64Array:
    """Return the minimum value at each control."""
    minimum = np.full(count, start)
    np.minimum.at(minimum, at.ravel(), values.ravel())
    return minimum


def _root_of(codes: Int64Array) -> Int64Array:
    level, col, row = decode(codes)
    up = level - ROOT_LEVEL
    return code_of(np.full_like(level, ROOT_LEVEL), col >> up, row >> up)
