"""Tiles of the program over a view or a flight: chosen and generated as the renderer does, but not drawn."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.benchmarks.flight_meshes import Tiles
from sketchterrain.benchmarks.flight_scene import FINEST_CELL, PICTURE
from sketchterrain.terrain.vertices import VERTEX
from sketchterrain.tiles.lod import CameraView, ScreenError
from sketchterrain.tiles.stream import TileStream

if TYPE_CHECKING:
    from sketchterrain.benchmarks.flight_scene import Stop
    from sketchterrain.terrain.terrain import Terrain
    from sketchterrain.tiles.tile_pool import Batch, DrawList

_BYTES = 2040 << 20  # of a pool: large tiles need much
_MOST_SLOTS = 8192


class OwnFrame(NamedTuple):
    """A frame of this program's.

    Attributes
    ----------
    generation, choice : float
        Seconds in which tiles were generated, and chosen.
    tiles : int
        How many were generated.
    draws : DrawList
    """

    generation: float
    choice: float
    tiles: int
    draws: DrawList


class OwnTiles:
    """Tiles by their error on the screen, in a store of their own.

    Parameters
    ----------
    terrain
        Whose tiles.
    quads
        Along a tile's side.
    tolerance
        τ, px.
    """

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

    def settle(self, view: CameraView) -> OwnFrame:
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
