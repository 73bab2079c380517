"""Tiles in the way of Zaaijer 2013, chapter 2: a quad is at most √d / (T · F) m long, rebuilt for each view.

The world is one square, a quadtree's root. Tiles across an edge differ by one level at most. F follows from
the features near a tile, the largest counts; the thesis tells no values.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.placement.feature_types import FEATURE_TYPES
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.tiles.quadtree import EAST, NORTH, SOUTH, WEST

PLAIN = 1.0
"""F where no feature is near."""


class ThesisTile(NamedTuple):
    """A tile's place in the quadtree, and on which sides it lies at a coarser one (bits of a border case)."""

    level: int
    col: int
    row: int
    case: int


class Disc(NamedTuple):
    """Where a feature makes F larger."""

    x: float
    y: float
    radius: float
    factor: float


@dataclass(frozen=True)
class ThesisView:
    """The metric's settings."""

    extent: float
    quads: int
    tessellation: float
    finest_cell: float = 0.2
    discs: tuple[Disc, ...] = ()

    @property
    def finest(self) -> int:
        """The level at which splitting ends."""
        return max(0, int(np.floor(np.log2(self.extent / self.quads / self.finest_cell) + 1e-9)))

    def tiles(self, eye: Sequence[float], ground: float) -> list[ThesisTile]:
        """Return the tiles that cover the world for a view, coarse ones first."""
        found: list[ThesisTile] = []
        splits = self._splits(np.asarray(eye, np.float64), ground)
        there = np.ones((1, 1), np.bool_)
        for level, split in enumerate(splits):
            case = _coarser(there)
            for row, col in np.argwhere(there & ~split).tolist():
                found.append(ThesisTile(level, col, row, int(case[row, col])))
            there = _doubled(split)
        return found

    def _splits(self, eye: Float64Array, ground: float) -> list[BoolArray]:
        """Tell of each level which of its tiles, [row, column], are split."""
        splits: list[BoolArray] = []
        for level in range(self.finest + 1):
            parent = _doubled(splits[-1]) if splits else np.ones((1, 1), np.bool_)
            wanted = parent & (level < self.finest)
            if wanted.any():
                width = self.extent / 2**level
                longest = np.sqrt(self._distance(eye, ground, level)) / (
                    self.tessellation * self._factors[level]
                )
                wanted &= width / self.quads > longest
            splits.append(wanted)
        # A tile can be split only where all its neighbours are there.
        for level in range(self.finest, 0, -1):
            needed = splits[level].copy()
            needed[1:] |= splits[level][:-1]
            needed[:-1] |= splits[level][1:]
            needed[:, 1:] |= splits[level][:, :-1]
            needed[:, :-1] |= splits[level][:, 1:]
            splits[level - 1] |= _halved(needed)
        return splits

    def _distance(self, eye: Float64Array, ground: float, level: int) -> Float64Array:
        width = self.extent / 2**level
        corners = np.arange(2**level) * width
        dx, dy = (np.maximum(np.maximum(corners - at, at - corners - width), 0.0) for at in eye[:2])
        return np.asarray(np.sqrt(dx[None, :] ** 2 + dy[:, None] ** 2 + (eye[2] - ground) ** 2))

    @cached_property
    def _factors(self) -> tuple[Float64Array, ...]:
        """F of each level's tiles."""
        factors = []
        for level in range(self.finest + 1):
            width = self.extent / 2**level
            corners = np.arange(2**level) * width
            factor = np.full((2**level, 2**level), PLAIN)
            for disc in self.discs:
                dx, dy = (np.maximum(np.maximum(corners - at, at - corners - width), 0.0) for at in disc[:2])
                reached = dx[None, :] ** 2 + dy[:, None] ** 2 < disc.radius**2
                factor[reached] = np.maximum(factor[reached], disc.factor)
            factors.append(factor)
        return tuple(factors)


def feature_discs(recipe: TerrainRecipe, factor: float) -> tuple[Disc, ...]:
    """Return painted mountains and pieces of rivers as discs of one factor."""
    mountains = recipe.painted[recipe.painted["type"] == FEATURE_TYPES.index("mountain")]
    discs = [Disc(float(f["x"]), float(f["y"]), float(f["radius"]), factor) for f in mountains]
    for river in recipe.rivers:
        line, reach = river.points[:, :2], 4.0 * float(np.max(river.width))
        apart = np.linalg.norm(np.diff(line, axis=0), axis=1)
        for (x, y), length in zip((line[1:] + line[:-1]) / 2, apart, strict=True):
            discs.append(Disc(float(x), float(y), length / 2 + reach, factor))
    return tuple(discs)


def _doubled(flags: BoolArray) -> BoolArray:
    """Return the children's flags: each its parent's."""
    return np.asarray(flags.repeat(2, axis=0).repeat(2, axis=1))


def _halved(flags: BoolArray) -> BoolArray:
    """Return the parents' flags: set where one of a parent's children is."""
    side = len(flags) // 2
    return np.asarray(flags.reshape(side, 2, side, 2).any(axis=(1, 3)))


def _coarser(there: BoolArray) -> npt.NDArray[np.int64]:
    """Tell on which sides of a level's tiles, rows from south to north, none of this level is."""
    case = np.zeros(there.shape, np.int64)
    case[:-1] |= np.where(there[1:], 0, NORTH)
    case[1:] |= np.where(there[:-1], 0, SOUTH)
    case[:, 1:] |= np.where(there[:, :-1], 0, WEST)
    case[:, :-1] |= np.where(there[:, 1:], 0, EAST)
    return case
