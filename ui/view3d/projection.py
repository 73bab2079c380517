"""The camera of a picture, the ground below its overlays, and the scale read off them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.ui.engine.protocol import FrameFacts, Pose, Relief

_NEAREST = 1e-3  # of the clip space's w (m before the eye) that counts as seen
_FLATTEST = 0.02  # slope of a line of sight below which it meets no level plane


@dataclass(frozen=True, eq=False)
class Seen:
    """Places as they are seen."""

    at: Float64Array  # px from the widget's upper left corner; undefined behind the camera
    away: Float64Array  # m before the eye; what is not before it has 0 or less

    @property
    def before(self) -> npt.NDArray[np.bool_]:
        """Which ones lie before the eye."""
        return np.asarray(self.away > _NEAREST)


class Projection:
    """A picture's camera, for the place where the picture is shown."""

    def __init__(self, frame: FrameFacts, place: tuple[float, float, float, float]) -> None:
        self.eye: Float64Array = np.array(frame.pose.eye, np.float64)
        self.place = place
        self._clip: Float64Array = np.array(frame.to_clip, np.float64).reshape(4, 4)
        self._back = np.asarray(np.linalg.inv(self._clip), np.float64)

    def see(self, places: npt.ArrayLike) -> Seen:
        """Return where places (n, 3) in m are seen."""
        off = np.atleast_2d(np.asarray(places, np.float64)) - self.eye
        clip = off @ self._clip[:, :3].T + self._clip[:, 3]
        away = clip[:, 3]
        safe = np.where(np.abs(away) > _NEAREST, away, _NEAREST)
        left, top, width, height = self.place
        at = np.stack(
            [
                left + 0.5 * width * (1.0 + clip[:, 0] / safe),
                top + 0.5 * height * (1.0 - clip[:, 1] / safe),
            ],
            axis=-1,
        )
        return Seen(at, np.asarray(away))

    def ray(self, x: float, y: float) -> Float64Array:
        """Return the unit vector along which a place (px of the widget) is seen."""
        left, top, width, height = self.place
        across, up = 2.0 * (x - left) / width - 1.0, 1.0 - 2.0 * (y - top) / height
        near, far = (self._back @ [across, up, depth, 1.0] for depth in (-1.0, 1.0))
        along = far[:3] / far[3] - near[:3] / near[3]
        return np.asarray(along / np.linalg.norm(along))

    def on_level(self, x: float, y: float, z: float) -> tuple[float, float] | None:
        """Return where (m) the ray of a pixel meets the plane at height z (m); None if nowhere or far off."""
        along = self.ray(x, y)
        rise = z - float(self.eye[2])
        if abs(along[2]) < _FLATTEST or rise * along[2] <= 0.0:
            return None
        east, north = self.eye[:2] + along[:2] * (rise / along[2])
        return float(east), float(north)

    def share(self, x: float, y: float) -> tuple[float, float]:
        """Return a place of the widget (px) as shares of the picture from its upper left corner."""
        left, top, width, height = self.place
        return (x - left) / width, (y - top) / height

    def metres_per_px(self, place: npt.ArrayLike) -> float:
        """Return how many metres across a px of the widget is at a place (m); 0 behind the eye."""
        seen = self.see(place)
        _, _, _, height = self.place
        # The second row of the matrix is the upward axis over tan(fov / 2).
        scale = float(np.linalg.norm(self._clip[1, :3]))
        return max(2.0 * float(seen.away[0]) / (scale * height), 0.0)

    def runs(self, places: npt.ArrayLike) -> list[tuple[int, Float64Array]]:
        """Return the parts of a line (n, 3) that lie before the eye, as px (m, 2), cut where they pass it."""
        line = np.asarray(places, np.float64)
        seen = self.see(line)
        inside = seen.before
        if inside.all():
            return [(0, seen.at)] if len(line) > 1 else []
        found = []
        turns = np.flatnonzero(np.diff(inside)) + 1
        for first, end in zip([0, *turns], [*turns, len(line)], strict=True):
            if not inside[first]:
                continue
            part = [seen.at[first:end]]
            if first > 0:
                part.insert(0, self._cut(line, seen.away, int(first), int(first) - 1))
            if end < len(line):
                part.append(self._cut(line, seen.away, int(end) - 1, int(end)))
            together = np.concatenate(part)
            if len(together) > 1:
                found.append((int(first), together))
        return found

    def _cut(self, line: Float64Array, away: Float64Array, seen: int, unseen: int) -> Float64Array:
        """Return where a piece of a line passes just before the eye, (1, 2)."""
        near = 1e-3 * float(away[seen]) + 2.0 * _NEAREST
        share = (away[seen] - near) / (away[seen] - away[unseen])
        return self.see((line[seen] + max(share, 0.0) * (line[unseen] - line[seen]))[None]).at


