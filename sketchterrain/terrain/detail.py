"""How much full detail can differ from what a cell size shows: the tail of each series that makes heights."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features import FEATURE_TYPES
from sketchterrain.features.profiles import area_profile, hill_profile, mountain_profile
from sketchterrain.terrain.centrelines import tolerance_cell
from sketchterrain.terrain.culling import field_index
from sketchterrain.terrain.detail_parts import Near, Tail
from sketchterrain.terrain.field_packing import pack_fields, pack_lakes
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.octaves import band_weight, octave_table
from sketchterrain.terrain.packing import effective_cell, pack_world
from sketchterrain.terrain.recipe import FINEST_CELL

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.terrain.kernel_arguments import Reaching
    from sketchterrain.terrain.recipe import TerrainRecipe

    Reals = npt.NDArray[np.float64]

NOISE_PEAK = 1.01
"""No octave of noise goes farther from 0: a simplex's corners give no more, each with its worst gradient."""

_HILL_SWELL = 0.4
_GULLY_PEAK = 1.25  # an octave of gullies goes no farther from 0, in its own depth
_GULLY_SLOPE = 13.0  # of such an octave, over its depth and times its wavelength
_ROCK_OVER_SLOPE = 0.78  # of slope^2 / (slope^2 + 0.7), which rock is rough by
_PLATEAU_SLOPE = 3.0  # of an area's profile, over a radius
_DUNE_SLOPE, _CREST_SHARE, _VIGOUR_SLOPE = 9.1, 0.9, 1.05
_LEVELLED = 0.35  # height of dunes whose waves no cell shows, and how far a wave leaves it
_BANK_RISE = 0.5
_LEAST_CELLS = 2.0
# Arcs for a coarser cell: by how much of it, along the banks' slope, and by the fall over how many widths of
# the river the bed differs. Measured, not proven: blends of arcs shift where these are cut differently.
_ARC_SLOPES, _ARC_WIDTHS = 0.4, 0.8
_ROUNDING = 1e-6  # of the height
_ROCK = (20.0, 100.0)  # m: massifs from which on and to which rock shows
# So many features of a kind that are lost to the cell size stand in one place at their full height, at most.
_LOST_TOGETHER = 4.0
_MOUNTAIN, _HILL, _FIRST_DUNE = 0, 1, 3
_TURNS = np.linspace(0.0, 1.0, 2049)


