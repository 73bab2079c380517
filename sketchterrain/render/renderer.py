"""Renderer of one terrain: complete still pictures, or frames of a moving picture within a time budget."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.geometry.camera import Camera, ClippedView, clip_planes, draw_distance
from sketchterrain.render.appearance import JUMP_BUDGET
from sketchterrain.render.ground_stream import view_of
from sketchterrain.render.programs import ResourceCache
from sketchterrain.render.quality import FrameStats, Quality, StreamStats, TimeBudget
from sketchterrain.render.scene import TerrainSource, surface_heights
from sketchterrain.render.scenery import Scenery
from sketchterrain.render.sharing_probe import moved_to_context, shared_with_gl
from sketchterrain.render.sky import Sun, Weather
from sketchterrain.render.targets import depth_rows
from sketchterrain.tiles.lod import FAINT

if TYPE_CHECKING:
    from sketchterrain.array_types import BoolArray, Bounds, Float32Array
    from sketchterrain.drape.drapes import Drapes

REST: Final = 0.25
"""s without motion or a change before a picture that lacks no visible tile is drawn at full size."""
FAST_DRAW: Final = 0.15  # s; a full-size picture faster than this is drawn at once after a change
CATCH_UP_SHARE: Final = 0.25
"""Share of the drawing time at full size that is loaded for, if that is more than the budget."""
DRAWING: Final = (0.02, 0.03)
"""s; pictures in motion shrink if drawing takes longer than the second, and grow below the first, ..."""
SCALE_STEP: Final = 0.9  # ... by this factor
PART: Final = 0.045  # s of preparing a refined picture at a time
STILL_PARTS: Final = 16  # parts of each costly pass of a refined picture
TILES_SHARE: Final = (0.8, 0.8, 0.8, 0.0)
"""Share of the budget for tiles, by frame, while light or plants are missing."""
OTHERS_SHARE: Final = (0.1, 0.1, 0.1, 1.0)
"""Share of the budget that light and plants get even if tiles exceeded theirs."""
LABELS_SHARE: Final = 0.1  # of the budget, for reading features besides that


class Renderer:
    """Draws one terrain into any framebuffer of one context.

    Still picture: `prepare`, then `draw`. Moving picture: `frame`, once per frame. `timings` sums up the
    seconds of each stage, `terrain` is on the device that writes its tiles: update from this one. Without
    `weather` the sketch's is used; a given `resources` is closed by `release` unless borrowed. `timer`
    measures the budget. `drapes` are drawn by ``tiles`` or a method of `draped.SCREEN_METHODS`.
    """

    def __init__(
        self,
        context: moderngl.Context,
        terrain: TerrainSource,
        *,
        sun: Sun,
        weather: Weather | None = None,
        textures: Path | None = None,
        quality: Quality | None = None,
        timer: Callable[[], float] = time.perf_counter,
        resources: ResourceCache | None = None,
        drapes: Drapes | None = None,
        drape_method: str = "tiles",
    ) -> None:
        self.timings: dict[str, float] = {}
        self._context = context
        self.terrain = terrain = shared_with_gl(terrain)
        self._quality = quality = quality or Quality()
        self._sun, self._weather = sun, weather or Weather.from_sketch(terrain.sketch)
        self._timer = timer
        self._last_camera: Camera | None = None
        self._ground: tuple[TerrainSource, tuple[float, float], float] = terrain, (np.inf, np.inf), 0.0
        self._rest_seconds, self._turn = 0.0, 0
        self._scale = max(0.5, quality.moving_scale)  # of pictures in motion
        self._was_whole = False  # the last picture, at full size
        self._since_update, self._full_draw_seconds = 0.0, 0.0
        self.scenery = Scenery(
            context,
            terrain,
            sun=sun,
            weather=self._weather,
            textures=textures,
            quality=quality,
            timed=self._timed,
            resources=resources,
            drape_method=drape_method,
        )
        self.stream = self.scenery.stream
        if drapes is not None:
            self.set_drapes(drapes)

    def prepare(self, camera: Camera, size: tuple[int, int], *, elapsed: float | None = None) -> None:
        """Generate all tiles, light and plants of a picture of `size` (width, height; px).

        `elapsed` (s) since the last frame of a film keeps labels steady; other pictures have no past.
        """
        for _ in self._prepared(self._clipped(camera), size, np.inf, elapsed):
            pass

    def _prepared(
        self, clipped: ClippedView, size: tuple[int, int], part: float, elapsed: float | None = None
    ) -> Iterator[None]:
        """Do what `prepare` does while iterated, in parts of about `part` s."""
        camera, distance, above = clipped
        scenery, pool, lit = self.scenery, self.stream.tiles.pool, self.scenery.lit
        seen = view_of(camera, size, draw_distance=distance)
        budget = partial(TimeBudget, part, timer=self._timer)
        steps: tuple[tuple[str, Callable[[], bool]], ...] = (
            ("light", lambda: lit.converge(camera, budget())),
            ("tiles", lambda: self.stream.refine(camera, size, draw_distance=distance, budget=part)),
            ("appearance", lambda: scenery.paint(seen, pool, budget())),
            ("foliage", lambda: scenery.forest.refine(camera, size, lit, budget())),
            ("appearance", lambda: scenery.labels.update(camera.eye, above, elapsed, part)),
        )
        scenery.settle_drapes()
        for stage, step in steps:
            complete = False
            while not complete:
                with self._timed(stage):
                    complete = step()
                if not complete:
                    yield

    def draw(
        self, camera: Camera, framebuffer: moderngl.Framebuffer, *, clock: float = 0.0, once: bool = False
    ) -> None:
        """Draw the prepared picture into a framebuffer; `clock` (s) animates water, plants and clouds.

        Drawn `once` it takes less memory.
        """
        with self._timed("draw"):
            clipped, size = self._clipped(camera), framebuffer.size
            for _ in self.scenery.draw(clipped, framebuffer, size=size, clock=clock, once=once):
                pass

    def refined(
        self, camera: Camera, framebuffer: moderngl.Framebuffer, *, clock: float = 0.0
    ) -> Iterator[None]:
        """Prepare and draw a still picture while iterated, in parts of about `PART`.

        A terrain, sun or weather that changes meanwhile, or another use of the context, spoils it.
        """
        clipped, size = self._clipped(camera), framebuffer.size
        yield from self._prepared(clipped, size, PART)
        for _ in self.scenery.draw(clipped, framebuffer, size=size, clock=clock, parts=STILL_PARTS):
            self._context.finish()
            yield

    def set_terrain(self, terrain: TerrainSource, areas: Sequence[Bounds]) -> None:
        """Replace the terrain by another one of the same extent, bit-equal outside `areas` (W, S, E, N; m).

        Call it between two frames. Visible tiles and water are updated before this returns, so no frame mixes
        two terrains. Light and plants follow in the next frames, within their budget.
        """
        self._since_update = 0.0
        self.terrain = moved_to_context(terrain, self.terrain.context)
        self.scenery.set_terrain(self.terrain, areas)

    def set_drapes(self, drapes: Drapes | None, held: tuple[int, int] | None = None) -> None:
        """Replace the draped layers from the next frame on.

        `held` (number of a layer, feature) is drawn by geometry on the drawn triangles: an edit of it paints
        no tile.
        """
        self.scenery.set_drapes(drapes, held)

    def relight(self, *, sun: Sun | None = None, weather: Weather | None = None) -> None:
        """Change sun or weather; shadows follow within the budget of the next frames."""
        self._sun, self._weather = sun or self._sun, weather or self._weather
        self.scenery.relight(self._sun, self._weather)

    def frame(
        self,
        camera: Camera,
        framebuffer: moderngl.Framebuffer,
        *,
        elapsed: float,
        clock: float = 0.0,
        budget: float | None = None,
        hasty: bool = False,
    ) -> FrameStats:
        """Draw the frame `elapsed` seconds after the last one, from the data loaded by then.

        New tiles, light and plants together take at most `budget` seconds (default: the quality's), except in
        the first frame, after the eye jumped and of another terrain; see `TerrainStream.update`. Until the
        camera rests and no tile is missing, and while the frame is `hasty`, a smaller picture is drawn and
        enlarged.
        """
        size, budget = framebuffer.size, self._quality.budget if budget is None else budget
        moves = self._last_camera is None or (camera.eye, camera.target, camera.fov) != (
            self._last_camera.eye,
            self._last_camera.target,
            self._last_camera.fov,
        )
        self._last_camera, self._rest_seconds = camera, 0.0 if moves else self._rest_seconds + elapsed
        if self._was_whole and not moves:
            budget = max(budget, CATCH_UP_SHARE * self._full_draw_seconds)
        clipped, draped = self._clipped(camera), self.scenery.draped.seconds
        self.scenery.advance_drapes(elapsed)
        loaded, tiles, light, plants = self._load(clipped, size, elapsed=elapsed, budget=budget)
        complete = loaded and self.scenery.forest.converged
        follows = self._full_draw_seconds <= FAST_DRAW or (self._since_update >= REST and not hasty)
        full_size = self.stream.tiles.complete and self._rest_seconds >= REST and follows
        self._was_whole = full_size
        scale = 1.0 if full_size else self._scale
        inner = (max(round(size[0] * scale), 1), max(round(size[1] * scale), 1))
        start = self._timer()
        with self._timed("draw"):
            moving = moves or not complete
            for _ in self.scenery.draw(clipped, framebuffer, size=inner, clock=clock, moving=moving):
                pass
        draw_seconds = self._timer() - start
        if full_size:
            self._full_draw_seconds = draw_seconds
            if draw_seconds <= DRAWING[1]:
                self._scale = 1.0
        else:
            self._adapt_scale(draw_seconds)
        whole = inner == size and self.scenery.labels.converged
        return FrameStats(
            **vars(tiles) | {"triangles": self.scenery.triangles, "converged": complete and whole},
            light_seconds=light,
            plant_seconds=plants,
            draw_seconds=draw_seconds,
            drape_seconds=self.scenery.draped.seconds - draped,
            size=inner,
        )

    def _adapt_scale(self, seconds: float) -> None:
        """Adapt the size of pictures in motion to the time that drawing the last one took."""
        shortest, longest = DRAWING
        step = SCALE_STEP if seconds > longest else 1.0 / SCALE_STEP if seconds < shortest else 1.0
        self._scale = min(max(step * self._scale, self._quality.moving_scale), 1.0)

    def load(self, camera: Camera, size: tuple[int, int], *, elapsed: float, budget: float) -> bool:
        """Load what frames of a view at rest show, within a budget (s); return whether it is complete.

        `elapsed` is the time (s) since the last frame or load.
        """
        self._rest_seconds += elapsed
        loaded, *_ = self._load(self._clipped(camera), size, elapsed=elapsed, budget=budget)
        return loaded and self.scenery.labels.complete and self.scenery.forest.loaded

    def _load(
        self, clipped: ClippedView, size: tuple[int, int], *, elapsed: float, budget: float
    ) -> tuple[bool, StreamStats, float, float]:
        """Advance all that is loaded within a budget (s).

        Return whether it is complete but for plants and labels, and the seconds of light and plants.
        """
        view, draw_distance, above = clipped
        lit, forest, scenery = self.scenery.lit, self.scenery.forest, self.scenery
        self._since_update += elapsed
        self._turn = (self._turn + 1) % len(TILES_SHARE)
        is_painted = scenery.appearance.converged and scenery.draped.converged
        others_pending = not (is_painted and lit.converged and forest.converged)
        tiles = self.stream.update(
            view,
            size,
            elapsed=elapsed,
            budget=budget * TILES_SHARE[self._turn] if others_pending else budget,
            draw_distance=draw_distance,
        )
        left = max(budget - tiles.generation_seconds, budget * OTHERS_SHARE[self._turn])
        if (seen := self.stream.view) is not None:
            if any(seen.velocity):  # as small as it is drawn
                seen = replace(seen, pixels_per_radian=seen.pixels_per_radian * self._scale)
            spent = TimeBudget(JUMP_BUDGET if tiles.jumped else 0.5 * left, timer=self._timer)
            scenery.paint(seen, self.stream.tiles.pool, spent)
            left = max(left - spent.spent, 0.0)
        remaining = TimeBudget(left, timer=self._timer)
        lit.update(view, elapsed, remaining.fraction(0.5))
        light_end = remaining.spent
        forest.update(view, size, lit, elapsed, remaining)
        plants = remaining.spent - light_end
        scenery.labels.update(view.eye, above, elapsed, LABELS_SHARE * budget)
        is_painted = scenery.appearance.converged and scenery.draped.converged
        return tiles.converged and lit.converged and is_painted, tiles, light_end, plants

    def _clipped(self, camera: Camera) -> ClippedView:
        """Return the camera with clipping planes for its height."""
        x, y, z = camera.eye
        if self._ground[0] is not self.terrain or self._ground[1] != (x, y):
            self._ground = self.terrain, (x, y), float(surface_heights(self.terrain, x, y))
        above = max(z - self._ground[2], 0.0)
        distance = draw_distance(above, extent=self.terrain.extent, extents=self._quality.draw_distance)
        near, far = clip_planes(min(above, self.scenery.built.clearance(camera.eye)), distance)
        return ClippedView(replace(camera, near=near, far=far), distance, above)

    def shape(self, camera: Camera, size: tuple[int, int]) -> tuple[Float32Array, BoolArray, BoolArray]:
        """Return what the last picture, of this camera, shows: for measurements.

        Distances (m) to its ground, drawn again at a size (px), infinite in the sky; where water is seen;
        where ground is not `FAINT`; each (height, width), row 0 on top.
        """
        view, reach, _ = self._clipped(camera)
        depth = self._context.depth_texture(size)
        target = self._context.framebuffer([], depth)
        target.use()
        target.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        for _ in self.stream.draw(camera.eye):
            pass
        z = 2.0 * depth_rows(depth).astype(np.float64) - 1.0
        distance = 2.0 * view.near * view.far / (view.far + view.near - z * (view.far - view.near))
        wet = self.scenery.water_mask()
        rows, columns = (np.arange(n) * m // n for n, m in zip(size[::-1], wet.shape, strict=True))
        clear = (z < 1.0) & (self.stream.tiles.metric.contrast(distance, reach) >= FAINT)
        return np.where(z < 1.0, distance, np.inf).astype(np.float32), wet[rows[:, None], columns], clear

    def release(self) -> None:
        """Free GPU memory (if the context's ``gc_mode`` is ``auto``); the renderer is unusable afterwards.

        Material textures stay in the disk cache: the next renderer starts within a second. Release overlays
        of this renderer's stream too.
        """
        self._context.finish()
        self.stream.release()
        del self.stream, self.scenery

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self._context.finish()
            self.timings[stage] = self.timings.get(stage, 0.0) + time.perf_counter() - start
