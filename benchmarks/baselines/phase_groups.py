"""Poisson-disk points in the way of Zaaijer 2013, chapter 6, after Wei 2008: what is compared with.

Taken from the thesis: Wei's cells, each with at most one point, which throw darts in groups of cells that
are far enough apart (phase groups), in random order, from coarse cells to fine ones; up to k darts a cell;
positions by a cipher of the cell's place with three iterations; an index array that holds each cell's
point; points written one after another by an atomic counter.

Where it is silent the choice is the cheaper one: cells of side r/√2, nine groups in the finest level and
four in coarser ones, as few as there can be; three levels, since more do not better the spectrum; all k
darts of a cell in one turn of the groups; buffers made once; a square whose border ends the points. Wei's
quality takes a dart a turn, so that cells whose turn comes first do not fill up before others begin:
`rounds` does that.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.placement.hashing import hash_keys

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

_FILE = "baselines/phase_groups.cl"
_GROUP = 64
_EMPTY = -1


@dataclass(frozen=True, eq=False)
class _Level:
    """Cells of one size: how many along the side, how wide, how far points reach, and each one's point."""

    columns: int
    cell: float
    reach: int
    index: Any


class PhaseGroups:
    """Points at least a distance apart on a square."""

    def __init__(
        self,
        context: ComputeContext,
        side: float,
        distance: float,
        trials: int,
        *,
        levels: int = 3,
        rounds: bool = False,
    ) -> None:
        self._context, self._side, self._distance = context, side, distance
        self._trials, self._rounds = trials, rounds
        cell = distance / sqrt(2.0)
        coarsest = ceil(ceil(side / cell) / 2 ** (levels - 1))
        self._levels = []
        for level in range(levels):
            columns, wide = coarsest << level, cell * 2 ** (levels - 1 - level)
            index = context.upload(np.full(columns**2, _EMPTY, np.int32), writable=True)
            self._levels.append(_Level(columns, wide, ceil(distance / wide), index))
        self._nothing = np.full(coarsest**2, _EMPTY, np.int32)
        self._most = int(1.3 * (side / distance + 1.0) ** 2) + 1  # circles of diameter 1 do not lie denser
        self._points = context.empty((self._most, 2), np.float32)
        self._count = context.upload(np.zeros(1, np.int32), writable=True)

    def points(self, seed: int) -> npt.NDArray[np.float32]:
        """Return the points of a seed, m, shape (n, 2), in no order."""
        context = self._context
        start = np.zeros(1, np.int32)
        events = [
            context.write(self._levels[0].index, self._nothing),
            context.write(self._count, start),
        ]
        rng = np.random.default_rng(seed)
        salt = np.uint32(hash_keys(seed, "phase groups") & np.uint64(0xFFFFFFFF))
        for number, level in enumerate(self._levels):
            if number:
                self._refine(self._levels[number - 1], level)
            turns = [(t, 1) for t in range(self._trials)] if self._rounds else [(0, self._trials)]
            for first, trials in turns:
                for group in rng.permutation((level.reach + 1) ** 2).tolist():
                    self._throw(level, group, first, trials, salt)
        found = int(context.download(self._count, 1, np.int32)[0])
        for event in events:
            context.wait(event)
        return context.download(self._points, (found, 2), np.float32)

    def _throw(self, level: _Level, group: int, first: int, trials: int, salt: np.uint32) -> None:
        row, column = divmod(group, level.reach + 1)
        along = -(-level.columns // (level.reach + 1))
        numbers = (level.columns, level.reach, level.reach + 1, column, row, first, trials)
        columns, reach, apart, *rest = (np.int32(number) for number in numbers)
        lengths = (np.float32(length) for length in (level.cell, self._side, self._distance))
        written = (level.index, self._points, self._count)
        self._context.launch(
            _FILE,
            "throw_darts",
            (_rounded_up(along), along),
            *(*written, columns, *lengths, reach, apart, *rest, salt),
            group=(_GROUP, 1),
        )

    def _refine(self, coarse: _Level, fine: _Level) -> None:
        size = (_rounded_up(coarse.columns), coarse.columns)
        given = (coarse.index, fine.index, self._points, np.int32(coarse.columns), np.float32(fine.cell))
        self._context.launch(_FILE, "refine", size, *given, group=(_GROUP, 1))


def _rounded_up(number: int) -> int:
    return -(-number // _GROUP) * _GROUP
