"""Camera motions of keys, drags and the wheel, and poses that show a selection or everything."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from PyQt6.QtCore import Qt

from sketchterrain.hydrology.lakes import lake_centre
from sketchterrain.ui.commands.placed_edits import find_lake, find_point, find_river
from sketchterrain.ui.engine.protocol import Fly, GoTo, Pan, Placement, Pose, Turn, Zoom
from sketchterrain.ui.models.workspace import Selection

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


class FlightKeys:
    """Keys held down; each method returns the new motion, None if it did not change."""

    def __init__(self) -> None:
        self._down: set[int] = set()
        self._boost = 1.0

    def press(self, key: int) -> Fly | None:
        return self._changed(self._down | {key} if key in FLYING_KEYS else self._down, self._boost)

    def release(self, key: int) -> Fly | None:
        return self._changed(self._down - {key}, self._boost)

    def set_boost(self, on: bool) -> Fly | None:
        return self._changed(self._down, _BOOST if on else 1.0)

    def release_all(self) -> Fly | None:
        """Release all keys, as when the view loses the focus."""
        return self._changed(set(), 1.0)

    def _changed(self, down: set[int], boost: float) -> Fly | None:
        before = self._motion()
        self._down, self._boost = down, boost
        after = self._motion()
        return after if after != before else None

    def _motion(self) -> Fly:
        axes = {"forward": 0.0, "right": 0.0, "up": 0.0}
        for key in self._down:
            axis, sign = FLYING_KEYS[Qt.Key(key)]
            axes[axis] = min(max(axes[axis] + sign, -1.0), 1.0)
        # Shift alone is no motion.
        return Fly(**axes, boost=self._boost if any(axes.values()) else 1.0)


_DISTANCE = 1.6  # of the diameter of what is shown
_MIN_DISTANCE = 40.0  # m
_FOV = 50.0  # degrees, the engine's default
_ELEVATION = 26.0  # degrees: the horizon is just visible
_FILLED = 0.94  # of the picture, by the sketch's corners


def overview(bounds: tuple[float, float, float, float], height: float, *, aspect: float) -> Pose:
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
    return Pose((x, y - distance * math.cos(rise), height + distance * math.sin(rise)), (x, y, height), _FOV)


def motion_to(
    placed: Placement | None, selection: Selection | None, *, size: tuple[float, float]
) -> GoTo | None:
    """Return the motion that shows the selection; None without one or if it no longer exists."""
    if placed is None or selection is None:
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
        inside = ((line >= 0.0) & (line <= np.array(size))).all(axis=1)
        line = line[inside] if inside.any() else line
        x, y = (0.5 * (line.min(axis=0) + line.max(axis=0))).tolist()
        return _go_to(x, y, float(np.ptp(line, axis=0).max()))
    if lake is not None:
        x, y = lake_centre(lake).tolist()
        return _go_to(x, y, lake.shape.spacing * max(lake.shape.inside.shape))
    return None


def _go_to(x: float, y: float, diameter: float) -> GoTo:
    return GoTo(x, y, max(_DISTANCE * diameter, _MIN_DISTANCE))
