"""The drained ground: nodes read by quadratic B-splines, gullies and roughness below their spacing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, LatticeArray, StructuredArray
from sketchterrain.geometry.box_index import ITEM
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.io.disk_cache import RecordCache
from sketchterrain.io.resources import code_digest, kernel_constants
from sketchterrain.landforms.base_ground import BaseGround, NodeSource, NodeValues
from sketchterrain.landforms.node_raster import (
    APRON,
    CHUNK,
    NODE_BITS,
    DrainedRaster,
    NodeReader,
    node_level,
)
from sketchterrain.terrain.layers.erosion import FEED, GULLY_PEAK, STEEPEST, gully_octave, gully_steepness
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
    scaled_slope,
)
from sketchterrain.terrain.noise import (
    NOISE_PEAK,
    NoiseStack,
    OctaveTable,
    ValueSlope,
    fbm,
    fbm_slope,
    omitted_amplitudes,
)

if TYPE_CHECKING:
    from sketchterrain.landforms.relief_fields import UnpaintedSettings
    from sketchterrain.landforms.unpainted import UnpaintedGround

_HEADER: Final = "layers/relief.clh"
_GENTLE_GULLIES, _SMOOTH, _LEVEL, _SLOPE_LIMIT, _ROUNDED_UP = kernel_constants(
    _HEADER, "GENTLE_GULLIES", "SMOOTH_GROUND", "LEVEL_GROUND", "SLOPE_LIMIT", "ROUNDED_UP"
)
_PATCHY, _PATCHY_MEAN, _PATCHY_LEAST = kernel_constants(_HEADER, "PATCHY", "PATCHY_MEAN", "PATCHY_LEAST")
# Wavelengths of the noises and the greatest displacement of nodes, in the spacing r0 of the finest ones.
_BEND_WAVES, _GULLY_WAVES, _DETAIL_WAVES = 8.0, 4.0, 2.0
_BEND = 0.8
_FIXED_POINT = 6  # iterations
_BEND_STRETCH = 1.5  # bound of how much steeper displacement makes nodes
# How far gullies and the roughness of ground as steep as 1 go up and down, in their own wavelengths.
_GULLY_DEPTH = 0.1
_DETAIL_DEPTH = 0.06
_COARSE_STEEPER = 4.0  # bound of how much steeper the finest nodes are than coarser ones
_GULLY_SLOPE = 13.0  # bound of an octave's slope, over its depth and times its wavelength


@dataclass(frozen=True)
class UnpaintedNodes:
    """Nodes of unpainted ground with some settings."""

    settings: UnpaintedSettings

    def window(
        self, level: int, column: int, row: int, rows: int, columns: int, *, painted: bool = True
    ) -> NodeValues:
        """Return a window of nodes, without those of the painted region unless ``painted``."""
        nodes: NodeValues = self._ground.window(level, column, row, rows, columns, painted=painted)
        return nodes

    def prepare(
        self, level: int, corners: LatticeArray, rows: int, columns: int, *, painted: bool = True
    ) -> None:
        """Drain at once what windows of a size need, by their south-western nodes (n, 2)."""
        self._ground.prepare(level, corners, rows, columns, painted=painted)

    @property
    def _ground(self) -> UnpaintedGround:
        from sketchterrain.landforms.unpainted import unpainted_ground

        return unpainted_ground(self.settings)


@lru_cache(maxsize=4)
def _disk_cache(settings: UnpaintedSettings) -> RecordCache:
    """Return the cache on disk of chunks, by the settings and the program's sources."""
    return RecordCache("ground", f"{settings}\n{code_digest()}")


@dataclass(frozen=True)
class ReliefScale:
    """Strengths of the noises below the raster."""

    bend: float  # displacement of nodes, lattice units
    gully_depth: float  # m, of an octave of gullies of bare rock, over its amplitude
    detail_depth: float  # m, the same of its roughness, over its slope


@dataclass(frozen=True, eq=False)
class NearNodes:
    """Extremes of the nodes around n blocks."""

    level: int
    extremes: Float64Array  # (n, 5) as of `square_extremes`


