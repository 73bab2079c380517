"""Objects on a terrain that are not height: the water of lakes, rivers and the sea, as meshes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from sketchterrain.geometry.splines import arc_length
from sketchterrain.schema.layers import layer_of

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Bounds, Float32Array, Float64Array
    from sketchterrain.landforms.placement.feature_types import Lake, River, ShapeField
    from sketchterrain.terrain.surfaces import TerrainFeatures


ACROSS: Final = 9  # vertices from bank to bank
OVERLAP: Final = 1.7  # width of the mesh in widths of the water, so that it ends inside the banks
OPEN_WATER: Final = 8  # quads along each side of one that stands for them far from the shore
SHEET_CELLS: Final = 400  # largest number of quads along a lake's longer side
ROUGHNESS: Final = 0.042  # Manning's n of a bed of gravel, s/m^(1/3)
SHALLOWNESS: Final = 18.0  # width of a river over its hydraulic radius
PEAK: Final = 4.0 / 3.0
"""Speed in the middle over the mean: of the profile 1 - x³ (water_waves.glsl: stream_profile)."""
SPEEDS: Final = (0.25, 3.2)  # range of speeds, m/s
FALL_WIDTHS: Final = 4.0  # length in widths over which a river's slope is measured
MOUTH: Final = 9.0  # m into a lake over which a river's surface fades into the lake's
LEVEL: Final = 0.4  # largest difference of level (m) at which two overlapping waters merge
ESTUARY: Final = 0.15  # m over the sea's level over which a river's surface fades into it
SEA: Final = -1.0  # half width (m) that marks the sea for water.frag.glsl


class WaterSurface(NamedTuple):
    """Triangle mesh of a water surface."""

    position: Float64Array  # (n, 3) world coordinates, m
    flow: Float64Array  # (n, 4) m across and along, unit vector downstream
    shore_distance: Float64Array  # (n,) m from the shore, negative in the bank
    stream: Float64Array  # (n, 4) speed (m/s), slope, visible share, half width (m; lakes 0, sea −1)
    triangles: npt.NDArray[np.uint32]  # (k,) indices, three a triangle, counter-clockwise from above


@dataclass(frozen=True, eq=False)
class TerrainObject:
    """A thing on the terrain that is not height: so far, a water surface."""

    name: str  # of its node in exports: "river 7", by its id
    kind: str  # its painted layer: lake, river or sea
    key: Hashable  # equal for equal objects
    mesh: Callable[[Bounds], WaterSurface]  # its surface; bounds (m) limit the sea's
    lines: Callable[[], tuple[Float64Array, Float64Array]]  # starts and ends (n, 3; m) of lines that mark it
    level: float | None = None  # m, of a plane without end, whose shore is where it meets the ground


def terrain_objects(features: TerrainFeatures) -> list[TerrainObject]:
    """Return the waters, lakes first; where waters overlap, one of them is faded out."""
    rivers = [river for river in features.rivers if len(river.centreline) > 1]
    return [
        *(_lake_object(lake) for lake in features.lakes),
        *(_river_object(river, _wider(rivers, number), features) for number, river in enumerate(rivers)),
        *([] if features.sea_level is None else [_sea_object(features.sea_level)]),
    ]


def _lake_object(lake: Lake) -> TerrainObject:
    shape, level = lake.shape, lake.level
    key = (level, shape.west, shape.south, shape.spacing, shape.inside.shape, shape.inside.tobytes())
    lines = partial(shore_lines, shape, level)
    kind = layer_of(lake.id)
    return TerrainObject(f"{kind} {lake.id}", kind, key, lambda _: lake_surface(shape, level), lines)


def _river_object(river: River, wider: Sequence[River], features: TerrainFeatures) -> TerrainObject:
    line, width = river.centreline, river.centreline_width

    def mesh(_: Bounds) -> WaterSurface:
        surface = river_surface(line, width)
        position, visible = surface.position, surface.stream[:, 2]
        visible *= _outside_lakes(position, features.lakes) * _outside_rivers(position, wider)
        if features.sea_level is not None:
            visible *= np.clip((position[:, 2] - features.sea_level) / ESTUARY, 0.0, 1.0)
        return surface

    kind, lines = layer_of(river.id), (line[:-1], line[1:])
    return TerrainObject(f"{kind} {river.id}", kind, (line.tobytes(), width.tobytes()), mesh, lambda: lines)


def _sea_object(level: float) -> TerrainObject:
    none = np.zeros((0, 3)), np.zeros((0, 3))
    return TerrainObject("sea", "sea", level, partial(sea_surface, level), lambda: none, level)


def _wider(rivers: Sequence[River], number: int) -> list[River]:
    """Return the rivers that cover a river where they overlap."""
    widths = [(float(river.centreline_width.mean()), -k) for k, river in enumerate(rivers)]
    return [river for river, width in zip(rivers, widths, strict=True) if width > widths[number]]


def flow_speed_and_slope(centreline: Float64Array, width: Float32Array) -> tuple[Float64Array, Float64Array]:
    """Return speed in the middle (m/s) and slope of a river, from its (m, 3) centreline and width (m,).

    Manning's formula R^(2/3) √slope / n with the hydraulic radius R from the width, clipped to `SPEEDS`; the
    slope is taken over `FALL_WIDTHS` widths.
    """
    distance = arc_length(centreline)
    wide = width.astype(np.float64)
    half = 0.5 * FALL_WIDTHS * wide
    before, after = np.maximum(distance - half, 0.0), np.minimum(distance + half, distance[-1])
    level = centreline[:, 2]
    drop = np.interp(before, distance, level) - np.interp(after, distance, level)
    fall = np.maximum(drop / np.maximum(after - before, 1e-9), 0.0)
    mean = (wide / SHALLOWNESS) ** (2.0 / 3.0) * np.sqrt(fall) / ROUGHNESS
    return np.clip(PEAK * mean, *SPEEDS), fall


def river_surface(centreline: Float64Array, width: Float32Array) -> WaterSurface:
    """Widen a (m, 3) centreline, downstream, m ≥ 2, to a mesh of m · ACROSS vertices."""
    flat = centreline[:, :2]
    downstream = np.gradient(flat, axis=0)
    downstream /= np.maximum(np.linalg.norm(downstream, axis=1, keepdims=True), 1e-9)
    to_right = np.stack([downstream[:, 1], -downstream[:, 0]], axis=1)
    across = np.linspace(-0.5, 0.5, ACROSS)[None, :] * (OVERLAP * width.astype(np.float64) + 1.0)[:, None]
    position = np.empty((len(flat), ACROSS, 3))
    position[..., :2] = flat[:, None, :] + across[..., None] * to_right[:, None, :]
    position[..., 2] = centreline[:, 2:3]
    flow = np.empty((len(flat), ACROSS, 4))
    flow[..., 0] = across
    flow[..., 1] = arc_length(centreline)[:, None]
    flow[..., 2:] = downstream[:, None, :]
    half = 0.5 * width.astype(np.float64)
    stream = np.empty((len(flat), ACROSS, 4))
    for k, value in enumerate((*flow_speed_and_slope(centreline, width), np.ones(len(flat)), half)):
        stream[..., k] = value[:, None]
    triangles = quads(np.arange(len(flat) * ACROSS, dtype=np.uint32).reshape(len(flat), ACROSS))
    inside = half[:, None] - np.abs(across)
    return WaterSurface(
        position.reshape(-1, 3),
        flow.reshape(-1, 4),
        inside.ravel(),
        stream.reshape(-1, 4),
        triangles.ravel(),
    )


def lake_surface(shape: ShapeField, level: float) -> WaterSurface:
    """Cover a lake with a flat grid that ends inside its banks; across and along are east and north."""
    rows, columns = shape.inside.shape
    step = -(-max(rows, columns) // SHEET_CELLS)
    # The last row and column once more, so that a coarse grid reaches the rim.
    row = np.minimum(np.arange(0, rows + step - 1, step), rows - 1)
    column = np.minimum(np.arange(0, columns + step - 1, step), columns - 1)
    inside = shape.inside[np.ix_(row, column)]
    x, y = np.meshgrid(column * shape.spacing, row * shape.spacing)
    position = np.stack([x + shape.west, y + shape.south, np.full(x.shape, level)], axis=-1)
    flow = np.stack([x, y, np.zeros(x.shape), np.ones(x.shape)], axis=-1)
    index = np.arange(x.size, dtype=np.uint32).reshape(x.shape)
    wet = np.maximum.reduce([inside[:-1, :-1], inside[:-1, 1:], inside[1:, :-1], inside[1:, 1:]])
    cells = wet > -0.25 * shape.spacing
    # In open water one quad stands for many: all lie in one plane.
    across, along = (count // OPEN_WATER for count in cells.shape)
    many = across * OPEN_WATER, along * OPEN_WATER
    blocks = inside[: many[0], : many[1]].reshape(across, OPEN_WATER, along, OPEN_WATER)
    least = blocks.min(axis=(1, 3))
    far_out = least > 0.5 * OPEN_WATER * step * shape.spacing
    cells[: many[0], : many[1]] &= ~far_out.repeat(OPEN_WATER, axis=0).repeat(OPEN_WATER, axis=1)
    corners = index[: many[0] + 1 : OPEN_WATER, : many[1] + 1 : OPEN_WATER]
    chosen = np.concatenate([quads(index)[cells], quads(corners)[far_out]])
    used, triangles = np.unique(chosen, return_inverse=True)
    stream = np.tile([0.0, 0.0, 1.0, 0.0], (len(used), 1))
    return WaterSurface(
        position.reshape(-1, 3)[used],
        flow.reshape(-1, 4)[used],
        inside.ravel()[used].astype(np.float64),
        stream,
        triangles.ravel().astype(np.uint32),
    )


def sea_surface(level: float, bounds: Bounds) -> WaterSurface:
    """Cover a rectangle with one quad at the level of the sea."""
    west, south, east, north = bounds
    corners = np.array([[west, south], [east, south], [west, north], [east, north]])
    flow = np.concatenate([corners, np.tile([0.0, 1.0], (4, 1))], axis=1)
    return WaterSurface(
        np.column_stack([corners, np.full(4, level)]),
        flow,
        np.full(4, np.inf),
        np.tile([0.0, 0.0, 1.0, SEA], (4, 1)),
        quads(np.arange(4, dtype=np.uint32).reshape(2, 2)).ravel(),
    )


def shore_lines(shape: ShapeField, level: float) -> tuple[Float64Array, Float64Array]:
    """Return starts and ends of the sample edges between inside and outside of a shape."""
    inside = shape.inside > 0
    starts: list[Float64Array] = []
    ends: list[Float64Array] = []
    for axis, side in ((0, (0.5, 0.0)), (1, (0.0, 0.5))):
        cut = np.argwhere(np.diff(inside.astype(np.int8), axis=axis) != 0).astype(np.float64)
        cut[:, axis] += 0.5
        row, column = cut.T
        for into, sign in ((starts, -1.0), (ends, 1.0)):
            x = shape.west + (column + sign * side[0]) * shape.spacing
            y = shape.south + (row + sign * side[1]) * shape.spacing
            into.append(np.stack([x, y, np.full(len(x), level)], axis=-1))
    return np.concatenate(starts), np.concatenate(ends)


def quads(index: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
    """Return indices of two triangles a quad, (rows − 1, columns − 1, 6); rows go north and columns east."""
    sw, se, nw, ne = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return np.stack([sw, se, ne, sw, ne, nw], axis=-1)


def _outside_lakes(position: Float64Array, lakes: Sequence[Lake]) -> Float64Array:
    """Return how visible a river is at places: 1 on land, 0 from `MOUTH` inside a lake's shore on."""
    visible = np.ones(len(position))
    for lake in lakes:
        field = lake.shape
        at = np.stack([position[:, 1] - field.south, position[:, 0] - field.west]) / field.spacing
        inside = map_coordinates(field.inside.astype(np.float64), at, order=1, mode="nearest")
        share = np.clip(inside / MOUTH, 0.0, 1.0)
        visible *= np.where(np.abs(position[:, 2] - lake.level) < LEVEL, 1.0 - share, 1.0)
    return visible


