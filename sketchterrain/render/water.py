"""Rivers and lakes of a terrain as OpenGL draws them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, cast

import moderngl
import numpy as np

from sketchterrain.look.water_surfaces import surfaces
from sketchterrain.render.programs import build_program, set_uniforms
from sketchterrain.render.water_waves import LAYERS, wave_layers, wave_phases, wave_texture

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from sketchterrain.render.scene import Features
    from sketchterrain.render.targets import RenderTargets

OVER: Final = (moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA)
UNDER: Final = (moderngl.ONE, moderngl.SRC_ALPHA)
"""How what is drawn is dimmed and added to: water_bank.frag.glsl."""
_PARTS: Final = [("3f4", "place"), ("4f4", "course"), ("2f4", "shore"), ("4f4", "nature")]


class Water:
    """The surfaces of all rivers and lakes, as one list of triangles.

    Parameters
    ----------
    context
        Where they are drawn.
    features
        What there is.
    part
        Whether water is drawn at all.
    defines
        The passes' own, of a quality; ``MATERIALS`` 1 leaves out wet banks, and what costs most.

    Attributes
    ----------
    textures : dict of str to moderngl.Texture
        By the names that shaders know them by; to be bound as the passes' own are.
    """

    def __init__(
        self,
        context: moderngl.Context,
        features: Features,
        *,
        part: bool = True,
        defines: Mapping[str, int] | None = None,
    ) -> None:
        self._context = context
        self._part, self._defines = part, dict(defines or {})
        self._arrays: list[moderngl.VertexArray] = []
        self._programs: list[moderngl.Program] = []
        self._shown: object = None
        self._cheap = self._defines.get("MATERIALS") == 1
        self._layers = 1 if self._cheap else len(LAYERS)
        self.textures: dict[str, moderngl.Texture] = {}
        self.change(features)

    def build(self, features: Features, defines: Mapping[str, int]) -> None:
        """Draw waters by programs with other macros from now on."""
        self._defines, self._programs, self._shown = dict(defines), [], None
        self.change(features)

    def change(self, features: Features) -> None:
        """Draw other waters from now on."""
        state = _state(features) if self._part else ()
        if state == self._shown:
            return
        self._shown = state
        parts = surfaces(features) if self._part else []
        self._arrays = []
        if not parts:
            return
        self._anchor = parts[0].place[0].copy()
        vertices, indices, base = [], [], 0
        for place, course, inside, nature, triangles in parts:
            shore = np.stack([inside, np.full(len(inside), max(-inside.min(), 0.0))], axis=1)
            rows = np.concatenate([place - self._anchor, course, shore, nature], axis=1)
            vertices.append(rows.astype(np.float32))
            indices.append(triangles + np.uint32(base))
            base += len(place)
        buffer = self._context.buffer(np.concatenate(vertices).tobytes())
        order = self._context.buffer(np.concatenate(indices).tobytes())
        for program in self._built():
            # A driver takes no attribute that a program does not read.
            layout = " ".join(size if name in program else _skipped(size) for size, name in _PARTS)
            names = [name for _, name in _PARTS if name in program]
            content = [(buffer, layout, *names)]
            self._arrays.append(self._context.vertex_array(program, content, index_buffer=order))

    def _built(self) -> list[moderngl.Program]:
        """Return the programs, and have the waves; both are made when there is water for the first time."""
        if not self._programs:
            self._programs = [
                build_program(self._context, f"{name}.vert.glsl", f"{name}.frag.glsl", defines=self._defines)
                for name in (["water"] if self._cheap else ["water_bank", "water"])
            ]
            self.textures["wave_slopes"] = wave_texture(self._context)
        return self._programs

    def __bool__(self) -> bool:
        return bool(self._arrays)

    def draw(
        self, eye: tuple[float, float, float], targets: RenderTargets, uniforms: Mapping[str, object]
    ) -> None:
        """Draw how wet the banks are, and the water, as seen from `eye`, into ``targets.scene``.

        Parameters
        ----------
        eye
            World coordinates (m).
        targets
            Hold all that is drawn already.
        uniforms
            Those of all passes, and ``clock`` (s), ``wind`` (m/s) and ``lift`` (water.vert.glsl).
        """
        if not self._arrays:
            return
        layers = wave_layers(cast("tuple[float, float]", uniforms["wind"]), self._layers)
        phases = wave_phases(layers, eye, cast(float, uniforms["clock"]))
        own = {
            "anchor": tuple(self._anchor - np.asarray(eye)),
            "wave_layers": _array(layers),
            "wave_phases": _array(phases),
        }
        context = self._context
        context.enable(moderngl.BLEND)
        for array in self._arrays:
            # Each looks at what was drawn before it.
            targets.copy_scene()
            targets.scene.use()
            water = array is self._arrays[-1]
            targets.scene.depth_mask = water
            context.blend_func = OVER if water else UNDER
            set_uniforms(array.program, {**uniforms, **own})
            array.render()
        context.disable(moderngl.BLEND)


def _array(rows: npt.NDArray[np.float64]) -> object:
    """Return an array of vectors as a uniform's value; one of a single vector is that vector."""
    values = [tuple(row) for row in rows.tolist()]
    return values if len(values) > 1 else values[0]


def _skipped(size: str) -> str:
    """Return the format of an attribute that is there and is not read."""
    return f"{4 * int(size[0])}x"


def _state(features: Features) -> tuple[object, ...]:
    """Return what is equal for the same waters."""
    rivers = [(river.centreline.tobytes(), river.centreline_width.tobytes()) for river in features.rivers]
    lakes = [
        (lake.level, shape.west, shape.south, shape.spacing, shape.inside.shape, shape.inside.tobytes())
        for lake in features.lakes
        for shape in (lake.shape,)
    ]
    return (*rivers, *lakes)