_STEPS = 48  # along a line of sight
_CLEAR = (0.02, 0.98)  # shares of a line of sight that are looked at
_SLACK = 1.5  # samples of the relief: a line of sight may cut so deep into the ground, for it is coarse


class Ground:
    """Heights of the terrain at any place of the sketch."""

    def __init__(self, relief: Relief, spacing: float) -> None:
        self._height = relief.height
        self.spacing = spacing
        rows, columns = relief.height.shape
        self._size = columns * spacing, rows * spacing

    def height(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Float64Array:
        """Return heights (m) at places (m), those outside the sketch as at its edge."""
        rows, columns = self._height.shape
        column = np.clip(np.asarray(x, np.float64) / self.spacing - 0.5, 0.0, columns - 1.0)
        row = np.clip(rows - np.asarray(y, np.float64) / self.spacing - 0.5, 0.0, rows - 1.0)
        left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
        right, below = np.minimum(left + 1, columns - 1), np.minimum(top + 1, rows - 1)
        across, down = column - left, row - top
        upper = (1.0 - across) * self._height[top, left] + across * self._height[top, right]
        lower = (1.0 - across) * self._height[below, left] + across * self._height[below, right]
        return np.asarray((1.0 - down) * upper + down * lower)

    def covers(self, x: npt.ArrayLike, y: npt.ArrayLike) -> BoolArray:
        """Return which places (m) lie in the sketch."""
        east, north = np.asarray(x), np.asarray(y)
        return np.asarray((east >= 0.0) & (east <= self._size[0]) & (north >= 0.0) & (north <= self._size[1]))

    def on(self, places: npt.ArrayLike, *, lift: float = 0.0) -> Float64Array:
        """Return places (n, 2) with their heights, (n, 3), `lift` m above the ground."""
        at = np.asarray(places, np.float64)
        return np.column_stack([at, self.height(at[:, 0], at[:, 1]) + lift])

    def hides(self, eye: npt.ArrayLike, places: npt.ArrayLike) -> BoolArray:
        """Return which places (n, 3) in m are hidden from an eye (m) by ground of the sketch."""
        start, ends = np.asarray(eye, np.float64), np.asarray(places, np.float64)
        share = np.linspace(*_CLEAR, _STEPS)[:, None]
        x = start[0] + share * (ends[:, 0] - start[0])
        y = start[1] + share * (ends[:, 1] - start[1])
        z = start[2] + share * (ends[:, 2] - start[2])
        # Near its end a line of sight is as near the ground as the place is, which itself lies on it.
        slack = _SLACK * self.spacing * (0.5 + share)
        return np.asarray(((self.height(x, y) > z + slack) & self.covers(x, y)).any(axis=0))


def ring(x: float, y: float, radius: float, *, count: int = 96) -> Float64Array:
    """Return a closed ring of places (count + 1, 2) around a place (m)."""
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def round_length(metres: float) -> float:
    """Return the greatest of 1, 2, 5, 10, 20, 50 … m, or of 1, 0.5, 0.2 … m, that is no longer."""
    power = 10.0 ** math.floor(math.log10(metres))
    return next(step for step in (5.0 * power, 2.0 * power, power) if step <= metres * (1.0 + 1e-9))


def length_text(metres: float) -> str:
    """Return a length for a person: ``350 m``, ``2.4 km``."""
    if abs(metres) < 999.5:
        return f"{metres:.0f} m" if abs(metres) >= 9.95 else f"{metres:.1f} m"
    kilometres = metres / 1000.0
    return f"{kilometres:.1f} km" if abs(kilometres) < 99.95 else f"{kilometres:.0f} km"


def standing_text(pose: Pose, ground: Ground | None) -> str:
    """Return how high the eye is, and over the ground where that is known."""
    x, y, z = pose.eye
    if ground is None or not bool(ground.covers(x, y)):
        return f"eye at {length_text(z)}"
    return (
        f"eye at {length_text(z)} · {length_text(max(z - float(ground.height(x, y)), 0.0))} over the ground"
    )


def scale_bar(projection: Projection, pose: Pose, *, most: float) -> tuple[float, float] | None:
    """Return a round length (m) and how many px wide it is across the picture's middle; None if unknown."""
    per_px = projection.metres_per_px([pose.target])
    if per_px <= 0.0:
        return None
    length = round_length(per_px * most)
    return length, length / per_px
