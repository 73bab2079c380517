"""Cameras and their draw distance."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError

Floats: TypeAlias = npt.NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]
HeightFunction: TypeAlias = Callable[[npt.ArrayLike, npt.ArrayLike], npt.NDArray[Any]]
"""Terrain heights (m) at x, y (m), which broadcast together."""

_NEAR = (0.1, 100.0)  # m
# Of the clearance: a cliff of 75° beside the eye is 0.26 of it away, 0.18 at a picture's corners.
_NEAR_SHARE = 0.16


def direction(heading: float, pitch: float) -> Floats:
    """Return the unit vector along a compass bearing and an elevation, both in degrees."""
    bearing, rise = np.radians([heading, pitch])
    return np.array([np.sin(bearing) * np.cos(rise), np.cos(bearing) * np.cos(rise), np.sin(rise)])


def clip_planes(clearance: float, draw_distance: float) -> tuple[float, float]:
    """Return near and far distance (m) for an eye `clearance` m above the terrain: nothing is cut off."""
    near = float(np.clip(_NEAR_SHARE * clearance, *_NEAR))
    return near, max(1.1 * draw_distance, 2.0 * near)


@dataclass(frozen=True)
class Camera:
    """Camera at `eye` looking at `target` (m), with a vertical field of view (degrees) and clip planes (m).

    Everything is float64; only positions relative to the eye are passed to the GPU, as float32.
    """

    eye: Vector
    target: Vector
    fov: float = 38.0
    near: float = 1.0
    far: float = 60_000.0

    def __post_init__(self) -> None:
        if not np.isfinite([*self.eye, *self.target]).all() or self.eye == self.target:
            raise InputError(
                f"expected a finite eye and another finite target, got {self.eye} and {self.target}"
            )
        if not 0 < self.fov < 170 or not 0 < self.near < self.far:
            raise InputError(
                "expected a field of view in (0, 170)° and 0 < near < far, "
                f"got {self.fov:g}°, {self.near:g} m and {self.far:g} m"
            )

    @property
    def forward(self) -> Floats:
        """Unit vector from the eye to the target."""
        along = np.subtract(self.target, self.eye)
        return np.asarray(along / np.linalg.norm(along))

    @property
    def heading(self) -> float:
        """Compass bearing of the view, degrees clockwise from north."""
        east, north, _ = self.forward
        return float(np.degrees(np.arctan2(east, north)) % 360.0)

    @property
    def pitch(self) -> float:
        """Elevation of the view above the horizon, degrees."""
        return float(np.degrees(np.arcsin(np.clip(self.forward[2], -1.0, 1.0))))

    def ray(self, x: float, y: float, aspect: float) -> Floats:
        """Return the unit vector through a picture position; x and y are −1 … 1 to the right and up."""
        half = np.tan(np.radians(self.fov) / 2.0)
        along = self.view()[:3, :3].T @ np.array([x * half * aspect, y * half, -1.0])
        return np.asarray(along / np.linalg.norm(along))

    def view(self) -> Floats:
        """Return the (4, 4) rotation from positions relative to the eye to camera axes (right, up, back)."""
        back = -self.forward
        up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 0.9999 else np.array([0.0, 1.0, 0.0])
        right = np.cross(up, back)
        right /= np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3, :3] = right, np.cross(back, right), back
        return matrix

    def projection(self, aspect: float) -> Floats:
        """Return the (4, 4) OpenGL projection matrix for a picture of this width over height."""
        scale = 1.0 / np.tan(np.radians(self.fov) / 2.0)
        depth = self.far - self.near
        return np.array(
            [
                [scale / aspect, 0.0, 0.0, 0.0],
                [0.0, scale, 0.0, 0.0],
                [0.0, 0.0, -(self.far + self.near) / depth, -2.0 * self.far * self.near / depth],
                [0.0, 0.0, -1.0, 0.0],
            ]
        )

    def to_clip(self, aspect: float) -> Floats:
        """Return the (4, 4) matrix from positions relative to the eye to clip space."""
        return self.projection(aspect) @ self.view()

    def frustum(self, aspect: float) -> Floats:
        """Return the six view planes (6, 4): a·x + b·y + c·z + d ≥ 0 inside, unit normals; read-only.

        Order: left, right, bottom, top, near, far.
        """
        return _frustum(self, aspect)


class ClippedView(NamedTuple):
    """A camera with clipping planes for its height above the terrain."""

    camera: Camera
    draw_distance: float  # m
    above: float  # m, that height


@lru_cache(maxsize=8)
def _frustum(camera: Camera, aspect: float) -> Floats:
    """Compute `Camera.frustum`, cached since many objects of a frame are culled by it."""
    rows = camera.to_clip(aspect)
    planes = np.concatenate([rows[3] + rows[:3], rows[3] - rows[:3]])[[0, 3, 1, 4, 2, 5]]
    planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    planes[:, 3] -= planes[:, :3] @ np.asarray(camera.eye)
    planes.flags.writeable = False
    return planes


CLIMB: Final = 8.0  # increase of the draw distance (m) per metre of height above the terrain
FARTHEST: Final = 16.0  # largest draw distance, in extents: the width of the coarsest tiles


def draw_distance(clearance: float, *, extent: float, extents: float) -> float:
    """Return the draw distance (m) for an eye `clearance` m above the terrain: `extents` at the terrain."""
    return min(extents * extent + CLIMB * clearance, FARTHEST * extent)
