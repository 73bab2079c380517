"""The flight's camera path, its images, and streaming of this program's tiles."""

from dataclasses import dataclass
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.benchmarks.flight_meshes import Tiles
from sketchterrain.benchmarks.screen_error import Picture
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.store import load_sketch
from sketchterrain.render.camera import Camera
from sketchterrain.render.flight import Flight, Keyframe
from sketchterrain.terrain.building import build
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.terrain.vertices import VERTEX
from sketchterrain.tiles.lod import CameraView, ScreenError
from sketchterrain.tiles.stream import TileStream
from sketchterrain.tiles.tile_pool import Batch, DrawList

EXTENT: Final = 4096.0
"""m; the thesis's terrain (section 7.1)."""
FINEST_CELL: Final = 0.2
"""m; its finest quads."""
PICTURE: Final = Picture(1280, 720)
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
    found = []
    for eye, target, fov, velocity, below in zip(*views, ground, strict=True):
        x, y, z = eye.tolist()
        camera = Camera((x, y, z), tuple(target.tolist()), fov=float(fov))
        found.append(Stop(camera, float(below), tuple(velocity.tolist())))
    return tuple(found)


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
        slots = min(_BYTES // (VERTEX.itemsize * (quads + 1) ** 2), _MOST_SLOTS)
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
        return self._stream.error_factor == 1.0

    def converge(self, view: CameraView) -> OwnFrame:
        """Generate all that a view wants; seconds count until the last tile that it shows is there.

        What is wanted out of the picture, for when the eye turns, comes after it.
        """
        batches: list[tuple[Batch, float, float]] = []
        start = perf_counter()

        def generate(batch: Batch) -> npt.NDArray[np.void]:
            begun = perf_counter()
            facts = self._terrain.write_tiles(batch.keys, batch.slots, batch.parents, self._store)
            batches.append((batch, begun, perf_counter()))
            return facts

        draws = self._stream.generate_all(view, generate)
        shown = set(draws.keys)
        last = max((i for i, (batch, _, _) in enumerate(batches) if shown & set(batch.keys)), default=-1)
        needed = batches[: last + 1]
        generation = sum(end - begun for _, begun, end in needed)
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
