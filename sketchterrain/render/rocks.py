"""Stones around the eye, from pebbles to boulders: strewn, found out once a stone, drawn with their shade."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.programs import build_program, build_transform, set_uniforms
from sketchterrain.render.rock_meshes import DETAILS, SHAPES, rock_mesh
from sketchterrain.render.scatter import Nearby, Strewing, hashed
from sketchterrain.render.strewn import Strewn

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.quality import Quality
    from sketchterrain.render.scatter import Places


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
FOUND: Final = ("stand", "spin", "ground", "kind", "hue")
"""What rock_place.vert.glsl says of a stone."""
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
        self._sorts: list[tuple[_Stones, Nearby]] = []
        if quality.grass == 0.0 or not quality.includes("rocks"):
            return
        for each in STONES:
            strewing = each.strewing.as_far(quality.grass, share=quality.blades)
            self._sorts.append((replace(each, strewing=strewing), Nearby(strewing, sort=by_mesh)))
        self.pool = Strewn(
            context,
            [rock_mesh(shape, detail) for detail in range(DETAILS) for shape in range(len(SHAPES))],
            finding=build_transform(context, "rock_place.vert.glsl", FOUND, defines=defines),
            found=FOUND,
            drawing=build_program(context, "rock.vert.glsl", "rock.frag.glsl", defines=defines),
        )
        self._shade = build_program(context, "rock_shade.vert.glsl", "rock_shade.frag.glsl", defines=defines)
        darkening = (self.pool.found, "4f4 16x 4f4 4f4 16x/i", "stand", "ground", "kind")
        self._patches = context.vertex_array(self._shade, [darkening])

    def draw(self, camera: Camera, aspect: float, uniforms: Mapping[str, object], *, above: float) -> None:
        """Draw what a camera sees; see `Grass.draw`."""
        self.triangles = self.stones = 0
        for stones, nearby in self._sorts:
            places = nearby.seen(camera, aspect, above)
            if len(places.rows):
                strewing = stones.strewing
                own = {
                    "strewing": (float(strewing.room), strewing.full, strewing.reach, strewing.cell),
                    "sizes": (*stones.sizes, stones.often),
                    "tumble": stones.tumble,
                }
                self.pool.find_out(places, {**uniforms, **own})
                self._draw(places, uniforms)

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
        self.pool.draw(places, uniforms)
        context.enable_only(moderngl.DEPTH_TEST)
        self.stones += many
        self.triangles += self.pool.triangles(places)


def by_mesh(places: Places) -> Places:
    """Sort places by detail and shape, which follows from a place's hash: counts are (details · shapes,)."""
    rows = places.rows
    detail = np.repeat(np.arange(len(places.counts)), places.counts)
    shape = hashed(rows["seed"] ^ hashed(rows["rank"])).astype(np.int64) % len(SHAPES)
    mesh = detail * len(SHAPES) + shape
    counts: npt.NDArray[np.int64] = np.bincount(mesh, minlength=_MESHES).astype(np.int64)
    return places._replace(rows=rows[np.argsort(mesh, kind="stable")], counts=counts)
