"""Choose where the sun stands for a view."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.render.relief import sample_heights
from sketchterrain.render.sky import Sun

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.relief import HeightMap
    from sketchterrain.render.scene import Terrain

    Floats = npt.NDArray[np.float64]

__all__ = ["find_sun"]

ELEVATION: Final = 27.0
"""Degrees: long shadows that model the ground, and still the colours of day."""
TO_THE_SIDE: Final = 108.0
"""Degrees between view and sun: side light from a little behind the photographer."""
STEPS: Final = 28


def find_sun(terrain: Terrain, camera: Camera) -> Sun:
    """Choose the side, left or right of a camera, from which the sun lights more of what it sees.

    Looks at coarse heights in a fan before the camera. The same input always gives the same sun.
    """
    extent = terrain.extent
    ahead = camera.forward[:2] * 0.5 * extent
    relief = sample_heights(terrain, (camera.eye[0] + ahead[0], camera.eye[1] + ahead[1]), 2.4 * extent, 320)
    bearing = np.radians(camera.heading) + np.linspace(-0.5, 0.5, 41)[:, None]
    distance = extent * np.geomspace(0.02, 1.3, 48)[None, :]
    x = camera.eye[0] + np.sin(bearing) * distance
    y = camera.eye[1] + np.cos(bearing) * distance
    seen = _share_of_picture(relief.at(x, y), camera.eye[2], distance)
    suns = [Sun((camera.heading + side * TO_THE_SIDE) % 360.0, ELEVATION) for side in (-1.0, 1.0)]
    lit = [float(np.sum(seen * _lit(relief, sun, x, y))) for sun in suns]
    return suns[int(np.argmax(lit))]


def _share_of_picture(height: Floats, eye: float, distance: Floats) -> Floats:
    slope = (height - eye) / distance
    skyline = np.maximum.accumulate(slope, axis=1)
    before = np.concatenate([skyline[:, :1], skyline[:, :-1]], axis=1)
    return np.asarray(np.maximum(slope - before, 0.0))


def _lit(relief: HeightMap, sun: Sun, x: Floats, y: Floats) -> Floats:
    """Return the cosine of incidence on the ground, 0 where other ground stands before the sun."""
    east, north, up = sun.direction
    h, d = relief.at(x, y), relief.texel
    slope_x = (relief.at(x + d, y) - relief.at(x - d, y)) / (2 * d)
    slope_y = (relief.at(x, y + d) - relief.at(x, y - d)) / (2 * d)
    cosine = (up - slope_x * east - slope_y * north) / np.sqrt(1.0 + slope_x**2 + slope_y**2)
    free = np.ones(x.shape, dtype=np.bool_)
    for run in d * np.geomspace(1.5, 160.0, STEPS):
        free &= relief.at(x + east * run, y + north * run) <= h + up * run + 0.5 * d
    return np.asarray(np.maximum(cosine, 0.0) * free)
