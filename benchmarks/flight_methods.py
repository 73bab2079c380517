"""Methods to draw a view: own tiles, the metric of Zaaijer 2013, uniform grids, heightmap meshers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib.metadata import PackageNotFoundError, version
from time import perf_counter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.benchmarks.baselines.noise import Absent
from sketchterrain.benchmarks.baselines.thesis import SplineSampling, ThesisTiles
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.flight_scene import (
    FINEST_CELL,
    Mesh,
    OwnTiles,
    Tiles,
    View,
    drawn,
    height_range,
    uniform_tiles,
    view_of,
    within_world,
)
from sketchterrain.benchmarks.thesis import ThesisView, feature_discs
from sketchterrain.benchmarks.timing import lap
from sketchterrain.generation.terrain import Terrain
from sketchterrain.tiles.lod import inside_frustum
from sketchterrain.tiles.stream import QUADS

RASTER_QUADS = 256
_RASTER_BATCH = 16

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
        cell = square.width / RASTER_QUADS
        height = square.heights[row.astype(np.int64), column.astype(np.int64)].astype(np.float64)
        x, y = square.west + column * cell, square.south + (RASTER_QUADS - row) * cell
        return Mesh(np.stack([x, y, height], axis=-1), triangles)


class Rasters:
    """Heightmaps around an eye."""

    def __init__(self, terrain: Terrain, view: View, *, apart: float = 2.0) -> None:
        self._view = view
        self._widest = (
            apart * RASTER_QUADS / view.picture.pixels_per_radian(view.stop.camera)
        )  # of its distance
        level = int(np.floor(np.log2(terrain.extent / RASTER_QUADS / FINEST_CELL)))
        self._store = terrain.vertex_store(_RASTER_BATCH, quads=RASTER_QUADS)
        keys = [key for key in self._split(terrain, (0, 0, 0), level) if self._seen(terrain, key)]
        squares: list[Square] = []
        self.seconds = 0.0
        for start in range(0, len(keys), _RASTER_BATCH):
            squares += self._made(terrain, keys[start : start + _RASTER_BATCH])
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

    tile = Martini(RASTER_QUADS + 1).create_tile(heights)

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
        return column, RASTER_QUADS - up, np.asarray(found.triangles, np.int64)

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


OURS = "this program"
THESIS = "the thesis's metric"
SAMPLING = SplineSampling(8, 3)
"""How the thesis's kernels look for the nearest place on a river: the cheapest that serves mountains well."""

_FACTOR = 2.0  # F near mountains and rivers
_APART = 2.0  # px between samples of heightmaps, at least
_BATCH = 64  # tiles of the uniform grid written at once


class Shown(NamedTuple):
    """What a way draws of a view."""

    meshes: Iterable[Mesh]
    triangles: int
    seconds: float
    whole: bool = True


@dataclass(frozen=True)
class DrawMethod:
    """A way to draw."""

    name: str
    unit: str
    settings: tuple[float, ...]
    draw: Callable[[View, float], Shown]


def methods(terrain: Terrain, effort: Effort) -> tuple[list[DrawMethod], list[Absent]]:
    """Return the ways, and the peers that are not on this machine."""
    found = [
        DrawMethod(f"{name}, {quads} quads", unit, settings, partial(draw, terrain, quads))
        for name, unit, settings, draw in (
            (OURS, "τ = {:g} px", effort.flight_own_pixels, _own),
            (THESIS, "T = {:g}", effort.flight_tessellations, _thesis),
        )
        for quads in effort.flight_own_quads
    ]
    cells = tuple(terrain.extent / QUADS / 2**level for level in effort.flight_grid_levels)
    found.append(DrawMethod("uniform grid", "{:g} m", cells, partial(_uniform, terrain)))
    rasters = _RasterMemory(terrain, min(effort.flight_pixels))
    absent = []
    for name in MESHERS:
        peer = mesher(name)
        if isinstance(peer, Absent):
            absent.append(peer)
        else:
            found.append(DrawMethod(peer.name, "{:g} px", effort.flight_pixels, partial(rasters.draw, peer)))
    return found, absent


@lru_cache(maxsize=32)
def thesis_view(terrain: Terrain, quads: int, tessellation: float) -> ThesisView:
    """Return the thesis's metric over the world."""
    return ThesisView(
        terrain.extent, quads, tessellation, FINEST_CELL, feature_discs(terrain.recipe, _FACTOR)
    )


def thesis_seconds(terrain: Terrain, places: npt.NDArray[np.int64], quads: int) -> float:
    """Return what the thesis's kernels take for tiles (level, column, row): a launch of each a tile."""
    seconds = 0.0
    for level in np.unique(places[:, 0]):
        keys = [(int(a), int(b), int(c)) for a, b, c in places[places[:, 0] == level]]
        tiles = ThesisTiles(terrain.recipe, terrain.context, keys, quads=quads)
        seconds += lap(partial(tiles.launch, SAMPLING)).wall
    return seconds


def _own(terrain: Terrain, quads: int, view: View, tolerance: float) -> Shown:
    tiles = OwnTiles(terrain, quads=quads, tolerance=tolerance)
    frame = tiles.converge(view_of(view.stop, terrain.extent))
    seen = drawn(terrain, within_world(frame.draws, quads), view)
    return Shown(seen.meshes(), seen.triangles, frame.generation + frame.choice, tiles.whole)


def _thesis(terrain: Terrain, quads: int, view: View, tessellation: float) -> Shown:
    chosen = thesis_view(terrain, quads, tessellation).tiles(view.stop.camera.eye, view.stop.ground)
    rows = np.array(chosen, np.int64)
    seen = drawn(terrain, Tiles(quads, rows[:, :3], rows[:, 3]), view)
    return Shown(seen.meshes(), seen.triangles, thesis_seconds(terrain, seen.places, quads))


def _uniform(terrain: Terrain, view: View, cell: float) -> Shown:
    level = round(np.log2(terrain.extent / QUADS / cell))
    seen = drawn(terrain, uniform_tiles(terrain.extent, QUADS, level), view)
    store = terrain.vertex_store(_BATCH, quads=QUADS)
    start = perf_counter()
    for first in range(0, len(seen.places), _BATCH):
        keys = [(int(a), int(b), int(c)) for a, b, c in seen.places[first : first + _BATCH]]
        terrain.write_tiles(keys, np.arange(len(keys)), np.full(len(keys), -1), store)
    return Shown(seen.meshes(), seen.triangles, perf_counter() - start)


class _RasterMemory:
    """Keeps the heightmaps of the last views, which all meshers and errors share."""

    def __init__(self, terrain: Terrain, finest: float) -> None:
        self._terrain = terrain
        self._apart = max(_APART, finest / 2)
        self._known: dict[View, Rasters] = {}

    def draw(self, peer: Mesher, view: View, pixels: float) -> Shown:
        if view not in self._known:
            self._known[view] = Rasters(self._terrain, view, apart=self._apart)
        rasters = self._known[view]
        start = perf_counter()
        meshes: Sequence[Mesh] = [
            peer.mesh(square, rasters.allowed(square, pixels)) for square in rasters.squares
        ]
        seconds = perf_counter() - start + rasters.seconds
        return Shown(meshes, sum(len(mesh.triangles) for mesh in meshes), seconds)
