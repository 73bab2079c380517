"""Grass, flowers and ferns around the eye: strewn, found out once a plant, drawn with its blades."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.gl_functions import COMMAND
from sketchterrain.render.grass_meshes import DETAILS, KINDS, VERTEX, tuft_mesh
from sketchterrain.render.programs import build_program, build_transform, set_uniforms
from sketchterrain.render.scatter import SEED, Strewing, cells_within, in_sight, places_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.quality import Quality
    from sketchterrain.render.scatter import Places

__all__ = ["Grass"]

STREWN: Final = {
    "meadow": Strewing(salt=101, density=85.0, full=4.2, reach=110.0, cell=3.0, details=(4.5, 18.0)),
    "tall": Strewing(salt=202, density=7.0, full=12.0, reach=80.0, cell=6.0, details=(6.0, 22.0)),
    "flower": Strewing(salt=303, density=3.0, full=18.0, reach=80.0, cell=6.0, details=(5.0, 14.0)),
    "fern": Strewing(salt=404, density=1.6, full=22.0, reach=100.0, cell=8.0, details=(8.0, 26.0)),
}
"""At the best quality."""
PLANT: Final = 4 * 4 * 7
"""Bytes of a plant, captured from grass_plant.vert.glsl."""
_CAPTURED: Final = ("stand", "turn", "albedo", "ground", "sky", "under", "veil")


class Grass:
    """What grows on the ground around an eye, as far as it is not a tree.

    Parameters
    ----------
    context
        Where it is drawn.
    quality
        How far and how densely.
    defines
        Macros of the shading, see `Shading.defines`.

    Attributes
    ----------
    triangles : int
        Of the last picture.
    plants : int
        Places that it asked for; where something else covers the ground they stay empty.
    """

    def __init__(self, context: moderngl.Context, *, quality: Quality, defines: Mapping[str, int]) -> None:
        self.triangles = self.plants = 0
        self._kinds = (
            [_Kind(context, kind, quality=quality, defines=defines) for kind in KINDS]
            if quality.grass > 0.0 and quality.has("grass")
            else []
        )

    def draw(self, camera: Camera, aspect: float, uniforms: Mapping[str, object], *, above: float) -> None:
        """Draw what a camera sees.

        Parameters
        ----------
        camera
            From where.
        aspect
            Width of the picture over its height.
        uniforms
            Of all passes: textures, `clock`, `wind`, and the map of the drawn ground.
        above
            m of the eye over the ground.
        """
        self.triangles = self.plants = 0
        for kind in self._kinds:
            kind.draw(camera, aspect, uniforms, above)
            self.triangles += kind.triangles
            self.plants += kind.plants


class _Kind:
    """One kind of plant: its mesh in all details, and the places that it may stand at."""

    def __init__(
        self, context: moderngl.Context, kind: str, *, quality: Quality, defines: Mapping[str, int]
    ) -> None:
        self.triangles = self.plants = 0
        own = {**defines, "KIND": KINDS.index(kind)}
        self._spread = 1.0 / quality.blades
        self._strewing = STREWN[kind].as_far(quality.grass, share=quality.blades)
        meshes = [tuft_mesh(kind, detail) for detail in range(DETAILS)]
        self._sizes = np.array([mesh.triangles.size for mesh in meshes])
        self._first_index = np.cumsum(self._sizes) - self._sizes
        many = np.array([len(mesh.vertices) for mesh in meshes])
        self._first_vertex = np.cumsum(many) - many
        self._context = context
        self._seeds = context.buffer(reserve=SEED.itemsize, dynamic=True)
        self._captured = context.buffer(reserve=PLANT, dynamic=True)
        self._commands = context.buffer(reserve=COMMAND.itemsize * DETAILS, dynamic=True)
        self._vertices = context.buffer(np.concatenate([mesh.vertices for mesh in meshes]).tobytes())
        self._indices = context.buffer(np.concatenate([mesh.triangles.ravel() for mesh in meshes]).tobytes())
        self._plant = build_transform(context, "grass_plant.vert.glsl", _CAPTURED, defines=own)
        self._program = build_program(context, "grass.vert.glsl", "grass.frag.glsl", defines=own)
        self._planting = context.vertex_array(self._plant, [(self._seeds, "2f4 2u4", "corner", "seed")])
        self._array = context.vertex_array(
            self._program,
            [
                (self._vertices, _format(VERTEX), *(VERTEX.names or ())),
                (self._captured, "4f4 4f4 4f4 4f4 4f4 4f4 4f4/i", *_CAPTURED),
            ],
            index_buffer=self._indices,
        )

    def draw(self, camera: Camera, aspect: float, uniforms: Mapping[str, object], above: float) -> None:
        strewing = self._strewing
        cells = cells_within(camera.eye, strewing.reach, strewing.cell)
        cells = cells[in_sight(camera.frustum(aspect), cells, strewing.cell, camera.eye, above)]
        places = places_of(strewing, cells, camera.eye, above)
        self.plants = len(places.rows)
        self.triangles = int((places.counts * self._sizes).sum()) // 3
        if not self.plants:
            return
        self._find_out(places, uniforms)
        self._context.enable_only(moderngl.DEPTH_TEST)
        commands = np.zeros(DETAILS, COMMAND)
        commands["count"], commands["first"] = self._sizes, self._first_index
        commands["base_vertex"] = self._first_vertex
        commands["instances"] = places.counts
        commands["base_instance"] = np.cumsum(places.counts) - places.counts
        commands = commands[commands["instances"] > 0]
        self._commands.write(commands.tobytes())
        set_uniforms(self._program, uniforms)
        self._array.render_indirect(self._commands, moderngl.TRIANGLES, count=len(commands))

    def _find_out(self, places: Places, uniforms: Mapping[str, object]) -> None:
        strewing = self._strewing
        for buffer, size in ((self._seeds, SEED.itemsize), (self._captured, PLANT)):
            if buffer.size < size * self.plants:
                buffer.orphan(size * max(self.plants, 2 * (buffer.size // size)))
        self._seeds.write(places.rows.tobytes())
        numbers = (float(strewing.room), strewing.full, strewing.reach, strewing.cell)
        set_uniforms(self._plant, {**uniforms, "strewing": numbers, "spread": self._spread})
        self._planting.transform(self._captured, moderngl.POINTS, vertices=self.plants)


def _format(dtype: np.dtype[np.void]) -> str:
    """Return what a vertex array wants to know of a vertex of float32 vectors."""
    return " ".join(f"{dtype[name].shape[0]}f4" for name in dtype.names or ())
