"""Where one looks from: an orbit, a flight or a walk over the ground, and how one becomes the other."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.render import Camera
from sketchterrain.render.near_ground import NearGround
from sketchterrain.render.orbit import Orbit
from sketchterrain.render.scene import BoundedTerrain, visible_rectangle
from sketchterrain.render.sight import sight
from sketchterrain.render.walk import Walk
from sketchterrain.ui.engine.protocol import Fly, GoTo, Pan, Pose, Turn, Zoom

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.render.camera import Vector
    from sketchterrain.render.scene import TerrainSource

FOV: Final = 50.0
"""Degrees, vertical."""
REACH: Final = 8.0
"""Extents, how far lines of sight are followed."""
_START: Final = (0.74, 22.0)  # extents from the middle, degrees over it: most of the sketch, and the sky
_WIDE: Final = 1.4  # width over height of the narrowest picture for which that holds
_GLIDE: Final = 0.5  # s
_STILL: Final = 2e-5  # of the distance to what is looked at; smaller motions are none
_KEYS: Final = 0.7  # heights of the picture a second, as keys move an orbit's pivot
_RISE: Final = 0.9  # e-foldings of its distance a second


class CameraController:
    """Follows what a person does with mouse and keys, in any mode; without OpenGL."""

    def __init__(self, terrain: TerrainSource, *, aspect: float = _WIDE) -> None:
        self._terrain = terrain
        self._near = NearGround(terrain)
        self._way = Fly()
        self._glide: _Glide | None = None
        self._camera: Camera | None = None
        self.mode = "orbit"
        self.restless = True
        self.size = terrain.size
        west, south, east, north = visible_rectangle(terrain)
        x, y = (west + east) / 2, (south + north) / 2
        self._orbit = self._circling(
            (x, y, float(terrain.heights(x, y))),
            distance=_START[0] * terrain.extent * max(_WIDE / aspect, 1.0),
            elevation=_START[1],
        )
        self._walk: Walk | None = None

    def follow(self, terrain: TerrainSource) -> None:
        """Move above another terrain from now on; the eye stays where it is, unless that is in the ground."""
        self._terrain = terrain
        self._near = NearGround(terrain)
        self.restless = True

    def use(self, mode: str) -> None:
        """Move in another mode, from where the eye is."""
        if mode == self.mode:
            return
        camera = self.camera()
        self.mode, self._glide, self.restless = mode, None, True
        if mode == "orbit":
            self._orbit_from(camera)
        elif self._walk is None:
            self._walk = self._walking(camera)
        else:
            self._walk.on_foot = mode == "walk"

    def take(self, motion: Turn | Pan | Zoom | Fly | GoTo, *, aspect: float) -> None:
        """Do what a person asks for; `aspect` is the picture's width over its height."""
        self.restless = True
        if isinstance(motion, Fly):
            self._way = motion
        elif isinstance(motion, Turn):
            self._turn(motion)
        elif isinstance(motion, Pan):
            self._pan(motion)
        elif isinstance(motion, Zoom):
            self._zoom(motion, aspect)
        else:
            self._go_to(motion)

    def be_at(self, camera: Camera) -> None:
        """Be somewhere else at once."""
        self._glide, self.restless = None, True
        if self._walk is None:
            self._orbit_from(camera)
        else:
            self._walk.jump(camera.eye, heading=camera.heading, pitch=camera.pitch)

    def advance(self, elapsed: float) -> bool:
        """Let time (s) pass; return whether the eye moved."""
        if self._walk is None:
            self._move_orbit(elapsed)
            self._orbit.advance(elapsed)
        elif self._glide is not None:
            self._glide.advance(self._walk, elapsed)
            self._glide = None if self._glide.over else self._glide
        else:
            way = self._way
            self._walk.advance(elapsed, forward=way.forward, right=way.right, up=way.up, boost=way.boost)
        self._keep_inside()
        before, after = self._camera, self._moved()
        if before is not None and _is_near(before, after):
            self.restless = self._way != Fly(boost=self._way.boost) or self._glide is not None
            return False
        self._camera = after
        return True

    def camera(self) -> Camera:
        """Return the camera as of the last `advance`."""
        if self._camera is None:
            self._camera = self._moved()
        return self._camera

    def pose(self) -> Pose:
        """Return where it is, and a point of the ground that it looks at, or one before it."""
        camera = self.camera()
        return Pose(camera.eye, camera.target, camera.fov)

    def seen(self, x: float, y: float, *, aspect: float) -> Vector | None:
        """Return what ground is seen at a place of the picture (shares, from its upper left corner), m."""
        camera = self.camera()
        along = camera.ray(2.0 * x - 1.0, 1.0 - 2.0 * y, aspect)
        return sight(self._heights, camera.eye, along, reach=REACH * self._terrain.extent)

    def _heights(self, x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.float32]:
        return self._terrain.heights(x, y)

    def _ground(self, x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.float64]:
        return self._near(x, y)

    def _moved(self) -> Camera:
        far = REACH * self._terrain.extent
        if self._walk is None:
            return self._orbit.camera(draw_distance=far)
        return self._walk.camera(draw_distance=far, fov=FOV)

    def _keep_inside(self) -> None:
        """Nobody walks off the end of a world that has one."""
        walk = self._walk
        if walk is None or not walk.on_foot or not isinstance(self._terrain, BoundedTerrain):
            return
        west, south, east, north = self._terrain.bounds
        x, y, z = walk.eye
        inside = (min(max(x, west), east), min(max(y, south), north), z)
        if inside != walk.eye:
            walk.jump(inside)

    def _turn(self, motion: Turn) -> None:
        if self._walk is None:
            self._orbit.turn(motion.right, motion.up)
        else:
            self._walk.look(motion.right, motion.up)

    def _pan(self, motion: Pan) -> None:
        if self._walk is None:
            self._orbit.pan(motion.right, motion.up)
            return
        camera = self.camera()
        height = 2.0 * math.tan(math.radians(camera.fov) / 2.0) * max(self._walk.clearance, 10.0)
        right, up, _ = camera.view()[:3, :3]
        self._shift(height * (motion.right * right + motion.up * up))

    def _zoom(self, motion: Zoom, aspect: float) -> None:
        place = self.seen(motion.x, motion.y, aspect=aspect)
        if self._walk is None:
            self._orbit.zoom(motion.factor, place)
            return
        camera = self.camera()
        if place is None:
            ray = camera.ray(2.0 * motion.x - 1.0, 1.0 - 2.0 * motion.y, aspect)
            way = 10.0 * max(self._walk.clearance, 10.0) * ray
        else:
            way = np.subtract(place, camera.eye)
        self._shift((1.0 - min(motion.factor, 2.0)) * way)

    def _shift(self, way: npt.NDArray[np.float64]) -> None:
        walk = self._walk
        assert walk is not None  # noqa: S101 # an orbit has ways of its own
        x, y, z = (np.asarray(walk.eye) + way).tolist()
        self._glide = _Glide(walk, (x, y, z), walk.heading, walk.pitch, seconds=0.12)

    def _go_to(self, motion: GoTo) -> None:
        place = (motion.x, motion.y, float(self._terrain.heights(motion.x, motion.y)))
        if self._walk is None:
            self._orbit.glide(place, distance=motion.distance)
            return
        camera = self.camera()
        away = np.subtract(camera.eye, place)
        length = max(float(np.linalg.norm(away)), 1.0)
        eye = np.asarray(place) + away * ((motion.distance or length) / length)
        x, y, z = eye.tolist()
        aimed = Camera((x, y, z), place)
        self._glide = _Glide(self._walk, (x, y, z), aimed.heading, aimed.pitch, seconds=_GLIDE)

    def _move_orbit(self, elapsed: float) -> None:
        way = self._way
        step = _KEYS * way.boost * min(elapsed, 0.2)
        if way.forward or way.right:
            self._orbit.pan(step * way.right, step * way.forward)
        if way.up:
            self._orbit.zoom(math.exp(_RISE * way.boost * way.up * min(elapsed, 0.2)))

    def _circling(
        self, pivot: Vector, *, distance: float, heading: float = 0.0, elevation: float, fov: float = FOV
    ) -> Orbit:
        return Orbit(self._ground, pivot, heading=heading, elevation=elevation, distance=distance, fov=fov)

    def _orbit_from(self, camera: Camera) -> None:
        """Go around what lies in the picture's middle."""
        place = sight(self._heights, camera.eye, camera.forward, reach=REACH * self._terrain.extent)
        if place is None:  # into the sky: around what is before one
            x, y, z = (np.asarray(camera.eye) + 0.3 * self._terrain.extent * camera.forward).tolist()
            place = (x, y, z)
        distance = float(np.linalg.norm(np.subtract(place, camera.eye)))
        self._walk = None
        self._orbit = self._circling(
            place, distance=distance, heading=camera.heading, elevation=-camera.pitch, fov=camera.fov
        )

    def _walking(self, camera: Camera) -> Walk:
        walk = Walk(self._ground, camera.eye, heading=camera.heading, pitch=camera.pitch)
        walk.on_foot = self.mode == "walk"
        return walk


