"""Camera navigation: orbit, walk and fly, with collision against the ground."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.render.camera import Camera, clip_planes, direction
from sketchterrain.render.scene import sample_heights

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.render.camera import Floats, Ground, Vector
    from sketchterrain.render.scene import HeightMap, TerrainSource


NARROWEST: Final = 48.0
"""m, side of the smallest map."""
SPREADS: Final = 4.0
"""Side of a map, in the spread of the places that are asked for …"""
TOO_WIDE: Final = 4.0
"""… and how many times that a map may be wide before there is a finer one."""


class NearGround:
    """Heights of a terrain by interpolation in a map around the places that are asked for.

    It is a `Ground` for `Walk` and `Orbit`. A map is made when a place lies outside the last one, or when all
    lie so near to one another that a finer map shows more.

    Parameters
    ----------
    terrain
        Whose ground.
    texels
        Along a side of the map; near the ground they are 48 m / 128 wide.
    """

    def __init__(self, terrain: TerrainSource, *, texels: int = 128) -> None:
        self._terrain = terrain
        self._texels = texels
        self._map: HeightMap | None = None

    def __call__(self, x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return heights (m) at places (m), arrays that broadcast together."""
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        low = np.array([x.min(), y.min()])
        high = np.array([x.max(), y.max()])
        wanted = max(NARROWEST, SPREADS * float((high - low).max()))
        if self._map is None or not _serves(self._map, low, high, wanted):
            east, north = (0.5 * (low + high)).tolist()
            self._map = sample_heights(self._terrain, (east, north), wanted, self._texels)
        return self._map.at(x, y)


def _serves(
    kept: HeightMap, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], wanted: float
) -> bool:
    corner = np.array([kept.west, kept.south]) + kept.texel  # half a texel in, the last samples lie
    inside = (low >= corner).all() and (high <= corner + kept.width - 2.0 * kept.texel).all()
    return bool(inside) and kept.width <= TOO_WIDE * wanted


_SAMPLES: Final = 256
_ROUNDS: Final = 4
_NEAREST: Final = 0.5  # m


def sight(ground: Ground, eye: Vector, along: npt.ArrayLike, *, reach: float) -> Vector | None:
    """Return the first point where a line of sight goes into the ground, None if it does not.

    Ridges that are narrower than a hundredth of their distance can be missed.
    """
    start, way = np.asarray(eye, np.float64), np.asarray(along, np.float64)
    far = np.concatenate([[0.0], np.geomspace(_NEAREST, reach, _SAMPLES - 1)])
    for _ in range(_ROUNDS):
        places = start + far[:, None] * way
        below = places[:, 2] < np.asarray(ground(places[:, 0], places[:, 1]), np.float64)
        if not below.any():
            return None
        first = int(np.argmax(below))
        if first == 0:
            break
        far = np.linspace(far[first - 1], far[first], _SAMPLES)
    x, y, z = (start + far[first] * way).tolist()
    return x, y, z


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


EYE_HEIGHT: Final = 1.7
"""Height above the ground (m) at which the eye comes to rest."""
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
