"""Rivers and lakes drawn by OpenGL."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, cast

import moderngl
import numpy as np

from sketchterrain.look.water_surfaces import water_surfaces
from sketchterrain.render.programs import build_program, set_uniforms
from sketchterrain.render.water_waves import LAYERS, wave_layers, wave_phases, wave_texture

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from sketchterrain.look.waters import PlacedFeatures
    from sketchterrain.render.targets import RenderTargets

ALPHA_BLEND: Final = (moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA)
DARKEN_AND_ADD: Final = (moderngl.ONE, moderngl.SRC_ALPHA)
"""Blend function of wet banks: water_bank.frag.glsl."""
_ATTRIBUTES: Final = (
    ("3f4", "local_position"),
    ("4f4", "flow_frame"),
    ("2f4", "shore"),
    ("4f4", "stream_params"),
)


class Water:
    """The surfaces of all rivers and lakes in one vertex buffer; ``MATERIALS`` 1 leaves out wet banks.

    `textures` are to be bound for the passes by the names of their samplers.
    """

    def __init__(
        self,
        context: moderngl.Context,
        features: PlacedFeatures,
        *,
        enabled: bool = True,
        defines: Mapping[str, int] | None = None,
    ) -> None:
        self._context = context
        self._enabled, self._defines = enabled, dict(defines or {})
        self._arrays: list[moderngl.VertexArray] = []
        self._programs: list[moderngl.Program] = []
        self._uploaded: object = None
        self._cheap = self._defines.get("MATERIALS") == 1
        self.textures: dict[str, moderngl.Texture] = {}
        self.set_features(features)

    def __bool__(self) -> bool:
        return bool(self._arrays)

    def rebuild(self, features: PlacedFeatures, defines: Mapping[str, int]) -> None:
        """Replace the programs by ones with other macros."""
        self._defines, self._programs, self._uploaded = dict(defines), [], None
        self.set_features(features)

    def set_features(self, features: PlacedFeatures) -> None:
        """Replace the rivers and lakes; nothing happens if they are equal."""
        state = _state(features) if self._enabled else ()
        if state == self._uploaded:
            return
        self._uploaded = state
        surfaces = water_surfaces(features) if self._enabled else []
        self._arrays = []
        if not surfaces:
            return
        self._anchor = surfaces[0].position[0].copy()
        vertices, indices, base = [], [], 0
        for position, flow, shore_distance, stream, triangles in surfaces:
            bank = np.full(len(shore_distance), max(-shore_distance.min(), 0.0))
            columns = (
                position - self._anchor,
                flow,
                shore_distance[:, None],
                bank[:, None],
                stream,
            )
            vertices.append(np.concatenate(columns, axis=1).astype(np.float32))
            indices.append(triangles + np.uint32(base))
            base += len(position)
        buffer = self._context.buffer(np.concatenate(vertices).tobytes())
        index_buffer = self._context.buffer(np.concatenate(indices).tobytes())
        if not self._programs:
            self._programs = [
                build_program(self._context, f"{name}.vert.glsl", f"{name}.frag.glsl", defines=self._defines)
                for name in (["water"] if self._cheap else ["water_bank", "water"])
            ]
            self.textures["wave_slopes"] = wave_texture(self._context)
        for program in self._programs:
            # Drivers reject attributes that a program does not read: they are skipped as padding.
            layout = [size if name in program else f"{4 * int(size[0])}x" for size, name in _ATTRIBUTES]
            names = [name for _, name in _ATTRIBUTES if name in program]
            content = [(buffer, " ".join(layout), *names)]
            self._arrays.append(self._context.vertex_array(program, content, index_buffer=index_buffer))

    def draw(
        self, eye: tuple[float, float, float], targets: RenderTargets, uniforms: Mapping[str, object]
    ) -> None:
        """Draw wet banks and the water into ``targets.scene``, which holds everything else already.

        `uniforms` are those of all passes, ``clock`` (s), ``wind`` (m/s) and ``lift`` (water.vert.glsl).
        """
        if not self._arrays:
            return
        count = 1 if self._cheap else len(LAYERS)
        layers = wave_layers(cast("tuple[float, float]", uniforms["wind"]), count)
        own = {
            "anchor": tuple(self._anchor - np.asarray(eye)),
            "wave_layers": _uniform_array(layers),
            "wave_phases": _uniform_array(wave_phases(layers, eye, cast(float, uniforms["clock"]))),
        }
        context = self._context
        context.enable(moderngl.BLEND)
        for array in self._arrays:
            targets.copy_scene()  # each pass reads what was drawn before it
            targets.scene.use()
            water = array is self._arrays[-1]
            targets.scene.depth_mask = water
            context.blend_func = ALPHA_BLEND if water else DARKEN_AND_ADD
            set_uniforms(array.program, {**uniforms, **own})
            array.render()
        context.disable(moderngl.BLEND)


def _uniform_array(rows: npt.NDArray[np.float64]) -> object:
    """Return an array of vectors as a uniform's value; for a single vector, that vector."""
    values = [tuple(row) for row in rows.tolist()]
    return values if len(values) > 1 else values[0]


def _state(features: PlacedFeatures) -> tuple[object, ...]:
    """Return a value that is equal for equal waters."""
    rivers = [(river.centreline.tobytes(), river.centreline_width.tobytes()) for river in features.rivers]
    lakes = [
        (lake.level, shape.west, shape.south, shape.spacing, shape.inside.shape, shape.inside.tobytes())
        for lake in features.lakes
        for shape in (lake.shape,)
    ]
    return (*rivers, *lakes)