class DetailBound:
    """Bounds of |height at full detail - height at a cell size| over blocks of ground.

    Each noise misses the octaves that the cell size fades out, and none of these goes beyond its amplitude.
    A noise that bends outlines moves a profile by no more than the profile's steepest slope; one that makes
    heights swell counts with the height it is multiplied by, which is bounded by how near the features come
    to the block. Features, lakes and channels that fade out count with what is lost of them.

    Parameters
    ----------
    recipe : TerrainRecipe
    """

    def __init__(self, recipe: TerrainRecipe) -> None:
        self._recipe = recipe
        self._tails = lru_cache(maxsize=64)(self._tail)
        self._hill_slope = _steepest(hill_profile(_TURNS, recipe.flank))
        self._mountain_slope = max(
            _steepest(mountain_profile(_TURNS, peak, recipe.flank)) for peak in (0.0, 1.0)
        )
        fields = pack_fields(recipe, [lake.shape for lake in recipe.lakes])
        self._fields, self._lakes_at = fields, field_index(fields)
        world = pack_world(recipe, FINEST_CELL, real=np.float64).scalars[0]
        self._relief, self._ridge_depth, self._spur = (
            float(world[name]) for name in ("half_relief", "ridge_depth", "spur")
        )
        self._gully_depth, self._crag_depth = (float(world[name]) for name in ("gully_depth", "crag_depth"))

    def of(self, reaching: Reaching, blocks: npt.NDArray[np.int64], cell_size: float) -> Reals:
        """Return the bound of each block, m, shape (blocks,).

        Parameters
        ----------
        reaching
            What reaches the blocks at the cell size.
        blocks
            West, south, east and north, lattice units, shape (n, 4).
        cell_size
            Metres between samples.
        """
        tail = self._tails(effective_cell(cell_size))
        near = self._near(reaching, blocks)
        bound = tail.ground + self._hills(tail, near) + self._mountains(tail, near)
        bound += self._gullies(tail, near) + self._crags(tail, near)
        bound += self._dunes(tail, near) + self._lakes(near, blocks, effective_cell(cell_size))
        bound += self._rivers(reaching, effective_cell(cell_size))
        rounding = _ROUNDING * (self._relief + near.hill + near.mountain)
        return np.asarray(bound + np.where(bound > 0, rounding, 0.0))

    def _tail(self, cell: float) -> Tail:
        recipe, unit = self._recipe, metres_per_unit(self._recipe.extent)
        full, shown = (
            octave_table(recipe.stacks, extent=recipe.extent, seed=recipe.seed, cell_size=size)
            for size in (FINEST_CELL, cell)
        )
        amplitude, left = {}, {}
        for name, (first, last) in full.ranges.items():
            amplitude[name] = full.scale[first:last, 0]
            seen = shown.scale[slice(*shown.ranges[name]), 0]
            left[name] = np.concatenate([seen, np.zeros(last - first - len(seen))])
        missing = {name: float(np.sum(amplitude[name] - left[name])) * NOISE_PEAK for name in full.ranges}
        warp, ridge = max(missing["warp_u"], missing["warp_v"]), missing["ridge"]
        hills, mountains = self._lost("hill", cell, 0.5), self._lost("mountain", cell, 0.25)
        # An octave of gullies follows what slopes the ones before it left: from the first that differs on, or
        # from the first of all where the relief below differs, each counts once in full and once as shown.
        differs = amplitude["gully"] > left["gully"]
        moved = warp + ridge + hills + mountains > 0
        turned = (np.cumsum(differs) - differs > 0) | moved
        gullies = np.where(turned, amplitude["gully"] + left["gully"], amplitude["gully"] - left["gully"])
        start, end = full.ranges["gully"]
        return Tail(
            ground=self._relief * missing["ground"],
            hills=hills,
            mountains=mountains,
            crags=self._crag_depth * missing["crag"],
            crags_left=self._crag_depth * NOISE_PEAK * float(np.sum(left["crag"])),
            moved=moved,
            warp=warp,
            ridge=ridge,
            crest=missing["crest"],
            gullies=self._gully_depth * _GULLY_PEAK * gullies,
            wavelengths=unit / full.scale[start:end, 1],
            waves=np.array([1 - band_weight(length, cell) for length, _ in recipe.dune_styles]),
        )

    def _lost(self, kind: str, cell: float, power: float) -> float:
        """Return what is lost of features too small for a cell size, where several stand together."""
        recipe = self._recipe
        small = recipe.painted[recipe.painted["type"] == FEATURE_TYPES.index(kind)]
        small = small[small["radius"] < 2 * cell]
        gone = small["strength"] * _gone(small["radius"] / cell)
        strongest, radii = getattr(recipe.fill, "max_strength", None), np.linspace(0.0, 2.0, 21)
        if strongest is not None:
            # No smaller radius is stronger, and none between two of these is less visible than the lower one.
            of_fill = [strongest(kind, radius * cell) for radius in radii[1:]] * _gone(radii[:-1])
            gone = np.append(gone, of_fill)
        return float(gone.max(initial=0.0) * _LOST_TOGETHER**power)

    def _near(self, reaching: Reaching, blocks: npt.NDArray[np.int64]) -> Near:
        recipe, features, lists = self._recipe, reaching.features, reaching.lists
        unit, count = metres_per_unit(recipe.extent), len(blocks)
        starts, member = lists["feature_starts"], lists["feature_list"]
        of_slot = np.diff(starts, axis=-1)
        slots = of_slot.shape[1]
        if not member.size:
            none = np.zeros(count)
            styles = np.zeros((count, slots - _FIRST_DUNE))
            return Near(none, none, none, none, none, none, styles, styles)
        packed = features.packed
        block, slot = np.divmod(np.repeat(np.arange(count * slots), of_slot.ravel()), slots)
        at, shape = packed.at[member], packed.shape[member]
        outside = np.maximum(np.maximum(blocks[block, :2] - at, at - blocks[block, 2:]), 0) * unit
        radii = np.hypot(outside[:, 0], outside[:, 1]) * shape[:, 0]
        radii = np.maximum(radii - np.hypot(shape[:, 8], shape[:, 9]), 0)
        bent = np.maximum(radii - np.sqrt(2) * recipe.warp, 0)
        spur = self._spur * NOISE_PEAK

        def power_mean(kind: int, heights: Reals, power: int) -> Reals:
            sums = np.bincount(block, weights=np.where(slot == kind, heights, 0.0) ** power, minlength=count)
            return np.asarray(sums ** (1 / power))

        hill = power_mean(_HILL, shape[:, 1] * hill_profile(bent, shape[:, 3]), 2)
        peaks = shape[:, 1] * mountain_profile(np.maximum(bent - spur, 0), shape[:, 2], shape[:, 3])
        mountain = power_mean(_MOUNTAIN, peaks, 4)
        # The same without profiles, for what moves these.
        hill_sum, mountain_sum = (
            power_mean(kind, shape[:, 1], power) for kind, power in ((_HILL, 2), (_MOUNTAIN, 4))
        )
        cut = np.where(slot <= _HILL, shape[:, 4], 0.0)
        erosion, widest = np.zeros(count), np.zeros(count)
        np.maximum.at(erosion, block, cut)
        np.maximum.at(widest, block, np.where(cut > 0, shape[:, 5], 0.0))
        cover, dune = np.zeros((count, slots)), np.zeros((count, slots))
        np.add.at(cover, (block, slot), area_profile(bent) ** 4)
        np.maximum.at(dune, (block, slot), shape[:, 1])
        cover = np.minimum(cover**0.25, 1.0)[:, _FIRST_DUNE:]
        return Near(hill, mountain, hill_sum, mountain_sum, erosion, widest, cover, dune[:, _FIRST_DUNE:])

    def _hills(self, tail: Tail, near: Near) -> Reals:
        moved = near.hill_sum * self._hill_slope * np.sqrt(2) * self._recipe.warp * tail.warp
        swollen = _HILL_SWELL * near.hill * tail.warp
        return np.asarray((1 + _HILL_SWELL) * (moved + tail.hills) + swollen)

    def _mountains(self, tail: Tail, near: Near) -> Reals:
        depth, spur = self._ridge_depth, self._spur
        bent = np.sqrt(2) * self._recipe.warp * tail.warp * (1 + 2 * spur * NOISE_PEAK)
        moved = near.mountain_sum * self._mountain_slope * (bent + spur * tail.ridge)
        swollen = depth * near.mountain * tail.ridge
        return np.asarray((1 + depth * NOISE_PEAK) * (moved + tail.mountains) + swollen)

    def _crags(self, tail: Tail, near: Near) -> Reals:
        """Return what rock misses, and how far missing gullies' slopes change what is left of it."""
        slopes = _GULLY_SLOPE * near.erosion * (self._shown(tail, near) @ (tail.gullies / tail.wavelengths))
        steeper = np.ones(len(slopes)) if tail.moved else np.minimum(_ROCK_OVER_SLOPE * slopes, 1.0)
        return np.asarray(_rocky(near.mountain) * (tail.crags + steeper * tail.crags_left))

    def _gullies(self, tail: Tail, near: Near) -> Reals:
        return np.asarray(near.erosion * (self._shown(tail, near) @ tail.gullies))

    def _shown(self, tail: Tail, near: Near) -> Reals:
        """Return how much of each octave of gullies features as wide as these show, shape (n, octaves)."""
        across = np.clip((near.widest[:, None] / tail.wavelengths - 0.5) * 2, 0, 1)
        return np.asarray(across * across * (3 - 2 * across))

    def _dunes(self, tail: Tail, near: Near) -> Reals:
        shown = 1 - tail.waves
        wave = tail.waves * (1 - _LEVELLED)
        wave = wave + shown * (_DUNE_SLOPE * _CREST_SHARE + _VIGOUR_SLOPE) * tail.crest
        moved = np.minimum(_PLATEAU_SLOPE * np.sqrt(2) * self._recipe.warp * tail.warp, 1.0)
        return np.asarray(np.sum(near.dune * (near.cover * np.minimum(wave, 1.0) + moved), axis=-1))

    def _lakes(self, near: Near, blocks: npt.NDArray[np.int64], cell: float) -> Reals:
        """Return what lakes that fade out change at most: ground up to their rims, or down to their beds."""
        bound = np.zeros(len(blocks))
        if not self._recipe.lakes:
            return bound
        lakes = pack_lakes(self._recipe, self._fields, cell)
        lost, level = 1 - lakes.shape[:, 3], lakes.shape[:, 2]
        if not lost.any():
            return bound
        block, lake = self._lakes_at.touching(blocks)
        low = -self._relief * NOISE_PEAK - near.erosion * self._gully_depth * _GULLY_PEAK
        rise = (1 + _HILL_SWELL) * near.hill + (1 + self._ridge_depth * NOISE_PEAK) * near.mountain
        high = self._relief * NOISE_PEAK + rise + near.dune.sum(axis=-1)
        up = 2 * np.maximum((level + lakes.profile[:, 3])[lake] - low[block], 0)
        down = high[block] - (level - lakes.profile[:, 0])[lake]
        np.maximum.at(bound, block, lost[lake] * np.maximum(up, down))
        return bound

    def _rivers(self, reaching: Reaching, cell: float) -> Reals:
        """Return what channels that fade out change, and what arcs that lie a little elsewhere do."""
        rivers, starts, member = reaching.rivers, reaching.lists["river_starts"], reaching.lists["river_list"]
        count = len(starts) - 1
        lost, depth, moved = np.zeros((3, count))
        if not member.size:
            return lost
        block = np.repeat(np.arange(count), np.diff(starts))
        half_width = np.minimum(rivers.up[:, 1], rivers.down[:, 1])[member]
        deep = np.maximum(rivers.up[:, 2], rivers.down[:, 2])[member]
        shown = np.clip(2 * half_width / cell / _LEAST_CELLS - 1, 0, 1)
        np.maximum.at(lost, block, 1 - shown * shown * (3 - 2 * shown))
        np.maximum.at(depth, block, deep)
        tolerance = tolerance_cell(cell)
        if tolerance > FINEST_CELL:
            fall = np.abs(rivers.up[:, 0] - rivers.down[:, 0])[member]
            steep = fall / np.maximum(np.hypot(rivers.along[member, 0], rivers.along[member, 1]), 1e-3)
            off = _ARC_SLOPES * tolerance * 2 * deep / half_width + _ARC_WIDTHS * 2 * half_width * steep
            np.maximum.at(moved, block, off)
        return np.asarray((1 + _BANK_RISE) * depth * lost + moved)


def _gone(cells: Reals) -> Reals:
    """Return what is lost of features so many cells in radius."""
    left = np.clip(cells - 1.0, 0.0, 1.0)
    return 1 - left * left * (3 - 2 * left)


def _rocky(height: Reals) -> Reals:
    """Return how much of a mountain massifs up to a height (m) are at most."""
    t = np.clip((height - _ROCK[0]) / (_ROCK[1] - _ROCK[0]), 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def _steepest(profile: Reals) -> float:
    return float(np.abs(np.diff(profile)).max() * (len(_TURNS) - 1))
