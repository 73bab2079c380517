"""Point features: painted ones and fill, as packed for kernels, and the warp of their outlines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import ClassVar, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array, LatticeArray, StructuredArray
from sketchterrain.geometry.box_index import BoxIndex, row_difference, rows_only_in
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.landforms.placement.feature_types import (
    FEATURE_TYPES,
    area_profile,
    conifer_share,
)
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.terrain.layers.layer import (
    ITEMS,
    Culled,
    DetailState,
    HostSamples,
    HostSite,
    LayerChange,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
    effective_cell,
    mask_bits,
    smooth_rise,
)
from sketchterrain.terrain.noise import NoiseStack, OctaveTable, fbm

_HEADER: Final = "layers/points.clh"
SLOT_FOREST, SLOT_DUNE = (int(slot) for slot in kernel_constants(_HEADER, "SLOT_FOREST", "SLOT_DUNE"))
"""Indices of a block's lists by kind of feature; dunes have one for each style from `SLOT_DUNE` on."""
FEATURE_COLUMNS: Final = kernel_columns(_HEADER, "FeatureRow")
"""Columns of packed features."""
_SLOTS = ("forest",)  # then the styles of dunes
_AREAS = [FEATURE_TYPES.index(name) for name in (*_SLOTS, "dune")]

# Noises must not depend on placed features: an edit in one corner would reshape the whole world.
_WARP_SHARE = 1 / 5  # of the extent


@dataclass(frozen=True)
class PackedFeatures:
    """Features that may affect the blocks of one launch, in the order of their ids."""

    at: LatticeArray  # (n, 2) centres, lattice units
    row: Float64Array  # (n, 4) columns of `FEATURE_COLUMNS`
    support: Float64Array  # (n,) radius of influence, m
    slot: LatticeArray  # (n,) kind of feature: the index of its list in a block

    def __getitem__(self, name: str) -> Float64Array:
        """Return a column of `FEATURE_COLUMNS`, shape (n,)."""
        return self.row[:, FEATURE_COLUMNS[name]]


