"""Camera of the 3-D view: projection, terrain heights, motions and poses."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from PyQt6.QtCore import Qt
from scipy.ndimage import map_coordinates

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.geometry.camera import Camera
from sketchterrain.landforms.placement.feature_types import lake_centre
from sketchterrain.ui.canvas.decorations import nice_length
from sketchterrain.ui.commands import find_lake, find_point, find_river
from sketchterrain.ui.engine.protocol import Fly, FrameFacts, GoTo, Pan, Placement, Relief, Turn, Zoom
from sketchterrain.ui.models.workspace import Selection

_NEAREST = 1e-3  # least clip-space w (m before the eye) of visible points
_FLATTEST = 0.02  # least slope of a ray that is intersected with a level plane
_RAY_SAMPLES = 48
_RAY_RANGE = (0.02, 0.98)  # tested fractions of a ray
_RAY_SLACK = 1.5  # samples of the coarse relief that a ray may cut into the terrain


@dataclass(frozen=True, eq=False)
class ProjectedPoints:
    """Points projected into a widget."""

    pixels: Float64Array  # (n, 2), from the upper left corner; undefined behind the eye
    depth: Float64Array  # m before the eye; 0 or less behind it

    @property
    def in_front(self) -> BoolArray:
        """Which points lie before the eye."""
        return np.asarray(self.depth > _NEAREST)


class Projection:
    """A picture's camera in a rectangle (left, top, width, height; px) of a widget."""

    def __init__(self, frame: FrameFacts, rectangle: tuple[float, float, float, float]) -> None:
        self.eye: Float64Array = np.array(frame.pose.eye, np.float64)
        self.rectangle = rectangle
        self._pose, self._aspect = frame.pose, frame.width / frame.height
        self._clip: Float64Array = frame.pose.to_clip(self._aspect)

    def project(self, points: npt.ArrayLike) -> ProjectedPoints:
        """Project points (n, 3) in m."""
        relative = np.atleast_2d(np.asarray(points, np.float64)) - self.eye
        clip = relative @ self._clip[:, :3].T + self._clip[:, 3]
        depth = clip[:, 3]
        divisor = np.where(np.abs(depth) > _NEAREST, depth, _NEAREST)
        left, top, width, height = self.rectangle
        x = left + 0.5 * width * (1.0 + clip[:, 0] / divisor)
        y = top + 0.5 * height * (1.0 - clip[:, 1] / divisor)
        return ProjectedPoints(np.stack([x, y], axis=-1), np.asarray(depth))

    def ray(self, x: float, y: float) -> Float64Array:
        """Return the unit vector of a pixel's ray."""
        left, top, width, height = self.rectangle
        across, up = 2.0 * (x - left) / width - 1.0, 1.0 - 2.0 * (y - top) / height
        return self._pose.ray(across, up, self._aspect)

    def intersect_level(self, x: float, y: float, z: float) -> tuple[float, float] | None:
        """Return where (m) a pixel's ray meets the plane at height z (m); None if nowhere or too far."""
        along = self.ray(x, y)
        rise = z - float(self.eye[2])
        if abs(along[2]) < _FLATTEST or rise * along[2] <= 0.0:
            return None
        east, north = self.eye[:2] + along[:2] * (rise / along[2])
        return float(east), float(north)

    def picture_fraction(self, x: float, y: float) -> tuple[float, float]:
        """Return a pixel's position as fractions of the picture from its upper left corner."""
        left, top, width, height = self.rectangle
        return (x - left) / width, (y - top) / height

    def metres_per_px(self, point: npt.ArrayLike) -> float:
        """Return the width of a pixel at a point, m; 0 behind the eye."""
        # The second row of the matrix is the upward axis over tan(fov / 2).
        scale = float(np.linalg.norm(self._clip[1, :3]))
        return max(2.0 * float(self.project(point).depth[0]) / (scale * self.rectangle[3]), 0.0)

    def project_segments(self, starts: npt.ArrayLike, ends: npt.ArrayLike) -> tuple[Float64Array, BoolArray]:
        """Return segments (n, 3) as pixels (m, 4), clipped before the eye, and which of the n they are."""
        first, second = np.array(starts, np.float64), np.array(ends, np.float64)
        depths = self.project(first).depth, self.project(second).depth
        visible = np.maximum(*depths) > 2.0 * _NEAREST
        for near, far, near_depth, far_depth in ((first, second, *depths), (second, first, *depths[::-1])):
            crosses = visible & (far_depth <= _NEAREST)
            limit = 1e-3 * near_depth[crosses] + _NEAREST
            share = (near_depth[crosses] - limit) / (near_depth[crosses] - far_depth[crosses])
            far[crosses] = near[crosses] + share[:, None] * (far[crosses] - near[crosses])
        pixels = [self.project(each[visible]).pixels for each in (first, second)]
        return np.concatenate(pixels, axis=1), np.asarray(visible)


