"""Draw a terrain: a still picture with all that belongs to it, or frame by frame what is ready."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.allowance import Allowance
from sketchterrain.render.atmosphere import AEROSOL_HEIGHT, RAYLEIGH, RAYLEIGH_HEIGHT
from sketchterrain.render.clouds import Clouds, cloud_defines
from sketchterrain.render.draw_distance import clipped
from sketchterrain.render.forest import Forest
from sketchterrain.render.frame import NOISE_PERIOD, FrameBlock
from sketchterrain.render.ground_cover import GroundCover
from sketchterrain.render.ground_stream import GroundStream
from sketchterrain.render.lit_ground import LitGround
from sketchterrain.render.quality import Quality
from sketchterrain.render.shading import Shading
from sketchterrain.render.sky import Sky, Sun
from sketchterrain.render.stats import FrameStats
from sketchterrain.render.surface_map import SurfaceMap
from sketchterrain.render.targets import Targets
from sketchterrain.render.textures import MaterialTextures, noise_texture
from sketchterrain.render.water import Water
from sketchterrain.render.weather import Weather
from sketchterrain.tiles import ScreenError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import Terrain

__all__ = ["Renderer"]

REST: Final = 0.25
"""s for which the eye must stand still, with nothing missing, before a picture of full size is drawn."""
TILES_SHARE: Final = (0.8, 0.8, 0.8, 0.0)
"""Of the budget, frame by frame, while light or plants are missing."""
OTHERS_SHARE: Final = (0.1, 0.1, 0.1, 1.0)
"""Of the budget, what light and plants get even where tiles took more than their share."""
QUAD: Final = 32.0
"""px that a quad of the ground is wide at most, where its tolerance is up to 2 px; more in proportion."""
WATER_LIFT: Final = 1.5
"""Times the ground's tolerance, by which water stands over the ground that may stand too high."""


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

    Attributes
    ----------
    ground : GroundStream
        The tiles; overlays draw them once more.
    timings : dict of str to float
        Seconds that each stage took, summed up.
    """

    def __init__(
        self,
        context: moderngl.Context,
        terrain: Terrain,
        *,
        sun: Sun,
        weather: Weather | None = None,
        textures: Path | None = None,
        quality: Quality | None = None,
        timer: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.timings: dict[str, float] = {}
        self._context = context
        self._terrain = terrain
        self._sun = sun
        self._weather = weather or Weather.of(terrain.sketch)
        self._textures = textures
        self._quality = quality = quality or Quality()
        self._timer = timer
        self._targets: dict[tuple[int, int], Targets] = {}
        self._frame_block = FrameBlock(context)
        self._aridity = float(terrain.sketch.climate.get("aridity", 0.2))
        self._last: Camera | None = None
        self._still, self._turn = 0.0, 0
        with self._timed("textures"):
            self._materials = MaterialTextures.of(context, terrain, quality, folder=textures)
            self._noise = noise_texture(context)
        with self._timed("sky"):
            self._sky = Sky(context, sun, self._weather, extent=terrain.extent)
            clouds = cloud_defines(quality, self._weather)
            self._shading = Shading(
                context, quality, aridity=self._aridity, look=terrain.sketch.look, clouds=clouds
            )
            self._clouds = Clouds(
                context, self._weather, self._sky, quality=quality, defines=self._shading.defines
            )
        metric = ScreenError(quality.tolerance, QUAD * max(quality.tolerance / 2.0, 1.0))
        self.ground = GroundStream(context, terrain, quality, metric=metric)
        self._lit = LitGround(
            context,
            terrain,
            sun,
            texels=quality.map_texels,
            close=quality.light_maps > 2,
            shadows=quality.has("shadows"),
        )
        self._forest = Forest(context, terrain, sun, quality=quality, defines=self._shading.defines)
        self._surface = SurfaceMap(
            context, self.ground.pool, texels=quality.surface_texels, reach=self._forest.reach
        )
        water, defines = quality.has("water"), self._shading.defines
        self._cover = GroundCover(context, quality=quality, shading=self._shading)
        self._clearance = 0.0
        self._water = Water(context, terrain.features, part=water, defines=defines)

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
            self._lit.settle(camera)
        view, distance = self._clipped(camera)
        with self._timed("tiles"):
            self.ground.settle(view, size, draw_distance=distance)
        with self._timed("foliage"):
            self._forest.settle(view, size[0] / size[1], self._lit)

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
            view, distance = self._clipped(camera)
            self._draw(view, distance, framebuffer, framebuffer.size, clock)

    @property
    def triangles(self) -> int:
        """Of the ground and the plants in the last picture."""
        return self.ground.pool.triangles + self._forest.triangles + self._cover.triangles

    def frame(
        self, camera: Camera, framebuffer: moderngl.Framebuffer, *, elapsed: float, clock: float = 0.0
    ) -> FrameStats:
        """Draw a frame of a moving picture: what is ready now, a little more of it each time.

        New tiles, light and plants take no more than the quality's budget together, but for the first frame
        and after the eye was put elsewhere; see `GroundStream.update`.

        Parameters
        ----------
        camera
            From where; its clipping planes are set here.
        framebuffer
            At least 8 bits a channel. Until the camera rests and nothing is missing any more, a smaller
            picture is drawn and enlarged.
        elapsed
            Seconds since the last frame.
        clock
            Seconds, moves the water.
        """
        size, budget = framebuffer.size, self._quality.budget
        moves = self._last is None or (camera.eye, camera.target, camera.fov) != (
            self._last.eye,
            self._last.target,
            self._last.fov,
        )
        self._last, self._still = camera, 0.0 if moves else self._still + elapsed
        view, distance = self._clipped(camera)
        self._turn = (self._turn + 1) % len(TILES_SHARE)
        busy = not (self._lit.settled and self._forest.settled)
        tiles = self.ground.update(
            view,
            size,
            elapsed=elapsed,
            budget=budget * TILES_SHARE[self._turn] if busy else budget,
            draw_distance=distance,
        )
        left = max(budget - tiles.generation_seconds, budget * OTHERS_SHARE[self._turn])
        allowance = Allowance(left, timer=self._timer)
        self._lit.update(view, elapsed, allowance.part(0.5))
        lit = allowance.spent
        self._forest.update(view, size[0] / size[1], self._lit, elapsed, allowance)
        grown = allowance.spent
        complete = tiles.settled and self._lit.settled and self._forest.settled
        inner = self._inner_size(size, rests=complete and self._still >= REST)
        with self._timed("draw"):
            self._draw(view, distance, framebuffer, inner, clock, moving=not complete)
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

    def _clipped(self, camera: Camera) -> tuple[Camera, float]:
        """Return the camera with clipping planes that suit its height, and the draw distance (m)."""
        x, y, z = camera.eye
        self._clearance = max(z - float(self._terrain.heights([x], [y])[0]), 0.0)
        return clipped(camera, self._clearance, extent=self._terrain.extent, reach=self._quality.reach)

    def _draw(
        self,
        camera: Camera,
        distance: float,
        framebuffer: moderngl.Framebuffer,
        size: tuple[int, int],
        clock: float,
        *,
        moving: bool = False,
    ) -> None:
        targets = self._targets.get(size)
        if targets is None:
            kept = list(self._targets.items())[-1:]
            targets = Targets(self._context, size, self._quality.samples)
            self._targets = {**dict(kept), size: targets}
        self._set_frame(camera, targets, distance)
        targets.seen.use()
        targets.seen.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self.ground.draw(camera.eye)
        self._surface.update(camera.eye, moving=moving)
        units = self._bind(targets) | {"clock": clock} | self._surface.uniforms(camera.eye)
        units |= self._clouds.draw(units, clock)
        self._shading.light_scene(targets, camera.eye, units)
        self._context.enable_only(moderngl.DEPTH_TEST)
        targets.scene.use()
        if self._cover:
            targets.copy_scene()
            targets.scene.use()
            self._cover.draw(camera, size, units, above=self._clearance)
        self._forest.draw(camera, size, units)
        if self._water:
            lift = WATER_LIFT * self._quality.tolerance * _pixel(camera, framebuffer.size[1])
            self._water.draw(camera.eye, targets, units | {"lift": lift})
        self._shading.develop(targets, framebuffer, units, exposure=self._sky.exposure(camera.heading))

    def _set_frame(self, camera: Camera, targets: Targets, distance: float) -> None:
        width, height = targets.size
        eye = camera.eye
        to_clip = camera.to_clip(width / height)
        frame, lit = self._frame_block, self._lit
        self._sky.look_from(eye[2] - lit.haze_base)
        hazy = float(self._quality.has("haze"))
        frame["to_clip"] = to_clip
        frame["from_clip"] = np.linalg.inv(to_clip)
        frame["eye"] = (eye[0] % NOISE_PERIOD, eye[1] % NOISE_PERIOD, eye[2])
        frame["to_sun"] = self._sun.direction
        frame["sun_light"] = (*self._sky.sunlight, self._sky.shaded_air)
        frame["sky_light"] = self._sky.harmonics
        frame["haze"] = (*(hazy * self._sky.haze), AEROSOL_HEIGHT)
        frame["air"] = (*(hazy * RAYLEIGH), RAYLEIGH_HEIGHT)
        frame["reach"] = (distance, lit.haze_base, *targets.inner)
        for field, value in lit.uniforms(eye).items():
            frame[field] = value
        frame["to_shade"] = self._forest.shade.matrices(eye)
        frame["shade_share"] = self._forest.shade.shown_share
        frame["trees"] = (self._forest.reach, self._aridity, _pixel(camera, height))
        frame.upload()

    def _bind(self, targets: Targets) -> dict[str, object]:
        """Bind all textures that passes share, each to a unit of its own; return the units by name."""
        textures: dict[str, moderngl.Texture | moderngl.TextureArray | moderngl.Texture3D] = {
            "sky_view": self._sky.view,
            **self._lit.textures,
            "noise_field": self._noise,
            "material_colour": self._materials.colour,
            "material_relief": self._materials.relief,
            **self._forest.shade.textures,
            **self._surface.textures,
            **self._water.textures,
            **targets.textures,
            **self._clouds.textures(targets),
        }
        units: dict[str, object] = {"wind": self._weather.drift}
        for unit, (name, texture) in enumerate(textures.items(), start=1):
            texture.use(unit)
            units[name] = unit
        return units

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self._context.finish()
            self.timings[stage] = self.timings.get(stage, 0.0) + time.perf_counter() - start


def _pixel(camera: Camera, height: int) -> float:
    """Return the angle (rad) of a pixel in the middle of a picture of a height (px)."""
    return 2.0 * float(np.tan(np.radians(camera.fov) / 2.0)) / height
