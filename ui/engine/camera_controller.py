"""Camera control of the 3-D view: orbit, flight and walk, and the transitions between them."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from sketchterrain.geometry.camera import Camera, Vector
from sketchterrain.render.navigation import LocalHeights, OrbitController, WalkController, intersect_terrain
from sketchterrain.render.scene import BoundedTerrain, TerrainSource, surface_heights, visible_rectangle
from sketchterrain.ui.engine.protocol import Fly, GoTo, Pan, Turn, Zoom

_FOV: Final = 50.0  # degrees, vertical
_RANGE: Final = 8.0  # of rays, in extents
_START_VIEW: Final = 0.74, 22.0  # distance in extents, elevation in degrees: most of the sketch, and sky
_LEAST_ASPECT: Final = 1.4  # narrowest image for which that holds
_GLIDE: Final = 0.5  # s
_STILLNESS: Final = 2e-5  # of the distance to the target; smaller motions are ignored
_PAN_RATE: Final = 0.7  # image heights a second, of keys that move an orbit's pivot
_ZOOM_RATE: Final = 0.9  # e-foldings of its distance a second


class CameraController:
    """Moves the camera by the user's motions, in any mode; independent of OpenGL."""

    def __init__(self, terrain: TerrainSource, *, aspect: float = _LEAST_ASPECT) -> None:
        self.set_terrain(terrain)
        self._motion = Fly()
        self._glide: _Glide | None = None
        self._camera: Camera | None = None
        self.mode = "orbit"
        self.size = terrain.size
        west, south, east, north = visible_rectangle(terrain)
        x, y = (west + east) / 2, (south + north) / 2
        self._orbit = OrbitController(
            self._surface_height,
            (x, y, float(surface_heights(terrain, x, y))),
            distance=_START_VIEW[0] * terrain.extent * max(_LEAST_ASPECT / aspect, 1.0),
            elevation=_START_VIEW[1],
            fov=_FOV,
        )
        self._walk: WalkController | None = None

    def set_terrain(self, terrain: TerrainSource) -> None:
        """Move over another terrain from now on; the camera stays, unless it would be below ground."""
        self._terrain = terrain
        self._near_surface = LocalHeights(terrain)
        self.restless = True

    def set_mode(self, mode: str) -> None:
        """Change between orbit, fly and walk, starting from the current camera."""
        if mode == self.mode:
            return
        camera = self.camera()
        self.mode, self._glide, self.restless = mode, None, True
        if mode == "orbit":
            self._start_orbit(camera)
            return
        self._walk = self._walk or WalkController(
            self._surface_height, camera.eye, heading=camera.heading, pitch=camera.pitch
        )
        self._walk.on_foot = mode == "walk"

    def handle(self, motion: Turn | Pan | Zoom | Fly | GoTo, *, aspect: float) -> None:
        """Apply a motion; `aspect` is the image's width over its height."""
        self.restless = True
        if isinstance(motion, Fly):
            self._motion = motion
        elif isinstance(motion, Turn):
            self._turn(motion)
        elif isinstance(motion, Pan):
            self._pan(motion)
        elif isinstance(motion, Zoom):
            self._zoom(motion, aspect)
        else:
            self._glide_to(motion)

    def set_camera(self, camera: Camera) -> None:
        self._glide, self.restless = None, True
        if self._walk is None:
            self._start_orbit(camera)
        else:
            self._walk.jump(camera.eye, heading=camera.heading, pitch=camera.pitch)

    def advance(self, elapsed: float) -> bool:
        """Advance time by `elapsed` s; return whether the camera moved."""
        if self._walk is None:
            self._move_orbit(elapsed)
            self._orbit.advance(elapsed)
        elif self._glide is not None:
            self._glide.advance(self._walk, elapsed)
            self._glide = None if self._glide.done else self._glide
        else:
            fly = self._motion
            self._walk.advance(elapsed, forward=fly.forward, right=fly.right, up=fly.up, boost=fly.boost)
        self._keep_inside()
        before, after = self._camera, self._current_camera()
        if before is not None and _nearly_equal(before, after):
            self.restless = self._motion != Fly(boost=self._motion.boost) or self._glide is not None
            return False
        self._camera = after
        return True

    def camera(self) -> Camera:
        """Return the camera as of the last `advance`."""
        if self._camera is None:
            self._camera = self._current_camera()
        return self._camera

    def pick(self, x: float, y: float, *, aspect: float) -> Vector | None:
        """Return the terrain position (m) at an image position (fractions from the upper left corner)."""
        camera = self.camera()
        along = camera.ray(2.0 * x - 1.0, 1.0 - 2.0 * y, aspect)
        return intersect_terrain(self._heights, camera.eye, along, max_distance=_RANGE * self._terrain.extent)

    def _heights(self, x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.float32]:
        return surface_heights(self._terrain, x, y)

    def _surface_height(self, x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.float64]:
        return self._near_surface(x, y)  # of the current terrain

    def _current_camera(self) -> Camera:
        far = _RANGE * self._terrain.extent
        if self._walk is None:
            return self._orbit.camera(draw_distance=far)
        return self._walk.camera(draw_distance=far, fov=_FOV)

    def _keep_inside(self) -> None:
        """Clamp a walk to the bounds of a stored world."""
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
        self._glide_by(height * (motion.right * right + motion.up * up))

    def _zoom(self, motion: Zoom, aspect: float) -> None:
        place = self.pick(motion.x, motion.y, aspect=aspect)
        if self._walk is None:
            self._orbit.zoom(motion.factor, place)
            return
        camera = self.camera()
        if place is None:
            ray = camera.ray(2.0 * motion.x - 1.0, 1.0 - 2.0 * motion.y, aspect)
            offset = 10.0 * max(self._walk.clearance, 10.0) * ray
        else:
            offset = np.subtract(place, camera.eye)
        self._glide_by((1.0 - min(motion.factor, 2.0)) * offset)

    def _glide_by(self, offset: npt.NDArray[np.float64]) -> None:
        walk = self._walk
        assert walk is not None  # noqa: S101 # an orbit pans and zooms by itself
        x, y, z = (np.asarray(walk.eye) + offset).tolist()
        self._glide = _Glide(walk, (x, y, z), walk.heading, walk.pitch, seconds=0.12)

    def _glide_to(self, motion: GoTo) -> None:
        place = (motion.x, motion.y, float(self._heights(motion.x, motion.y)))
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
        motion = self._motion
        step = _PAN_RATE * motion.boost * min(elapsed, 0.2)
        if motion.forward or motion.right:
            self._orbit.pan(step * motion.right, step * motion.forward)
        if motion.up:
            self._orbit.zoom(math.exp(_ZOOM_RATE * motion.boost * motion.up * min(elapsed, 0.2)))

    def _start_orbit(self, camera: Camera) -> None:
        """Orbit the terrain position in the image centre; if it is sky, a point in front of the camera."""
        place = intersect_terrain(
            self._heights, camera.eye, camera.forward, max_distance=_RANGE * self._terrain.extent
        )
        if place is None:
            x, y, z = (np.asarray(camera.eye) + 0.3 * self._terrain.extent * camera.forward).tolist()
            place = (x, y, z)
        distance = float(np.linalg.norm(np.subtract(place, camera.eye)))
        self._walk = None
        angles = {"heading": camera.heading, "elevation": -camera.pitch, "fov": camera.fov}
        self._orbit = OrbitController(self._surface_height, place, distance=distance, **angles)


