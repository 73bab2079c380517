"""Scene of a terrain and its render passes: tiles, light, plants, water, sky, clouds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.array_types import BoolArray, Bounds
from sketchterrain.geometry.camera import Camera, ClippedView
from sketchterrain.render.appearance import AppearanceTextures
from sketchterrain.render.atmosphere import AEROSOL_HEIGHT, RAYLEIGH_HEIGHT
from sketchterrain.render.built import BuiltScenery
from sketchterrain.render.clouds import Clouds, cloud_defines
from sketchterrain.render.draped import DrapedScreen
from sketchterrain.render.draped_geometry import Held
from sketchterrain.render.forest import Forest
from sketchterrain.render.ground import SurfaceMap
from sketchterrain.render.ground_cover import GroundCover
from sketchterrain.render.ground_stream import TerrainStream
from sketchterrain.render.labels import Labels
from sketchterrain.render.lit_ground import GroundLighting
from sketchterrain.render.programs import ResourceCache, Textures, bind_textures
from sketchterrain.render.quality import Quality, TimeBudget
from sketchterrain.render.scene import TerrainSource
from sketchterrain.render.shading import Shading
from sketchterrain.render.sky import Sky, Sun, Weather
from sketchterrain.render.targets import FrameBlock, RenderTargets, depth_rows, wrap_to_noise_period
from sketchterrain.render.textures import MaterialTextures, noise_texture
from sketchterrain.render.water import Water
from sketchterrain.schema.geology import Strata
from sketchterrain.tiles.lod import CameraView, ScreenError
from sketchterrain.tiles.tile_pool import TilePool

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.drape.drapes import Drapes

QUAD: Final = 32.0  # px; largest width of a quad up to a tolerance of 2 px, in proportion to it above
LIFT: Final = 1.5  # tolerances by which water is lifted above terrain that may be drawn too high


class Scenery:
    """Terrain tiles, light, plants, ground cover, water, sky and clouds, and the passes that draw them.

    `timed` measures the stages ``textures`` and ``sky`` of the construction. `stream` has the tiles, `lit`
    the light on them, `appearance` what is painted on them, `draped` what else is draped over them,
    `surface` a map of the drawn terrain, `built` bridges and buildings, `forest` plants and their shadow
    maps, `cover` grass and stones near the eye, `shading` the full-screen passes.
    """

    def __init__(
        self,
        context: moderngl.Context,
        terrain: TerrainSource,
        *,
        sun: Sun,
        weather: Weather,
        textures: Path | None,
        quality: Quality,
        timed: Callable[[str], AbstractContextManager[None]],
        resources: ResourceCache | None = None,
        drape_method: str = "tiles",
    ) -> None:
        resources = resources or ResourceCache()
        self._context = context
        self._sun = sun
        self._weather = weather
        self._features = terrain.features
        self._table, self._look = terrain.sketch.material_table, terrain.sketch.looks
        self._extent = terrain.extent
        self._quality = quality
        self._targets: dict[tuple[int, int], RenderTargets] = {}
        self._frame_block = FrameBlock(context)
        self._aridity, self._strata = _aridity(terrain), Strata.from_settings(terrain.sketch.geology)
        self.appearance = AppearanceTextures(context, terrain, quality)
        self.labels = Labels(context, terrain)
        self._textures = textures
        with timed("textures"):
            self._materials, self._noise = load_textures(
                context, terrain.sketch, terrain.context.device, quality, resources, folder=textures
            )
        with timed("sky"):
            self._sky = Sky(context, sun, weather, extent=terrain.extent)
            self._cloudiness = cloud_defines(quality, weather)
            self.shading, self._clouds = self._lighting()
        widest = QUAD * max(quality.tolerance / 2.0, 1.0)
        metric = ScreenError(
            quality.tolerance, widest, finest=quality.finest_quad, extinction=self._extinction
        )
        self.stream = TerrainStream(context, terrain, quality, metric=metric, resources=resources)
        self.lit = GroundLighting(
            context,
            terrain,
            sun,
            texels=quality.map_texels,
            close=quality.light_maps > 2,
            shadows=quality.includes("shadows"),
        )
        self.draped = DrapedScreen(context, self.stream, self.lit, quality, drape_method)
        self.built = BuiltScenery(context, terrain, defines=self.shading.defines)
        self.forest = Forest(
            context, terrain, sun, quality=quality, defines=self.shading.defines, built=self.built
        )
        tiles, radius = self.stream.tile_renderer, self.forest.draw_distance
        self.surface = SurfaceMap(context, tiles, texels=quality.surface_texels, radius=radius)
        self.cover = self._ground_cover()
        self._water = Water(
            context, self._features, enabled=quality.includes("water"), defines=self.shading.defines
        )

    @property
    def _extinction(self) -> float:
        """Extinction (1/m) by which far errors count less; 0 where quality leaves out the air."""
        return self._sky.extinction if self._quality.includes("haze") else 0.0

    def _ground_cover(self) -> GroundCover:
        return GroundCover(
            self._context, quality=self._quality, shading=self.shading, appearance=self.appearance.defines
        )

    def _lighting(self) -> tuple[Shading, Clouds]:
        """Return the full-screen passes and the clouds for the current weather."""
        shading = Shading(
            self._context,
            self._quality,
            self._table,
            aridity=self._aridity,
            look=self._look,
            strata=self._strata,
            clouds=self._cloudiness,
            appearance=self.appearance.defines,
        )
        clouds = Clouds(
            self._context, self._weather, self._sky, quality=self._quality, defines=shading.defines
        )
        return shading, clouds

    @property
    def triangles(self) -> int:
        """Triangles of terrain, plants, ground cover and what is built in the last picture."""
        others = self.forest.triangles + self.cover.triangles + self.built.triangles
        return self.stream.tile_renderer.triangles + others

    def set_terrain(self, terrain: TerrainSource, areas: Sequence[Bounds]) -> None:
        """Replace the terrain: tiles and water at once, light and plants over the next frames."""
        self.stream.set_terrain(terrain, areas)
        self.lit.set_terrain(terrain, areas)
        self.built.set_terrain(terrain, areas)
        self.forest.set_terrain(terrain, areas)
        self.surface.invalidate()
        self._paint(partial(self.appearance.set_terrain, terrain, areas))
        self.labels.set_terrain(terrain)
        self._features = terrain.features
        self._water.set_features(self._features)
        self._update_materials(terrain)

    def set_drapes(self, drapes: Drapes | None, held: Held | None = None) -> None:
        """Replace the draped layers; one feature may be held for editing."""
        self.draped.set_drapes(drapes, held)
        self.labels.set_drapes(drapes)
        self._paint_drapes()

    def paint(self, view: CameraView, pool: TilePool, budget: TimeBudget) -> bool:
        """Draw tiles of what is painted on the ground; return whether a view has all of them."""
        return self.appearance.update(view, pool, budget) & self.draped.update(view, pool, budget)

    def settle_drapes(self) -> None:
        """End all fades of draped features, for a still."""
        self.draped.settle()
        self._paint_drapes()

    def advance_drapes(self, elapsed: float) -> None:
        """Advance fades of draped features by a frame time (s)."""
        self.draped.advance(elapsed, tiles_converged=self.appearance.converged)
        self._paint_drapes()

    def _paint_drapes(self) -> None:
        self._paint(partial(self.appearance.set_drapes, self.draped.painted))

    def _paint(self, change: Callable[[], None]) -> None:
        """Change what tiles show, and rebuild programs if their macros change."""
        macros = self.appearance.defines
        change()
        if self.appearance.defines != macros:
            self.shading.set_appearance(self.appearance.defines)
            self.cover = self._ground_cover()

    def _update_materials(self, terrain: TerrainSource) -> None:
        aridity, look = _aridity(terrain), terrain.sketch.looks
        strata = Strata.from_settings(terrain.sketch.geology)
        if look != self._look:
            self._materials = MaterialTextures(
                self._context, terrain.sketch, terrain.context.device, self._quality, folder=self._textures
            )
        if (aridity, look, strata) != (self._aridity, self._look, self._strata):
            self._aridity, self._look, self._strata = aridity, look, strata
            self.shading.set_materials(aridity, look, strata)

    def relight(self, sun: Sun, weather: Weather) -> None:
        """Change sun and weather; shadows follow over the next frames.

        Programs are rebuilt only if clouds appear, disappear or become overcast.
        """
        if (sun, weather) == (self._sun, self._weather):
            return
        sun_moved, cloudiness = sun != self._sun, cloud_defines(self._quality, weather)
        self._sun, self._weather = sun, weather
        self._sky = Sky(self._context, sun, weather, extent=self._extent)
        tiles = self.stream.tiles
        tiles.metric = replace(tiles.metric, extinction=self._extinction)
        if sun_moved:
            self.lit.relight(sun)
            self.forest.relight(sun)
        if cloudiness == self._cloudiness:
            self._clouds.set_weather(weather, self._sky)
            return
        self._cloudiness = cloudiness
        self.shading, self._clouds = self._lighting()
        self.forest.rebuild(self.shading.defines)
        self.built.rebuild(self.shading.defines)
        self.cover = self._ground_cover()
        self._water.rebuild(self._features, self.shading.defines)

    def draw(
        self,
        view: ClippedView,
        framebuffer: moderngl.Framebuffer,
        *,
        size: tuple[int, int],
        clock: float,
        moving: bool = False,
        parts: int = 1,
        once: bool = False,
    ) -> Iterator[None]:
        """Draw all loaded content into a framebuffer, enlarged from `size` (px), while iterated.

        `clock` (s) animates water, plants and clouds, `moving` means that the camera moves or that tiles,
        light or plants are incomplete. Costly passes are cut into `parts`; nothing else may use the context
        until the last one, or the picture is lost. A picture drawn `once` takes less memory.
        """
        camera, draw_distance, above = view
        targets = self._targets.get(size)
        if targets is None:
            last_used = dict(list(self._targets.items())[-1:])
            words = self.stream.tile_renderer.words
            targets = RenderTargets(self._context, size, self._quality.samples, words, once=once)
            self._targets = last_used if once else {**last_used, size: targets}
        self._drawn = targets
        self._set_frame(camera, targets, draw_distance)
        exposure = self._sky.exposure(camera.heading)
        painted = self.appearance.uniforms(camera.eye) | {"appearance_exposure": exposure}
        targets.gbuffer.use()
        targets.gbuffer.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        yield from self.stream.draw(camera.eye, parts=parts)
        self.draped.draw(camera, targets, _pixel(camera, size[1]))
        self.surface.update(camera.eye, moving=moving)
        clouds = self._clouds.follow(
            camera, size[0] / size[1], base=self.lit.haze_base, clock=clock, moving=moving
        )
        lift = LIFT * self._quality.tolerance * _pixel(camera, framebuffer.size[1])
        units = (
            self._bind(targets) | {"clock": clock, "lift": lift} | self.surface.uniforms(camera.eye) | clouds
        )
        yield from self._clouds.draw(units, parts=parts)
        yield from self.shading.shade_scene(targets, camera.eye, units | painted, parts=parts)
        units |= self._bind(targets) if once else {}
        self.labels.test(targets, camera.eye)
        built = units | (self.shading.material_uniforms(camera.eye) if self.built else {})
        self._context.enable_only(moderngl.DEPTH_TEST)
        targets.scene.use()
        if self.cover:
            targets.copy_scene()
            targets.scene.use()
            yield from self.cover.draw(camera, size, units | painted, above=above)
        yield from self.built.draw(camera, targets, built, parts=parts)
        self._context.enable_only(moderngl.DEPTH_TEST)
        yield from self.forest.draw(camera, size, units, parts=parts)
        if self._water:
            yield from self._water.draw(camera, targets, units, parts=parts)
        self.shading.tonemap(targets, framebuffer, units, exposure=exposure)
        self.labels.draw(camera, framebuffer, moving=moving)

    def water_mask(self) -> BoolArray:
        """Return where the last picture shows water, at its internal size, row 0 on top."""
        after, before = depth_rows(self._drawn.depth), depth_rows(self._drawn.copy_depth)
        return np.asarray((after < before) & bool(self._water))

    def _set_frame(self, camera: Camera, targets: RenderTargets, distance: float) -> None:
        width, height = targets.size
        eye = camera.eye
        to_clip = camera.to_clip(width / height)
        frame, lit = self._frame_block, self.lit
        self._sky.set_height(eye[2] - lit.haze_base)
        hazy = float(self._quality.includes("haze"))
        frame["to_clip"] = to_clip
        frame["from_clip"] = np.linalg.inv(to_clip)
        tree_line = float(self.stream.terrain.sketch.climate.get("tree_line", _NO_TREE_LINE))
        frame["eye"] = (wrap_to_noise_period(eye[0]), wrap_to_noise_period(eye[1]), eye[2], tree_line)
        frame["to_sun"] = self._sun.direction
        frame["sun_light"] = (*self._sky.sunlight, self._sky.shaded_air)
        frame["sky_light"] = self._sky.harmonics
        frame["haze"] = (*(hazy * self._sky.haze), AEROSOL_HEIGHT)
        frame["air"] = (*(hazy * self._sky.rayleigh), RAYLEIGH_HEIGHT)
        frame["view_range"] = (distance, lit.haze_base, *targets.sample_size)
        for field, value in lit.uniforms(eye).items():
            frame[field] = value
        frame["to_shade"] = self.forest.shadows.matrices(eye)
        frame["shade_share"] = self.forest.shadows.fade_shares
        canopy = min(self._quality.canopy_distance, self.forest.draw_distance)
        frame["trees"] = (canopy, self._aridity, _pixel(camera, height), self.forest.draw_distance)
        frame.upload()

    def _bind(self, targets: RenderTargets) -> dict[str, object]:
        """Bind all shared textures to units of their own; return the units by sampler name."""
        textures: dict[str, Textures] = {
            "sky_view": self._sky.view,
            **self.lit.textures,
            "noise_field": self._noise,
            "material_colour": self._materials.colour,
            "material_relief": self._materials.relief,
            **self.forest.shadows.textures,
            **self.surface.textures,
            **self._water.textures,
            **targets.textures,
            **self._clouds.textures(targets),
            **self.appearance.textures,
            **self.draped.textures,
        }
        return bind_textures(textures) | {"wind": self._weather.drift, "means": self._materials.means}


def load_textures(
    context: moderngl.Context,
    sketch: Sketch,
    device: object,
    quality: Quality,
    resources: ResourceCache,
    *,
    folder: Path | None = None,
) -> tuple[MaterialTextures, moderngl.Texture]:
    """Return the textures of a sketch's materials, and noise; missing ones are computed on a device."""
    key = repr((sketch.looks, sketch.materials)), folder, quality.material_texels, quality.hexes > 1
    materials = resources.get_or_create(
        "materials",
        key,
        lambda: MaterialTextures(context, sketch, device, quality, folder=folder),
    )
    return materials, resources.get_or_create("noise", None, lambda: noise_texture(context))


_NO_TREE_LINE: Final = 1e4  # m


def _aridity(terrain: TerrainSource) -> float:
    return float(terrain.sketch.climate.get("aridity", 0.2))


def _pixel(camera: Camera, height: int) -> float:
    """Return the angle (rad) of a pixel in the centre of a picture `height` px high."""
    return 2.0 * float(np.tan(np.radians(camera.fov) / 2.0)) / height
