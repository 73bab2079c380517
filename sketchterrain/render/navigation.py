"""Camera navigation: orbit, walk and fly above the terrain, lines of sight, local terrain heights."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from sketchterrain.geometry.camera import Camera, Floats, HeightFunction, Vector, clip_planes, direction
from sketchterrain.render.scene import HeightMap, TerrainSource, sample_heights

MIN_WIDTH: Final = 48.0  # least width of a map (m)
WIDTH_PER_SPREAD: Final = 4.0  # width of a map, in spreads of the queried positions
MAX_WIDTH_RATIO: Final = 4.0
"""Ratio of a map's width to the required one above which it is replaced by a finer one."""


class LocalHeights:
    """Terrain heights by interpolation in a map of texels² around the queried positions.

    A `HeightFunction` for `WalkController` and `OrbitController`. The map is replaced when a position is
    outside of it, or when a finer map is needed; at its finest texels are 48 m / 128 wide.
    """

    def __init__(self, terrain: TerrainSource, *, texels: int = 128) -> None:
        self._terrain = terrain
        self._texels = texels
        self._map: HeightMap | None = None

    def __call__(self, x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return heights (m) at positions (m), which broadcast together."""
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        low = np.array([x.min(), y.min()])
        high = np.array([x.max(), y.max()])
        width = max(MIN_WIDTH, WIDTH_PER_SPREAD * float((high - low).max()))
        if self._map is None or not _covers(self._map, low, high, width):
            east, north = (0.5 * (low + high)).tolist()
            self._map = sample_heights(self._terrain, (east, north), width, self._texels)
        return self._map.at(x, y)


def _covers(
    cached: HeightMap, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], width: float
) -> bool:
    corner = np.array([cached.west, cached.south]) + cached.texel  # samples are at texel centres
    inside = (low >= corner).all() and (high <= corner + cached.width - 2.0 * cached.texel).all()
    return bool(inside) and cached.width <= MAX_WIDTH_RATIO * width


_RAY_SAMPLES: Final = 256
_RAY_ROUNDS: Final = 4
_RAY_START: Final = 0.5  # m


def intersect_terrain(
    heights: HeightFunction, eye: Vector, along: npt.ArrayLike, *, max_distance: float
) -> Vector | None:
    """Return the first intersection (m) of a ray with the terrain within `max_distance` m, None without one.

    Ridges narrower than a hundredth of their distance can be missed.
    """
    start, ray = np.asarray(eye, np.float64), np.asarray(along, np.float64)
    far = np.concatenate([[0.0], np.geomspace(_RAY_START, max_distance, _RAY_SAMPLES - 1)])
    for _ in range(_RAY_ROUNDS):
        positions = start + far[:, None] * ray
        below = positions[:, 2] < np.asarray(heights(positions[:, 0], positions[:, 1]), np.float64)
        if not below.any():
            return None
        first = int(np.argmax(below))
        if first == 0:
            break
        far = np.linspace(far[first - 1], far[first], _RAY_SAMPLES)
    return _vector(start + far[first] * ray)


CLEARANCE: Final = 1.0  # least height of the eye above the terrain (m)
DISTANCES: Final = (2.0, 5e6)  # range of the distance from eye to pivot (m)
ELEVATIONS: Final = (-30.0, 89.0)  # range of the elevation of the eye above the pivot's horizon (degrees)

_SOFT = 1.0  # m, width of the smooth maximum of eye height and terrain
_ORBIT_TIME = 0.10  # s, time constant
_FLATTEST = 0.2  # least sine of the elevation that stretches a pan
_HEADING, _ELEVATION, _DISTANCE = range(3)


class OrbitController:
    """Camera that looks at a pivot from a heading, an elevation (degrees) and a distance (m).

    Input sets a goal; the state relaxes to it exponentially, all parts at one rate and integrated exactly:
    the path does not depend on the frame rate, and a zoom keeps its point fixed in the picture. An eye below
    the terrain is lifted above it.
    """

    def __init__(
        self,
        heights: HeightFunction,
        pivot: Vector,
        *,
        heading: float = 0.0,
        elevation: float = 35.0,
        distance: float = 1000.0,
        fov: float = 50.0,
    ) -> None:
        self._heights = heights
        self.fov = fov
        # heading, elevation, distance, pivot
        self._goal = np.array([heading, elevation, distance, *pivot], np.float64)
        self._clamp_goal()
        self._state = self._goal.copy()

    @property
    def pivot(self) -> Vector:
        """Current pivot (m)."""
        return _vector(self._state[3:])

    @property
    def distance(self) -> float:
        """Distance from pivot to eye (m), unless the terrain lifts the eye."""
        return float(self._state[_DISTANCE])

    @property
    def heading(self) -> float:
        """Compass bearing of the view, degrees, 0 … 360."""
        return float(self._state[_HEADING] % 360.0)

    @property
    def elevation(self) -> float:
        """Elevation of the eye above the pivot's horizon, degrees."""
        return float(self._state[_ELEVATION])

    def turn(self, right: float, up: float) -> None:
        """Rotate about the pivot: the eye moves right and up (degrees)."""
        self._goal[:2] += -right, up
        self._clamp_goal()

    def pan(self, right: float, up: float) -> None:
        """Move the pivot along the terrain, by shares of the picture's height; it follows the terrain."""
        height = 2.0 * math.tan(math.radians(self.fov) / 2.0) * self._goal[_DISTANCE]
        heading, elevation = self._goal[:2]
        upward = up / max(math.sin(math.radians(elevation)), _FLATTEST)
        move = height * (right * direction(heading + 90.0, 0.0) + upward * direction(heading, 0.0))
        x, y = self._goal[3:5] + move[:2]
        before, after = self._heights([self._goal[3], x], [self._goal[4], y])
        self._goal[3:] = x, y, self._goal[5] + float(after) - float(before)

    def zoom(self, factor: float, about: Vector | None = None) -> None:
        """Multiply the distance; `about` (m; default: the pivot) stays fixed in the picture."""
        distance = self._goal[_DISTANCE]
        self._goal[_DISTANCE] = distance * factor
        self._clamp_goal()
        if about is not None:
            self._goal[3:] = about + (self._goal[3:] - about) * (self._goal[_DISTANCE] / distance)

    def glide(self, pivot: Vector, *, distance: float | None = None) -> None:
        """Move smoothly to another pivot."""
        self._goal[3:] = pivot
        self._goal[_DISTANCE] = distance or self._goal[_DISTANCE]
        self._clamp_goal()

    def jump(self, pivot: Vector, *, distance: float | None = None) -> None:
        """Move to another pivot at once."""
        self.glide(pivot, distance=distance)
        self._state = self._goal.copy()

    def advance(self, elapsed: float) -> None:
        """Advance by `elapsed` s."""
        self._state += (self._goal - self._state) * _relaxation(max(elapsed, 0.0), _ORBIT_TIME)

    def camera(self, *, draw_distance: float) -> Camera:
        """Return the camera, clipped for a draw distance (m)."""
        heading, elevation, distance = self._state[:3].tolist()
        pivot = self._state[3:]
        eye = pivot - distance * direction(heading, -elevation)
        heights = float(self._heights(eye[0], eye[1]))
        eye[2] = _smooth_maximum(float(eye[2]), heights + CLEARANCE)
        near, far = clip_planes(float(eye[2]) - heights, draw_distance)
        return Camera(_vector(eye), _vector(pivot), fov=self.fov, near=near, far=far)

    def _clamp_goal(self) -> None:
        goal = self._goal
        goal[_ELEVATION] = np.clip(goal[_ELEVATION], *ELEVATIONS)
        goal[_DISTANCE] = np.clip(goal[_DISTANCE], *DISTANCES)


def _smooth_maximum(value: float, floor: float) -> float:
    """Return a smooth maximum, equal to the maximum where the values are `_SOFT` apart."""
    near = max(_SOFT - abs(value - floor), 0.0)
    return max(value, floor) + 0.25 * near * near / _SOFT


def _vector(values: Floats) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


EYE_HEIGHT: Final = 1.7  # resting height of the eye above the terrain (m)
STEEPEST: Final = 89.0  # largest pitch (degrees); the heading is undefined at 90°

_SPEEDS = (4.0, 3000.0)  # m/s, at the terrain and at most
_SPEED_PER_HEIGHT = 0.8  # 1/s
_STEP = 1.0 / 240.0  # s, of the integration
_MAX_STEPS = 64  # per advance; longer pauses take longer steps, which stay stable
_VELOCITY_TIME = 0.20  # s, time constants: of the velocity
_LOOK_TIME = 0.04  # of the view direction
_RISE_TIME = 0.15  # of the height above the terrain
_CLIMB_TIME = 0.05  # of the climb ahead of a slope
_LOOKAHEAD = np.array([0.0, 0.1, 0.2, 0.35, 0.55, 0.8, 1.1])  # s ahead at which the terrain is sampled
_REST_SPEED = 1e-5  # m/s, below which the eye stops


class WalkController:
    """Camera that moves in its view direction: on foot at `EYE_HEIGHT`, or flying.

    Velocity, direction and height relax exponentially and are integrated exactly over steps of at most
    1/240 s: the path does not depend on the frame rate. Everything is float64. `clearance` is the height of
    the eye above the terrain (m).
    """

    def __init__(
        self,
        heights: HeightFunction,
        eye: Vector,
        *,
        heading: float = 0.0,
        pitch: float = 0.0,
        on_foot: bool = False,
    ) -> None:
        self._heights = heights
        self.on_foot = on_foot
        self._target_look = np.array([heading, pitch], np.float64)
        self.jump(eye, heading=heading, pitch=pitch)

    @property
    def eye(self) -> Vector:
        """Position of the eye (m)."""
        return _vector(self._eye)

    @property
    def heading(self) -> float:
        """Compass bearing of the view, degrees, 0 … 360."""
        return float(self._look[0] % 360.0)

    @property
    def pitch(self) -> float:
        """Elevation of the view, degrees."""
        return float(self._look[1])

    def jump(self, eye: Vector, *, heading: float | None = None, pitch: float | None = None) -> None:
        """Move to another position at once, at rest and above the terrain."""
        heading = self._target_look[0] if heading is None else heading
        pitch = self._target_look[1] if pitch is None else pitch
        self._eye = np.array(eye, np.float64)
        self._look = np.array([heading, np.clip(pitch, -STEEPEST, STEEPEST)], np.float64)
        self._target_look = self._look.copy()
        self.velocity = np.zeros(3)
        heights = self._heights_at(self._eye[None, :2])[0]
        self._eye[2] = heights + EYE_HEIGHT if self.on_foot else max(self._eye[2], heights + EYE_HEIGHT)
        self.clearance = float(self._eye[2] - heights)

    def look(self, right: float, up: float) -> None:
        """Turn by degrees, with smooth motion."""
        target = self._target_look
        target += right, up
        target[1] = np.clip(target[1], -STEEPEST, STEEPEST)

    def advance(
        self, elapsed: float, *, forward: float = 0.0, right: float = 0.0, up: float = 0.0, boost: float = 1.0
    ) -> None:
        """Advance by `elapsed` s with input −1 … 1 per axis and a speed factor."""
        steps = min(max(math.ceil(elapsed / _STEP - 1e-6), 1), _MAX_STEPS)
        if elapsed <= 0.0:
            return
        push = np.array([right, forward, up], np.float64)
        push *= boost / max(1.0, float(np.linalg.norm(push)))
        for _ in range(steps):
            self._step(elapsed / steps, push)

    def camera(self, *, draw_distance: float, fov: float = 50.0) -> Camera:
        """Return the camera, clipped for a draw distance (m)."""
        target = self._eye + 1000.0 * direction(*self._look)
        near, far = clip_planes(self.clearance, draw_distance)
        return Camera(self.eye, _vector(target), fov=fov, near=near, far=far)

    def _step(self, h: float, push: Floats) -> None:
        self._look += (self._target_look - self._look) * _relaxation(h, _LOOK_TIME)
        target = self._target_velocity(push)
        excess, share = self.velocity - target, _relaxation(h, _VELOCITY_TIME)
        self._eye += target * h + excess * (_VELOCITY_TIME * share)
        self.velocity = target + excess * (1.0 - share)
        if not push.any() and float(np.abs(self.velocity).max()) < _REST_SPEED:
            self.velocity[:] = 0.0
        self._stay_above(h)

    def _target_velocity(self, push: Floats) -> Floats:
        heading, pitch = self._look
        forward = direction(heading, 0.0 if self.on_foot else pitch)
        across = direction(heading + 90.0, 0.0)
        speed = float(np.clip(_SPEED_PER_HEIGHT * self.clearance, *_SPEEDS))
        up = 0.0 if self.on_foot else push[2]
        return np.asarray(speed * (push[0] * across + push[1] * forward + [0.0, 0.0, up]))

    def _stay_above(self, h: float) -> None:
        """Climb ahead of slopes, relax to the resting height, stay above `CLEARANCE`."""
        grounds = self._heights_at(self._eye[:2] + self.velocity[:2] * _LOOKAHEAD[:, None])
        rest = grounds + EYE_HEIGHT
        z, climb = float(self._eye[2]), float(self.velocity[2])
        if not self.on_foot:
            needed = float(((rest[1:] - z) / _LOOKAHEAD[1:]).max())
            if needed > max(climb, 0.0):
                climb += (needed - climb) * _relaxation(h, _CLIMB_TIME)
        if self.on_foot or z < rest[0]:
            z += (rest[0] - z) * _relaxation(h, _RISE_TIME)
            if climb < 0.0:
                climb -= climb * _relaxation(h, _CLIMB_TIME)
        if z < grounds[0] + CLEARANCE:
            z, climb = grounds[0] + CLEARANCE, max(climb, 0.0)
        self._eye[2], self.velocity[2] = z, climb
        self.clearance = float(z - grounds[0])

    def _heights_at(self, positions: Floats) -> Floats:
        return np.asarray(self._heights(positions[:, 0], positions[:, 1]), np.float64)


def _relaxation(h: float, constant: float) -> float:
    """Return the share of the distance to its goal that a relaxing value covers in h seconds."""
    return -math.expm1(-h / constant)
