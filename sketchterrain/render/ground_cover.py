"""What covers the ground near the eye and stands on what is drawn of it: stones and grass."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.render.grass import Grass
from sketchterrain.render.rocks import Rocks

if TYPE_CHECKING:
    from collections.abc import Mapping

    import moderngl

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.quality import Quality
    from sketchterrain.render.shading import Shading


class GroundCover:
    """Stones and grass around an eye.

    Parameters
    ----------
    context
        Where they are drawn.
    quality
        How far and how many.
    shading
        How the ground under them is lit and tinted.
    """

    def __init__(self, context: moderngl.Context, *, quality: Quality, shading: Shading) -> None:
        self._shading = shading
        self._parts = (
            Rocks(context, quality=quality, defines=shading.defines),
            Grass(context, quality=quality, defines=shading.defines),
        )
        self._any = quality.grass > 0.0 and (quality.includes("rocks") or quality.includes("grass"))

    def __bool__(self) -> bool:
        """Tell whether anything is ever drawn."""
        return self._any

    @property
    def triangles(self) -> int:
        """Of the last picture."""
        return sum(part.triangles for part in self._parts)

    def draw(
        self, camera: Camera, size: tuple[int, int], uniforms: Mapping[str, object], *, above: float
    ) -> None:
        """Draw what a camera sees.

        Parameters
        ----------
        camera
            From where.
        size
            Of the picture (px).
        uniforms
            Of all passes; the textures ``scene`` and ``scene_depth`` hold the bare ground.
        above
            m of the eye over the ground.
        """
        for part in self._parts:
            part.draw(camera, size[0] / size[1], {**uniforms, **self._shading.tints}, above=above)