class _Glide:
    """A walk's way to a place, with another look there."""

    def __init__(self, walk: Walk, eye: Vector, heading: float, pitch: float, *, seconds: float) -> None:
        turn = (heading - walk.heading + 180.0) % 360.0 - 180.0
        self._start = np.array([*walk.eye, walk.heading, walk.pitch])
        self._way = np.array([*eye, walk.heading + turn, pitch]) - self._start
        self._seconds, self._spent = seconds, 0.0

    @property
    def over(self) -> bool:
        """Whether it is there."""
        return self._spent >= self._seconds

    def advance(self, walk: Walk, elapsed: float) -> None:
        """Go on for a time (s)."""
        self._spent += elapsed
        share = min(self._spent / self._seconds, 1.0)
        x, y, z, heading, pitch = (self._start + share * share * (3.0 - 2.0 * share) * self._way).tolist()
        walk.jump((x, y, z), heading=heading, pitch=pitch)


def _is_near(one: Camera, other: Camera) -> bool:
    """Whether nobody sees the difference: motion fades out and would keep a picture from coming to rest."""
    length = float(np.linalg.norm(np.subtract(other.target, other.eye)))
    moved = (
        np.abs(np.subtract(one.eye, other.eye)).max() + np.abs(np.subtract(one.target, other.target)).max()
    )
    return bool(moved < _STILL * length) and one.fov == other.fov
