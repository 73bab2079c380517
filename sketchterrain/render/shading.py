"""Full-screen passes: shading of the terrain, sky, upsampling to samples, tone mapping."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, Final

import moderngl
import numpy as np

from sketchterrain.look.texture_levels import layer_tints
from sketchterrain.render.programs import fullscreen_pass, set_uniforms
from sketchterrain.render.quality import Quality
from sketchterrain.render.targets import RenderTargets, bands
from sketchterrain.render.textures import (
    OCTAVES,
    material_macros,
    texture_phases,
    texture_uniforms,
    texture_widths,
)
from sketchterrain.schema.geology import Strata
from sketchterrain.schema.materials import MaterialTable

_JOINTS: Final = 1.6  # across the beds, a bed's thickness along them


class Shading:
    """Programs of all full-screen passes, built for one quality.

    `look` has the sketch's looks of the materials of a table: a layer with a colour of its own is not tinted.
    `appearance` are macros of the ground's program alone. `defines` are the macros of all programs that shade
    something, `tints` the climate tints as uniforms.
    """

    def __init__(
        self,
        context: moderngl.Context,
        quality: Quality,
        table: MaterialTable,
        *,
        aridity: float,
        look: Mapping[str, Mapping[str, Any]],
        strata: Strata,
        clouds: Mapping[str, int],
        appearance: Mapping[str, int | str] = MappingProxyType({"APPEARANCE": 0}),
    ) -> None:
        self._context = context
        self._samples = quality.samples
        self._table = table
        self.defines: dict[str, int | str] = {
            **material_macros(table),
            "OCTAVES": OCTAVES,
            "MATERIALS": quality.materials,
            "PLANES": quality.planes,
            "SIZES": quality.octaves,
            "HEXES": quality.hexes,
            "DETAIL": int(quality.includes("detail")),
            **clouds,
            "LIGHT_MAPS": quality.light_maps,
            "SHADE_MAPS": quality.shade_maps,
            "SAMPLES": quality.samples,
        }
        self.set_appearance(appearance)
        self.set_materials(aridity, look, strata)
        self._sky = fullscreen_pass(context, "sky.frag.glsl", defines=self.defines)
        self._upsample = (
            fullscreen_pass(context, "spread.frag.glsl", defines=self.defines)
            if quality.samples > 1
            else None
        )
        self._tonemap = fullscreen_pass(context, "picture.frag.glsl", defines=self.defines)
        self._enlarge = fullscreen_pass(context, "enlarge.frag.glsl")

    def set_appearance(self, macros: Mapping[str, int | str]) -> None:
        """Replace the program of the ground by one with other macros of `AppearanceTextures`."""
        self._appearance = dict(macros)
        self._grounds = {False: self._ground_pass(draped=False)}

    def _ground_pass(self, *, draped: bool) -> moderngl.VertexArray:
        defines = {**self.defines, **self._appearance, "DRAPED": int(draped)}
        return fullscreen_pass(self._context, "shade_ground.frag.glsl", defines=defines)

    def set_materials(self, aridity: float, look: Mapping[str, Mapping[str, Any]], strata: Strata) -> None:
        """Set tints and texture sizes from the climate, the rock and the sketch's looks."""
        self._strata = strata
        tints = layer_tints(self._table, aridity, look, strata.rock)
        self.tints: dict[str, object] = {"tints": [tuple(row) for row in tints]}
        self._widths = texture_widths(self._table, look)
        self._materials = self.tints | texture_uniforms(self._table, self._widths)

    def material_uniforms(self, eye: tuple[float, float, float]) -> dict[str, object]:
        """Return the uniforms of matter.glsl and variety.glsl for an eye (m)."""
        phases = [tuple(phase) for phase in texture_phases(self._table, eye, self._widths).tolist()]
        return self._materials | {"phases": phases} | _strata_uniforms(self._strata, eye)

    def shade_scene(
        self, targets: RenderTargets, eye: tuple[float, float, float], units: dict[str, object], *, parts: int
    ) -> Iterator[None]:
        """Shade the G-buffer, with the sky behind it, into ``targets.scene``; yield between parts.

        The texture `draped` of `units` is drawn over the ground if there is one.
        """
        if (draped := "draped" in units) not in self._grounds:
            self._grounds[draped] = self._ground_pass(draped=draped)
        shade, ground = self._grounds[draped], units | self.material_uniforms(eye)
        if self._upsample is None:
            self._shade_single_sample(targets, shade, ground, units)
            return
        self._context.enable_only(moderngl.NOTHING)
        yield from _run_banded(targets.shaded, shade, ground, parts)
        targets.release_weights()
        yield from _run_banded(targets.sky, self._sky, units, parts)
        targets.add_scene()
        yield from _run_banded(targets.upsampled, self._upsample, units, parts)

    def _shade_single_sample(
        self,
        targets: RenderTargets,
        shade: moderngl.VertexArray,
        ground: dict[str, object],
        units: dict[str, object],
    ) -> None:
        """Shade with one sample a pixel: the depth test separates terrain from sky."""
        context = self._context
        targets.copy_scene()
        targets.scene.depth_mask = False
        targets.scene.use()
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = ">"
        _run(shade, ground)
        context.depth_func = "<="
        _run(self._sky, units)
        context.depth_func = "<"
        targets.scene.depth_mask = True

    def tonemap(
        self,
        targets: RenderTargets,
        framebuffer: moderngl.Framebuffer,
        units: dict[str, object],
        *,
        exposure: float,
    ) -> None:
        """Map radiance to colours, enlarged if the framebuffer is larger than the targets."""
        self._context.enable_only(moderngl.NOTHING)
        whole = framebuffer.size == targets.size
        (framebuffer if whole else targets.tonemapped).use()
        _run(self._tonemap, units | {"exposure": exposure})
        if not whole:
            framebuffer.use()
            _run(self._enlarge, units)


def _run(array: moderngl.VertexArray, uniforms: dict[str, object]) -> None:
    set_uniforms(array.program, uniforms)
    array.render(vertices=3)


def _run_banded(
    target: moderngl.Framebuffer, array: moderngl.VertexArray, uniforms: dict[str, object], parts: int
) -> Iterator[None]:
    for _ in bands(target, parts):
        _run(array, uniforms)
        yield


def _strata_uniforms(strata: Strata, eye: tuple[float, float, float]) -> dict[str, object]:
    """Return the uniforms of beds and joints in kernels/render/shade_ground.frag.glsl for an eye (m)."""
    along = tuple(_JOINTS / strata.rock.bed * each for each in strata.strike)
    return {
        "strata": (*strata.across, float(np.dot(strata.across, eye))),
        "joints": (*along, float(np.dot(along, eye[:2])), strata.rock.joints),
        "banding": strata.rock.banding,
    }
