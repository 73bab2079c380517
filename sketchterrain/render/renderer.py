"""Draw a terrain: a still picture with all that belongs to it, or frame by frame what is ready."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from sketchterrain.render.allowance import TimeBudget
from sketchterrain.render.draw_distance import clipped
from sketchterrain.render.quality import Quality
from sketchterrain.render.scenery import Scenery
from sketchterrain.render.sharing_probe import moved_to_context, shared_with_gl
from sketchterrain.render.stats import Change, FrameStats
from sketchterrain.render.weather import Weather

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    import moderngl

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.kept import ResourceCache
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Sun

REST: Final = 0.25
"""s for which the eye must stand still, with nothing missing, before a picture of full size is drawn."""
QUICK: Final = 0.1
"""s; a picture of full size that takes no longer is drawn while a changed terrain is followed, too."""
CAUGHT_UP: Final = 0.5
"""s after a change, from which on light and plants are followed in full size at any rate ..."""
CATCHING_UP: Final = 0.25
"""... with so much of the time that drawing takes, if that is more than the budget."""
TILES_SHARE: Final = (0.8, 0.8, 0.8, 0.0)
"""Of the budget, frame by frame, while light or plants are missing."""
OTHERS_SHARE: Final = (0.1, 0.1, 0.1, 1.0)
"""Of the budget, what light and plants get even where tiles took more than their share."""


class Renderer:
    """Draws one terrain into any framebuffer of one context.

    A still picture: `prepare`, then `draw`. A moving one: `frame` for each of its frames.

    Parameters
    ----------
    context
        OpenGL 4.3 core.
    terrain
        What to draw.
    sun
        Where the sun stands.
    weather
        Clouds, wind and haze; by default the sketch's.
    textures
        A folder of pictures that replace the program's own textures.
    quality
        What a picture may cost.
    timer
        Seconds that run on, against which a frame's budget is kept.
    kept
        What the renderers of this context before it have left, and the next one will find; it is closed with
        this one, unless it is lent.

    Attributes
    ----------
    scenery : Scenery
        All that is drawn.
    ground : TerrainStream
        Its tiles; overlays draw them once more.
    timings : dict of str to float
        Seconds that each stage took, summed up.
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
        kept: ResourceCache | None = None,
    ) -> None:
        self.timings: dict[str, float] = {}
        self._context = context
        self._terrain = terrain = shared_with_gl(terrain)
        self._quality = quality = quality or Quality()
        self._sun, self._weather = sun, weather or Weather.from_sketch(terrain.sketch)
        self._timer = timer
        self._last: Camera | None = None
        self._still, self._turn = 0.0, 0
        self._whole = False  # whether the picture was complete since the eye moved
        self._unchanged, self._took = 0.0, 0.0
        self.scenery = Scenery(
            context,
            terrain,
            sun=sun,
            weather=self._weather,
            textures=textures,
            quality=quality,
            timed=self._timed,
            kept=kept,
        )
        self.ground = self.scenery.ground

    def prepare(self, camera: Camera, size: tuple[int, int]) -> None:
        """Make all that a picture shows: tiles, light and plants.

        Parameters
        ----------
        camera
            From where; tiles and plants outside its view are left out.
        size
            Width and height of the picture (px).
        """
        with self._timed("light"):
            self.scenery.lit.settle(camera)
        view, distance, _ = self._clipped(camera)
        with self._timed("tiles"):
            self.ground.settle(view, size, draw_distance=distance)
        with self._timed("foliage"):
            self.scenery.forest.settle(view, size, self.scenery.lit)

    def draw(self, camera: Camera, framebuffer: moderngl.Framebuffer, *, clock: float = 0.0) -> None:
        """Draw what `camera` sees, as far as it was prepared, into a framebuffer.

        Parameters
        ----------
        camera
            The one that `prepare` was given.
        framebuffer
            At least 8 bits a channel; its size is the picture's.
        clock
            Seconds, moves the water.
        """
        with self._timed("draw"):
            view, distance, above = self._clipped(camera)
            self.scenery.draw(
                view, framebuffer, size=framebuffer.size, draw_distance=distance, above=above, clock=clock
            )

    @property
    def triangles(self) -> int:
        """Of the ground and the plants in the last picture."""
        return self.scenery.triangles

    def change(self, terrain: TerrainSource, areas: Sequence[tuple[float, float, float, float]]) -> Change:
        """Draw another terrain of the same extent from now on; call it between two frames.

        When this returns, the ground that the last frame's camera may see is the new one wherever an area
        touches it, and so is the water: no frame shows a part of the old and a part of the new. Light and
        plants follow in the next frames, within their budget; until then they are as they were.

        Parameters
        ----------
        terrain
            The other one, on the device of `terrain`; `sketchterrain.terrain.rebuild` makes it.
        areas
            West, south, east, north (m): elsewhere every bit of the two terrains is the same.

        Raises
        ------
        InputError
            If the extent is another one.
        """
        start = self._timer()
        self._unchanged = 0.0
        terrain = moved_to_context(terrain, self._terrain.context)
        ground = self.scenery.change(terrain, areas)
        self._terrain = terrain
        return Change(ground.seconds, self._timer() - start, ground.tiles_rewritten, ground.tiles_dropped)

    @property
    def terrain(self) -> TerrainSource:
        """What is drawn, on the device that writes its tiles: the next one is to be made from it."""
        return self._terrain

    def relight(self, *, sun: Sun | None = None, weather: Weather | None = None) -> None:
        """Draw another hour or another weather from now on; shadows follow within the frames' budget.

        Parameters
        ----------
        sun
            Where the sun stands; as it was by default.
        weather
            Clouds, wind and haze; as they were by default.
        """
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
    ) -> FrameStats:
        """Draw a frame of a moving picture: what is ready now, a little more of it each time.

        New tiles, light and plants take no more than the quality's budget together, but for the first frame
        and after the eye was put elsewhere; see `TerrainStream.update`.

        Parameters
        ----------
        camera
            From where; its clipping planes are set here.
        framebuffer
            At least 8 bits a channel. Until the camera rests and nothing is missing any more, a smaller
            picture is drawn and enlarged; where the terrain changes before a camera at rest, only if one of
            full size takes long.
        elapsed
            Seconds since the last frame.
        clock
            Seconds, moves the water.
        budget
            Seconds for what is new; by default the quality's. An eye at rest can spare more.
        """
        size, budget = framebuffer.size, self._quality.budget if budget is None else budget
        moves = self._last is None or (camera.eye, camera.target, camera.fov) != (
            self._last.eye,
            self._last.target,
            self._last.fov,
        )
        self._last, self._still = camera, 0.0 if moves else self._still + elapsed
        self._unchanged += elapsed
        self._whole = self._whole and not moves
        if self._whole:
            budget = max(budget, CATCHING_UP * self._took)
        view, distance, above = self._clipped(camera)
        self._turn = (self._turn + 1) % len(TILES_SHARE)
        busy = not (self.scenery.lit.settled and self.scenery.forest.settled)
        tiles = self.ground.update(
            view,
            size,
            elapsed=elapsed,
            budget=budget * TILES_SHARE[self._turn] if busy else budget,
            draw_distance=distance,
        )
        left = max(budget - tiles.generation_seconds, budget * OTHERS_SHARE[self._turn])
        allowance = TimeBudget(left, timer=self._timer)
        self.scenery.lit.update(view, elapsed, allowance.fraction(0.5))
        lit = allowance.spent
        self.scenery.forest.update(view, size, self.scenery.lit, elapsed, allowance)
        grown = allowance.spent
        complete = tiles.settled and self.scenery.lit.settled and self.scenery.forest.settled
        self._whole = self._whole or (complete and self._still >= REST)
        follows = self._took <= QUICK or (tiles.settled and self._unchanged >= CAUGHT_UP)
        inner = self._inner_size(size, rests=self._whole and (complete or follows))
        with self._timed("draw"):
            self.scenery.draw(
                view,
                framebuffer,
                size=inner,
                draw_distance=distance,
                above=above,
                clock=clock,
                moving=not complete,
            )
        if inner == size:
            self._took = allowance.spent - grown
        return FrameStats(
            generation_seconds=tiles.generation_seconds,
            light_seconds=lit,
            plant_seconds=grown - lit,
            draw_seconds=allowance.spent - grown,
            tiles_generated=tiles.tiles_generated,
            tiles_drawn=tiles.tiles_drawn,
            resident_tiles=tiles.resident_tiles,
            triangles=self.triangles,
            size=inner,
            settled=complete and inner == size,
        )

    def _inner_size(self, size: tuple[int, int], *, rests: bool) -> tuple[int, int]:
        scale = 1.0 if rests else self._quality.moving_scale
        return max(round(size[0] * scale), 1), max(round(size[1] * scale), 1)

    def _clipped(self, camera: Camera) -> tuple[Camera, float, float]:
        """Return the camera with clipping planes that suit its height, the draw distance, its height (m)."""
        x, y, z = camera.eye
        above = max(z - float(self._terrain.heights([x], [y])[0]), 0.0)
        return *clipped(camera, above, extent=self._terrain.extent, reach=self._quality.reach), above

    def release(self) -> None:
        """Give back all that it holds on the GPU, where the context's ``gc_mode`` is ``auto``; draw no more.

        Textures of materials are kept on the disk: a renderer of another quality is there in a second.
        Overlays of this one's ground are to be let go of too.
        """
        self._context.finish()
        self.ground.release()
        del self.ground, self.scenery

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self._context.finish()
            self.timings[stage] = self.timings.get(stage, 0.0) + time.perf_counter() - start