class TerrainHeights:
    """Bilinear heights of the sketch's relief; `spacing` is that of its samples, m."""

    def __init__(self, relief: Relief, spacing: float) -> None:
        self._height = relief.height
        self.spacing = spacing
        rows, columns = relief.height.shape
        self._size = columns * spacing, rows * spacing

    def height(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Float64Array:
        """Return heights at places (m), clamped to the sketch's edge."""
        column, row = (
            np.asarray(x) / self.spacing - 0.5,
            len(self._height) - np.asarray(y) / self.spacing - 0.5,
        )
        places = np.stack([row, column]).reshape(2, -1)
        heights = map_coordinates(self._height, places, np.float64, order=1, mode="nearest")
        return np.asarray(heights).reshape(row.shape)

    def contains(self, x: npt.ArrayLike, y: npt.ArrayLike) -> BoolArray:
        """Return which places (m) lie in the sketch."""
        east, north = np.asarray(x), np.asarray(y)
        return np.asarray((east >= 0.0) & (east <= self._size[0]) & (north >= 0.0) & (north <= self._size[1]))

    def drape(self, places: npt.ArrayLike) -> Float64Array:
        """Return places (n, 2) with their heights, (n, 3)."""
        plane = np.asarray(places, np.float64)
        return np.column_stack([plane, self.height(plane[:, 0], plane[:, 1])])

    def occludes(self, eye: npt.ArrayLike, points: npt.ArrayLike) -> BoolArray:
        """Return which points (n, 3) are hidden from an eye by the terrain (m)."""
        start, ends = np.asarray(eye, np.float64), np.asarray(points, np.float64)
        share = np.linspace(*_RAY_RANGE, _RAY_SAMPLES)[:, None]
        x, y, z = (start[axis] + share * (ends[:, axis] - start[axis]) for axis in range(3))
        # Towards its end a ray comes as near to the terrain as the point, which lies on it.
        slack = _RAY_SLACK * self.spacing * (0.5 + share)
        return np.asarray(((self.height(x, y) > z + slack) & self.contains(x, y)).any(axis=0))


def circle(x: float, y: float, radius: float, *, count: int = 96) -> Float64Array:
    """Return a closed circle of places (count + 1, 2) around a place (m)."""
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def length_text(metres: float) -> str:
    """Return a length in words: ``350 m``, ``2.4 km``."""
    if abs(metres) < 999.5:
        return f"{metres:.0f} m" if abs(metres) >= 9.95 else f"{metres:.1f} m"
    kilometres = metres / 1000.0
    return f"{kilometres:.1f} km" if abs(kilometres) < 99.95 else f"{kilometres:.0f} km"


def eye_height_text(pose: Camera, terrain: TerrainHeights | None) -> str:
    """Return the eye's elevation, and its height above the terrain where that is known."""
    x, y, z = pose.eye
    text = f"eye at {length_text(z)}"
    if terrain is None or not bool(terrain.contains(x, y)):
        return text
    return f"{text} · {length_text(max(z - float(terrain.height(x, y)), 0.0))} above the ground"


def scale_bar(projection: Projection, pose: Camera, *, most: float) -> tuple[float, float] | None:
    """Return a round length (m) and its width (px, at most `most`) at the centre; None if unknown."""
    per_px = projection.metres_per_px([pose.target])
    if per_px <= 0.0:
        return None
    length = nice_length(per_px * most)
    return length, length / per_px


_ORBIT = 0.3  # degrees a px
_LOOK = 0.15  # degrees a px
_NOTCH = 0.85  # factor of the distance a notch of the wheel
_BOOST = 4.0
_ZOOM_RANGE = 0.2, 5.0  # factors of one event

_Key = Qt.Key
FLYING_KEYS: Final = {
    _Key.Key_W: ("forward", 1.0),
    _Key.Key_Up: ("forward", 1.0),
    _Key.Key_S: ("forward", -1.0),
    _Key.Key_Down: ("forward", -1.0),
    _Key.Key_D: ("right", 1.0),
    _Key.Key_Right: ("right", 1.0),
    _Key.Key_A: ("right", -1.0),
    _Key.Key_Left: ("right", -1.0),
    _Key.Key_E: ("up", 1.0),
    _Key.Key_PageUp: ("up", 1.0),
    _Key.Key_Q: ("up", -1.0),
    _Key.Key_PageDown: ("up", -1.0),
}


def drag_motion(mode: str, right: float, down: float, *, height: float, pans: bool) -> Turn | Pan:
    """Return the motion of a drag (px): in orbit the terrain follows the mouse, else the view direction."""
    if pans:
        return Pan(-right / height, down / height)
    if mode == "orbit":
        return Turn(-right * _ORBIT, down * _ORBIT)
    return Turn(right * _LOOK, -down * _LOOK)


def zoom_motion(notches: float, x: float, y: float) -> Zoom:
    """Return the motion of a wheel at a place of the picture (fractions)."""
    least, most = _ZOOM_RANGE
    return Zoom(min(max(_NOTCH**notches, least), most), x, y)


def flight(keys: Collection[int]) -> Fly:
    """Return the motion of keys that are held down; Shift makes it faster."""
    axes = {"forward": 0.0, "right": 0.0, "up": 0.0}
    for key in FLYING_KEYS.keys() & set(keys):
        axis, sign = FLYING_KEYS[key]
        axes[axis] = min(max(axes[axis] + sign, -1.0), 1.0)
    # Shift alone is no motion.
    return Fly(**axes, boost=_BOOST if _Key.Key_Shift in keys and any(axes.values()) else 1.0)


_DISTANCE = 1.6  # of the diameter of what is shown
_MIN_DISTANCE = 40.0  # m
_FOV = 50.0  # degrees, the engine's default
_ELEVATION = 26.0  # degrees: the horizon is just visible
_FILLED = 0.94  # of the picture, by the sketch's corners


def overview(bounds: tuple[float, float, float, float], height: float, *, aspect: float) -> Camera:
    """Return the pose that shows a rectangle (west, south, east, north; m) at a height from the south."""
    x, y = 0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])
    east, north = x - bounds[0], y - bounds[1]
    rise = math.radians(_ELEVATION)
    upright = _FILLED * math.tan(math.radians(_FOV) / 2.0)
    # The near corners are the widest, and all four must lie inside.
    distance = max(
        max(east / (upright * aspect), abs(corner) * math.sin(rise) / upright) - corner * math.cos(rise)
        for corner in (-north, north)
    )
    eye = x, y - distance * math.cos(rise), height + distance * math.sin(rise)
    return Camera(eye, (x, y, height), _FOV)


