"""How far the ground is drawn from an eye, and the clipping planes that go with it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sketchterrain.render.camera import clip_planes

if TYPE_CHECKING:
    from sketchterrain.render.camera import Camera

CLIMB: Final = 8.0
"""m by which the draw distance grows with each metre of height above the ground."""
FARTHEST: Final = 16.0
"""Extents: draw distance at most; the coarsest tiles are as wide."""


def draw_distance(clearance: float, *, extent: float, reach: float) -> float:
    """Return how far the ground is drawn (m)."""
    return min(reach * extent + CLIMB * clearance, FARTHEST * extent)


def with_clip_planes(
    camera: Camera, clearance: float, *, extent: float, reach: float
) -> tuple[Camera, float]:
    """Return a camera with clipping planes that suit its height, and the draw distance (m)."""
    distance = draw_distance(clearance, extent=extent, reach=reach)
    near, far = clip_planes(clearance, distance)
    return replace(camera, near=near, far=far), distance
