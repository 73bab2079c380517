"""Stones around the eye, from pebbles to boulders: strewn, found out once a stone, drawn with their shade."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.gl_functions import COMMAND
from sketchterrain.render.programs import build_program, build_transform, set_uniforms
from sketchterrain.render.rock_meshes import DETAILS, SHAPES, VERTEX, rock_mesh
from sketchterrain.render.scatter import SEED, Strewing, cells_within, hashed, in_sight, places_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.quality import Quality
    from sketchterrain.render.scatter import Places

__all__ = ["Rocks", "by_mesh"]


@dataclass(frozen=True)
class _Stones:
    """Stones of some sizes.

    Attributes
    ----------
    strewing : Strewing
        At the best quality.
    sizes : (float, float)
        m, radius of the smallest and of the largest.
    often : float
        Share of the places that hold one on scree.
    tumble : float
        rad that they lie turned over at most.
    """

    strewing: Strewing
    sizes: tuple[float, float]
    often: float
    tumble: float


STONES: Final = (
    _Stones(Strewing(11, 7.0, 3.0, 32.0, 4.0, (0.0, 0.0, 4.0)), (0.018, 0.10), 0.9, 3.0),
    _Stones(Strewing(22, 0.8, 9.0, 120.0, 8.0, (0.0, 9.0, 28.0)), (0.09, 0.5), 0.8, 1.2),
    _Stones(Strewing(33, 0.012, 50.0, 480.0, 40.0, (14.0, 45.0, 130.0)), (0.42, 2.6), 0.6, 0.7),
)
"""Pebbles, stones, boulders."""
STONE: Final = 4 * 4 * 5
"""Bytes of a stone, captured from rock_place.vert.glsl."""
_CAPTURED: Final = ("stand", "spin", "ground", "kind", "hue")
_MESHES: Final = DETAILS * len(SHAPES)


class Rocks:
    """Stones on the ground around an eye.

    Parameters
    ----------
    context
        Where they are drawn.
    quality
        How far and how many.
    defines
        Macros of the shading, see `Shading.defines`.

    Attributes
    ----------
    triangles : int
        Of the last picture.
    stones : int
        Places that it asked for; most of them are empty where no stones lie.
    """

    def __init__(self, context: moderngl.Context, *, quality: Quality, defines: Mapping[str, int]) -> None:
        self.triangles = self.stones = 0
        self._context = context
        self._sorts: list[_Stones] = []
        if quality.grass == 0.0 or not quality.has("rocks"):
            return
        self._sorts = [
            replace(stones, strewing=stones.strewing.as_far(quality.grass, share=quality.blades))
            for stones in STONES
        ]
        meshes = [rock_mesh(shape, detail) for detail in range(DETAILS) for shape in range(len(SHAPES))]
        self._sizes = np.array([mesh.triangles.size for mesh in meshes])
        self._first_index = np.cumsum(self._sizes) - self._sizes
        many = np.array([len(mesh.vertices) for mesh in meshes])
        self._first_vertex = np.cumsum(many) - many
        self._seeds = context.buffer(reserve=SEED.itemsize, dynamic=True)
        self._captured = context.buffer(reserve=STONE, dynamic=True)
        self._commands = context.buffer(reserve=COMMAND.itemsize * _MESHES, dynamic=True)
        vertices = context.buffer(np.concatenate([mesh.vertices for mesh in meshes]).tobytes())
        indices = context.buffer(np.concatenate([mesh.triangles.ravel() for mesh in meshes]).tobytes())
        self._place = build_transform(context, "rock_place.vert.glsl", _CAPTURED, defines=defines)
        self._program = build_program(context, "rock.vert.glsl", "rock.frag.glsl", defines=defines)
        self._shade = build_program(context, "rock_shade.vert.glsl", "rock_shade.frag.glsl", defines=defines)
        self._placing = context.vertex_array(self._place, [(self._seeds, "2f4 2u4", "corner", "seed")])
        captured = (self._captured, "4f4 4f4 4f4 4f4 4f4/i", *_CAPTURED)
        self._array = context.vertex_array(
            self._program,
            [(vertices, "3f4 3f4", *(VERTEX.names or ())), captured],
            index_buffer=indices,
        )
        darkening = (self._captured, "4f4 16x 4f4 4f4 16x/i", "stand", "ground", "kind")
        self._patches = context.vertex_array(self._shade, [darkening])

    def draw(self, camera: Camera, aspect: float, uniforms: Mapping[str, object], *, above: float) -> None:
        """Draw what a camera sees; see `Grass.draw`."""
        self.triangles = self.stones = 0
        for stones in self._sorts:
            strewing = stones.strewing
            cells = cells_within(camera.eye, strewing.reach, strewing.cell)
            cells = cells[in_sight(camera.frustum(aspect), cells, strewing.cell, camera.eye, above)]
            places = by_mesh(places_of(strewing, cells, camera.eye, above))
            if len(places.rows):
                self._find_out(stones, places, uniforms)
                self._draw(places, uniforms)

    def _find_out(self, stones: _Stones, places: Places, uniforms: Mapping[str, object]) -> None:
        strewing, many = stones.strewing, len(places.rows)
        for buffer, size in ((self._seeds, SEED.itemsize), (self._captured, STONE)):
            if buffer.size < size * many:
                buffer.orphan(size * max(many, 2 * (buffer.size // size)))
        self._seeds.write(places.rows.tobytes())
        own = {
            "strewing": (float(strewing.room), strewing.full, strewing.reach, strewing.cell),
            "sizes": (*stones.sizes, stones.often),
            "tumble": stones.tumble,
        }
        set_uniforms(self._place, {**uniforms, **own})
        self._placing.transform(self._captured, moderngl.POINTS, vertices=many)

    def _draw(self, places: Places, uniforms: Mapping[str, object]) -> None:
        many, context = len(places.rows), self._context
        context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        context.blend_func = moderngl.DST_COLOR, moderngl.ZERO
        target = context.fbo
        target.depth_mask = False
        set_uniforms(self._shade, uniforms)
        self._patches.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=many)
        target.depth_mask = True
        context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        commands = np.zeros(_MESHES, COMMAND)
        commands["count"], commands["first"] = self._sizes, self._first_index
        commands["base_vertex"], commands["instances"] = self._first_vertex, places.counts
        commands["base_instance"] = np.cumsum(places.counts) - places.counts
        commands = commands[commands["instances"] > 0]
        self._commands.write(commands.tobytes())
        set_uniforms(self._program, uniforms)
        self._array.render_indirect(self._commands, moderngl.TRIANGLES, count=len(commands))
        context.enable_only(moderngl.DEPTH_TEST)
        self.stones += many
        self.triangles += int((places.counts * self._sizes).sum()) // 3


def by_mesh(places: Places) -> Places:
    """Sort places by detail and shape, which follows from a place's hash: counts are (details · shapes,)."""
    rows = places.rows
    detail = np.repeat(np.arange(len(places.counts)), places.counts)
    shape = hashed(rows["seed"] ^ hashed(rows["rank"])).astype(np.int64) % len(SHAPES)
    mesh = detail * len(SHAPES) + shape
    counts: npt.NDArray[np.int64] = np.bincount(mesh, minlength=_MESHES).astype(np.int64)
    return places._replace(rows=rows[np.argsort(mesh, kind="stable")], counts=counts)
