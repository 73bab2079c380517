"""Bounds of the detail that a cell size omits, from the tails of the series that heights are made of."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.io.resources import kernel_constants
from sketchterrain.placement.feature_types import FEATURE_TYPES, area_profile, hill_profile, mountain_profile
from sketchterrain.terrain.centrelines import tolerance_cell
from sketchterrain.terrain.culling import field_index
from sketchterrain.terrain.kernel_arguments import CulledInputs
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.noise import band_weight, octave_table
from sketchterrain.terrain.packing import (
    FEATURE,
    SLOT_DUNE,
    SLOT_HILL,
    SLOT_MOUNTAIN,
    effective_cell,
    pack_fields,
    pack_lakes,
    pack_world,
)
from sketchterrain.terrain.recipe import FINEST_CELL, TerrainRecipe

NOISE_PEAK = 1.01
"""Bound of |noise| in one octave: a simplex's corners give no more, each with its worst gradient."""

_HILL_SWELL, _ROCK_HEIGHT, _INVERSE_ROCK_RANGE = kernel_constants(
    "relief.clh", "HILL_SWELL", "ROCK_HEIGHT", "INVERSE_ROCK_RANGE"
)
_CREST_SHARE, _LEVELLED = kernel_constants("height.clh", "CREST_SHIFT", "DUNE_LEVEL")
_BANK_RISE, _MIN_CELLS = kernel_constants("rivers.clh", "BANK_RISE", "CHANNEL_CELLS")
_GULLY_PEAK = 1.25  # bound of an octave of gullies, over its depth
_GULLY_SLOPE = 13.0  # bound of its slope, over its depth and times its wavelength
_ROCK_OVER_SLOPE = 0.78  # greatest derivative of slope^2 / (slope^2 + 0.7), the roughness of rock
_PLATEAU_SLOPE = 3.0  # of an area's profile, over a radius
_DUNE_SLOPE, _VIGOUR_SLOPE = 9.1, 1.05
# Difference of the bed by arcs for a coarser cell: in cells along the banks' slope, and in widths along the
# fall. Measured, not proven: blends of arcs shift where these are split differently.
_ARC_SLOPES, _ARC_WIDTHS = 0.4, 0.8
_ROUNDING = 1e-6  # of the height
# Most features of a kind, omitted at a cell size, that overlap at their full height.
_MAX_OVERLAP = 4.0
_TURNS = np.linspace(0.0, 1.0, 2049)


@dataclass(frozen=True)
class OmittedDetail:
    """Detail that one cell size omits anywhere; m unless noted."""

    ground: float  # of the ground's octaves
    hills: float  # of hills that are too small
    mountains: float
    crags: float  # of the roughness of bare rock
    crags_left: float  # resolved part of that roughness
    moved: bool  # hills or mountains themselves differ
    warp: float  # of multiplied noises, dimensionless
    ridge: float
    crest: float
    gullies: Float64Array  # (octaves,) at full erosion
    wavelengths: Float64Array  # (octaves,) of the gullies
    waves: Float64Array  # (styles,) unresolved share of the dunes' waves


@dataclass(frozen=True)
class BlockExtrema:
    """Greatest effects of the features near each of n blocks."""

    hill: Float64Array  # (n,) height without swell or gullies, m
    mountain: Float64Array
    hill_sum: Float64Array  # (n,) the same if all of them had their summit in the block, m
    mountain_sum: Float64Array
    erosion: Float64Array  # (n,) 0 … 1
    widest: Float64Array  # (n,) width of the widest gullies, m
    cover: Float64Array  # (n, styles) 0 … 1
    dune: Float64Array  # (n, styles) height of the highest dunes, m


