"""Corridors: rivers as arcs of their centrelines, with the valleys that they carve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, LatticeArray, StructuredArray
from sketchterrain.geometry.box_index import ITEM, BoxIndex, content_items
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.landforms.placement.feature_types import River, cubic
from sketchterrain.stages.runner import Runner
from sketchterrain.terrain.centrelines import (
    LEAST_WIDTH,
    MAX_TOLERANCE,
    TOLERANCE_CELLS,
    VALLEY_RUN_PER_DEPTH,
    PreparedCentreline,
    arc_boxes,
    flatten_to_arcs,
    meetings_on,
    nearest_on_arc,
    prepare_centreline,
    signed_square,
    tolerance_cell,
    typical_half_width,
)
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
    smooth_rise,
)
from sketchterrain.terrain.noise import FINEST_CELL

_HEADER: Final = "layers/corridors.clh"
ARC: Final = kernel_columns(_HEADER, "ArcRow")
SECTION: Final = kernel_columns(_HEADER, "SectionRow")
"""Columns of packed arcs of rivers, and of rivers at one end of an arc."""
_CHANNEL_NAMES = "NEARNESS WEIGHT_SCALE BANK_WIDTH BANK_RISE FLOODPLAIN_SLOPE CHANNEL_CELLS MATERIAL_CELLS"
_BANK_NAMES = "POOL SHOAL CUT_BANK POINT_BAR SWAYED_BANK BAR_WIDTH BARE_BANK INVERSE_FRINGE"
_NEARNESS, _WEIGHT_SCALE, _BANK_WIDTH, _BANK_RISE, _FLOODPLAIN_SLOPE, _CHANNEL_CELLS, _MATERIAL_CELLS = (
    kernel_constants(_HEADER, *_CHANNEL_NAMES.split())
)
_POOL, _SHOAL, _CUT_BANK, _POINT_BAR, _SWAYED_BANK, _BAR_WIDTH, _BARE_BANK, _INVERSE_FRINGE = (
    kernel_constants(_HEADER, *_BANK_NAMES.split())
)
# Difference of the bed by arcs for a coarser cell: in cells along the banks' slope, and in widths along the
# fall. Measured, not proven: blends of arcs shift where these are split differently.
_ARC_SLOPES, _ARC_WIDTHS = 0.4, 0.8
_POINTS_AT_ONCE = 1 << 15
_SIDE_SLOPE = 1.5  # greatest slope of a valley's sides over their mean one


@dataclass(frozen=True)
class PackedRivers:
    """Arcs of all centrelines (``Rivers`` of ``kernels/layers/corridors.clh``)."""

    unit: float  # m a lattice unit
    start: LatticeArray  # (n, 2) upstream ends, lattice units
    arc: Float64Array  # (n, 8) columns of `ARC`
    up: Float64Array  # (n, 4) columns of `SECTION`
    down: Float64Array  # (n, 4)

    @property
    def chord(self) -> Float64Array:
        """Vectors from the upstream to the downstream ends (m), shape (n, 2)."""
        return self.arc[:, [ARC["chord_east"], ARC["chord_north"]]]

    def ends(self, name: str) -> tuple[Float64Array, Float64Array]:
        """Return a column of `SECTION` at the upstream and at the downstream ends, shape (n,) each."""
        return self.up[:, SECTION[name]], self.down[:, SECTION[name]]

    def is_in(self, other: PackedRivers) -> BoolArray:
        """Return which arcs are among those of other centrelines, shape (n,)."""
        own, others = (
            np.ascontiguousarray(np.column_stack([each.start, each.arc])).view("V80")[:, 0].tolist()
            for each in (self, other)
        )
        return np.fromiter(map(frozenset(others).__contains__, own), np.bool_, len(own))

    @cached_property
    def boxes(self) -> LatticeArray:
        """Boxes (n, 4) that arcs affect, lattice units."""
        radius = np.maximum(*self.ends("valley_radius"))
        return arc_boxes(self.start, self.chord, self.arc[:, ARC["arc_bend"]], radius, self.unit)

    @cached_property
    def index(self) -> BoxIndex:
        """Index of the boxes."""
        return BoxIndex(self.boxes)


@dataclass(frozen=True, eq=False)
class Course:
    """A river with its centreline, ready to be flattened to arcs."""

    river: River
    valley_radius: Float64Array  # (m,) radius of influence at each point of the centreline, m
    anchor: LatticeArray  # (2,) its source, lattice units
    line: PreparedCentreline  # relative to the anchor, m: far from the origin it would round otherwise

    pieces: StructuredArray  # `ITEM` rows: its parts between control points, by the inputs of their arcs

    def is_hidden(self, cell: float) -> bool:
        """Return whether it is a stream that cells of at least this size (m) do not show."""
        widest = self.line.river.centreline_width.max()
        return self.river.label == 0 and widest <= _CHANNEL_CELLS * cell

    @property
    def change(self) -> float:
        """Height (m) that a stream changes the ground by, at most."""
        radius, deep = float(self.valley_radius.max()), float(self.river.centreline_depth.max())
        return (1 + _BANK_RISE) * deep + radius / VALLEY_RUN_PER_DEPTH


def _prepared(river: River, valley_radius: Float64Array, meetings: Float64Array, extent: float) -> Course:
    """Prepare a river whose centreline meets others at some points (n, 2), m."""
    unit = metres_per_unit(extent)
    anchor = to_lattice(river.centreline[0, :2], extent)
    away = np.append(anchor * unit, 0.0)
    local = replace(river, points=river.points - away, centreline=river.centreline - away)
    if river.centreline_width.min() < LEAST_WIDTH:
        width = np.maximum(river.centreline_width, np.float32(LEAST_WIDTH))
        local = replace(local, centreline_width=width)
    line = prepare_centreline(local, valley_radius, meetings - away[:2])
    return Course(river, valley_radius, anchor, line, _pieces(anchor, line, unit))


@dataclass(frozen=True, eq=False)
class CorridorsLayer(TerrainLayer):
    """Rivers on their way through the terrain."""

    name: ClassVar[str] = "corridors"
    item_masks: ClassVar[tuple[str, ...]] = ("water", "wetness")

    courses: tuple[Course, ...] = field(metadata=ITEMS)

    @classmethod
    def of(
        cls,
        rivers: Sequence[River],
        valley_radii: Sequence[Float64Array],
        extent: float,
        run: Runner | None = None,
    ) -> CorridorsLayer:
        """Return the layer of rivers with their valleys' radii at each point of the centreline, m."""
        ends = np.array([river.centreline[-1, :2] for river in rivers]).reshape(-1, 2)
        run = Runner() if run is None else run
        return cls(
            tuple(
                run(
                    _prepared,
                    river,
                    radii,
                    river.centreline[meetings_on(river, ends), :2],
                    extent,
                    hashed=False,
                )
                for river, radii in run.steps(list(zip(rivers, valley_radii, strict=True)))
            )
        )

    @property
    def rivers(self) -> tuple[River, ...]:
        """The rivers."""
        return tuple(course.river for course in self.courses)

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return the parts of rivers between control points.

        The arcs there depend on the curve, on the samples of the centreline from one control point to the
        other, and on which of these are ends of arcs: where all of these are bit-equal, so are the arcs for
        every cell size.
        """
        del world
        rows = np.concatenate([np.zeros(0, ITEM), *(course.pieces for course in self.courses)])
        return np.asarray(rows[np.argsort(rows, order=("id", "digest"))])

    def pack_key(self, cell: float) -> float:
        """Return the cell size that arcs are made for."""
        return tolerance_cell(cell)

    def pack(self, sampling: Sampling) -> Packed:
        """Return the arcs."""
        rivers = self.arcs(sampling.world.extent, sampling.cell)
        arrays = {
            "river_from": rivers.start,
            "river_arc": rivers.arc,
            "river_up": rivers.up,
            "river_down": rivers.down,
        }
        unchanged = rivers.is_in(self.arcs(sampling.world.extent))
        return Packed(arrays, rivers.boxes, "river", details=(rivers, unchanged))

    def arcs(self, extent: float, cell_size: float = FINEST_CELL) -> PackedRivers:
        """Return the rivers' centrelines as arcs, within 1 % of the cell size of their splines.

        Where rivers meet, both have the same point. Streams that the cells do not show are left out.
        """
        cell = tolerance_cell(cell_size)
        return self.cache.get_or_compute((extent, cell), lambda: self._flattened(extent, cell))

    def _flattened(self, extent: float, cell: float) -> PackedRivers:
        unit = metres_per_unit(extent)
        shown = [course for course in self.courses if not course.is_hidden(cell)]
        if not shown:
            empty = np.zeros((0, 4))
            return PackedRivers(unit, np.zeros((0, 2), np.int64), np.zeros((0, 8)), empty, empty)
        courses = [flatten_to_arcs(course.line, cell_size=cell, least=unit) for course in shown]
        arcs = [len(each.bend) for each in courses]
        starts, ends = (
            np.concatenate([c.points[part] for c in courses]) for part in (slice(-1), slice(1, None))
        )
        anchor = np.repeat([course.anchor for course in shown], arcs, axis=0)
        start, end = (to_lattice(each[:, :2], extent) + anchor for each in (starts, ends))
        vector = (end - start) * unit
        length2 = np.sum(vector**2, axis=1)
        valid = length2 > 0
        arc = np.zeros((len(start), 8))
        for name, values in {
            "chord_east": vector[:, 0],
            "chord_north": vector[:, 1],
            "inverse_chord_square": 1 / np.where(valid, length2, 1),
            "typical_half_width": np.repeat([typical_half_width(course.river) for course in shown], arcs),
            "arc_bend": np.concatenate([each.bend for each in courses]),
            "arc_lean": 0.5 * (starts[:, 6] + ends[:, 6]),
            "sway_up": starts[:, 7],
            "sway_down": ends[:, 7],
        }.items():
            arc[:, ARC[name]] = values
        return PackedRivers(unit, start[valid], arc[valid], starts[valid, 2:6], ends[valid, 2:6])

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add the change by channels that fade out, and by arcs flattened for a coarser cell."""
        for course in self.courses:
            if course.is_hidden(tolerance_cell(sampling.cell)):
                blocks = state.blocks[:, None]
                beside = (blocks[..., :2] <= course.pieces["high"]) & (
                    blocks[..., 2:] >= course.pieces["low"]
                )
                state.bound += course.change * beside.all(axis=-1).any(axis=-1)
        starts, member = culled.lists["river_starts"], culled.lists["river_list"]
        rivers, unchanged = culled.details.details  # with the arcs that a finer cell has too
        cell = sampling.cell
        count = len(starts) - 1
        lost, depth, moved = np.zeros((3, count))
        if not member.size:
            return
        block = np.repeat(np.arange(count), np.diff(starts))
        half_width = np.minimum(*rivers.ends("half_width"))[member]
        deep = np.maximum(*rivers.ends("river_depth"))[member]
        np.maximum.at(lost, block, 1 - smooth_rise(2 * half_width / cell / _CHANNEL_CELLS, 1, 1))
        np.maximum.at(depth, block, deep)
        tolerance = tolerance_cell(cell)
        if tolerance > FINEST_CELL:
            water, radius = rivers.ends("water_surface"), rivers.ends("valley_radius")
            fall = np.abs(np.subtract(*water))[member]
            steep = fall / np.maximum(np.hypot(*rivers.chord[member].T), 1e-3)
            # The valley's sides, too, may be steep: through a plateau they are as high as it is.
            rise = np.maximum(state.high[block] - np.minimum(*water)[member], 0)
            # In the water of a deep river a brook's sides are that river's.
            side = _SIDE_SLOPE * rise / np.maximum(np.minimum(*radius)[member], half_width)
            bank = 1.5 * _BANK_RISE / _BANK_WIDTH * (1 + _CUT_BANK)  # of a cut bank, depths a half width
            slope = np.maximum(max(bank, 2.0) * deep / half_width, side)
            off = _ARC_SLOPES * tolerance * slope + _ARC_WIDTHS * 2 * half_width * steep
            off[unchanged[member]] = 0
            np.maximum.at(moved, block, off)
        state.bound += (1 + _BANK_RISE) * depth * lost + moved

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with rivers carved into it; in a lake a river builds no dam."""
        rivers = self.arcs(site.sampling.world.extent, site.sampling.cell)
        if not len(rivers.start):
            return ground
        carved, river = _carved(ground.height, rivers, site)
        height = carved + (np.minimum(carved, ground.height) - carved) * ground.lake
        return replace(ground, height=height, water=np.maximum(ground.water, river))


def _pieces(anchor: LatticeArray, line: PreparedCentreline, unit: float) -> StructuredArray:
    """Return the inputs of the arcs between two control points, and the box of their support."""
    # The first and last sample of the centreline on each cubic of the spline, both ends included.
    number = np.arange(len(line.curve), dtype=np.float64)
    first = np.searchsorted(line.along, number, side="right") - 1
    last = np.searchsorted(line.along, number + 1.0, side="left")
    samples = np.column_stack([line.along, line.line, line.anchors, line.steep])
    widest = float(line.river.centreline_width.max())
    whole = (
        anchor.tobytes()
        + np.float64(typical_half_width(line.river)).tobytes()
        + bytes(widest > 2.0 * cell for cell in TOLERANCE_CELLS)
    )
    boxes = _boxes(line, first, last, margin=MAX_TOLERANCE + 3.0 * unit) / unit + np.tile(anchor, 2)
    contents = [
        (whole, line.curve[number].tobytes(), samples[first[number] : last[number] + 1].tobytes())
        for number in range(len(boxes))
    ]
    low, high = np.floor(boxes[:, :2]).astype(np.int64), np.ceil(boxes[:, 2:]).astype(np.int64)
    return content_items(contents, low, high)


def _boxes(
    course: PreparedCentreline, first: npt.NDArray[np.intp], last: npt.NDArray[np.intp], *, margin: float
) -> Float64Array:
    """Return rectangles (m, relative to the centreline's source) around each cubic, as wide as the valley."""
    c = course.curve
    # A cubic is within the corners of its Bézier form.
    corners = np.stack(
        [c[..., 0], c[..., 0] + c[..., 1] / 3, c[..., 0] + (2 * c[..., 1] + c[..., 2]) / 3, c.sum(axis=-1)]
    )
    pairs = np.stack([first, np.minimum(last + 1, len(course.line) - 1)], axis=-1).ravel()
    radius = np.maximum(np.maximum.reduceat(course.line[:, 5], pairs)[::2], course.line[last, 5])
    wide = (radius * (1 + 1e-5) + margin)[:, None]
    return np.column_stack([corners.min(axis=0) - wide, corners.max(axis=0) + wide])


def _carved(height: Float64Array, rivers: PackedRivers, site: HostSite) -> tuple[Float64Array, Float64Array]:
    """Return the carved heights, and the mask of water."""
    cell, unit = site.sampling.cell, site.sampling.unit
    weights, nearest = np.zeros(height.shape), np.full(height.shape, 1e30)
    length = np.hypot(*rivers.chord.T)
    sums = np.zeros((7, *height.shape))
    for first in range(0, len(height), _POINTS_AT_ONCE):
        x, y = (each[first : first + _POINTS_AT_ONCE] for each in (site.x, site.y))
        # Beyond its box an arc adds exactly nothing.
        point, i = rivers.index.at_points(x, y)
        offset = np.stack([x[point], y[point]], axis=-1) - rivers.start[i]
        away: Float64Array = np.asarray(offset * unit, np.float64)
        t, d2 = nearest_on_arc(rivers.chord[i], rivers.arc[i, ARC["arc_bend"]], away)
        here = (rivers.up[i] + (rivers.down[i] - rivers.up[i]) * t[:, None]).T
        lean, sway, end = (rivers.arc[i, ARC[name]] for name in ("arc_lean", "sway_up", "sway_down"))
        side = signed_square(rivers.chord[i], rivers.arc[i, ARC["arc_bend"]], away)
        width, radius = here[SECTION["half_width"]], here[SECTION["valley_radius"]]
        near2 = d2 + width**2 * _NEARNESS
        side /= near2
        measure = rivers.arc[i, ARC["typical_half_width"]]
        here = np.concatenate([here, side * [lean, sway + (end - sway) * t], [measure]])
        share2 = d2 / radius**2
        inside = np.maximum(1 - share2, 0)
        near_by = (_WEIGHT_SCALE * width / near2) ** 4
        contribution = np.minimum(length[i], np.sqrt(near2)) * inside**2 * near_by
        point += first
        np.add.at(weights, point, contribution)
        for total, values in zip(sums, contribution * here, strict=True):
            np.add.at(total, point, values)
        np.minimum.at(nearest, point, d2 / (measure * np.maximum(inside * (1 + share2), 1e-6)))
    near = weights > 1e-30
    surface, half_width, depth, radius, lean, sway, typical = sums[:, near] / weights[near]
    d = np.sqrt(nearest[near] * typical)
    ground = height[near]

    channel = smooth_rise(2 * half_width / cell, _CHANNEL_CELLS, _CHANNEL_CELLS)
    bank = _BANK_RISE * depth
    half_side = half_width * (1 + sway)
    across = d / half_side
    bed = -depth * np.maximum(1 - across**2, 0) * (1 + lean * across**2 * np.where(lean > 0, _POOL, _SHOAL))
    steep = 1 + _SWAYED_BANK * sway + lean * np.where(lean > 0, _CUT_BANK, _POINT_BAR)
    rise = bank * smooth_rise((across - 1) * (1 + sway), 0, _BANK_WIDTH / steep)
    flat = _FLOODPLAIN_SLOPE * np.maximum(d - half_side, 0)
    enforced = surface + flat + bank + (rise + bed - bank) * channel
    edge = (1 + _BANK_WIDTH) * half_width
    s = np.clip((d - edge) / np.maximum(radius - edge, edge), 0, 1)
    terrain = ground + np.maximum(surface + bank - ground, 0) * (1 - s**4) * (1 - s**2)
    carved, mask = height.copy(), np.zeros(height.shape)
    carved[near] = terrain + (enforced - terrain) * cubic(s)
    off = d / np.maximum(half_side, _MATERIAL_CELLS * cell) - 1
    outside, bar = np.maximum(off, 0), np.clip(-2 * lean, 0, 1)
    beside = 0.75 - 0.25 * off + _BAR_WIDTH * bar * np.minimum(outside, 1)
    beside -= _BARE_BANK * (1 - bar) * np.minimum(outside * _INVERSE_FRINGE, 1)
    mask[near] = np.maximum(beside, 0)
    return carved, mask