@dataclass(frozen=True, eq=False)
class PointsLayer(TerrainLayer):
    """Point features, which forests and dunes are made of, and the warp of their outlines."""

    name: ClassVar[str] = "points"

    painted: StructuredArray = field(metadata=ITEMS)  # placed features (dtype ``FEATURE``), sorted by id
    fill: Fill = field(metadata=ITEMS)  # features of unpainted areas

    @cached_property
    def dune_styles(self) -> tuple[tuple[float, float], ...]:
        """Distinct (wavelength in m, wind in degrees) of the dunes, sorted; the key of their layer."""
        dunes = self.painted[self.painted["type"] == FEATURE_TYPES.index("dune")]
        painted = {(float(dune["wavelength"]), float(dune["wind"])) for dune in dunes}
        return tuple(sorted(painted | self.fill.dune_styles))

    @property
    def slots(self) -> int:
        """Number of feature lists of a block."""
        return len(_SLOTS) + len(self.dune_styles)

    @cached_property
    def has_conifer_shares(self) -> bool:
        """Whether any forest's share of conifers is set instead of derived from elevation."""
        forests = self.painted[self.painted["type"] == FEATURE_TYPES.index("forest")]
        shares = (*conifer_share(forests["peakiness"]), self.fill.conifers)
        return bool(max(shares) >= 0.0)

    def without_forests(self) -> PointsLayer:
        """Return the dunes alone: all features on which heights depend."""
        dunes = self.painted[self.painted["type"] == FEATURE_TYPES.index("dune")]
        empty = replace(self.fill, rules={}, painted=dunes[:0], images={}, near=None, replaced=dunes[:0])
        return PointsLayer(dunes, self.fill if self.fill.dune_styles else empty)

    def stacks(self, world: WorldSettings) -> tuple[NoiseStack, ...]:
        """Return the noises of the warp."""
        outline = world.extent * _WARP_SHARE
        return NoiseStack("warp_u", outline, 0.45, most=3), NoiseStack("warp_v", outline, 0.45, most=3)

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return the painted features."""
        del world
        return self.painted

    def boxes(self, rows: StructuredArray, world: WorldSettings) -> LatticeArray:
        """Return boxes around the features' support."""
        at, support = self._positions(rows, world), self.support(rows["radius"], world)
        wide = np.ceil(support / world.unit).astype(np.int64)[:, None]
        return np.concatenate([at - wide, at + wide], axis=1)

    def change(self, old: TerrainLayer, world: WorldSettings) -> LayerChange | None:
        """Return changed features, of the fill too; None if the fill may differ anywhere."""
        assert isinstance(old, PointsLayer)  # noqa: S101 # layers are compared with their own kind
        removed, added = row_difference(old.painted, self.painted)
        fills = self._fill_difference(old)
        if fills is None:
            return None
        # A fill feature that an edit made a painted one, unchanged, is in both.
        gone, came = (
            unique_by_id(parts)
            for parts in ([old.painted[removed], fills[0]], [self.painted[added], fills[1]])
        )
        gone, came = (_areas(each) for each in (rows_only_in(gone, came), rows_only_in(came, gone)))
        boxes = np.concatenate([old.boxes(gone, world), self.boxes(came, world)])
        return LayerChange(removed, added, boxes, self.boxes(np.concatenate(fills), world))

    def _fill_difference(self, old: PointsLayer) -> tuple[StructuredArray, StructuredArray] | None:
        if old.fill is self.fill or max(old.fill.max_radius, self.fill.max_radius) == 0:
            return self.painted[:0], self.painted[:0]
        return old.fill.difference(self.fill)

    def _positions(self, rows: StructuredArray, world: WorldSettings) -> LatticeArray:
        return to_lattice(np.stack([rows["x"], rows["y"]], axis=-1), world.extent)

    def support(self, radius: npt.ArrayLike, world: WorldSettings) -> Float64Array:
        """Return the radius of influence (m) of features of a ground radius (m), padded for rounding."""
        radii = np.asarray(radius, np.float64)
        return np.asarray(radii * support_radii(world.fidelity) * (1 + 1e-5) + 2 * world.unit)

    def fill_near(
        self, blocks: LatticeArray, world: WorldSettings, *, min_radius: float = 0.0
    ) -> list[StructuredArray]:
        """Return the fill of at least a radius (m) that may affect blocks (n, 4), with duplicates."""
        if self.fill.max_radius < min_radius or self.fill.max_radius == 0:
            return []
        margin = self.fill.max_radius * support_radii(world.fidelity) + 1
        metres = blocks * world.unit + margin * np.array([-1, -1, 1, 1])
        return [self.fill.within(*area, min_radius=min_radius) for area in _merge_if_compact(metres)]

    def pack(self, sampling: Sampling) -> Packed:
        """Return the scalars; the features near some blocks are packed for these."""
        scalars = {"warp": outline_warp(sampling.world.fidelity), "slots": self.slots} | sampling.ranges(
            "warp_u", "warp_v"
        )
        return Packed({"point_params": sampling.struct(_HEADER, "PointParams", scalars)})

    def pack_features(
        self, features: StructuredArray, world: WorldSettings, cell_size: float
    ) -> PackedFeatures:
        """Return forests and dunes as kernels read them, without those too small for the cell size.

        Features narrower than two cells fade out: strength × (0 at a radius of one cell … 1 at two).
        """
        cell = effective_cell(cell_size)
        radius = features["radius"].astype(np.float64)
        fade = smooth_rise(radius / cell, 1, 1)
        visible = (fade > 0) & np.isin(features["type"], _AREAS)
        features, radius, fade = features[visible], radius[visible], fade[visible]
        row = np.zeros((features.size, 4))
        row[:, FEATURE_COLUMNS["inverse_radius"]] = 1 / radius
        row[:, FEATURE_COLUMNS["feature_strength"]] = features["strength"] * fade
        return PackedFeatures(
            self._positions(features, world), row, self.support(radius, world), self._slots_of(features)
        )

    def _slots_of(self, features: StructuredArray) -> LatticeArray:
        slot = np.empty(features.size, dtype=np.int64)
        for number, name in enumerate(_SLOTS):
            slot[features["type"] == FEATURE_TYPES.index(name)] = number
        is_dune = features["type"] == FEATURE_TYPES.index("dune")
        for number, (wavelength, wind) in enumerate(self.dune_styles):
            of_style = is_dune & (features["wavelength"] == wavelength) & (features["wind"] == wind)
            slot[of_style] = len(_SLOTS) + number
        return slot

    def masks(self, culled: Culled, blocks: int) -> npt.NDArray[np.int32]:
        """Return the masks of the kinds of features near each block."""
        del blocks
        some = np.diff(culled.lists["point_starts"], axis=-1) > 0
        dunes = np.asarray(some[:, SLOT_DUNE:].any(axis=-1))
        return mask_bits(dune=dunes, forest=some[:, SLOT_FOREST])

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Find the greatest effects of the features near each block, for the layers made of them."""
        state.near = _near_points(state.blocks, culled, sampling.world)

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Find the features near the points."""
        sampling = site.sampling
        finder = site.finder or PointFinder(self, sampling.world)
        block = np.array([[site.x.min(), site.y.min(), site.x.max(), site.y.max()]])
        near = finder.near(block, min_radius=sampling.cell)
        packed = self.pack_features(near, sampling.world, sampling.cell)
        warp = outline_warp(sampling.world.fidelity)
        site.points = PointSite(site.x, site.y, sampling.unit, packed, sampling.octaves, warp)
        return ground


