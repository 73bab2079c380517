"""Draw a terrain: what is uploaded once, and what is drawn every frame."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.forest import Forest, shade_matrix, wedge
from sketchterrain.render.frame import NOISE_PERIOD, FrameBlock
from sketchterrain.render.ground import DrawnGround
from sketchterrain.render.lit_ground import LitGround
from sketchterrain.render.quality import Quality
from sketchterrain.render.shading import Shading
from sketchterrain.render.sky import Sky, Sun
from sketchterrain.render.targets import Targets
from sketchterrain.render.textures import MaterialTextures, noise_texture
from sketchterrain.render.water import Water
from sketchterrain.tiles import select_tiles

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import Terrain

__all__ = ["Renderer"]

SHADE_TEXELS: Final = 2048
"""Side of the maps of the plants' shadows."""


class Renderer:
    """Draws one terrain into any framebuffer of one context.

    `prepare` makes what a region needs: call it before `draw`, and again when the eye has moved far.

    Parameters
    ----------
    context
        OpenGL 4.3 core.
    terrain
        What to draw.
    sun
        Where the sun stands.
    quality
        What a picture may cost.

    Attributes
    ----------
    timings : dict of str to float
        Seconds that each stage took, summed up.
    """

    def __init__(
        self, context: moderngl.Context, terrain: Terrain, *, sun: Sun, quality: Quality | None = None
    ) -> None:
        self.timings: dict[str, float] = {}
        self._context = context
        self._terrain = terrain
        self._sun = sun
        self._quality = quality or Quality()
        self._targets: Targets | None = None
        self._frame = FrameBlock(context)
        self._aridity = float(terrain.sketch.climate.get("aridity", 0.2))
        with self._timed("textures"):
            self._materials = MaterialTextures(context)
            self._noise = noise_texture(context)
        self._shade_maps = [_shade_map(context, SHADE_TEXELS) for _ in range(2)]
        self._shades = [context.framebuffer((), shade_map) for shade_map in self._shade_maps]
        self._lit = LitGround(context, terrain, sun, texels=self._quality.map_texels)
        with self._timed("sky"):
            self._sky = Sky(context, sun)
            self._shading = Shading(context, self._quality, aridity=self._aridity)

    def prepare(self, camera: Camera, size: tuple[int, int]) -> None:
        """Compute tiles and light for what a camera sees.

        Parameters
        ----------
        camera
            From where; tiles outside its view are left out.
        size
            Width and height of the picture (px).
        """
        height = size[1]
        aspect = size[0] / height
        extent, quality = self._terrain.extent, self._quality
        self._reach = quality.reach * extent
        eye = camera.eye
        with self._timed("light"):
            self._lit.settle(camera)
            far = self._lit.far_relief
        with self._timed("tiles"):
            clearance = eye[2] - self._lit.height_at(eye[0], eye[1])
            keys = select_tiles(
                eye,
                extent,
                draw_distance=self._reach,
                split=quality.split,
                clearance=max(clearance, 0.5),
                frustum=camera.frustum(aspect),
                height_range=far.bounds,
            )
            tiles = self._terrain.tiles(keys)
        with self._timed("upload"):
            self._ground = DrawnGround(self._context, extent, keys, tiles)
            self._water = Water(self._context, self._terrain.features, self._ground)
        with self._timed("foliage"):
            self._woods = min(quality.woods, 0.45 * extent)
            plants = self._terrain.foliage(*wedge(camera, aspect, self._woods))
        with self._timed("forest"):
            self._forest = Forest(
                self._context, plants, self._ground, camera, height=height, reach=self._woods
            )

    def draw(self, camera: Camera, framebuffer: moderngl.Framebuffer, *, clock: float = 0.0) -> None:
        """Draw what `camera` sees into a framebuffer.

        Parameters
        ----------
        camera
            Near the one that `prepare` was given.
        framebuffer
            At least 8 bits a channel; its size is the picture's.
        clock
            Seconds, moves the water.
        """
        with self._timed("draw"):
            if self._targets is None or self._targets.size != framebuffer.size:
                self._targets = Targets(self._context, framebuffer.size, self._quality.samples)
            self._set_frame(camera, self._targets)
            self._bind(self._targets)
            self._cast_shadows(camera)
            self._draw_ground(camera, self._targets)
            self._draw_upon_ground(camera, self._targets, clock)
            self._shading.develop(self._targets, framebuffer, self._units, exposure=self._sky.exposure)

    def _cast_shadows(self, camera: Camera) -> None:
        self._context.enable_only(moderngl.DEPTH_TEST)
        for index, target in enumerate(self._shades):
            target.use()
            target.clear(depth=1.0)
            self._forest.cast_shadows(camera.eye, index)

    def _shade_matrices(self, camera: Camera) -> list[npt.NDArray[np.float64]]:
        """Place a small map over the foreground and a wide one over all plants."""
        ahead = camera.forward * [1.0, 1.0, 0.0]
        ahead /= max(float(np.linalg.norm(ahead)), 1e-6)
        matrices = []
        for middle, half in ((0.06, 0.075), (0.45, 0.60)):
            centre = ahead * middle * self._woods
            centre[2] = (
                self._lit.height_at(camera.eye[0] + centre[0], camera.eye[1] + centre[1]) - camera.eye[2]
            )
            matrices.append(shade_matrix(self._sun, centre, half * self._woods, 3000.0))
        return matrices

    def _draw_ground(self, camera: Camera, targets: Targets) -> None:
        targets.seen.use()
        targets.seen.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self._ground.draw(camera.eye)
        self._shading.light_scene(targets, camera.eye, self._units)

    def _draw_upon_ground(self, camera: Camera, targets: Targets, clock: float) -> None:
        self._context.enable_only(moderngl.DEPTH_TEST)
        targets.scene.use()
        self._forest.draw(camera.eye, self._units)
        if self._water:
            targets.copy_scene()
            targets.scene.use()
            self._water.set_uniforms(self._units | {"clock": clock})
            self._water.draw(camera.eye)
        self._context.enable_only(moderngl.NOTHING)

    def _set_frame(self, camera: Camera, targets: Targets) -> None:
        width, height = targets.size
        eye = camera.eye
        to_clip = camera.to_clip(width / height)
        frame = self._frame
        frame["to_clip"] = to_clip
        frame["from_clip"] = np.linalg.inv(to_clip)
        frame["eye"] = (eye[0] % NOISE_PERIOD, eye[1] % NOISE_PERIOD, eye[2])
        frame["to_sun"] = self._sun.direction
        frame["sun_light"] = (*self._sky.sunlight, self._sky.exposure)
        frame["sky_light"] = self._sky.harmonics
        rayleigh = np.array([0.25, 0.58, 1.30]) / self._reach
        frame["haze"] = (*(rayleigh + 2.1 / self._reach), self._lit.haze_height)
        frame["reach"] = (self._reach, self._lit.haze_base, *targets.inner)
        for field, value in self._lit.uniforms(eye).items():
            frame[field] = value
        pixel = 2.0 * np.tan(np.radians(camera.fov) / 2.0) / height
        frame["to_shade"] = self._shade_matrices(camera)
        frame["trees"] = (self._woods, self._aridity, pixel)
        frame.upload()

    def _bind(self, targets: Targets) -> None:
        """Bind all textures that passes share, each to a unit of its own."""
        textures: dict[str, moderngl.Texture | moderngl.TextureArray] = {
            "sky_view": self._sky.view,
            **self._lit.textures,
            "noise_field": self._noise,
            "material_colour": self._materials.colour,
            "material_relief": self._materials.relief,
            "shade_near": self._shade_maps[0],
            "shade_far": self._shade_maps[1],
            **targets.textures,
        }
        self._units: dict[str, object] = {"cloud_cover": 0.42}
        for unit, (name, texture) in enumerate(textures.items(), start=1):
            texture.use(unit)
            self._units[name] = unit

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self._context.finish()
            self.timings[stage] = self.timings.get(stage, 0.0) + time.perf_counter() - start


def _shade_map(context: moderngl.Context, texels: int) -> moderngl.Texture:
    texture = context.depth_texture((texels, texels))
    texture.compare_func = "<="
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture
