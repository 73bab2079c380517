"""The camera of a picture, terrain heights below its overlays, and the scale bar."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sketchterrain.ui.engine.protocol import FrameFacts, Pose, Relief

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

_NEAREST = 1e-3  # least clip-space w (m before the eye) of visible points
_FLATTEST = 0.02  # least slope of a ray that is intersected with a level plane
_RAY_SAMPLES = 48
_RAY_RANGE = (0.02, 0.98)  # tested fractions of a ray
_RAY_SLACK = 1.5  # samples of the coarse relief that a ray may cut into the terrain


@dataclass(frozen=True, eq=False)
class ProjectedPoints:
    """Points projected into a widget."""

    pixels: Floats  # (n, 2), from the upper left corner; undefined behind the eye
    depth: Floats  # m before the eye; 0 or less behind it

    @property
    def in_front(self) -> Flags:
        """Which points lie before the eye."""
        return np.asarray(self.depth > _NEAREST)


class Projection:
    """A picture's camera in a rectangle (left, top, width, height; px) of a widget."""

    def __init__(self, frame: FrameFacts, rectangle: tuple[float, float, float, float]) -> None:
        self.eye: Floats = np.array(frame.pose.eye, np.float64)
        self.rectangle = rectangle
        self._clip: Floats = np.array(frame.to_clip, np.float64).reshape(4, 4)
        self._inverse = np.asarray(np.linalg.inv(self._clip), np.float64)

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

    def ray(self, x: float, y: float) -> Floats:
        """Return the unit vector of a pixel's ray."""
        left, top, width, height = self.rectangle
        across, up = 2.0 * (x - left) / width - 1.0, 1.0 - 2.0 * (y - top) / height
        near, far = (self._inverse @ [across, up, depth, 1.0] for depth in (-1.0, 1.0))
        along = far[:3] / far[3] - near[:3] / near[3]
        return np.asarray(along / np.linalg.norm(along))

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

    def visible_runs(self, points: npt.ArrayLike) -> list[tuple[int, Floats]]:
        """Return parts of a line (n, 3) before the eye: first index and pixels (m, 2), clipped at the eye."""
        line = np.asarray(points, np.float64)
        projected = self.project(line)
        inside = projected.in_front
        if inside.all():
            return [(0, projected.pixels)] if len(line) > 1 else []
        runs = []
        turns = np.flatnonzero(np.diff(inside)) + 1
        for first, end in zip([0, *turns], [*turns, len(line)], strict=True):
            if not inside[first]:
                continue
            parts = [projected.pixels[first:end]]
            if first > 0:
                parts.insert(0, self._clip_end(line, projected.depth, int(first), int(first) - 1))
            if end < len(line):
                parts.append(self._clip_end(line, projected.depth, int(end) - 1, int(end)))
            pixels = np.concatenate(parts)
            if len(pixels) > 1:
                runs.append((int(first), pixels))
        return runs

    def _clip_end(self, line: Floats, depth: Floats, visible: int, hidden: int) -> Floats:
        """Return where a segment passes just before the eye, px (1, 2)."""
        near = 1e-3 * float(depth[visible]) + 2.0 * _NEAREST
        share = (depth[visible] - near) / (depth[visible] - depth[hidden])
        end = line[visible] + max(share, 0.0) * (line[hidden] - line[visible])
        return self.project(end[None]).pixels


class TerrainHeights:
    """Bilinear heights of the sketch's relief; `spacing` is that of its samples, m."""

    def __init__(self, relief: Relief, spacing: float) -> None:
        self._height = relief.height
        self.spacing = spacing
        rows, columns = relief.height.shape
        self._size = columns * spacing, rows * spacing

    def height(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Floats:
        """Return heights at places (m), clamped to the sketch's edge."""
        rows, columns = self._height.shape
        column = np.clip(np.asarray(x, np.float64) / self.spacing - 0.5, 0.0, columns - 1.0)
        row = np.clip(rows - np.asarray(y, np.float64) / self.spacing - 0.5, 0.0, rows - 1.0)
        left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
        right, below = np.minimum(left + 1, columns - 1), np.minimum(top + 1, rows - 1)
        across, down = column - left, row - top
        upper = (1.0 - across) * self._height[top, left] + across * self._height[top, right]
        lower = (1.0 - across) * self._height[below, left] + across * self._height[below, right]
        return np.asarray((1.0 - down) * upper + down * lower)

    def contains(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Flags:
        """Return which places (m) lie in the sketch."""
        east, north = np.asarray(x), np.asarray(y)
        return np.asarray((east >= 0.0) & (east <= self._size[0]) & (north >= 0.0) & (north <= self._size[1]))

    def drape(self, places: npt.ArrayLike) -> Floats:
        """Return places (n, 2) with their heights, (n, 3)."""
        plane = np.asarray(places, np.float64)
        return np.column_stack([plane, self.height(plane[:, 0], plane[:, 1])])

    def occludes(self, eye: npt.ArrayLike, points: npt.ArrayLike) -> Flags:
        """Return which points (n, 3) are hidden from an eye by the terrain (m)."""
        start, ends = np.asarray(eye, np.float64), np.asarray(points, np.float64)
        share = np.linspace(*_RAY_RANGE, _RAY_SAMPLES)[:, None]
        x, y, z = (start[axis] + share * (ends[:, axis] - start[axis]) for axis in range(3))
        # Towards its end a ray comes as near to the terrain as the point, which lies on it.
        slack = _RAY_SLACK * self.spacing * (0.5 + share)
        return np.asarray(((self.height(x, y) > z + slack) & self.contains(x, y)).any(axis=0))


def circle(x: float, y: float, radius: float, *, count: int = 96) -> Floats:
    """Return a closed circle of places (count + 1, 2) around a place (m)."""
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def round_length(metres: float) -> float:
    """Return the greatest round length, 1, 2 or 5 times a power of ten, that is no longer."""
    power = 10.0 ** math.floor(math.log10(metres))
    return next(step for step in (5.0 * power, 2.0 * power, power) if step <= metres * (1.0 + 1e-9))


def length_text(metres: float) -> str:
    """Return a length in words: ``350 m``, ``2.4 km``."""
    if abs(metres) < 999.5:
        return f"{metres:.0f} m" if abs(metres) >= 9.95 else f"{metres:.1f} m"
    kilometres = metres / 1000.0
    return f"{kilometres:.1f} km" if abs(kilometres) < 99.95 else f"{kilometres:.0f} km"


def eye_height_text(pose: Pose, terrain: TerrainHeights | None) -> str:
    """Return the eye's elevation, and its height above the terrain where that is known."""
    x, y, z = pose.eye
    text = f"eye at {length_text(z)}"
    if terrain is None or not bool(terrain.contains(x, y)):
        return text
    return f"{text} · {length_text(max(z - float(terrain.height(x, y)), 0.0))} above the ground"


def scale_bar(projection: Projection, pose: Pose, *, most: float) -> tuple[float, float] | None:
    """Return a round length (m) and its width (px, at most `most`) at the centre; None if unknown."""
    per_px = projection.metres_per_px([pose.target])
    if per_px <= 0.0:
        return None
    length = round_length(per_px * most)
    return length, length / per_px