def _outside_rivers(position: Float64Array, rivers: Sequence[River]) -> Float64Array:
    """Return how visible a river is at places: 1 at other rivers' banks, 0 halfway to their middle."""
    visible = np.ones(len(position))
    for river in rivers:
        line, reach = river.centreline, 0.5 * float(river.centreline_width.max())
        low, high = line[:, :2].min(axis=0) - reach, line[:, :2].max(axis=0) + reach
        near = np.flatnonzero(((position[:, :2] >= low) & (position[:, :2] <= high)).all(axis=1))
        if not near.size:
            continue
        found = cKDTree(line[:, :2]).query(position[near, :2], distance_upper_bound=reach)
        within = np.isfinite(found[0])
        near, distance, nearest = (np.asarray(each)[within] for each in (near, *found))
        place = position[near]
        half = 0.5 * river.centreline_width[nearest].astype(np.float64)
        share = np.clip(2.0 * (1.0 - distance / half), 0.0, 1.0)
        beside = np.abs(place[:, 2] - line[nearest, 2]) < LEVEL
        # Not before its start and beyond its end.
        for end, towards in ((0, 1), (len(line) - 1, len(line) - 2)):
            inward = (place[:, :2] - line[end, :2]) @ (line[towards, :2] - line[end, :2])
            beside &= (nearest != end) | (inward > 0.0)
        visible[near] *= np.where(beside, 1.0 - share, 1.0)
    return visible
