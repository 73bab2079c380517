"""Tiles for each frame: chosen, generated within the frame's budget, and drawn."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.features.recent import IdentityKey
from sketchterrain.render.ground import TileRenderer
from sketchterrain.render.kept import ResourceCache
from sketchterrain.render.quality import Quality
from sketchterrain.render.scene import BoundedTerrain
from sketchterrain.render.sharing_probe import moved_to_context, shared_with_gl
from sketchterrain.render.stats import StreamStats, TileUpdateStats
from sketchterrain.render.vertex_memory import GLVertexMemory, open_vertex_memory
from sketchterrain.terrain.vertices import VERTEX
from sketchterrain.tiles import CameraView, ScreenError, TileStream
from sketchterrain.tiles.bounds import UNBOUNDED

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import moderngl
    import numpy.typing as npt

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import TileSource
    from sketchterrain.tiles import Batch, DrawList
    from sketchterrain.tiles.metrics import Metric

    Box = tuple[float, float, float, float]

QUAD, QUAD_A_PIXEL = 24.0, 8.0
"""px; quads are no wider than the first and so much more for each pixel of tolerance."""
LEAP: Final = 0.1
"""Extents. An eye that is farther from where it was in the last frame has been put there."""
LEAP_BUDGET: Final = 0.5
"""s for the first frame, and for one after a leap: so much goes into a whole picture at once."""
HURRY_SECONDS: Final = 2.0
"""So long after a leap at most, until the picture is as good as it gets ..."""
HURRY: Final = 8.0
"""... tiles morph so many times as quickly ..."""
HURRY_SHARE: Final = 0.5
"""... and may take so much of the time, if that is more than the budget."""
_MOST_BATCHES: Final = 64
"""In a frame."""
_ROOM: Final = 1.5
"""Times as long as the longest of a frame another batch must have left."""


class TerrainStream:
    """The ground as a camera sees it, frame by frame.

    Parameters
    ----------
    context
        Where it is drawn.
    terrain
        Whose ground.
    quality
        How large tiles are, how exact, and how much memory they may take.
    memory
        Kind of the vertices' memory, see :func:`open_vertex_memory`; the best that works by default.
    finest_cell
        No quad is made narrower than this, m, nor than a ground that is `BoundedTerrain` knows itself.
    metric
        Which tiles are too coarse; by default by the quality's tolerance on the screen.
    timer
        Seconds that run on, by which the time for tiles is kept.
    kept
        Has the vertices' memory, and is closed with this; by default there is nothing else in it.

    Attributes
    ----------
    pool : TileRenderer
        What draws; overlays draw the same tiles by other programs.
    tiles : TileStream
        Which tiles there are.
    draws : DrawList or None
        What the last frame draws.
    memory : GLVertexMemory
        Where the vertices live.
    terrain : TileSource
        Whose ground it is, on the device that writes the vertices.
    written : int
        Tiles generated so far.
    """

    def __init__(
        self,
        context: moderngl.Context,
        terrain: TileSource,
        quality: Quality | None = None,
        *,
        memory: str | None = None,
        finest_cell: float = 0.2,
        metric: Metric | None = None,
        timer: Callable[[], float] = time.perf_counter,
        kept: ResourceCache | None = None,
    ) -> None:
        quality = quality or Quality()
        terrain = shared_with_gl(terrain)
        quads = quality.quads
        tile_bytes = (quads + 1) ** 2 * VERTEX.itemsize
        slots = max(quality.tile_memory // tile_bytes, 1)
        bounds = terrain.bounds if isinstance(terrain, BoundedTerrain) else None
        if isinstance(terrain, BoundedTerrain):
            finest_cell = max(finest_cell, terrain.finest_cell)
        self.tiles = TileStream(
            terrain.extent,
            quads=quads,
            slots=slots,
            finest_cell=finest_cell,
            bounds=bounds or UNBOUNDED,
            metric=metric
            or ScreenError(
                quality.tolerance, quad=QUAD + QUAD_A_PIXEL * quality.tolerance, neighbour_limit=quality.steep
            ),
        )
        self.draws: DrawList | None = None
        self.written = 0
        self.terrain = terrain
        self._timer = timer
        self._view: CameraView | None = None
        self._kept = kept or ResourceCache()
        self.memory = self._kept.of(
            "vertices",
            (IdentityKey(terrain.context), slots * tile_bytes, memory),
            lambda: open_vertex_memory(context, terrain.context, slots * tile_bytes, kind=memory),
            close=GLVertexMemory.close,
        )
        self._store = terrain.vertex_store(slots, quads=quads, memory=self.memory)
        self.pool = TileRenderer(context, terrain.extent, self.memory.vertices, quads=quads, bounds=bounds)
        self._eye: npt.NDArray[np.float64] | None = None
        self._placed_for: tuple[float, float, float] | None = None
        self._since_leap = np.inf

    def update(
        self,
        camera: Camera,
        size: tuple[int, int],
        *,
        elapsed: float,
        budget: float,
        draw_distance: float,
    ) -> StreamStats:
        """Go on by a frame: generate what the budget allows, split, merge and morph.

        Parameters
        ----------
        camera
            From where. An eye more than a tenth of an extent away from the last frame's has leapt: a whole
            picture is made at once, and it becomes as good as it gets within a second or so.
        size
            Width and height of the picture, px.
        elapsed
            Seconds since the last frame.
        budget
            Seconds that tiles may take. The first frame, and one after a leap, begins none after 0.5 s; until
            the picture is whole, for 2 s at most, half of the time may then go into them.
        draw_distance
            Horizontal distance up to which the ground is drawn, m.
        """
        eye = np.asarray(camera.eye)
        gone = np.inf if self._eye is None else float(np.linalg.norm(eye - self._eye))
        leapt = gone > LEAP * self.terrain.extent
        velocity = (0.0, 0.0, 0.0)
        if self._eye is not None and not leapt and elapsed > 0:
            x, y, z = ((eye - self._eye) / elapsed).tolist()
            velocity = (x, y, z)
        self._eye = eye
        self._since_leap = 0.0 if leapt else self._since_leap + elapsed
        self._view = view = view_of(camera, size, draw_distance=draw_distance, velocity=velocity)
        hurries = self._since_leap < HURRY_SECONDS
        if leapt:
            budget = max(LEAP_BUDGET, budget)
        elif hurries:
            budget = max(HURRY_SHARE * elapsed, budget)
        count, seconds = self._generate(view, budget, leapt=leapt)
        if leapt:
            self.tiles.jump(view)
        draws = self.tiles.advance(view, elapsed=HURRY * elapsed if hurries else elapsed)
        self._place(self._renewed(view, draws), camera.eye)
        if self.tiles.converged:
            self._since_leap = np.inf
        return StreamStats(
            seconds,
            count,
            self.pool.tiles,
            self.pool.triangles,
            self.tiles.pool.count,
            self.tiles.converged,
            leapt,
        )

    def settle(self, camera: Camera, size: tuple[int, int], *, draw_distance: float) -> None:
        """Generate all that a still picture shows; see :meth:`update`."""
        self._view = view = view_of(camera, size, draw_distance=draw_distance)
        self._place(self.tiles.generate_all(view, self._write), camera.eye)
        self._eye = np.asarray(camera.eye)

    def change(self, terrain: TileSource, areas: Sequence[Box]) -> TileUpdateStats:
        """Show another terrain of the same extent from now on.

        What the last frame's view may show of the areas is written anew before this returns, so that no frame
        shows some tiles as they were and some as they are; the rest before it is shown.

        Parameters
        ----------
        terrain
            The other one, on the same device.
        areas
            West, south, east, north (m): elsewhere it is the same to the bit.

        Raises
        ------
        InputError
            If the extent is another one.
        """
        if terrain.extent != self.terrain.extent:
            raise InputError(
                f"expected a terrain of the same extent, {self.terrain.extent:g} m, got {terrain.extent:g} m"
            )
        start, before = self._timer(), self.written
        self.terrain = moved_to_context(terrain, self.terrain.context)
        dropped = self.tiles.invalidate(areas)
        if self._view is not None and self.draws is not None:
            self._place(self._renewed(self._view, self.tiles.draw_list(self._view)), self._view.eye)
        return TileUpdateStats(self._timer() - start, self.written - before, dropped)

    def _renewed(self, view: CameraView, draws: DrawList) -> DrawList:
        """Write anew what is outdated of what a view is to show; return what it shows then.

        TileSource that has sunk may show more that is outdated behind it.
        """
        while batch := self.tiles.stale_batch(draws):
            self.tiles.mark_generated(batch, self._write(batch), seconds=None)
            draws = self.tiles.draw_list(view)
        return draws

    def draw(self, eye: tuple[float, float, float]) -> None:
        """Draw the ground; the camera stands in the frame's uniform block, its eye is told once more."""
        if self.draws is not None:
            if eye != self._placed_for:
                self._place(self.draws, eye)
            self.pool.draw()

    def release(self) -> None:
        """Give what is kept back, where it is not lent; nothing can be drawn any more."""
        self.draws = None
        self._kept.close()

    def _place(self, draws: DrawList, eye: tuple[float, float, float]) -> None:
        self.draws, self._placed_for = draws, eye
        self.pool.place(draws, eye)

    def _generate(self, view: CameraView, budget: float, *, leapt: bool) -> tuple[int, float]:
        """Generate what fits into a budget (s); return how many tiles, and what they took (s)."""
        count, spent, longest = 0, 0.0, 0.0
        for _ in range(_MOST_BATCHES):
            left = max(budget - spent, 0.0)
            if left < _ROOM * longest:
                break
            batch = self.tiles.plan(view, budget=np.inf if leapt and left > 0 else left)
            if not batch:
                break
            start = self._timer()
            facts = self._write(batch)
            seconds = self._timer() - start
            self.tiles.mark_generated(batch, facts, seconds=seconds)
            count, spent = count + len(batch.keys), spent + seconds
            longest = 0.0 if leapt else max(longest, seconds)
        return count, spent

    def _write(self, batch: Batch) -> npt.NDArray[np.void]:
        self.written += len(batch.keys)
        self.pool.rewritten(batch.slots)
        return self.terrain.write_tiles(batch.keys, batch.slots, batch.parents, self._store)


def view_of(
    camera: Camera,
    size: tuple[int, int],
    *,
    draw_distance: float,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> CameraView:
    """Return what tiles need to know of a camera that takes a picture of so many pixels."""
    width, height = size
    return CameraView(
        camera.eye,
        camera.frustum(width / height),
        height / (2.0 * float(np.tan(np.radians(camera.fov) / 2.0))),
        velocity=velocity,
        draw_distance=draw_distance,
    )
