"""Grass, flowers and ferns around the eye: strewn, found out once a plant, drawn with its blades."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl

from sketchterrain.render.grass_meshes import DETAILS, KINDS, tuft_mesh
from sketchterrain.render.programs import build_program, build_transform
from sketchterrain.render.scatter import Nearby, Strewing
from sketchterrain.render.strewn import Strewn

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.quality import Quality

STREWN: Final = {
    "meadow": Strewing(salt=101, density=85.0, full=4.2, reach=110.0, cell=3.0, details=(4.5, 18.0)),
    "tall": Strewing(salt=202, density=7.0, full=12.0, reach=80.0, cell=6.0, details=(6.0, 22.0)),
    "flower": Strewing(salt=303, density=3.0, full=18.0, reach=80.0, cell=6.0, details=(5.0, 14.0)),
    "fern": Strewing(salt=404, density=1.6, full=22.0, reach=100.0, cell=8.0, details=(8.0, 26.0)),
}
"""At the best quality."""
FOUND: Final = ("stand", "turn", "albedo", "ground", "sky", "under", "veil")
"""What grass_plant.vert.glsl says of a plant."""


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
            if quality.grass > 0.0 and quality.includes("grass")
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
        self._nearby = Nearby(self._strewing)
        self._context = context
        self.tufts = Strewn(
            context,
            [tuft_mesh(kind, detail) for detail in range(DETAILS)],
            finding=build_transform(context, "grass_plant.vert.glsl", FOUND, defines=own),
            found=FOUND,
            drawing=build_program(context, "grass.vert.glsl", "lit.frag.glsl", defines=own),
        )

    def draw(self, camera: Camera, aspect: float, uniforms: Mapping[str, object], above: float) -> None:
        strewing, places = self._strewing, self._nearby.seen(camera, aspect, above)
        self.plants, self.triangles = len(places.rows), self.tufts.triangles(places)
        if not self.plants:
            return
        numbers = (float(strewing.room), strewing.full, strewing.reach, strewing.cell)
        self.tufts.find_out(places, {**uniforms, "strewing": numbers, "spread": self._spread})
        self._context.enable_only(moderngl.DEPTH_TEST)
        self.tufts.draw(places, uniforms)
