"""Terrain tile streaming: select, generate within a time budget, and draw the tiles of each frame."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds
from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.ground import TileRenderer
from sketchterrain.render.programs import ResourceCache
from sketchterrain.render.quality import Quality, StreamStats
from sketchterrain.render.scene import BoundedTerrain, TileSource
from sketchterrain.render.sharing_probe import moved_to_context, shared_with_gl
from sketchterrain.render.textures import wooded_share
from sketchterrain.render.vertex_memory import GLVertexMemory, open_vertex_memory
from sketchterrain.schema.materials import weight_words
from sketchterrain.terrain.surfaces import vertex_dtype
from sketchterrain.tiles.lod import CameraView, ScreenError
from sketchterrain.tiles.quadtree import UNBOUNDED
from sketchterrain.tiles.stream import TileStream
from sketchterrain.tiles.tile_pool import Batch, DrawList

QUAD, QUAD_PER_TOLERANCE = 24.0, 8.0  # px; largest width of a quad: constant, and per pixel of tolerance
FINEST_CELL: Final = 0.2  # m, least width of a quad
JUMP: Final = 0.1  # Extents; a larger motion between two frames is a jump
FIRST_BUDGET, JUMP_BUDGET, CHANGE_BUDGET = 2.0, 0.5, 0.1
"""s for the first frame, that of a jump, and the first of another terrain: the next one may be waiting."""
CATCH_UP_SECONDS: Final = 2.0
"""s after a jump during which, until the picture is final, ..."""
MORPH_SPEEDUP: Final = 8.0
"""... tiles morph this many times faster ..."""
CATCH_UP_SHARE: Final = 0.5  # ... and may take this share of the time, if that is more than the budget
_MAX_BATCHES: Final = 64  # per frame
_BATCH_MARGIN: Final = 1.5
"""Another batch starts if this many times the longest batch of the frame still fits."""


class TerrainStream:
    """Tiles of a terrain for a moving camera.

    `metric` replaces the quality's screen-space error. `tiles` selects and caches tiles, `tile_renderer`
    draws them (overlays draw the same tiles with other programs), `view` is the last view, with its velocity,
    `draws` the last frame's list, `written` counts generated tiles.
    """

    def __init__(
        self,
        context: moderngl.Context,
        terrain: TileSource,
        quality: Quality | None = None,
        *,
        metric: ScreenError | None = None,
        timer: Callable[[], float] = time.perf_counter,
        resources: ResourceCache | None = None,
    ) -> None:
        quality = quality or Quality()
        terrain = shared_with_gl(terrain)
        quads = quality.quads
        materials = len(terrain.sketch.material_table)
        words = weight_words(materials)
        tile_bytes = (quads + 1) ** 2 * vertex_dtype(materials).itemsize
        slots = max(quality.tile_memory // tile_bytes, 1)
        bounds = terrain.bounds if isinstance(terrain, BoundedTerrain) else None
        own_cell = terrain.finest_cell if isinstance(terrain, BoundedTerrain) else 0.0
        self.tiles = TileStream(
            terrain.extent,
            quads=quads,
            slots=slots,
            finest_cell=max(FINEST_CELL, own_cell),
            bounds=bounds or UNBOUNDED,
            metric=metric
            or ScreenError(
                quality.tolerance,
                quad=QUAD + QUAD_PER_TOLERANCE * quality.tolerance,
                neighbour_limit=quality.neighbour_limit,
            ),
        )
        self.draws: DrawList | None = None
        self.written = 0
        self.terrain = terrain
        self._timer = timer
        self.view: CameraView | None = None
        self._resources = resources or ResourceCache()
        self.memory = self._resources.get_or_create(
            "vertices",
            (terrain.context, slots * tile_bytes),
            lambda: open_vertex_memory(context, terrain.context, slots * tile_bytes),
            close=GLVertexMemory.close,
        )
        self._store = terrain.vertex_store(slots, quads=quads, memory=self.memory)
        self.tile_renderer = TileRenderer(
            *(context, terrain.extent, self.memory.vertices, words),
            wooded=wooded_share(terrain.sketch.material_table),
            quads=quads,
            bounds=bounds,
        )
        self._camera: Camera | None = None  # of the last frame; None: the next one jumps
        self._placed_eye: tuple[float, float, float] | None = None
        self._since_jump = np.inf
        self._changed = False  # the terrain, since the last frame

    def update(
        self,
        camera: Camera,
        size: tuple[int, int],
        *,
        elapsed: float,
        budget: float,
        draw_distance: float,
    ) -> StreamStats:
        """Advance by one frame: generate tiles within `budget` (s), split, merge and morph.

        The first frame starts no batch after 2 s, that of a jump none after 0.5 s. The first of another
        terrain generates what is in sight for 0.1 s. Afterwards, until the picture is final, tiles may take
        half of `elapsed` (s) for at most 2 s, and morph faster; at rest, 0.1 s while one in sight is missing.
        """
        before, self._camera = self._camera, camera
        moved = np.full(3, np.inf) if before is None else np.subtract(camera.eye, before.eye)
        far = float(np.linalg.norm(moved)) > JUMP * self.terrain.extent
        jumped, self._changed = far or self._changed, False
        velocity = (0.0, 0.0, 0.0)
        if not jumped and elapsed > 0:
            x, y, z = (moved / elapsed).tolist()
            velocity = (x, y, z)
        self._since_jump = 0.0 if jumped else self._since_jump + elapsed
        self.view = view = view_of(camera, size, draw_distance=draw_distance, velocity=velocity)
        lacks_shape = camera == before and not self.tiles.complete
        catches_up = self._since_jump < CATCH_UP_SECONDS
        if jumped:
            least = FIRST_BUDGET if self.draws is None else JUMP_BUDGET if far else CHANGE_BUDGET
            budget = max(least, budget)
        elif lacks_shape:
            budget = max(CHANGE_BUDGET, budget)
        elif catches_up:
            budget = max(CATCH_UP_SHARE * elapsed, budget)
        count, seconds = self._generate(view, budget, jumped=far, in_sight=jumped and not far)
        if jumped:
            self.tiles.jump(view)
        draws = self.tiles.advance(view, elapsed=MORPH_SPEEDUP * elapsed if catches_up else elapsed)
        self._place(self._with_updated_tiles(view, draws), camera.eye)
        if self.tiles.converged:
            self._since_jump = np.inf
        return StreamStats(
            seconds,
            count,
            self.tile_renderer.tiles,
            self.tile_renderer.triangles,
            self.tiles.complete,
            self.tiles.converged,
            far,
        )

    def refine(self, camera: Camera, size: tuple[int, int], *, draw_distance: float, budget: float) -> bool:
        """Generate tiles of a still within a budget (s), and place them; return whether that is complete."""
        self.view = view = view_of(camera, size, draw_distance=draw_distance)
        if budget < np.inf:  # else `converge` generates them
            self._generate(view, budget, still=True)
            if not self.tiles.has_still:
                return False
        self.converge(camera, size, draw_distance=draw_distance, still=True)
        return True

    def converge(
        self, camera: Camera, size: tuple[int, int], *, draw_distance: float, still: bool = False
    ) -> None:
        """Generate all tiles of a view; a `still` lacks those that are not in the picture."""
        self.view = view = view_of(camera, size, draw_distance=draw_distance)
        self._place(self.tiles.generate_all(view, self._write, still=still), camera.eye)
        self._camera = None if still else camera  # after a still the next frame jumps

    def set_terrain(self, terrain: TileSource, areas: Sequence[Bounds]) -> None:
        """Replace the terrain by another one of the same extent, bit-equal outside `areas` (W, S, E, N; m).

        Visible tiles of the areas are rewritten before this returns, so that no frame mixes two terrains; the
        others before they become visible.
        """
        if terrain.extent != self.terrain.extent:
            raise InputError(
                f"expected a terrain of the same extent, {self.terrain.extent:g} m, got {terrain.extent:g} m"
            )
        self.terrain = moved_to_context(terrain, self.terrain.context)
        self.tiles.invalidate(areas)
        self._changed = True
        if self.view is not None and self.draws is not None:
            self._place(self._with_updated_tiles(self.view, self.tiles.draw_list(self.view)), self.view.eye)

    def _with_updated_tiles(self, view: CameraView, draws: DrawList) -> DrawList:
        """Rewrite outdated tiles of a draw list; return the list afterwards."""
        # Terrain that was lowered may reveal more outdated tiles behind it.
        while batch := self.tiles.stale_batch(draws):
            self.tiles.mark_generated(batch, self._write(batch), seconds=None)
            draws = self.tiles.draw_list(view)
        return draws

    def draw(self, eye: tuple[float, float, float], *, parts: int = 1) -> Iterator[None]:
        """Draw the tiles with the camera of the frame's uniform block, which has the same eye.

        Yields between parts.
        """
        if self.draws is not None:
            if eye != self._placed_eye:
                self._place(self.draws, eye)
            for tiles in np.array_split(np.arange(self.tile_renderer.tiles), parts):
                self.tile_renderer.draw(tiles=None if parts == 1 else tiles)
                yield

    def release(self) -> None:
        """Release the vertex memory unless borrowed; nothing can be drawn afterwards."""
        self.draws = None
        self._resources.close()

    def _place(self, draws: DrawList, eye: tuple[float, float, float]) -> None:
        self.draws, self._placed_eye = draws, eye
        self.tile_renderer.set_tiles(draws, eye)

    def _generate(
        self, view: CameraView, budget: float, *, jumped: bool = False, **which: bool
    ) -> tuple[int, float]:
        """Generate batches within a budget (s); return the number of tiles and the seconds spent."""
        count, spent, longest = 0, 0.0, 0.0
        for _ in range(_MAX_BATCHES):
            left = max(budget - spent, 0.0)
            if left < _BATCH_MARGIN * longest:
                break
            batch = self.tiles.plan(view, budget=np.inf if jumped and left > 0 else left, **which)
            if not batch:
                break
            start = self._timer()
            statistics = self._write(batch)
            seconds = self._timer() - start
            waited = self.draws is None and not count  # until the kernels were built
            self.tiles.mark_generated(batch, statistics, seconds=None if waited else seconds)
            count, spent = count + len(batch.keys), spent + (0.0 if waited else seconds)
            longest = 0.0 if jumped else max(longest, seconds)
        return count, spent

    def _write(self, batch: Batch) -> npt.NDArray[np.void]:
        self.written += len(batch.keys)
        self.tile_renderer.mark_rewritten(batch.slots)
        return self.terrain.write_tiles(batch.keys, batch.slots, batch.parents, self._store)


def view_of(
    camera: Camera,
    size: tuple[int, int],
    *,
    draw_distance: float,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> CameraView:
    """Return the tile selection's view of a camera with a picture of `size` (px); `velocity` in m/s."""
    width, height = size
    return CameraView(
        camera.eye,
        camera.frustum(width / height),
        height / (2.0 * float(np.tan(np.radians(camera.fov) / 2.0))),
        velocity=velocity,
        draw_distance=draw_distance,
    )