@dataclass(frozen=True, eq=False)
class ReliefLayer(TerrainLayer):
    """The drained ground: unpainted nodes without end, and the painted region."""

    name: ClassVar[str] = "relief"

    unpainted: NodeSource
    painted: DrainedRaster | None = field(default=None, metadata=ITEMS)
    base: BaseGround | None = None

    def reader(self) -> NodeReader:
        """Return a reader of its nodes with an empty cache."""
        disk = _disk_cache(self.unpainted.settings) if isinstance(self.unpainted, UnpaintedNodes) else None
        return NodeReader(self.unpainted, self.painted, disk=disk, base=self.base)

    def stacks(self, world: WorldSettings) -> tuple[NoiseStack, ...]:
        """Return the noises of displacement, gullies and roughness."""
        spacing = world.unit * 2.0**NODE_BITS
        return (
            NoiseStack("bend_u", _BEND_WAVES * spacing, 0.5, most=2),
            NoiseStack("bend_v", _BEND_WAVES * spacing, 0.5, most=2),
            NoiseStack("gully", _GULLY_WAVES * spacing, 0.36, most=4),
            NoiseStack("detail", _DETAIL_WAVES * spacing, 0.5),
        )

    def scale(self, world: WorldSettings) -> ReliefScale:
        """Return the strengths of the noises."""
        stacks = {stack.name: stack for stack in self.stacks(world)}
        gully, detail = stacks["gully"], stacks["detail"]
        return ReliefScale(
            bend=_BEND * 2.0**NODE_BITS,
            gully_depth=_GULLY_DEPTH * gully.wavelength / (1 - gully.gain),
            detail_depth=_DETAIL_DEPTH * detail.wavelength / (1 - detail.gain),
        )

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return the blocks of the painted raster."""
        del world
        return np.zeros(0, ITEM) if self.painted is None else self.painted.items()

    def pack(self, sampling: Sampling) -> Packed:
        """Return the scalars; nodes near some blocks are packed for these."""
        scale, bits = self.scale(sampling.world), NODE_BITS + node_level(sampling.cell, sampling.world.extent)
        scalars = sampling.ranges("bend_u", "bend_v", "gully", "detail") | {
            "inverse_spacing": 2.0**-bits / sampling.unit,
            "bend": scale.bend * 2.0**-bits,
            "gully_depth": scale.gully_depth,
            "detail_depth": scale.detail_depth,
            "node_bits": bits,
        }
        return Packed({"relief_params": sampling.struct(_HEADER, "ReliefParams", scalars)})

    def masks(self, culled: Culled, blocks: int) -> npt.NDArray[np.int32]:
        """Return the masks of rock and wetness."""
        del blocks
        near: NearNodes = culled.details
        return mask_bits(mountain=near.extremes[:, 3] > 0, wetness=near.extremes[:, 4] > 0)

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add omitted octaves at the steepest slope near each block.

        Coarser unpainted nodes are drained by themselves: their valleys lie elsewhere, so that they differ
        from the finest by what the ground near a block goes up and down, and are less steep.
        """
        near: NearNodes = culled.details
        scale, unit = self.scale(sampling.world), sampling.unit
        low, high, step, rock, _ = near.extremes.T
        low, high = self._with_faded_paint(state.blocks, near.level, low, high)
        slope = np.sqrt(2) * step / (unit * 2.0 ** (NODE_BITS + near.level))
        bend = max(sampling.missing("bend_u"), sampling.missing("bend_v"))
        moved = np.sqrt(2) * slope * scale.bend * unit * bend
        if near.level:
            moved += high - low
            slope *= _COARSE_STEEPER
        full, resolved = sampling.all_octaves, sampling.octaves
        per_metre = full.scale[slice(*full.ranges["gully"]), 1] / unit
        amplitude, left = omitted_amplitudes(full, resolved, "gully")
        erosion = scale.gully_depth * (_GENTLE_GULLIES + (1 - _GENTLE_GULLIES) * rock / 255)
        slope, cut, deepest = slope * _BEND_STRETCH, np.zeros(len(low)), np.zeros(len(low))
        # An octave follows the slopes of coarser ones: from the first that differs, each counts twice.
        turned = bend > 0 or near.level > 0
        changed = slope * turned
        for whole, part, inverse in zip(amplitude, left, per_metre, strict=True):
            depth = erosion * _steepness(slope)
            omitted = whole + part if turned else whole - part
            cut += GULLY_PEAK * depth * omitted
            deepest += GULLY_PEAK * depth * whole
            steeper = FEED * _GULLY_SLOPE * depth * inverse
            slope, changed = slope + steeper * whole, changed + steeper * omitted
            turned = turned or whole > part
        rough, rough_left = omitted_amplitudes(full, resolved, "detail")
        roughness = scale.detail_depth * (_SMOOTH + (1 - _SMOOTH) * rock / 255) * NOISE_PEAK
        # Omitted octaves, and those left as deep as another slope asks.
        depth = roughness * _depth(slope)
        cut += depth * np.sum(rough - rough_left)
        cut += np.minimum(depth, roughness * changed) * np.sum(rough_left)
        state.bound += moved + cut
        state.low += low - moved - deepest - depth
        state.high += high + moved + deepest + depth
        state.scale += np.maximum(np.abs(low), np.abs(high))

    def _with_faded_paint(
        self, blocks: LatticeArray, level: int, low: Float64Array, high: Float64Array
    ) -> tuple[Float64Array, Float64Array]:
        """Return extremes near blocks with those of the painted region where a level has none of it."""
        if self.painted is None or level < len(self.painted.levels):
            return low, high
        coarsest = self.painted.levels[-1]
        corner = np.array([coarsest.column, coarsest.row])
        size = np.array(coarsest.height.shape[::-1])
        bits = NODE_BITS + len(self.painted.levels) - 1
        box = np.concatenate([corner - 1, corner + size + 1]) << bits
        inside = ((blocks[:, :2] <= box[2:]) & (blocks[:, 2:] >= box[:2])).all(axis=1)
        finest = next(each.height for each in self.painted.levels if not np.isnan(each.height).all())
        return (
            np.where(inside, np.minimum(low, np.nanmin(finest)), low),
            np.where(inside, np.maximum(high, np.nanmax(finest)), high),
        )

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with its gullies and roughness."""
        scale, octaves = self.scale(site.sampling.world), site.sampling.octaves
        rise, rock, wet, data = self._eroded(site)
        free = np.maximum(1.0 - _ROUNDED_UP * data, 0.0)
        steep = np.hypot(rise.east, rise.north)
        depth = free * scale.detail_depth * (_SMOOTH + (1 - _SMOOTH) * rock) * _depth(steep)
        rough = depth * fbm(octaves, "detail", site.x, site.y)
        if site.base is not None:
            rough = rough + data * site.base.detail(site, rise)
        return replace(ground, height=rise.value + rough, mountain=rock, wetness=wet)

    def eroded(self, site: HostSite) -> ValueSlope:
        """Return the splines with their gullies, without roughness."""
        return self._eroded(site)[0]

    def _eroded(self, site: HostSite) -> tuple[ValueSlope, Float64Array, Float64Array, Float64Array]:
        """Return the splines with their gullies, the shares of rock, wetness and data."""
        rise, rock, wet, data, noise = self.smooth(site)
        free = np.maximum(1.0 - _ROUNDED_UP * data, 0.0)
        patches = np.clip(_PATCHY_MEAN + _PATCHY * noise, _PATCHY_LEAST, 1)
        erosion = free * (_GENTLE_GULLIES + (1 - _GENTLE_GULLIES) * rock) * patches
        cut = gullies(self.scale(site.sampling.world), site.sampling.octaves, site, rise, erosion)
        return ValueSlope(*(a + b for a, b in zip(rise, cut, strict=True))), rock, wet, data

    def displaced(self, at: Float64Array, world: WorldSettings, octaves: OctaveTable) -> Float64Array:
        """Return where nodes at positions (n, 2), m, appear: nodes are read at displaced positions."""
        bend, shown = self.scale(world).bend * world.unit, at
        for _ in range(_FIXED_POINT):
            x, y = (to_lattice(each, world.extent) for each in shown.T)
            shown = at - bend * np.stack([fbm(octaves, name, x, y) for name in ("bend_u", "bend_v")], axis=-1)
        return np.asarray(shown)

    def smooth(
        self, site: HostSite
    ) -> tuple[ValueSlope, Float64Array, Float64Array, Float64Array, Float64Array]:
        """Return the nodes' splines with their slope per metre, the share of rock, the wetness, and of data.

        Elevation data are added by their weight. With them comes the noise that displaces nodes eastward.
        """
        world = site.sampling.world
        level = node_level(site.sampling.cell, world.extent)
        bits = NODE_BITS + level
        bend = self.scale(world).bend * 2.0**-bits
        octaves = site.sampling.octaves
        noises = [fbm_slope(octaves, name, site.x, site.y) for name in ("bend_u", "bend_v")]
        bends = [scaled_slope(noise, bend) for noise in noises]
        place = np.stack([site.x, site.y], axis=-1) >> bits
        fraction = (np.stack([site.x, site.y], axis=-1) & ((1 << bits) - 1)) * 2.0**-bits
        u, v = (np.asarray(fraction[:, i] + np.clip(bends[i].value, -1, 1), np.float64) for i in (0, 1))
        if site.nodes is None:
            site.nodes = self.reader()
        height, weight = np.zeros((2, 3, *site.x.shape))
        rock, wet = np.zeros((2, *site.x.shape))
        chunk = place // CHUNK
        order = np.lexsort((chunk[:, 1], chunk[:, 0]))
        starts = np.flatnonzero(np.diff(chunk[order], axis=0).any(axis=1)) + 1
        for own in np.split(order, starts) if len(order) else []:
            corner = place[own].min(axis=0) - APRON[0]
            columns, rows = place[own].max(axis=0) + APRON[1] + 1 - corner
            nodes = site.nodes.window(level, *(int(n) for n in (*corner, rows, columns)))
            column, row = (place[own] - corner).T
            height[:, own] = _spline(nodes.height, column, row, u[own], v[own])
            if self.base is not None:
                weight[:, own] = _spline(nodes.base, column, row, u[own], v[own])
            for share, values in ((rock, nodes.rock), (wet, nodes.wetness)):
                share[own] = _bilinear(values, column, row, u[own], v[own]) / 255
        rise, data = (_displaced_slope(each, bends, 2.0**-bits, world.unit) for each in (height, weight))
        if site.base is not None:
            inside = data.value > 0.0
            z = [np.where(inside, each, 0.0) for each in site.base.heights[:3]]
            rise = ValueSlope(
                rise.value + data.value * z[0],
                rise.east + (data.east * z[0] + data.value * z[1]),
                rise.north + (data.north * z[0] + data.value * z[2]),
            )
        return rise, rock, wet, data.value, noises[0].value


def _displaced_slope(
    nodes: Float64Array, bends: Sequence[ValueSlope], across: float, unit: float
) -> ValueSlope:
    """Return values with slopes per spacing (3, n) with slopes per metre, of nodes displaced by noise."""
    (value, east, north), (bu, bv) = nodes, bends
    return ValueSlope(
        value,
        (east * (across + bu.east) + north * bv.east) / unit,
        (east * bu.north + north * (across + bv.north)) / unit,
    )


def _steepness(steep: Float64Array) -> Float64Array:
    """Return a bound of how deep gullies are on slopes up to one."""
    return gully_steepness(np.minimum(steep * steep, STEEPEST))


def _depth(steep: Float64Array) -> Float64Array:
    """Return how deep roughness is on a slope."""
    steep = steep + _LEVEL
    return np.asarray(steep / (1 + _SLOPE_LIMIT * steep))


def _spline(
    height: npt.NDArray[np.float32], column: LatticeArray, row: LatticeArray, u: Float64Array, v: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return values of quadratic B-splines at (u, v) beyond nodes, and their slopes per spacing."""
    across, up = (np.floor(f + 0.5).astype(np.int64) for f in (u, v))
    value, east, north = np.zeros((3, *u.shape))
    weights_u, slopes_u = _spline_weights(u - across)
    weights_v, slopes_v = _spline_weights(v - up)
    for j in range(3):
        for i in range(3):
            z = height[row + up + j - 1, column + across + i - 1].astype(np.float64)
            value += weights_v[j] * weights_u[i] * z
            east += weights_v[j] * slopes_u[i] * z
            north += slopes_v[j] * weights_u[i] * z
    return value, east, north