class _Glide:
    """An eased motion of a walk to another position and direction."""

    def __init__(
        self, walk: WalkController, eye: Vector, heading: float, pitch: float, *, seconds: float
    ) -> None:
        turn = (heading - walk.heading + 180.0) % 360.0 - 180.0
        self._start = np.array([*walk.eye, walk.heading, walk.pitch])
        self._motion = np.array([*eye, walk.heading + turn, pitch]) - self._start
        self._seconds, self._spent = seconds, 0.0

    @property
    def done(self) -> bool:
        return self._spent >= self._seconds

    def advance(self, walk: WalkController, elapsed: float) -> None:
        self._spent += elapsed
        share = min(self._spent / self._seconds, 1.0)
        x, y, z, heading, pitch = (self._start + share * share * (3.0 - 2.0 * share) * self._motion).tolist()
        walk.jump((x, y, z), heading=heading, pitch=pitch)


def _nearly_equal(one: Camera, other: Camera) -> bool:
    """Return whether the motion is imperceptible: it decays and would keep the image from settling."""
    length = float(np.linalg.norm(np.subtract(other.target, other.eye)))
    moved = (
        np.abs(np.subtract(one.eye, other.eye)).max() + np.abs(np.subtract(one.target, other.target)).max()
    )
    return bool(moved < _STILLNESS * length) and one.fov == other.fov