def outline_warp(fidelity: float) -> float:
    """Return the greatest displacement of features' outlines, in radii."""
    return 0.34 - 0.2 * fidelity - 0.5 * max(fidelity - 0.8, 0.0)


def support_radii(fidelity: float) -> float:
    """Return the radius of influence of features over their radius.

    The warp moves a point by up to its length in each direction.
    """
    return float(1 + np.sqrt(2) * outline_warp(fidelity))


def _areas(features: StructuredArray) -> StructuredArray:
    """Return the forests and dunes among features; mountains and hills change the relief alone."""
    return features[np.isin(features["type"], _AREAS)]


class PointFinder:
    """Features near blocks, by an index of the painted ones."""

    def __init__(self, layer: PointsLayer, world: WorldSettings, index: BoxIndex | None = None) -> None:
        self._layer = layer
        self._world = world
        self._index = BoxIndex(layer.boxes(layer.painted, world)) if index is None else index

    def updated(self, layer: PointsLayer, change: LayerChange) -> PointFinder:
        """Return the finder of a layer with changed painted features."""
        boxes = layer.boxes(layer.painted[change.added], self._world)
        return PointFinder(layer, self._world, self._index.updated(change.removed, change.added, boxes))

    def near(self, blocks: LatticeArray, *, min_radius: float) -> StructuredArray:
        """Return the painted features whose support meets any block (n, 4), and the fill that may, by id.

        Blocks are west, south, east, north in lattice units; fill with a radius (m) below ``min_radius`` is
        omitted.
        """
        fill = self._layer.fill_near(blocks, self._world, min_radius=min_radius)
        return unique_by_id([self.painted_near(blocks), *fill])

    def painted_near(self, blocks: LatticeArray) -> StructuredArray:
        """Return the painted features whose support meets any of the blocks, sorted by id."""
        _, item = self._index.touching(blocks)
        found: StructuredArray = self._layer.painted[np.unique(item)]
        return found


def unique_by_id(parts: Sequence[StructuredArray]) -> StructuredArray:
    """Return all features of some arrays once, sorted by id."""
    features = np.concatenate(parts)
    _, unique = np.unique(features["id"], return_index=True)
    return features[unique]


def _merge_if_compact(areas: Float64Array) -> list[tuple[float, float, float, float]]:
    """Return one bounding rectangle where it is little larger than the rectangles together."""
    west, south = areas[:, :2].min(axis=0)
    east, north = areas[:, 2:].max(axis=0)
    covered = float(np.sum((areas[:, 2] - areas[:, 0]) * (areas[:, 3] - areas[:, 1])))
    if (east - west) * (north - south) <= 2 * covered:
        return [(float(west), float(south), float(east), float(north))]
    return [(float(w), float(s), float(e), float(n)) for w, s, e, n in areas]


@dataclass(frozen=True)
class NearPoints:
    """Greatest effects of the dunes near each of n blocks."""

    cover: Float64Array  # (n, styles) 0 … 1
    dune: Float64Array  # (n, styles) height of the highest dunes, m


