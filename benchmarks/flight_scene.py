"""The flight's camera path and views, this program's tiles along it, and the triangles drawn of a view."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.benchmarks.screen_error import PictureSize, ScreenSamples, screen_distances
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.flight import Flight, Keyframe
from sketchterrain.terrain.surfaces import vertex_dtype
from sketchterrain.tiles.lod import CameraView, ScreenError, inside_frustum, morph_weights
from sketchterrain.tiles.quadtree import tile_indices
from sketchterrain.tiles.stream import TileStream
from sketchterrain.tiles.tile_pool import Batch, DrawList

_CHUNK = 1 << 20  # vertices evaluated at once
_LOOKED_AT, _MORE = 129, 100.0  # places a side of the world, and m beyond what was found there


class Mesh(NamedTuple):
    """Positions (m), shape (n, 3), and which three make a triangle, shape (m, 3)."""

    vertices: Float64Array
    triangles: Int64Array


@dataclass(frozen=True)
class Tiles:
    """Tiles to draw."""

    quads: int
    places: Int64Array
    cases: Int64Array
    morph: npt.NDArray[np.float32] | None = None
    full: bool = False

    def __len__(self) -> int:
        return len(self.places)

    def some(self, which: npt.NDArray[np.generic]) -> Tiles:
        """Return those of the tiles."""
        morph = None if self.morph is None else self.morph[which]
        return Tiles(self.quads, self.places[which], self.cases[which], morph, self.full)

    @property
    def triangles(self) -> int:
        """How many they have together."""
        _, _, count = tile_indices(self.quads)
        return int(count[self.cases].sum()) // 3


@dataclass(frozen=True)
class Drawn:
    """Tiles in view with their vertices, (tiles, vertices, 3), in parts of one level each."""

    parts: tuple[tuple[Tiles, Float64Array], ...]

    @property
    def places(self) -> Int64Array:
        """Level, column and row of each tile, (n, 3)."""
        return np.concatenate([tiles.places for tiles, _ in self.parts])

    @property
    def triangles(self) -> int:
        """How many are drawn."""
        return sum(tiles.triangles for tiles, _ in self.parts)

    def meshes(self) -> Iterator[Mesh]:
        """Yield the triangles, many tiles together."""
        for tiles, vertices in self.parts:
            indices, first, count = tile_indices(tiles.quads)
            corners = [
                indices[first[case] : first[case] + count[case]].astype(np.int64) + number * vertices.shape[1]
                for number, case in enumerate(tiles.cases.tolist())
            ]
            yield Mesh(vertices.reshape(-1, 3), np.concatenate(corners).reshape(-1, 3))


class View(NamedTuple):
    """A view to be measured."""

    stop: Stop
    picture: PictureSize

    @property
    def planes(self) -> Float64Array:
        """Return the frustum's planes; see ``Camera.frustum``."""
        return self.stop.camera.frustum(self.picture.width / self.picture.height)


def uniform_tiles(extent: float, quads: int, level: int) -> Tiles:
    """Return all tiles of a level in the square world."""
    row, col = np.mgrid[: 2**level, : 2**level].reshape(2, -1)
    places = np.stack([np.full(row.size, level), col, row], axis=-1).astype(np.int64)
    return Tiles(quads, places, np.zeros(len(places), np.int64))


@lru_cache(maxsize=4)
def height_range(terrain: Terrain) -> tuple[float, float]:
    """Return heights that no ground of the square world is below or above, m."""
    along = np.linspace(0.0, terrain.extent, _LOOKED_AT)
    heights = terrain.heights(along[None], along[:, None])
    return float(heights.min()) - _MORE, float(heights.max()) + _MORE


def drawn(terrain: Terrain, tiles: Tiles, view: View) -> Drawn:
    """Return the tiles that the frustum may show, judged by the lowest and highest of their vertices."""
    west, south, width = _squares(terrain, tiles)
    corner = np.stack([west, south], axis=-1)
    bottom, top = (np.full((len(tiles), 1), each) for each in height_range(terrain))
    low, high = np.hstack([corner, bottom]), np.hstack([corner + width[:, None], top])
    tiles = tiles.some(np.flatnonzero(inside_frustum(view.planes, low, high)))
    parts = []
    for part in _parts(tiles):
        vertices = _positions(terrain, part)
        seen = np.flatnonzero(inside_frustum(view.planes, vertices.min(axis=1), vertices.max(axis=1)))
        if seen.size:
            parts.append((part.some(seen), vertices[seen]))
    return Drawn(tuple(parts))


def measured(terrain: Terrain, meshes: Iterable[Mesh], view: View, *, every: int) -> Float64Array:
    """Return how many pixels what is seen of triangles stands from the terrain in full detail."""
    camera = view.stop.camera
    samples = ScreenSamples(camera, view.picture, every=every)
    for mesh in meshes:
        samples.add(mesh.vertices, mesh.triangles)
    points = samples.seen()
    return screen_distances(camera, view.picture, points, terrain.heights(points[:, 0], points[:, 1]))


