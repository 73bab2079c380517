"""Plants in the view, as instances in levels of detail, and the shadows that they throw."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.programs import build_program, set_uniforms
from sketchterrain.render.trees import DETAILS, HEIGHTS, SPECIES, plant_mesh

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.ground import DrawnGround
    from sketchterrain.render.sky import Sun

    Floats = npt.NDArray[np.float64]

__all__ = ["Forest", "shade_matrix", "wedge"]

PIXELS: Final = (72.0, 20.0)
"""Height of a plant in pixels under which the next coarser detail does."""
FADE: Final = 0.55
"""Share of the reach from which on plants are thinned out, to end in a seam that nobody sees."""
SINK: Final = 0.15
"""m; feet go so far into the ground."""


class Forest:
    """All plants that a view shows.

    Parameters
    ----------
    context
        Where they are drawn.
    plants
        Structured array with x, y, z, species, scale and rotation (see `Terrain.foliage`).
    ground
        What they stand on.
    camera, height
        Chooses levels of detail for a picture of this height (px).
    reach
        Distance (m) at which the last plants stand.
    """

    def __init__(
        self,
        context: moderngl.Context,
        plants: npt.NDArray[np.void],
        ground: DrawnGround,
        camera: Camera,
        *,
        height: int,
        reach: float,
    ) -> None:
        self._draws: list[tuple[moderngl.VertexArray, moderngl.VertexArray, int]] = []
        self._anchor = np.asarray(camera.eye)
        self._paint = build_program(context, "tree.vert.glsl", "tree.frag.glsl")
        self._cast = build_program(context, "tree_shadow.vert.glsl", "nothing.frag.glsl")
        distance = np.hypot(plants["x"] - camera.eye[0], plants["y"] - camera.eye[1])
        tint, whim = _whims(plants)
        keep = distance < reach * (FADE + (1.0 - FADE) * whim)
        plants, distance, tint = plants[keep], distance[keep], tint[keep]
        foot, _ = ground.surface(plants["x"].astype(np.float64), plants["y"].astype(np.float64))
        shown = np.isfinite(foot)
        plants, distance, tint, foot = plants[shown], distance[shown], tint[shown], foot[shown]
        self.count = len(plants)
        tall = np.asarray(HEIGHTS)[plants["species"]] * plants["scale"]
        pixels = tall / np.maximum(distance, 1.0) * height / (2 * np.tan(np.radians(camera.fov) / 2))
        detail = np.searchsorted(-np.asarray(PIXELS), -pixels)
        stands = np.empty((len(plants), 8), np.float32)
        stands[:, 0] = plants["x"] - self._anchor[0]
        stands[:, 1] = plants["y"] - self._anchor[1]
        stands[:, 2] = foot - SINK - self._anchor[2]
        stands[:, 3] = tall
        stands[:, 4], stands[:, 5] = np.cos(plants["rotation"]), np.sin(plants["rotation"])
        stands[:, 6], stands[:, 7] = tint, 0.0
        for species, name in enumerate(SPECIES):
            for level in range(DETAILS):
                members = stands[(plants["species"] == species) & (detail == level)]
                if len(members):
                    self._add(context, plant_mesh(name, level), members)

    def _add(
        self, context: moderngl.Context, mesh: npt.NDArray[np.void], stands: npt.NDArray[np.float32]
    ) -> None:
        vertices, instances = context.buffer(mesh.tobytes()), context.buffer(stands.tobytes())
        drawn = context.vertex_array(
            self._paint,
            [
                (vertices, "3f4 3f4 4f1", "place", "outward", "colour"),
                (instances, "4f4 4f4/i", "stand", "manner"),
            ],
        )
        cast = context.vertex_array(
            self._cast,
            [(vertices, "3f4 16x", "place"), (instances, "4f4 4f4/i", "stand", "manner")],
        )
        self._draws.append((drawn, cast, len(stands)))

    def draw(self, eye: tuple[float, float, float], uniforms: dict[str, object]) -> None:
        """Draw the plants as seen from `eye`."""
        set_uniforms(self._paint, uniforms | {"anchor": tuple(self._anchor - np.asarray(eye))})
        for drawn, _, count in self._draws:
            drawn.render(moderngl.TRIANGLES, instances=count)

    def cast_shadows(self, eye: tuple[float, float, float], shade_map: int) -> None:
        """Draw the plants' depth as the sun sees it; 0 is the near map, 1 the far one."""
        set_uniforms(self._cast, {"anchor": tuple(self._anchor - np.asarray(eye)), "map": shade_map})
        for _, cast, count in self._draws:
            cast.render(moderngl.TRIANGLES, instances=count)


def wedge(camera: Camera, aspect: float, reach: float) -> tuple[float, float, float, float]:
    """Return west, south, east and north (m) of the box around all that a camera sees within `reach`."""
    half = np.arctan(np.tan(np.radians(camera.fov) / 2.0) * aspect) + 0.06
    middle = np.radians(camera.heading)
    bearings = middle + np.linspace(-half, half, 9)
    x = np.concatenate([[0.0], reach * np.sin(bearings)]) + camera.eye[0]
    y = np.concatenate([[0.0], reach * np.cos(bearings)]) + camera.eye[1]
    return float(x.min()), float(y.min()), float(x.max()), float(y.max())


def shade_matrix(sun: Sun, centre: Floats, half_width: float, half_depth: float) -> Floats:
    """Return the (4, 4) matrix from positions relative to the eye to a map seen from the sun.

    Parameters
    ----------
    sun
        Its direction is the map's axis.
    centre
        (3,) middle of what the map covers, relative to the eye (m).
    half_width, half_depth
        Half the map's side, and half the range of depth along the light (m).
    """
    back = sun.direction
    up = np.array([0.0, 0.0, 1.0]) if back[2] < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[0, :3] = right / half_width
    matrix[1, :3] = np.cross(back, right) / half_width
    matrix[2, :3] = -back / half_depth
    matrix[:3, 3] = -matrix[:3, :3] @ centre
    return matrix


def _whims(plants: npt.NDArray[np.void]) -> tuple[Floats, Floats]:
    """Return two numbers for each plant from its place alone: tint in -1..1 and one in 0..1."""
    seed = (plants["x"] * 8.0).astype(np.int64) * 73_856_093 ^ (plants["y"] * 8.0).astype(
        np.int64
    ) * 19_349_663
    bits = (seed.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(24)
    first = (bits & np.uint64(0xFFFF)).astype(np.float64) / 0xFFFF
    second = ((bits >> np.uint64(16)) & np.uint64(0xFFFF)).astype(np.float64) / 0xFFFF
    return first * 2.0 - 1.0, second
