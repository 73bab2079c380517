"""Water surfaces of lakes and rivers as meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Float32Array, Float64Array
    from sketchterrain.placement.feature_types import Lake, River, ShapeField
    from sketchterrain.terrain.surfaces import TerrainFeatures


ACROSS: Final = 9  # vertices from bank to bank
OVERLAP: Final = 1.7  # width of the mesh in widths of the water, so that it ends inside the banks
SHEET_CELLS: Final = 400  # largest number of quads along a lake's longer side
ROUGHNESS: Final = 0.042  # Manning's n of a bed of gravel, s/m^(1/3)
SHALLOWNESS: Final = 18.0  # width of a river over its hydraulic radius
PEAK: Final = 4.0 / 3.0
"""Speed in the middle over the mean: of the profile 1 - x³ (water_waves.glsl: stream_profile)."""
SPEEDS: Final = (0.25, 3.2)  # range of speeds, m/s
FALL_WIDTHS: Final = 4.0  # length in widths over which a river's slope is measured
MOUTH: Final = 9.0  # m into a lake over which a river's surface fades into the lake's
LEVEL: Final = 0.4  # largest difference of level (m) at which two overlapping waters merge


class WaterSurface(NamedTuple):
    """Triangle mesh of a water surface."""

    position: Float64Array  # (n, 3) world coordinates, m
    flow: Float64Array  # (n, 4) m across and along, unit vector downstream
    shore_distance: Float64Array  # (n,) m from the shore, negative in the bank
    stream: Float64Array  # (n, 4) mid-stream speed (m/s), slope, visible share, half width (m; lake 0)
    triangles: npt.NDArray[np.uint32]  # (k,) indices, three a triangle, counter-clockwise from above


def water_surfaces(features: TerrainFeatures) -> list[WaterSurface]:
    """Return the surfaces of all waters, lakes first; where waters overlap, one of them is faded out."""
    rivers = [river for river in features.rivers if len(river.centreline) > 1]
    meshes = [lake_surface(lake.shape, lake.level) for lake in features.lakes]
    for number, river in enumerate(rivers):
        wider = [
            other
            for k, other in enumerate(rivers)
            if (other.centreline_width.mean(), -k) > (river.centreline_width.mean(), -number)
        ]
        surface = river_surface(river.centreline, river.centreline_width)
        surface.stream[:, 2] = _outside_lakes(surface.position, features.lakes) * _outside_rivers(
            surface.position, wider
        )
        meshes.append(surface)
    return meshes


def flow_speed_and_slope(centreline: Float64Array, width: Float32Array) -> tuple[Float64Array, Float64Array]:
    """Return speed in the middle (m/s) and slope of a river, from its (m, 3) centreline and width (m,).

    Manning's formula R^(2/3) √slope / n with the hydraulic radius R from the width, clipped to `SPEEDS`; the
    slope is taken over `FALL_WIDTHS` widths.
    """
    distance = _arc_length(centreline)
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
    flow[..., 1] = _arc_length(centreline)[:, None]
    flow[..., 2:] = downstream[:, None, :]
    half = 0.5 * width.astype(np.float64)
    stream = np.empty((len(flat), ACROSS, 4))
    for k, value in enumerate((*flow_speed_and_slope(centreline, width), np.ones(len(flat)), half)):
        stream[..., k] = value[:, None]
    triangles = _quads(np.arange(len(flat) * ACROSS, dtype=np.uint32).reshape(len(flat), ACROSS))
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
    used, triangles = np.unique(_quads(index)[wet > -0.25 * shape.spacing], return_inverse=True)
    stream = np.tile([0.0, 0.0, 1.0, 0.0], (len(used), 1))
    return WaterSurface(
        position.reshape(-1, 3)[used],
        flow.reshape(-1, 4)[used],
        inside.ravel()[used].astype(np.float64),
        stream,
        triangles.ravel().astype(np.uint32),
    )


def _quads(index: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
    """Return two triangles a quad, (rows − 1, columns − 1, 6); rows go north and columns east."""
    sw, se, nw, ne = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return np.stack([sw, se, ne, sw, ne, nw], axis=-1)


def _arc_length(centreline: Float64Array) -> Float64Array:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(centreline[:, :2], axis=0).T))])


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
        line = river.centreline
        distance, nearest = cKDTree(line[:, :2]).query(position[:, :2])
        half = 0.5 * river.centreline_width[nearest].astype(np.float64)
        share = np.clip(2.0 * (1.0 - distance / half), 0.0, 1.0)
        beside = np.abs(position[:, 2] - line[nearest, 2]) < LEVEL
        # Not before its start and beyond its end.
        for end, towards in ((0, 1), (len(line) - 1, len(line) - 2)):
            inward = (position[:, :2] - line[end, :2]) @ (line[towards, :2] - line[end, :2])
            beside &= (nearest != end) | (inward > 0.0)
        visible *= np.where(beside, 1.0 - share, 1.0)
    return visible
