"""The passes that make a picture of what is seen: ground, sky, edges, tones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.look.texture_maker import LAYERS
from sketchterrain.render.programs import fullscreen_pass, set_uniforms
from sketchterrain.render.texture_places import OCTAVES, texture_phases, texture_uniforms, texture_widths

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from sketchterrain.render.quality import Quality
    from sketchterrain.render.targets import RenderTargets

STRAW: Final = np.array([1.5, 1.2, 1.0])
"""Colour of grass where aridity is 1, over its own."""
RED: Final = np.array([1.35, 0.98, 0.72])
"""The same of `REDDENED`,"""
REDDENS: Final = 0.4
"""which begins at this aridity."""
REDDENED: Final = ("soil", "rock", "scree")


class Shading:
    """Programs of all passes over a whole picture, built for one quality.

    Parameters
    ----------
    context
        Where they run.
    quality
        How much they read; kernels/render/shade_ground.frag.glsl.
    aridity
        0 … 1, tints ground and plants.
    look
        What a sketch says of materials, by material; a colour that it gives is not tinted.
    clouds
        Macros that say which there are, `cloud_defines`.

    Attributes
    ----------
    defines : dict of str to int
        Macros of all programs that light something.
    tints : dict of str to object
        The climate's colours of the materials, as uniforms.
    """

    def __init__(
        self,
        context: moderngl.Context,
        quality: Quality,
        *,
        aridity: float,
        look: Mapping[str, Mapping[str, Any]],
        clouds: Mapping[str, int],
    ) -> None:
        self._context = context
        self._samples = quality.samples
        self.defines = {
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
        self._ground = fullscreen_pass(context, "shade_ground.frag.glsl", defines=self.defines)
        self.dress(aridity, look)
        self._sky = fullscreen_pass(context, "sky.frag.glsl", defines=self.defines)
        self._spread = (
            fullscreen_pass(context, "spread.frag.glsl", defines=self.defines)
            if quality.samples > 1
            else None
        )
        self._develop = fullscreen_pass(context, "picture.frag.glsl", defines=self.defines)
        self._enlarge = fullscreen_pass(context, "enlarge.frag.glsl")

    def dress(self, aridity: float, look: Mapping[str, Mapping[str, Any]]) -> None:
        """Show the materials of another climate, and as another sketch wants them."""
        self.tints = _climate_uniforms(aridity, look)
        self._widths = texture_widths(look)
        set_uniforms(self._ground.program, self.tints | texture_uniforms(self._widths))

    def light_scene(
        self, targets: RenderTargets, eye: tuple[float, float, float], units: dict[str, object]
    ) -> None:
        """Turn what is seen of the ground into light, put the sky behind it: into ``targets.scene``."""
        phases = [tuple(phase) for phase in texture_phases(eye, self._widths).tolist()]
        ground = units | {"phases": phases}
        if self._spread is None:
            self._light_once(targets, ground, units)
            return
        self._context.enable_only(moderngl.NOTHING)
        targets.shaded.use()
        _run(self._ground, ground)
        targets.sky.use()
        _run(self._sky, units)
        targets.spread.use()
        _run(self._spread, units)

    def _light_once(
        self, targets: RenderTargets, ground: dict[str, object], units: dict[str, object]
    ) -> None:
        """With one sample a pixel the depth test tells ground from sky: each is computed only where it is."""
        context = self._context
        targets.copy_scene()
        targets.scene.depth_mask = False
        targets.scene.use()
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = ">"
        _run(self._ground, ground)
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
        """Turn light into a picture, enlarged where the framebuffer is larger than the targets."""
        self._context.enable_only(moderngl.NOTHING)
        whole = framebuffer.size == targets.size
        (framebuffer if whole else targets.tonemapped).use()
        _run(self._develop, units | {"exposure": exposure})
        if not whole:
            framebuffer.use()
            _run(self._enlarge, units)


def _run(array: moderngl.VertexArray, uniforms: dict[str, object]) -> None:
    set_uniforms(array.program, uniforms)
    array.render(vertices=3)


def _climate_uniforms(aridity: float, look: Mapping[str, Mapping[str, Any]]) -> dict[str, object]:
    """Return the colour by which each layer's is multiplied: dry lands have straw and red stone."""
    red = 1.0 + (RED - 1.0) * max(0.0, aridity - REDDENS) / (1.0 - REDDENS)
    straw = 1.0 + (STRAW - 1.0) * aridity
    tints = np.ones((len(LAYERS), 3))
    for layer, name in enumerate(LAYERS):
        if not look.get(name, {}).get("colour"):
            tints[layer] = straw if name == "grass" else red if name in REDDENED else 1.0
    return {"tints": [tuple(row) for row in tints]}