def _near_points(blocks: LatticeArray, culled: Culled, world: WorldSettings) -> NearPoints:
    packed, lists = culled.details, culled.lists
    count = len(blocks)
    starts, member = lists["point_starts"], lists["point_list"]
    of_slot = np.diff(starts, axis=-1)
    slots = of_slot.shape[1]
    if not member.size:
        styles = np.zeros((count, slots - SLOT_DUNE))
        return NearPoints(styles, styles)
    block, slot = np.divmod(np.repeat(np.arange(count * slots), of_slot.ravel()), slots)
    at, column = packed.at[member], {name: packed[name][member] for name in FEATURE_COLUMNS}
    outside = np.maximum(np.maximum(blocks[block, :2] - at, at - blocks[block, 2:]), 0) * world.unit
    radii = np.hypot(outside[:, 0], outside[:, 1]) * column["inverse_radius"]
    bent = np.maximum(radii - np.sqrt(2) * outline_warp(world.fidelity), 0)
    cover, dune = np.zeros((count, slots)), np.zeros((count, slots))
    np.add.at(cover, (block, slot), area_profile(bent) ** 4)
    np.maximum.at(dune, (block, slot), column["feature_strength"])
    cover = np.minimum(cover**0.25, 1.0)[:, SLOT_DUNE:]
    return NearPoints(cover, dune[:, SLOT_DUNE:])


@dataclass(frozen=True)
class PointSite:
    """Lattice positions with the features near them and the warp there."""

    x: LatticeArray
    y: LatticeArray
    unit: float
    packed: PackedFeatures
    octaves: OctaveTable
    warp: float  # greatest displacement of outlines, in radii

    @cached_property
    def _metres(self) -> Float64Array:
        """Positions from the first one (m), (n, 2)."""
        return np.stack([self.x - self.x[:1], self.y - self.y[:1]], axis=-1) * self.unit

    @cached_property
    def _bend(self) -> tuple[Float64Array, ...]:
        """Displacement of outlines eastward and northward, in radii."""
        noises = (fbm(self.octaves, name, self.x, self.y) for name in ("warp_u", "warp_v"))
        return tuple(self.warp * np.clip(noise, -1, 1) for noise in noises)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._metres)

    def pairs_within_support(self, slot: int) -> PointPairs:
        """Pair these positions with the features of a slot whose support contains them."""
        packed = self.packed
        selected = np.flatnonzero(packed.slot == slot)
        if not (selected.size and self.x.size):
            return PointPairs(np.zeros(0, np.int64), np.zeros(0, np.int64))
        centre = (packed.at[selected] - [self.x[0], self.y[0]]) * self.unit
        wide = packed.support[selected] * (1 + 1e-9) + 1e-6
        found = self._tree.query_ball_point(centre, wide)
        count = [len(each) for each in found]
        point = np.fromiter(chain.from_iterable(found), dtype=np.int64, count=sum(count))
        return PointPairs(point, np.repeat(selected, count))

    def distances(self, pairs: PointPairs) -> Float64Array:
        """Return the distances of positions from features' centres, in radii."""
        packed, point, feature = self.packed, pairs.point, pairs.feature
        scale = self.unit * packed["inverse_radius"][feature]
        east, north = (bend[point] for bend in self._bend)
        dx = (self.x[point] - packed.at[feature, 0]) * scale + east
        dy = (self.y[point] - packed.at[feature, 1]) * scale + north
        return np.asarray(np.hypot(dx, dy))

    def summed(self, pairs: PointPairs, values: Float64Array) -> Float64Array:
        """Sum values of pairs at each position, in the order of the features."""
        return np.asarray(np.bincount(pairs.point, values, minlength=len(self.x)), dtype=np.float64)

    def areas(self, slot: int) -> tuple[Float64Array, Float64Array]:
        """Return the cover of an area type, 0 … 1, and the cover-weighted mean of its strength."""
        pairs = self.pairs_within_support(slot)
        cover = area_profile(self.distances(pairs))
        strength = self.packed["feature_strength"][pairs.feature]
        total, weights, strengths = (self.summed(pairs, each) for each in (cover**4, cover, cover * strength))
        mean = np.where(weights > 1e-6, strengths / np.maximum(weights, 1e-6), 0)
        return np.minimum(np.sqrt(np.sqrt(total)), 1), mean


class PointPairs(NamedTuple):
    """Pairs of positions and features, by index, in the order of the features."""

    point: LatticeArray
    feature: LatticeArray