def motion_to(
    placed: Placement,
    selection: Selection | None,
    lines: Sequence[Float64Array],
    *,
    size: tuple[float, float],
) -> GoTo | None:
    """Return the motion that shows the selection or its lines; None without one or if it no longer exists."""
    if lines:
        return show_line(np.concatenate(lines), size)
    if selection is None:
        return None
    find = (placed, selection)
    point, river, lake = find_point(*find), find_river(*find), find_lake(*find)
    if point is not None:
        return _go_to(float(point["x"]), float(point["y"]), 2.0 * float(point["radius"]))
    if river is not None:
        line = river.points[:, :2]
        if selection.index is not None and selection.index < len(line):
            x, y = line[selection.index].tolist()
            return _go_to(x, y, 8.0 * float(river.width[selection.index]))
        return show_line(line, size)
    if lake is not None:
        x, y = lake_centre(lake).tolist()
        return _go_to(x, y, lake.shape.spacing * max(lake.shape.inside.shape))
    return None


def show_line(line: Float64Array, size: tuple[float, float]) -> GoTo:
    """Return the motion that shows a line (n, 2), or its part in the sketch if there is one."""
    inside = ((line >= 0.0) & (line <= np.array(size))).all(axis=1)
    line = line[inside] if inside.any() else line
    x, y = (0.5 * (line.min(axis=0) + line.max(axis=0))).tolist()
    return _go_to(x, y, float(np.ptp(line, axis=0).max()))


def _go_to(x: float, y: float, diameter: float) -> GoTo:
    return GoTo(x, y, max(_DISTANCE * diameter, _MIN_DISTANCE))