class DetailBound:
    """Bounds of |height at full detail - height at a cell size| over blocks of terrain.

    Each noise misses the octaves that the cell size fades out, none of which exceeds its amplitude. A noise
    that warps outlines moves a profile by no more than the profile's steepest slope; one that scales heights
    counts with the height it multiplies, bounded by how near the features come to the block. Features, lakes
    and channels that fade out count with the share that is lost.
    """

    def __init__(self, recipe: TerrainRecipe) -> None:
        self._recipe = recipe
        self._omitted = lru_cache(maxsize=64)(self._omitted_detail)
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

    def bounds(self, culled: CulledInputs, blocks: LatticeArray, cell_size: float) -> Float64Array:
        """Return the bound (n,), m, of blocks (n, 4), from what affects them at the cell size."""
        omitted = self._omitted(effective_cell(cell_size))
        near = self._near(culled, blocks)
        bound = omitted.ground + self._hills(omitted, near) + self._mountains(omitted, near)
        bound += self._gullies(omitted, near) + self._crags(omitted, near)
        bound += self._dunes(omitted, near) + self._lakes(near, blocks, effective_cell(cell_size))
        bound += self._rivers(culled, effective_cell(cell_size))
        rounding = _ROUNDING * (self._relief + near.hill + near.mountain)
        return np.asarray(bound + np.where(bound > 0, rounding, 0.0))

    def _omitted_detail(self, cell: float) -> OmittedDetail:
        recipe, unit = self._recipe, metres_per_unit(self._recipe.extent)
        full, resolved = (
            octave_table(recipe.stacks, extent=recipe.extent, seed=recipe.seed, cell_size=size)
            for size in (FINEST_CELL, cell)
        )
        amplitude, left = {}, {}
        for name, (first, last) in full.ranges.items():
            amplitude[name] = full.scale[first:last, 0]
            resolved_scale = resolved.scale[slice(*resolved.ranges[name]), 0]
            left[name] = np.concatenate([resolved_scale, np.zeros(last - first - len(resolved_scale))])
        missing = {name: float(np.sum(amplitude[name] - left[name])) * NOISE_PEAK for name in full.ranges}
        warp, ridge = max(missing["warp_u"], missing["warp_v"]), missing["ridge"]
        hills, mountains = self._lost("hill", cell, 0.5), self._lost("mountain", cell, 0.25)
        # An octave of gullies follows the slopes that coarser ones left: from the first that differs, or from
        # the very first where the relief below differs, each counts once in full and once as resolved.
        differs = amplitude["gully"] > left["gully"]
        moved = warp + ridge + hills + mountains > 0
        turned = (np.cumsum(differs) - differs > 0) | moved
        gullies = np.where(turned, amplitude["gully"] + left["gully"], amplitude["gully"] - left["gully"])
        start, end = full.ranges["gully"]
        return OmittedDetail(
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
        """Return the height lost of features too small for a cell size, where several overlap."""
        recipe = self._recipe
        small = recipe.painted[recipe.painted["type"] == FEATURE_TYPES.index(kind)]
        small = small[small["radius"] < 2 * cell]
        lost = small["strength"] * _fade_loss(small["radius"] / cell)
        strongest, radii = getattr(recipe.fill, "max_strength", None), np.linspace(0.0, 2.0, 21)
        if strongest is not None:
            # Strength and visibility both grow with the radius.
            of_fill = [strongest(kind, radius * cell) for radius in radii[1:]] * _fade_loss(radii[:-1])
            lost = np.append(lost, of_fill)
        return float(lost.max(initial=0.0) * _MAX_OVERLAP**power)

    def _near(self, culled: CulledInputs, blocks: LatticeArray) -> BlockExtrema:
        recipe, features, lists = self._recipe, culled.features, culled.lists
        unit, count = metres_per_unit(recipe.extent), len(blocks)
        starts, member = lists["feature_starts"], lists["feature_list"]
        of_slot = np.diff(starts, axis=-1)
        slots = of_slot.shape[1]
        if not member.size:
            zero = np.zeros(count)
            styles = np.zeros((count, slots - SLOT_DUNE))
            return BlockExtrema(zero, zero, zero, zero, zero, zero, styles, styles)
        packed = features.packed
        block, slot = np.divmod(np.repeat(np.arange(count * slots), of_slot.ravel()), slots)
        at, column = packed.at[member], {name: packed[name][member] for name in FEATURE}
        strength, flank = column["feature_strength"], column["feature_flank"]
        outside = np.maximum(np.maximum(blocks[block, :2] - at, at - blocks[block, 2:]), 0) * unit
        radii = np.hypot(outside[:, 0], outside[:, 1]) * column["inverse_radius"]
        radii = np.maximum(radii - np.hypot(column["crest_east"], column["crest_north"]), 0)
        bent = np.maximum(radii - np.sqrt(2) * recipe.warp, 0)
        spur = self._spur * NOISE_PEAK

        def power_mean(kind: int, heights: Float64Array, power: int) -> Float64Array:
            sums = np.bincount(block, weights=np.where(slot == kind, heights, 0.0) ** power, minlength=count)
            return np.asarray(sums ** (1 / power))

        hill = power_mean(SLOT_HILL, strength * hill_profile(bent, flank), 2)
        peaks = strength * mountain_profile(np.maximum(bent - spur, 0), column["feature_peakiness"], flank)
        mountain = power_mean(SLOT_MOUNTAIN, peaks, 4)
        # The same without profiles, to bound shifts of the profiles.
        hill_sum, mountain_sum = (
            power_mean(kind, strength, power) for kind, power in ((SLOT_HILL, 2), (SLOT_MOUNTAIN, 4))
        )
        cut = np.where(slot <= SLOT_HILL, column["feature_erosion"], 0.0)
        erosion, widest = np.zeros(count), np.zeros(count)
        np.maximum.at(erosion, block, cut)
        np.maximum.at(widest, block, np.where(cut > 0, column["widest_gully"], 0.0))
        cover, dune = np.zeros((count, slots)), np.zeros((count, slots))
        np.add.at(cover, (block, slot), area_profile(bent) ** 4)
        np.maximum.at(dune, (block, slot), strength)
        cover = np.minimum(cover**0.25, 1.0)[:, SLOT_DUNE:]
        return BlockExtrema(
            hill, mountain, hill_sum, mountain_sum, erosion, widest, cover, dune[:, SLOT_DUNE:]
        )

    def _hills(self, omitted: OmittedDetail, near: BlockExtrema) -> Float64Array:
        moved = near.hill_sum * self._hill_slope * np.sqrt(2) * self._recipe.warp * omitted.warp
        swollen = _HILL_SWELL * near.hill * omitted.warp
        return np.asarray((1 + _HILL_SWELL) * (moved + omitted.hills) + swollen)

    def _mountains(self, omitted: OmittedDetail, near: BlockExtrema) -> Float64Array:
        depth, spur = self._ridge_depth, self._spur
        bent = np.sqrt(2) * self._recipe.warp * omitted.warp * (1 + 2 * spur * NOISE_PEAK)
        moved = near.mountain_sum * self._mountain_slope * (bent + spur * omitted.ridge)
        swollen = depth * near.mountain * omitted.ridge
        return np.asarray((1 + depth * NOISE_PEAK) * (moved + omitted.mountains) + swollen)

    def _crags(self, omitted: OmittedDetail, near: BlockExtrema) -> Float64Array:
        """Return the roughness that rock omits, and how far omitted gullies' slopes change the rest of it."""
        slopes = (
            _GULLY_SLOPE
            * near.erosion
            * (self._resolved(omitted, near) @ (omitted.gullies / omitted.wavelengths))
        )
        steeper = np.ones(len(slopes)) if omitted.moved else np.minimum(_ROCK_OVER_SLOPE * slopes, 1.0)
        return np.asarray(_rocky(near.mountain) * (omitted.crags + steeper * omitted.crags_left))

    def _gullies(self, omitted: OmittedDetail, near: BlockExtrema) -> Float64Array:
        return np.asarray(near.erosion * (self._resolved(omitted, near) @ omitted.gullies))

    def _resolved(self, omitted: OmittedDetail, near: BlockExtrema) -> Float64Array:
        """Return the share of each octave of gullies on features of such widths, shape (n, octaves)."""
        across = np.clip((near.widest[:, None] / omitted.wavelengths - 0.5) * 2, 0, 1)
        return np.asarray(across * across * (3 - 2 * across))

    def _dunes(self, omitted: OmittedDetail, near: BlockExtrema) -> Float64Array:
        resolved = 1 - omitted.waves
        wave = omitted.waves * (1 - _LEVELLED)
        wave = wave + resolved * (_DUNE_SLOPE * _CREST_SHARE + _VIGOUR_SLOPE) * omitted.crest
        moved = np.minimum(_PLATEAU_SLOPE * np.sqrt(2) * self._recipe.warp * omitted.warp, 1.0)
        return np.asarray(np.sum(near.dune * (near.cover * np.minimum(wave, 1.0) + moved), axis=-1))

    def _lakes(self, near: BlockExtrema, blocks: LatticeArray, cell: float) -> Float64Array:
        """Return the greatest change by lakes that fade out.

        Terrain up to their rims, or down to their beds.
        """
        bound = np.zeros(len(blocks))
        if not self._recipe.lakes:
            return bound
        lakes = pack_lakes(self._recipe, self._fields, cell)
        lost, level = 1 - lakes["lake_visible"], lakes["lake_level"]
        if not lost.any():
            return bound
        block, lake = self._lakes_at.touching(blocks)
        low = -self._relief * NOISE_PEAK - near.erosion * self._gully_depth * _GULLY_PEAK
        rise = (1 + _HILL_SWELL) * near.hill + (1 + self._ridge_depth * NOISE_PEAK) * near.mountain
        high = self._relief * NOISE_PEAK + rise + near.dune.sum(axis=-1)
        up = 2 * np.maximum((level + lakes["beach_rise"])[lake] - low[block], 0)
        down = high[block] - (level - lakes["lake_depth"])[lake]
        np.maximum.at(bound, block, lost[lake] * np.maximum(up, down))
        return bound

    def _rivers(self, culled: CulledInputs, cell: float) -> Float64Array:
        """Return the change by channels that fade out, and by arcs flattened for a coarser cell."""
        rivers, starts, member = culled.rivers, culled.lists["river_starts"], culled.lists["river_list"]
        count = len(starts) - 1
        lost, depth, moved = np.zeros((3, count))
        if not member.size:
            return lost
        block = np.repeat(np.arange(count), np.diff(starts))
        half_width = np.minimum(*rivers.ends("half_width"))[member]
        deep = np.maximum(*rivers.ends("river_depth"))[member]
        resolved = np.clip(2 * half_width / cell / _MIN_CELLS - 1, 0, 1)
        np.maximum.at(lost, block, 1 - resolved * resolved * (3 - 2 * resolved))
        np.maximum.at(depth, block, deep)
        tolerance = tolerance_cell(cell)
        if tolerance > FINEST_CELL:
            fall = np.abs(np.subtract(*rivers.ends("water_surface")))[member]
            steep = fall / np.maximum(np.hypot(*rivers.chord[member].T), 1e-3)
            off = _ARC_SLOPES * tolerance * 2 * deep / half_width + _ARC_WIDTHS * 2 * half_width * steep
            np.maximum.at(moved, block, off)
        return np.asarray((1 + _BANK_RISE) * depth * lost + moved)


def _fade_loss(cells: Float64Array) -> Float64Array:
    """Return the share that is lost of features of a radius in cells."""
    left = np.clip(cells - 1.0, 0.0, 1.0)
    return 1 - left * left * (3 - 2 * left)


def _rocky(height: Float64Array) -> Float64Array:
    """Return the greatest mountain mask of massifs up to a height (m)."""
    t = np.clip((height - _ROCK_HEIGHT) * _INVERSE_ROCK_RANGE, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def _steepest(profile: Float64Array) -> float:
    return float(np.abs(np.diff(profile)).max() * (len(_TURNS) - 1))
