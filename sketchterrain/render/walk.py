"""Moving freely over a terrain: WASD and the mouse, quick high up and slow near the ground, never into it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.render.camera import Camera, clip_planes, direction

if TYPE_CHECKING:
    from sketchterrain.render.camera import Floats, Ground, Vector

EYE_HEIGHT: Final = 1.7
"""Height above the ground (m) at which the eye comes to rest."""
CLEARANCE: Final = 1.0
"""Height above the ground (m) below which the eye never is."""
STEEPEST: Final = 89.0
"""Degrees up and down; straight up and down a heading means nothing."""

_SPEEDS = (4.0, 3000.0)  # m/s, at the ground and at most
_SPEED_PER_HEIGHT = 0.8  # 1/s
_STEP = 1.0 / 240.0  # s, of the integration
_MOST_STEPS = 64  # an advance; longer pauses take longer steps, which stay stable
_GAIN = 0.20  # s, time constants: of the velocity
_TURN = 0.04  # of the look
_RISE = 0.15  # of the eye's height over the ground
_AVOID = 0.05  # of the climb before a slope
_AHEAD = np.array([0.0, 0.1, 0.2, 0.35, 0.55, 0.8, 1.1])  # s, where the ground is looked at
_STILL = 1e-5  # m/s, what is slower stands


class Walk:
    """An eye that moves where it looks.

    Velocity, look and height relax exponentially, and are integrated exactly over steps of at most 1/240 s:
    the way does not depend on how many frames a second there are. Everything is float64.
    """

    def __init__(
        self, ground: Ground, eye: Vector, *, heading: float = 0.0, pitch: float = 0.0, on_foot: bool = False
    ) -> None:
        self._ground = ground
        self.on_foot = on_foot
        self._wanted_look = np.array([heading, pitch], np.float64)
        self.jump(eye, heading=heading, pitch=pitch)

    @property
    def eye(self) -> Vector:
        """Where the eye is, m."""
        x, y, z = self._eye.tolist()
        return x, y, z

    @property
    def heading(self) -> float:
        """Compass bearing of the view, degrees, 0 … 360."""
        return float(self._look[0] % 360.0)

    @property
    def pitch(self) -> float:
        """Elevation of the view, degrees."""
        return float(self._look[1])

    @property
    def clearance(self) -> float:
        """How high the eye is above the ground, m."""
        return self._clearance

    def jump(self, eye: Vector, *, heading: float | None = None, pitch: float | None = None) -> None:
        """Be somewhere else at once, standing still, above the ground there; the look stays unless given."""
        heading = self._wanted_look[0] if heading is None else heading
        pitch = self._wanted_look[1] if pitch is None else pitch
        self._eye = np.array(eye, np.float64)
        self._look = np.array([heading, np.clip(pitch, -STEEPEST, STEEPEST)], np.float64)
        self._wanted_look = self._look.copy()
        self.velocity = np.zeros(3)
        ground = self._ground_at(self._eye[None, :2])[0]
        self._eye[2] = ground + EYE_HEIGHT if self.on_foot else max(self._eye[2], ground + EYE_HEIGHT)
        self._clearance = float(self._eye[2] - ground)

    def look(self, right: float, up: float) -> None:
        """Turn by degrees; the view follows within a tenth of a second."""
        wanted = self._wanted_look
        wanted += right, up
        wanted[1] = np.clip(wanted[1], -STEEPEST, STEEPEST)

    def advance(
        self, elapsed: float, *, forward: float = 0.0, right: float = 0.0, up: float = 0.0, boost: float = 1.0
    ) -> None:
        """Let time pass."""
        steps = min(max(math.ceil(elapsed / _STEP - 1e-6), 1), _MOST_STEPS)
        if elapsed <= 0.0:
            return
        push = np.array([right, forward, up], np.float64)
        push *= boost / max(1.0, float(np.linalg.norm(push)))
        for _ in range(steps):
            self._step(elapsed / steps, push)

    def camera(self, *, draw_distance: float, fov: float = 50.0) -> Camera:
        """Return the camera at the eye; `draw_distance` (m) is how far the ground is drawn."""
        x, y, z = self._eye.tolist()
        ahead = 1000.0 * direction(*self._look)
        near, far = clip_planes(self._clearance, draw_distance)
        return Camera((x, y, z), (x + ahead[0], y + ahead[1], z + ahead[2]), fov=fov, near=near, far=far)

    def _step(self, h: float, push: Floats) -> None:
        self._look += (self._wanted_look - self._look) * _share(h, _TURN)
        wanted = self._wanted_velocity(push)
        excess, share = self.velocity - wanted, _share(h, _GAIN)
        self._eye += wanted * h + excess * (_GAIN * share)
        self.velocity = wanted + excess * (1.0 - share)
        if not push.any() and float(np.abs(self.velocity).max()) < _STILL:
            self.velocity[:] = 0.0
        self._stay_above(h)

    def _wanted_velocity(self, push: Floats) -> Floats:
        heading, pitch = self._look
        forward = direction(heading, 0.0 if self.on_foot else pitch)
        across = direction(heading + 90.0, 0.0)
        speed = float(np.clip(_SPEED_PER_HEIGHT * self._clearance, *_SPEEDS))
        up = 0.0 if self.on_foot else push[2]
        return np.asarray(speed * (push[0] * across + push[1] * forward + [0.0, 0.0, up]))

    def _stay_above(self, h: float) -> None:
        """Climb before slopes, come to rest over the ground, and never be lower than `CLEARANCE`."""
        grounds = self._ground_at(self._eye[:2] + self.velocity[:2] * _AHEAD[:, None])
        rest = grounds + EYE_HEIGHT
        z, climb = float(self._eye[2]), float(self.velocity[2])
        if not self.on_foot:
            needed = float(((rest[1:] - z) / _AHEAD[1:]).max())
            if needed > max(climb, 0.0):
                climb += (needed - climb) * _share(h, _AVOID)
        if self.on_foot or z < rest[0]:
            z += (rest[0] - z) * _share(h, _RISE)
            if climb < 0.0:
                climb -= climb * _share(h, _AVOID)
        if z < grounds[0] + CLEARANCE:
            z, climb = grounds[0] + CLEARANCE, max(climb, 0.0)
        self._eye[2], self.velocity[2] = z, climb
        self._clearance = float(z - grounds[0])

    def _ground_at(self, places: Floats) -> Floats:
        return np.asarray(self._ground(places[:, 0], places[:, 1]), np.float64)


def _share(h: float, constant: float) -> float:
    """Return how much of the way to its goal a relaxing value goes in a time."""
    return -math.expm1(-h / constant)