def _spline_weights(f: Float64Array) -> tuple[tuple[Float64Array, ...], tuple[Float64Array, ...]]:
    return (0.5 * (0.5 - f) ** 2, 0.75 - f * f, 0.5 * (0.5 + f) ** 2), (f - 0.5, -2 * f, f + 0.5)


def _bilinear(
    share: npt.NDArray[np.uint8], column: LatticeArray, row: LatticeArray, u: Float64Array, v: Float64Array
) -> Float64Array:
    across, up = (np.floor(f).astype(np.int64) for f in (u, v))
    fu, fv, column, row = u - across, v - up, column + across, row + up
    below = share[row, column] * (1 - fu) + share[row, column + 1] * fu
    above = share[row + 1, column] * (1 - fu) + share[row + 1, column + 1] * fu
    return np.asarray(below * (1 - fv) + above * fv)


def gullies(
    scale: ReliefScale, octaves: OctaveTable, site: HostSite, rise: ValueSlope, erosion: Float64Array
) -> ValueSlope:
    """Return the height added by erosion, with its slope per metre for constant directions of the waves."""
    total = ValueSlope(*np.zeros((3, *site.x.shape)))
    for i in range(*octaves.ranges["gully"]):
        depth = scale.gully_depth * octaves.scale[i, 0] * erosion
        total = gully_octave(octaves, i, site, depth, rise, total)
    return total
