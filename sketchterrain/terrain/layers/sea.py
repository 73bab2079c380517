"""The sea: a bed that shelves from the coast, beaches, and cliffs where high ground meets it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, LatticeArray, StructuredArray
from sketchterrain.geometry.box_index import BoxIndex, content_items
from sketchterrain.io.resources import kernel_constants
from sketchterrain.landforms.placement.feature_types import ShapeField, cubic
from sketchterrain.landforms.placement.sea import Sea, cliff_reach, raggedness, wandering
from sketchterrain.terrain.layers.fields import PackedFields, field_distance, pack_fields
from sketchterrain.terrain.layers.forests import COVER_NOISE, COVER_NOISE_CONTRAST
from sketchterrain.terrain.layers.layer import (
    ITEMS,
    Culled,
    DetailState,
    HostSamples,
    HostSite,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
    mask_bits,
    smooth_rise,
)
from sketchterrain.terrain.noise import NOISE_PEAK, NoiseStack, fbm, omitted_amplitudes

_HEADER: Final = "layers/sea.clh"
_EASED, _LOWLAND, _CLIFF, _RAGGED, _OCTAVES, _WANDERING, _BARS = kernel_constants(
    _HEADER, "EASED", "LOWLAND", "CLIFF", "RAGGED", "COAST_OCTAVES", "WANDERING", "BARS"
)
_INVERSE_LANDING, _INVERSE_DEEP, _WET_EDGE, _FOREST_END, _INVERSE_FOREST_FADE = kernel_constants(
    _HEADER, "INVERSE_LANDING", "INVERSE_DEEP", "WET_EDGE", "FOREST_END", "INVERSE_FOREST_FADE"
)
_SHORE_SLOPE = 0.05  # of the beach and the bed at the waterline, unless the shelf is flatter
_SWASH = 0.1  # height over or under the level up to which slopes are eased, over the beach's width
_SIDE = 64  # samples along a part of the coast that is an item
_OUTSIDE = 1 << 60  # lattice units: parts at the sketch's edge continue outward without end
_MARGIN = 2  # samples that a part affects beyond its own
# Greatest factor of a slope near an unpainted coast: at u² = 3/5, between the eased slope and the ground.
_STEEPENED = 1 + 0.8 * _EASED
_NOISE = "coast"
# Noise beyond the sketch: wavelength over the extent, gain, octaves.
_WAVE, _GAIN, _WAVES = 0.5, 0.5, 3
_FAR = 0.6  # distance from the sketch, over its extent, where coasts wander fully
_TURNS = 512  # samples of a cliff's profile


@dataclass(frozen=True, eq=False)
class SeaLayer(TerrainLayer):
    """The sea at one level, painted or wherever the ground is below it."""

    name: ClassVar[str] = "sea"

    level: float | None = None  # m; None: no sea
    beach: float = 1.0  # m
    shelf: float = 1.0  # m
    shore_slope: float = _SHORE_SLOPE
    painted: bool = False
    coast: ShapeField | None = field(default=None, metadata=ITEMS)  # m, positive in the sea
    depth: ShapeField | None = field(default=None, metadata=ITEMS)  # m, on the same grid

    @classmethod
    def of(cls, sea: Sea | None) -> SeaLayer:
        """Return the layer of a sea."""
        if sea is None:
            return cls()
        slope = _SHORE_SLOPE
        if sea.depth is not None:
            slope = min(slope, 1.5 * (1 - _BARS) * float(sea.depth.inside.min()) / sea.shelf)
        return cls(sea.level, sea.beach, sea.shelf, slope, sea.coast is not None, sea.coast, sea.depth)

    @property
    def reach(self) -> float:
        """Distance (m) inland up to which a painted coast may lower the ground."""
        return cliff_reach(self.beach)

    def ragged(self, world: WorldSettings) -> float:
        """Return by how much (m) noise shifts a painted coast, at most."""
        return 0.0 if self.coast is None else raggedness(world.fidelity, self.coast.spacing)

    def stacks(self, world: WorldSettings) -> tuple[NoiseStack, ...]:
        """Return the noise that lets painted coasts wander beyond the sketch."""
        return (NoiseStack(_NOISE, _WAVE * world.extent, _GAIN, most=_WAVES),) if self.painted else ()

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return square parts of the painted coast by their contents; those at the edge have no outer end."""
        contents, boxes = [], []
        if self.coast is not None and self.depth is not None:
            grid = np.array([self.coast.west, self.coast.south, self.coast.spacing, *self.coast.inside.shape])
            for rows, columns in _parts(self.coast.inside.shape):
                samples = [each.inside[rows, columns].tobytes() for each in (self.coast, self.depth)]
                place = np.array([rows.start, columns.start])
                contents.append((grid.tobytes(), place.tobytes(), *samples))
                boxes.append(_part_box(self.coast, rows, columns, world))
        sides = np.array(boxes, np.int64).reshape(-1, 4)
        return content_items(contents, sides[:, :2], sides[:, 2:])

    def pack(self, sampling: Sampling) -> Packed:
        """Return the profile, and the coast with the parts of it that reach the sea or its cliffs."""
        fields, shape = self._fields(sampling.world)
        arrays: dict[str, npt.NDArray[Any]] = {
            "sea_params": sampling.struct(_HEADER, "SeaParams", self._params(sampling)),
            "sea_at": fields.at,
            "sea_form": fields.form,
            "sea_shape": shape,
            "sea_samples": fields.samples,
        }
        visible = self._ranges(sampling.world)[:, 1] > -self.reach - self.ragged(sampling.world)
        return Packed(arrays, self._boxes(sampling.world), "sea", visible)

    def _params(self, sampling: Sampling) -> dict[str, float]:
        waves = sampling.ranges(_NOISE) if self.painted else {"coast_first": 0, "coast_last": 0}
        return waves | {
            "level": 0.0 if self.level is None else self.level,
            "inverse_beach": 1 / self.beach,
            "inverse_swash": 1 / (_SWASH * self.beach),
            "shore_slope": self.shore_slope,
            "shelf": self.shelf,
            "inverse_shelf": 1 / self.shelf,
            "reach": self.reach,
            "ragged": self.ragged(sampling.world),
            "wander": wandering(sampling.world.extent),
            "inverse_far": self._inverse_far(sampling.world),
            "mode": 0 if self.level is None else 1 + self.painted,
            "unused": 0,
        }

    def _inverse_far(self, world: WorldSettings) -> float:
        """Return 1 / (samples from the sketch to where coasts wander fully)²."""
        spacing = 1.0 if self.coast is None else self.coast.spacing
        return (spacing / (_FAR * world.extent)) ** 2

    def _fields(self, world: WorldSettings) -> tuple[PackedFields, Float64Array]:
        """Return the coast and the depth, and ``Fields.shape``.

        Their samples are the spline's coefficients, which blurs them: so an edit changes only what is near.
        """
        shapes = [each for each in (self.coast, self.depth) if each is not None]
        fields = self.cache.get_or_compute(
            world.extent, lambda: pack_fields(shapes, world.extent, is_blurred=True)
        )
        return fields, np.column_stack([fields.scale, *np.zeros((3, len(shapes)))])

    def _ranges(self, world: WorldSettings) -> Float64Array:
        """Least and greatest distance inside the painted sea (m) on each part of the coast, shape (n, 2).

        Parts at the sketch's edge include how far coasts wander beyond it.
        """
        if self.coast is None:
            return np.zeros((0, 2))
        inside = np.pad(self.coast.inside, _MARGIN, mode="edge")
        found = []
        for rows, columns in _parts(self.coast.inside.shape):
            part = inside[rows.start : rows.stop + 2 * _MARGIN, columns.start : columns.stop + 2 * _MARGIN]
            beyond = wandering(world.extent) * _is_at_edge(self.coast.inside.shape, rows, columns).any()
            found.append((float(part.min()) - beyond, float(part.max()) + beyond))
        return np.array(found)

    def _boxes(self, world: WorldSettings) -> LatticeArray:
        if self.coast is None:
            return np.zeros((0, 4), np.int64)
        return np.array([_part_box(self.coast, *part, world) for part in _parts(self.coast.inside.shape)])

    def masks(self, culled: Culled, blocks: int) -> npt.NDArray[np.int32]:
        """Return the water of blocks with sea; an unpainted one may be anywhere."""
        everywhere = np.full(blocks, self.level is not None and not self.painted)
        water = everywhere | (np.diff(culled.lists["sea_starts"]) > 0)
        return mask_bits(water=water, wetness=water)

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add what the omitted noise moves painted coasts by; nothing below is steeper than it was."""
        if self.level is None:
            return
        if not self.painted:
            state.bound *= _STEEPENED
            return
        low, high, at_edge = self._distances(state, sampling.world)
        full, left = omitted_amplitudes(sampling.all_octaves, sampling.octaves, COVER_NOISE)
        missing = float(np.sum((full - left)[: int(_OCTAVES)])) * NOISE_PEAK
        noise = min(1.5 * _RAGGED * COVER_NOISE_CONTRAST * missing, 2.0)
        deepest = 0.0 if self.depth is None else float(self.depth.inside.max())
        ragged = self.ragged(sampling.world)
        is_sea, is_coast = high > -ragged, (low < ragged) & (high > -self.reach - ragged)
        shelving = self.shore_slope + 1.5 * deepest * (1 + _BARS) / self.shelf
        slope = np.where(is_sea, shelving, 0.0)
        slope[is_coast] = np.maximum(slope[is_coast], self._steepest(state.high[is_coast] - self.level))
        state.bound = np.where(low > ragged, 0.0, state.bound)  # the ground has no effect on the bed
        moved = (
            min(1.5 * _WANDERING * sampling.missing(_NOISE), 2.0) * wandering(sampling.world.extent) * at_edge
        )
        moved += noise * ragged
        state.bound += moved * slope + noise * np.where(is_sea, _BARS * deepest, 0.0)
        bottom = self.level - deepest * (1 + _BARS) - self.shore_slope * self.shelf
        state.low = np.where(is_sea, np.minimum(state.low, bottom), state.low)
        state.high = np.maximum(state.high, self.level + _LOWLAND)
        state.scale += abs(self.level) + deepest

    def _distances(
        self, state: DetailState, world: WorldSettings
    ) -> tuple[Float64Array, Float64Array, BoolArray]:
        """Return the range of distances inside the painted sea (m), and whether coasts wander, on blocks."""
        if self.coast is None:
            raise ValueError("a painted sea has a coast")
        shape = self.coast.inside.shape
        index, ranges, edges = self.cache.get_or_compute(
            world,
            lambda: (
                BoxIndex(self._boxes(world)),
                self._ranges(world),
                np.array([_is_at_edge(shape, *part).any() for part in _parts(shape)]),
            ),
        )
        block, part = index.touching(state.blocks)
        low, high = np.full(len(state.blocks), np.inf), np.full(len(state.blocks), -np.inf)
        np.minimum.at(low, block, ranges[part, 0])
        np.maximum.at(high, block, ranges[part, 1])
        at_edge = np.zeros(len(state.blocks), np.bool_)
        np.logical_or.at(at_edge, block, edges[part])
        return low, high, at_edge

    def _steepest(self, ground: Float64Array) -> Float64Array:
        """Return the steepest slope of beaches and cliffs before ground of heights (m) over the level."""
        x = self.reach * (np.arange(_TURNS) + 0.5) / _TURNS
        left = self.reach - x
        envelope = self.shore_slope * x + _CLIFF * x**2 / left
        rise = self.shore_slope + _CLIFF * x * (self.reach + left) / left**2
        z = np.maximum(ground, _LOWLAND)[:, None]
        return np.asarray(1.05 * (z**3 / (z**2 + envelope**2) ** 1.5 * rise).max(axis=1, initial=0.0))

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with the sea in it."""
        if self.level is None:
            return ground
        z = ground.height - self.level
        if self.painted:
            d, noise, depth = self._coast_at(site)
            inland = np.clip(-d / self.beach, 0, 1)
            deep = np.clip(d / self.shelf, 0, 1)
            bed = depth * (1 + _BARS * noise) * deep**2 * (3 - 2 * deep)
            bed += self.shore_slope * self.shelf * deep * (1 - deep) ** 2
            z = np.where(d > 0, -bed, self.below_cliff(raised_lowland(z), np.maximum(-d, 0)))
        else:
            u = np.clip(z / (_SWASH * self.beach), -1, 1)
            z = z * (1 - _EASED * (1 - u * u) ** 2)
            inland, deep = np.clip(z / (_SWASH * self.beach), 0, 1), np.clip(-z * _INVERSE_DEEP, 0, 1)
        lake = cubic(inland * _INVERSE_LANDING)
        water = _WET_EDGE * (1 - inland) ** 2 + (1 - _WET_EDGE) * deep
        return replace(
            ground,
            height=self.level + z,
            lake=lake,
            water=water,
            mountain=ground.mountain * (1 - lake),
            forest=ground.forest * (1 - smooth_rise(water, _FOREST_END, 1 / _INVERSE_FOREST_FADE)),
        )

    def _coast_at(self, site: HostSite) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return the distance inside the shifted coast (m), the noise, and the greatest depth (m)."""
        (fields, _), octaves = self._fields(site.sampling.world), site.sampling.octaves
        first, last = octaves.ranges[COVER_NOISE]
        few = replace(octaves, ranges={COVER_NOISE: (first, min(last, first + int(_OCTAVES)))})
        d, depth = (field_distance(fields, i, site.x, site.y) for i in (0, 1))
        d += self._wandering(site, fields)
        ragged = self.ragged(site.sampling.world)
        near = d > -self.reach - ragged
        noise = np.zeros(len(d))
        raw = fbm(few, COVER_NOISE, site.x[near], site.y[near])
        noise[near] = softened(_RAGGED * COVER_NOISE_CONTRAST * raw)
        return d + ragged * noise, noise, depth

    def _wandering(self, site: HostSite, fields: PackedFields) -> Float64Array:
        """Return how far coasts are shifted beyond the sketch (m)."""
        form, scale = fields.form[0], fields.scale[0]
        u, v = (site.x - fields.at[0, 0]) * scale, (site.y - fields.at[0, 1]) * scale
        away = (u - np.clip(u, 0, form[1] - 1)) ** 2 + (v - np.clip(v, 0, form[2] - 1)) ** 2
        far = smooth_rise(away, 0, 1 / self._inverse_far(site.sampling.world))
        outside = far > 0
        raw = fbm(site.sampling.octaves, _NOISE, site.x[outside], site.y[outside])
        far[outside] *= wandering(site.sampling.world.extent) * softened(_WANDERING * raw)
        return far

    def below_cliff(self, z: Float64Array, x: Float64Array) -> Float64Array:
        """Return ground of a height z > 0 (m) over the level at x m from the coast, under the envelope."""
        left = np.maximum(self.reach - x, 0)
        envelope = x * (self.shore_slope * left + _CLIFF * x)
        under = z * envelope / np.sqrt(np.maximum((z * left) ** 2 + envelope**2, 1e-30))
        return np.where(left > 0, under, z)


def softened(x: Float64Array) -> Float64Array:
    """Return a smooth function within [-1, 1] that begins as 3/2 x."""
    c = np.clip(x, -1, 1)
    return np.asarray(c * (1.5 - 0.5 * c * c))


def raised_lowland(z: Float64Array) -> Float64Array:
    """Return heights (m) over the level above 0: below `LOWLAND` K it is K² / (2K - z)."""
    return np.where(z < _LOWLAND, _LOWLAND**2 / (2 * _LOWLAND - np.minimum(z, _LOWLAND)), z)


def _parts(shape: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
    """Return rows and columns of samples of each part of a coast."""
    for row in range(0, shape[0], _SIDE):
        for column in range(0, shape[1], _SIDE):
            yield slice(row, min(row + _SIDE, shape[0])), slice(column, min(column + _SIDE, shape[1]))


def _is_at_edge(shape: tuple[int, ...], rows: slice, columns: slice) -> BoolArray:
    """Return whether a part of a coast is at the sketch's west, south, east and north edge, shape (4,)."""
    return np.array([columns.start == 0, rows.start == 0, columns.stop == shape[1], rows.stop == shape[0]])


def _part_box(coast: ShapeField, rows: slice, columns: slice, world: WorldSettings) -> LatticeArray:
    """Return the box that a part of a coast affects, lattice units."""
    corner, step = np.array([coast.west, coast.south]), coast.spacing
    low = corner + (np.array([columns.start, rows.start]) - _MARGIN) * step
    high = corner + (np.array([columns.stop, rows.stop]) - 1 + _MARGIN) * step
    sides = np.concatenate([np.floor(low / world.unit), np.ceil(high / world.unit)]).astype(np.int64)
    at_edge = _is_at_edge(coast.inside.shape, rows, columns)
    return np.where(at_edge, [-_OUTSIDE, -_OUTSIDE, _OUTSIDE, _OUTSIDE], sides)
