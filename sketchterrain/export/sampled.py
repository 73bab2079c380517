"""Sample grids, terrains sampled at their vertices, and material weights as bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, UInt8Array
from sketchterrain.errors import InputError
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.terrain.surfaces import Band

if TYPE_CHECKING:
    from sketchterrain.generation.terrain import Terrain


CHANNELS = ("red", "green", "blue", "alpha")
ORIENTATION = {"row_0": "north", "column_0": "west", "samples": "vertices"}
_WHOLE = 255
# Lowest bit of each field of Terrain3D's control map.
_BASE, _OVERLAY, _BLEND = 27, 22, 14
# Overlay 30 or 31 on base 15 or 31 would be Inf or NaN, which some programs normalise.
_MAX_TEXTURES = 30


def row_bands(rows: int, step: int = 256) -> Iterator[slice]:
    """Return slices of successive rows, whose number bounds the memory of large grids."""
    return (slice(top, top + step) for top in range(0, rows, step))


def quantise_weights(weights: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Return weights (rows, columns, materials) as bytes with a sum of 255, by the largest remainder method.

    A byte differs from 255 times its weight by less than 1, a weight of 0 stays 0, and of equal remainders
    the first is rounded up.
    """
    result = np.empty(weights.shape, np.uint8)
    for rows in row_bands(len(weights)):
        result[rows] = _largest_remainder(weights[rows].reshape(-1, weights.shape[-1])).reshape(
            result[rows].shape
        )
    return result


def _largest_remainder(weights: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    total = weights.sum(axis=1, dtype=np.float64, keepdims=True)
    if not (np.isfinite(total).all() and (total > 0).all() and (weights >= 0).all()):
        raise InputError("expected material weights ≥ 0 with a finite sum above 0 at each vertex")
    scaled = weights * (_WHOLE / total)
    whole = np.floor(scaled)
    remainder = scaled - whole
    missing = np.rint(_WHOLE - whole.sum(axis=1)).astype(np.intp)
    result: npt.NDArray[np.uint8] = whole.astype(np.uint8)
    # Few vertices miss more than one or two steps, so this is quicker than sorting all remainders.
    open_rows = np.flatnonzero(missing)
    while open_rows.size:
        largest = remainder[open_rows].argmax(axis=1)
        result[open_rows, largest] += 1
        remainder[open_rows, largest] = -1.0
        missing[open_rows] -= 1
        open_rows = open_rows[missing[open_rows] > 0]
    return result


def rgba_weights(weights: UInt8Array, first: int) -> npt.NDArray[np.uint8]:
    """Return up to four materials, from a first one, as an RGBA image; unused channels are 0."""
    image = np.zeros((*weights.shape[:2], len(CHANNELS)), np.uint8)
    part = weights[..., first : first + len(CHANNELS)]
    image[..., : part.shape[-1]] = part
    return image


def splat_weights(weights: UInt8Array) -> UInt8Array:
    """Return weights for Unity's splat maps: interpolated, one row and column less, the edges still edges.

    Unity's terrain has 2ⁿ + 1 heights and 2ⁿ weights along a side, and its shader puts the outermost weights
    on the terrain's edges (TerrainSplatmapCommon.cginc: "adjust splatUVs so the edges of the terrain tile lie
    on pixel centers"). So weight i of n is at vertex i·n/(n − 1).
    """
    rows, columns = weights.shape[0] - 1, weights.shape[1] - 1
    top, down = _splat_positions(rows)
    left, across = _splat_positions(columns)
    result = np.empty((rows, columns, weights.shape[2]), np.uint8)
    for part in row_bands(rows):
        upper, lower = (weights[top[part] + step].astype(np.float32) for step in (0, 1))
        share = down[part, None, None]
        band = upper * (1.0 - share) + lower * share
        share = across[None, :, None]
        result[part] = quantise_weights(band[:, left] * (1.0 - share) + band[:, left + 1] * share)
    return result


def _splat_positions(count: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]]:
    """Return the quad of each of `count` positions over count + 1 vertices, and the position within it."""
    position = np.arange(count) * (count / max(count - 1, 1))
    position[-1] = count
    first = np.minimum(position.astype(np.intp), count - 1)
    return first, (position - first).astype(np.float32)


