"""Meshes by pymartini and pydelatin, which thin out a heightmap to an error in metres.

Neither knows a camera. So the world is cut into squares, narrower the nearer they are; each is a heightmap of
257² samples a few pixels apart (where the finest quads allow it), meshed to the error that a number of pixels
is at the square's nearest point, seen as sideways as at its farthest corner: what a program that streams
heightmaps can do. Gaps between squares are left.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from time import perf_counter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.benchmarks.baselines.problem import Absent
from sketchterrain.benchmarks.flight_meshes import Mesh, View, height_range
from sketchterrain.benchmarks.flight_scene import FINEST_CELL
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.terrain.vertices import VertexStore
from sketchterrain.tiles.lod import inside_frustum

QUADS = 256
_BATCH = 16

Thinned = tuple[Float64Array, Float64Array, npt.NDArray[np.int64]]


class Square(NamedTuple):
    """A part of the world with its heights, rows from north to south; metres."""

    west: float
    south: float
    width: float
    heights: Float32Array


@dataclass(frozen=True)
class Mesher:
    """A way to thin out a heightmap."""

    name: str
    prepare: Callable[[Float32Array], Callable[[float], Thinned]]

    def mesh(self, square: Square, error: float) -> Mesh:
        """Return a square's triangles for an error in metres."""
        column, row, triangles = self.prepare(square.heights)(error)
        cell = square.width / QUADS
        height = square.heights[row.astype(np.int64), column.astype(np.int64)].astype(np.float64)
        x, y = square.west + column * cell, square.south + (QUADS - row) * cell
        return Mesh(np.stack([x, y, height], axis=-1), triangles)


class Rasters:
    """Heightmaps around an eye."""

    def __init__(self, terrain: Terrain, view: View, *, apart: float = 2.0) -> None:
        self._view = view
        self._widest = apart * QUADS / view.picture.pixels_per_radian(view.stop.camera)  # of its distance
        level = int(np.floor(np.log2(terrain.extent / QUADS / FINEST_CELL)))
        self._store = VertexStore(terrain.context, _BATCH, quads=QUADS)
        keys = [key for key in self._split(terrain, (0, 0, 0), level) if self._seen(terrain, key)]
        squares: list[Square] = []
        self.seconds = 0.0
        for start in range(0, len(keys), _BATCH):
            squares += self._made(terrain, keys[start : start + _BATCH])
        self.squares = tuple(square for square in squares if self._shown(square))

    def allowed(self, square: Square, pixels: float) -> float:
        """Return the height in metres that covers so many pixels in a square at most."""
        x, y, z = self._view.stop.camera.eye
        near, far = _reach(square.west, square.south, square.width, x, y)
        low, high = float(square.heights.min()), float(square.heights.max())
        above = max(low - z, z - high, 0.0)
        scale = self._view.picture.pixels_per_radian(self._view.stop.camera)
        sideways = far / np.hypot(far, above)
        return float(pixels * max(np.hypot(near, above), 0.5) / scale / sideways)

    def _split(self, terrain: Terrain, key: tuple[int, int, int], finest: int) -> list[tuple[int, int, int]]:
        level, col, row = key
        width = terrain.extent / 2**level
        x, y, z = self._view.stop.camera.eye
        near, _ = _reach(col * width, row * width, width, x, y)
        if level >= finest or width <= self._widest * np.hypot(near, z - self._view.stop.ground):
            return [key]
        children = [(level + 1, 2 * col + i, 2 * row + j) for j in (0, 1) for i in (0, 1)]
        return [each for child in children for each in self._split(terrain, child, finest)]

    def _seen(self, terrain: Terrain, key: tuple[int, int, int]) -> bool:
        level, col, row = key
        width = terrain.extent / 2**level
        bottom, top = height_range(terrain)
        low = np.array([[col * width, row * width, bottom]])
        high = np.array([[(col + 1) * width, (row + 1) * width, top]])
        return bool(inside_frustum(self._view.planes, low, high)[0])

    def _shown(self, square: Square) -> bool:
        low = np.array([[square.west, square.south, float(square.heights.min())]])
        high = np.array([[*(low[0, :2] + square.width), float(square.heights.max())]])
        return bool(inside_frustum(self._view.planes, low, high)[0])

    def _made(self, terrain: Terrain, keys: Sequence[tuple[int, int, int]]) -> list[Square]:
        start = perf_counter()
        slots = np.arange(len(keys))
        terrain.write_tiles(keys, slots, np.full(len(keys), -1), self._store)
        heights = self._store.download()["height"].copy()
        self.seconds += perf_counter() - start
        widths = [terrain.extent / 2 ** key[0] for key in keys]
        return [
            Square(key[1] * width, key[2] * width, width, heights[i])
            for i, (key, width) in enumerate(zip(keys, widths, strict=True))
        ]


def mesher(name: str) -> Mesher | Absent:
    """Return a mesher by its package's name, or say that it is not installed."""
    try:
        return Mesher(f"{name} {version(name)}", MESHERS[name])
    except PackageNotFoundError:
        return Absent(name, "not installed: pip install 'sketchterrain[peers]'")


def _martini(heights: Float32Array) -> Callable[[float], Thinned]:
    from pymartini import Martini

    tile = Martini(QUADS + 1).create_tile(heights)

    def mesh(error: float) -> Thinned:
        vertices, triangles = tile.get_mesh(error)
        column, row = np.asarray(vertices, np.float64).reshape(-1, 2).T
        return column, row, np.asarray(triangles, np.int64).reshape(-1, 3)

    return mesh


def _delatin(heights: Float32Array) -> Callable[[float], Thinned]:
    from pydelatin import Delatin

    def mesh(error: float) -> Thinned:
        found = Delatin(heights, max_error=error)
        column, up, _ = np.asarray(found.vertices, np.float64).T  # its rows go the other way
        return column, QUADS - up, np.asarray(found.triangles, np.int64)

    return mesh


def _reach(west: float, south: float, width: float, x: float, y: float) -> tuple[float, float]:
    """Return the horizontal distances from a place to a square's nearest point and farthest corner, m."""
    near = np.hypot(max(west - x, x - west - width, 0.0), max(south - y, y - south - width, 0.0))
    far = np.hypot(max(abs(west - x), abs(west + width - x)), max(abs(south - y), abs(south + width - y)))
    return float(near), float(far)


MESHERS: dict[str, Callable[[Float32Array], Callable[[float], Thinned]]] = {
    "pymartini": _martini,
    "pydelatin": _delatin,
}
"""The peers by their packages' names."""