def _squares(terrain: Terrain, tiles: Tiles) -> tuple[Float64Array, Float64Array, Float64Array]:
    width = terrain.extent * np.exp2(-tiles.places[:, 0].astype(np.float64))
    return tiles.places[:, 1] * width, tiles.places[:, 2] * width, width


def _parts(tiles: Tiles) -> Iterator[Tiles]:
    """Yield the tiles of each level, so many at once as memory is meant for."""
    room = max(1, _CHUNK // (tiles.quads + 1) ** 2)
    for level in np.unique(tiles.places[:, 0]):
        which = np.flatnonzero(tiles.places[:, 0] == level)
        for start in range(0, len(which), room):
            yield tiles.some(which[start : start + room])


def _positions(terrain: Terrain, tiles: Tiles) -> Float64Array:
    """Return the vertices of tiles of one level, (tiles, vertices, 3)."""
    west, south, width = _squares(terrain, tiles)
    cell = float(width[0]) / tiles.quads
    x, y, z = _heights(terrain, west, south, tiles.quads, cell, full=tiles.full)
    if tiles.morph is not None:
        # A vertex that the parent lacks lies on its edge or its diagonal from north-west to south-east.
        odd = tiles.places[:, 1:] % 2
        corner_x, corner_y = west - odd[:, 0] * width, south - odd[:, 1] * width
        _, _, above = _heights(terrain, corner_x, corner_y, tiles.quads, 2 * cell, full=tiles.full)
        half = tiles.quads // 2
        parts = [
            above[i, half * (1 - row) : half * (2 - row) + 1, half * col : half * (col + 1) + 1]
            for i, (col, row) in enumerate(odd.tolist())
        ]
        share = morph_weights(tiles.morph, tiles.quads)
        z = z * (1 - share) + _refined(np.stack(parts)) * share
    return np.asarray(np.stack(np.broadcast_arrays(x, y, z), axis=-1).reshape(len(tiles), -1, 3))


def _heights(
    terrain: Terrain, west: Float64Array, south: Float64Array, quads: int, cell: float, *, full: bool
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return x, y and z of vertices, rows from north to south, (tiles, quads + 1, quads + 1)."""
    along = np.arange(quads + 1) * cell
    x = west[:, None, None] + along[None, None, :]
    y = south[:, None, None] + along[None, ::-1, None]
    z = terrain.heights(x, y, cell_size=0.0 if full else cell).astype(np.float64)
    return x, y, z


def _refined(coarse: Float64Array) -> Float64Array:
    """Return a surface's heights at twice as many places a side, on its triangles."""
    count, side, _ = coarse.shape
    fine = np.empty((count, 2 * side - 1, 2 * side - 1))
    fine[:, ::2, ::2] = coarse
    fine[:, ::2, 1::2] = (coarse[:, :, 1:] + coarse[:, :, :-1]) / 2
    fine[:, 1::2, ::2] = (coarse[:, 1:] + coarse[:, :-1]) / 2
    fine[:, 1::2, 1::2] = (coarse[:, :-1, :-1] + coarse[:, 1:, 1:]) / 2
    return fine


EXTENT: Final = 4096.0
"""m; the thesis's terrain (section 7.1)."""
FINEST_CELL: Final = 0.2
"""m; its finest quads."""
PICTURE: Final = PictureSize(1280, 720)
RATE: Final = 30.0
"""Frames a second."""

_FOV = 45.0
_PRESET = "valley_river"
_RADIUS, _SPEED = 1100.0, 40.0  # m, m/s
_HEIGHTS = (4.0, 6.0, 15.0, 40.0, 75.0, 105.0, 120.0, 95.0, 55.0, 20.0, 6.0)  # m above the ground
_APART = 1.0  # s
_AHEAD, _LOOK = 400.0, 20.0  # m: what the eye looks at, and how high that is above the ground


@dataclass(frozen=True)
class Stop:
    """A frame of the flight."""

    camera: Camera
    ground: float
    velocity: tuple[float, float, float]


def open_world(context: ComputeContext) -> Terrain:
    """Return valley_river over :data:`EXTENT` metres."""
    return build(load_sketch(_PRESET).replace(extent=EXTENT), device=context)


def recorded(terrain: Terrain) -> Flight:
    """Return the flight: ten seconds at 40 m/s along a circle, 4 to 120 m above the ground."""
    keys = []
    for number, height in enumerate(_HEIGHTS):
        turn = number * _SPEED * _APART / _RADIUS
        outward, ahead = (
            np.array(pair) for pair in ((np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn)))
        )
        eye = EXTENT / 2 + _RADIUS * outward
        target = eye + _AHEAD * ahead
        keys.append(Keyframe(number * _APART, (*eye.tolist(), height), (*target.tolist(), _LOOK), _FOV))
    flight = Flight(tuple(keys), heights="above ground")
    return flight.with_absolute_heights(lambda x, y: terrain.heights(x, y).astype(np.float64), clearance=2.0)


def stops(
    terrain: Terrain, frames: int, *, seconds: float = _APART * (len(_HEIGHTS) - 1)
) -> tuple[Stop, ...]:
    """Return so many frames of the flight, evenly over its first seconds."""
    flight = recorded(terrain)
    views = flight.at(np.linspace(0.0, seconds, frames))
    ground = terrain.heights(views.eye[:, 0], views.eye[:, 1])
    rows = zip(views.cameras, ground.tolist(), views.velocity.tolist(), strict=True)
    return tuple(Stop(camera, below, tuple(velocity)) for camera, below, velocity in rows)


_BYTES = 2040 << 20  # of a pool: large tiles need much
_MOST_SLOTS = 8192


class OwnFrame(NamedTuple):
    """A frame of this program's."""

    generation: float
    choice: float
    tiles: int
    draws: DrawList


class OwnTiles:
    """Tiles by their error on the screen, in a store of their own."""

    def __init__(self, terrain: Terrain, *, quads: int, tolerance: float) -> None:
        slots = min(_BYTES // (vertex_dtype(len(terrain.materials)).itemsize * (quads + 1) ** 2), _MOST_SLOTS)
        self._terrain = terrain
        self._store = terrain.vertex_store(slots, quads=quads)
        self._stream = TileStream(
            terrain.extent,
            quads=quads,
            slots=slots,
            finest_cell=FINEST_CELL,
            metric=ScreenError(tolerance=tolerance),
        )

    @property
    def count(self) -> int:
        """Tiles in the pool."""
        return self._stream.pool.count

    @property
    def whole(self) -> bool:
        """Whether the pool is large enough for what is asked."""
        return self._stream._error_factor == 1.0

    def converge(self, view: CameraView) -> OwnFrame:
        """Generate all that a view wants; seconds count until the last tile that it shows is there.

        What is wanted out of the picture, for when the eye turns, comes after it.
        """
        batches: list[tuple[Batch, float, float]] = []
        start = perf_counter()

        def generate(batch: Batch) -> npt.NDArray[np.void]:
            batch_start = perf_counter()
            facts = self._terrain.write_tiles(batch.keys, batch.slots, batch.parents, self._store)
            batches.append((batch, batch_start, perf_counter()))
            return facts

        draws = self._stream.generate_all(view, generate)
        shown = set(draws.keys)
        last = max((i for i, (batch, _, _) in enumerate(batches) if shown & set(batch.keys)), default=-1)
        needed = batches[: last + 1]
        generation = sum(end - batch_start for _, batch_start, end in needed)
        whole = needed[-1][2] - start if needed else 0.0
        tiles = sum(len(batch.keys) for batch, _, _ in needed)
        return OwnFrame(generation, whole - generation, tiles, draws)

    def frame(self, view: CameraView, *, elapsed: float, budget: float) -> OwnFrame:
        """Go on by a frame: generate what fits into the budget (s)."""
        start = perf_counter()
        batch = self._stream.plan(view, budget=budget)
        chosen = perf_counter()
        seconds = 0.0
        if batch:
            facts = self._terrain.write_tiles(batch.keys, batch.slots, batch.parents, self._store)
            seconds = perf_counter() - chosen
            self._stream.mark_generated(batch, facts, seconds=seconds)
        draws = self._stream.advance(view, elapsed=elapsed)
        return OwnFrame(seconds, perf_counter() - start - seconds, len(batch.keys), draws)


def view_of(stop: Stop, extent: float, *, around: bool = False) -> CameraView:
    """Return a stop's view of the square world, or of all of it around the eye."""
    camera = stop.camera
    # Nothing is to be seen beyond the world: the other ways have nothing there either.
    world = [[1.0, 0, 0, 0], [-1, 0, 0, extent], [0, 1, 0, 0], [0, -1, 0, extent]]
    frustum = camera.frustum(PICTURE.width / PICTURE.height)
    planes = np.array(world) if around else np.concatenate([frustum, world])
    scale = PICTURE.pixels_per_radian(camera)
    return CameraView(camera.eye, planes, scale, velocity=stop.velocity, draw_distance=2 * extent)


def within_world(draws: DrawList, quads: int) -> Tiles:
    """Return the drawn tiles that lie in the square world."""
    places = np.array(draws.keys, np.int64).reshape(-1, 3)
    level, col, row = places.T
    side = np.int64(1) << level.clip(0)
    inside = np.flatnonzero((level >= 0) & (col >= 0) & (row >= 0) & (col < side) & (row < side))
    return Tiles(quads, places[inside], draws.cases[inside], draws.morph[inside])