def flip_green(normal: UInt8Array) -> UInt8Array:
    """Convert a normal map from Y+ (OpenGL) to Y− (DirectX)."""
    result = normal.copy()
    result[..., 1] = 255 - result[..., 1]
    return result


def control_map(weights: UInt8Array) -> npt.NDArray[np.float32]:
    """Return Terrain3D's control map: the two heaviest materials of each vertex and their blend.

    From the highest bit: 5 bits of the base texture, 5 of the overlay texture, 8 of the overlay's share; the
    other bits are 0: no rotation, default scale, no hole, not automatic ("Control Map Format" in Terrain3D's
    documentation). Texture i is material i. The values are uint32 bits stored as float32: do not calculate
    with them.
    """
    if weights.shape[-1] > _MAX_TEXTURES:
        raise InputError(f"expected at most {_MAX_TEXTURES} materials, got {weights.shape[-1]}")
    result = np.empty(weights.shape[:2], np.uint32)
    for rows in row_bands(len(weights)):
        result[rows] = _control_bits(weights[rows])
    return result.view(np.float32)


def _control_bits(weights: UInt8Array) -> npt.NDArray[np.uint32]:
    base = weights.argmax(axis=-1)
    others = weights.copy()
    np.put_along_axis(others, base[..., None], 0, axis=-1)
    runner_up = others.argmax(axis=-1)
    most, second = (
        np.take_along_axis(values, index[..., None], axis=-1)[..., 0].astype(np.uint32)
        for values, index in ((weights, base), (others, runner_up))
    )
    overlay = np.where(second == 0, base, runner_up).astype(np.uint32)
    share = (_WHOLE * second + (most + second) // 2) // (most + second)
    bits: npt.NDArray[np.uint32] = base.astype(np.uint32) << _BASE | overlay << _OVERLAY | share << _BLEND
    return bits


BYTES_PER_VERTEX = 7 + len(BUILT_IN)  # height, normal and weights of the program's materials


@dataclass(frozen=True)
class SampleGrid:
    """A grid of vertices, the outermost ones on the rectangle's edges; row 0 is the north edge."""

    west: float  # m
    south: float
    east: float
    north: float
    columns: int  # vertices, ≥ 2
    rows: int

    @property
    def spacing(self) -> tuple[float, float]:
        """Metres between columns and between rows."""
        return (self.east - self.west) / (self.columns - 1), (self.north - self.south) / (self.rows - 1)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north (m)."""
        return self.west, self.south, self.east, self.north

    def window(self, left: int, top: int, columns: int, rows: int) -> SampleGrid:
        """Return a part of the grid."""
        dx, dy = self.spacing
        west, north = self.west + left * dx, self.north - top * dy
        return SampleGrid(west, north - (rows - 1) * dy, west + (columns - 1) * dx, north, columns, rows)


@dataclass(frozen=True, eq=False)
class TerrainSamples:
    """Heights, normals and materials at the vertices of a grid."""

    grid: SampleGrid
    height: npt.NDArray[np.float32]  # (rows, columns), m
    normal: npt.NDArray[np.uint8]  # (rows, columns, 3): east, north, up; 0 is −1, 255 is 1
    weights: npt.NDArray[np.uint8]  # (rows, columns, materials), sum 255
    # (rows, columns, 4) √ of the albedo of what is painted, and its share; None without any
    appearance: npt.NDArray[np.uint8] | None = None

    def window(self, left: int, top: int, columns: int, rows: int) -> TerrainSamples:
        """Return a part of the samples as views."""
        at = slice(top, top + rows), slice(left, left + columns)
        grid = self.grid.window(left, top, columns, rows)
        painted = None if self.appearance is None else self.appearance[at]
        return TerrainSamples(grid, self.height[at], self.normal[at], self.weights[at], painted)


def sample_terrain(
    terrain: Terrain, grid: SampleGrid, *, progress: Callable[[float], None] | None = None
) -> TerrainSamples:
    """Evaluate a terrain at a grid's vertices, in bands that are quantised at once."""
    shape = (grid.rows, grid.columns)
    samples = TerrainSamples(
        grid,
        np.empty(shape, np.float32),
        np.empty((*shape, 3), np.uint8),
        np.empty((*shape, len(terrain.material_names)), np.uint8),
        sample_appearance(terrain, grid),
    )

    def store(band: Band) -> None:
        rows = slice(band.top, band.top + len(band.height))
        samples.height[rows] = band.height
        samples.normal[rows] = quantise_normals(band.normal)
        samples.weights[rows] = quantise_weights(band.materials)

    with ThreadPoolExecutor(1, "quantise") as thread:  # meanwhile the device computes the next band
        last: Future[None] | None = None
        for band in terrain.grid(*grid.bounds, columns=grid.columns, rows=grid.rows, progress=progress):
            if last is not None:
                last.result()
            last = thread.submit(store, band)
        if last is not None:
            last.result()
    return samples


def sample_appearance(terrain: Terrain, grid: SampleGrid) -> npt.NDArray[np.uint8] | None:
    """Return the colour of roads, land use and draped layers at a grid's vertices; None without any."""
    appearance = terrain.draped_appearance
    if appearance.is_empty:
        return None
    size = {"columns": grid.columns, "rows": grid.rows}
    return appearance.window(grid.west, grid.north, cell=grid.spacing, **size)


def srgb_of(albedo: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Return linear albedos as sRGB (IEC 61966-2-1)."""
    encoded = np.where(albedo <= 0.0031308, 12.92 * albedo, 1.055 * albedo ** (1.0 / 2.4) - 0.055)
    return np.rint(255.0 * encoded).astype(np.uint8)


def appearance_picture(painted: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return the colour of what is painted as sRGB and opacity."""
    table = srgb_of((np.arange(256) / 255.0) ** 2)
    return np.concatenate([table[painted[..., :3]], painted[..., 3:]], axis=-1)


def quantise_normals(normal: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Return unit vectors as bytes: −1 is 0, 1 is 255."""
    whole: npt.NDArray[np.uint8] = np.rint(normal * np.float32(127.5) + np.float32(127.5)).astype(np.uint8)
    return whole


def interpolate_heights(samples: TerrainSamples, east: Float64Array, north: Float64Array) -> Float64Array:
    """Return heights between the vertices of a grid by bilinear interpolation.

    A program's two triangles in a quad differ from it by at most a quarter of the quad's twist
    |h00 + h11 − h01 − h10|.
    """
    grid = samples.grid
    dx, dy = grid.spacing
    left, across = _quad((east - grid.west) / dx, grid.columns)
    top, down = _quad((grid.north - north) / dy, grid.rows)
    height = samples.height
    upper = _mix(height[top, left], height[top, left + 1], across)
    lower = _mix(height[top + 1, left], height[top + 1, left + 1], across)
    return _mix(upper, lower, down)


def _quad(position: Float64Array, vertices: int) -> tuple[npt.NDArray[np.intp], Float64Array]:
    """Return the index of the quad along one axis, and the position within it, 0 … 1."""
    inside = np.clip(position, 0.0, vertices - 1.0)
    first = np.minimum(inside.astype(np.intp), vertices - 2)
    return first, inside - first


def _mix(a: npt.NDArray[np.floating], b: npt.NDArray[np.floating], share: Float64Array) -> Float64Array:
    return np.asarray(a * (1.0 - share) + b * share, np.float64)
