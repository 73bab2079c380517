"""Turning around a point on the ground: orbit, pan, zoom about what is under the mouse, smoothly."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.render.camera import Camera, clip_planes, direction

if TYPE_CHECKING:
    from sketchterrain.render.camera import Floats, Ground, Vector

CLEARANCE: Final = 1.0
"""Height above the ground (m) below which the eye never is."""
DISTANCES: Final = (2.0, 5e6)
"""From the eye to the pivot, m."""
ELEVATIONS: Final = (-30.0, 89.0)
"""Of the eye over the pivot's horizon, degrees."""

_SOFT = 1.0  # m, over which the eye comes to lie on the ground
_CONSTANT = 0.10  # s, in which all goes 63 % of the way to its goal
_FLATTEST = 0.2  # sine of the flattest view by which a pan is stretched
_HEADING, _ELEVATION, _DISTANCE = range(3)


class Orbit:
    """An eye that looks at a pivot from a heading, an elevation and a distance.

    What is asked for is a goal; everything relaxes to it exponentially and at one rate, exactly: the way does
    not depend on the frames a second, and a zoom keeps its point where it is in the picture all the while.
    The eye keeps its distance unless that were in the ground: then it is lifted just out of it.
    """

    def __init__(
        self,
        ground: Ground,
        pivot: Vector,
        *,
        heading: float = 0.0,
        elevation: float = 35.0,
        distance: float = 1000.0,
        fov: float = 50.0,
    ) -> None:
        self._ground = ground
        self.fov = fov
        # heading, elevation, distance, pivot
        self._goal = np.array([heading, elevation, distance, *pivot], np.float64)
        self._limit()
        self._now = self._goal.copy()

    @property
    def pivot(self) -> Vector:
        """What is looked at now, m."""
        x, y, z = self._now[3:].tolist()
        return x, y, z

    @property
    def distance(self) -> float:
        """From the pivot to the eye, m, where the ground does not lift it."""
        return float(self._now[_DISTANCE])

    @property
    def heading(self) -> float:
        """Compass bearing of the view, degrees, 0 … 360."""
        return float(self._now[_HEADING] % 360.0)

    @property
    def elevation(self) -> float:
        """How high the eye stands over the pivot's horizon, degrees."""
        return float(self._now[_ELEVATION])

    def turn(self, right: float, up: float) -> None:
        """Go around the pivot: the eye moves by degrees to its right, and up."""
        self._goal[:2] += -right, up
        self._limit()

    def pan(self, right: float, up: float) -> None:
        """Move the pivot over the ground."""
        height = 2.0 * math.tan(math.radians(self.fov) / 2.0) * self._goal[_DISTANCE]
        heading, elevation = self._goal[:2]
        upward = up / max(math.sin(math.radians(elevation)), _FLATTEST)
        move = height * (right * direction(heading + 90.0, 0.0) + upward * direction(heading, 0.0))
        x, y = self._goal[3:5] + move[:2]
        before, after = self._ground([self._goal[3], x], [self._goal[4], y])
        self._goal[3:] = x, y, self._goal[5] + float(after) - float(before)

    def zoom(self, factor: float, about: Vector | None = None) -> None:
        """Multiply the distance."""
        distance = self._goal[_DISTANCE]
        self._goal[_DISTANCE] = distance * factor
        self._limit()
        if about is not None:
            self._goal[3:] = about + (self._goal[3:] - about) * (self._goal[_DISTANCE] / distance)

    def glide(self, pivot: Vector, *, distance: float | None = None) -> None:
        """Go over to looking at another point, from the heading and the elevation that were asked for."""
        self._goal[3:] = pivot
        self._goal[_DISTANCE] = distance or self._goal[_DISTANCE]
        self._limit()

    def jump(self, pivot: Vector, *, distance: float | None = None) -> None:
        """Look at another point at once, from the heading and the elevation that were asked for."""
        self.glide(pivot, distance=distance)
        self._now = self._goal.copy()

    def advance(self, elapsed: float) -> None:
        """Let time (s) pass."""
        self._now += (self._goal - self._now) * -math.expm1(-max(elapsed, 0.0) / _CONSTANT)

    def camera(self, *, draw_distance: float) -> Camera:
        """Return the camera; `draw_distance` (m) is how far the ground is drawn."""
        heading, elevation, distance = self._now[:3].tolist()
        pivot = self._now[3:]
        eye = pivot - distance * direction(heading, -elevation)
        ground = float(self._ground(eye[0], eye[1]))
        eye[2] = _soft_greater(float(eye[2]), ground + CLEARANCE)
        near, far = clip_planes(float(eye[2]) - ground, draw_distance)
        return Camera(_vector(eye), _vector(pivot), fov=self.fov, near=near, far=far)

    def _limit(self) -> None:
        goal = self._goal
        goal[_ELEVATION] = np.clip(goal[_ELEVATION], *ELEVATIONS)
        goal[_DISTANCE] = np.clip(goal[_DISTANCE], *DISTANCES)


def _soft_greater(value: float, floor: float) -> float:
    """Return the greater one without a kink: never less, and exactly it where they are `_SOFT` apart."""
    near = max(_SOFT - abs(value - floor), 0.0)
    return max(value, floor) + 0.25 * near * near / _SOFT


def _vector(values: Floats) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
