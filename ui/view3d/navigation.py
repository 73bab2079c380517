"""Camera motions from keys, drags and the wheel, and the poses that show a selection or everything."""

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
_LOOK = 0.15
_NOTCH = 0.85  # of the distance that is left after a notch of the wheel
_BOOST = 4.0
_LEAST, _MOST = 0.2, 5.0  # factors of one event

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
"""Which way a key moves the eye."""


def dragged(mode: str, right: float, down: float, *, height: float, pans: bool) -> Turn | Pan:
    """Return the motion of a drag.

    Around a point the ground follows the mouse; in a flight and on foot the look does.
    """
    if pans:
        return Pan(-right / height, down / height)
    if mode == "orbit":
        return Turn(-right * _ORBIT, down * _ORBIT)
    return Turn(right * _LOOK, -down * _LOOK)


def zoomed(notches: float, x: float, y: float) -> Zoom:
    """Return the motion of a wheel; `x` and `y` are the mouse's place in the picture, in shares."""
    return Zoom(min(max(_NOTCH**notches, _LEAST), _MOST), x, y)


class Keys:
    """The keys that are held down."""

    def __init__(self) -> None:
        self._down: set[int] = set()
        self._boost = 1.0

    def press(self, key: int) -> Fly | None:
        """Hold a key; return the motion from now on, None if it changes nothing."""
        return self._changed(self._down | {key} if key in FLYING_KEYS else self._down, self._boost)

    def release(self, key: int) -> Fly | None:
        """Let a key go."""
        return self._changed(self._down - {key}, self._boost)

    def hurry(self, *, quick: bool) -> Fly | None:
        """Go faster, or not any more."""
        return self._changed(self._down, _BOOST if quick else 1.0)

    def let_go(self) -> Fly | None:
        """Let all keys go, as when the window is left."""
        return self._changed(set(), 1.0)

    def _changed(self, down: set[int], boost: float) -> Fly | None:
        before = self._motion()
        self._down, self._boost = down, boost
        after = self._motion()
        return after if after != before else None

    def _motion(self) -> Fly:
        ways = {"forward": 0.0, "right": 0.0, "up": 0.0}
        for key in self._down:
            way, sign = FLYING_KEYS[Qt.Key(key)]
            ways[way] = min(max(ways[way] + sign, -1.0), 1.0)
        # Faster than nothing is nothing: no message while one only holds Shift.
        return Fly(**ways, boost=self._boost if any(ways.values()) else 1.0)


_DISTANCE = 1.6  # of its diameter
_NEAREST = 40.0  # m
_FOV = 50.0  # degrees, as the engine's
_ELEVATION = 26.0  # degrees: just below a horizon that is seen
_FILLED = 0.94  # of the picture, by the sketch's corners


def overview(bounds: tuple[float, float, float, float], height: float, *, aspect: float) -> Pose:
    """Return the pose that shows a rectangle (west, south, east, north; m) at a height from the south."""
    x, y = 0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])
    east, north = x - bounds[0], y - bounds[1]
    rise = math.radians(_ELEVATION)
    upright = _FILLED * math.tan(math.radians(_FOV) / 2.0)
    # The near corners are the widest, and all four must lie inside; each says how far away the eye must be.
    distance = max(
        max(east / (upright * aspect), abs(corner) * math.sin(rise) / upright) - corner * math.cos(rise)
        for corner in (-north, north)
    )
    return Pose((x, y - distance * math.cos(rise), height + distance * math.sin(rise)), (x, y, height), _FOV)


def going_to(
    placed: Placement | None, selection: Selection | None, *, size: tuple[float, float]
) -> GoTo | None:
    """Return the motion that shows what is selected; None if nothing is, or it is gone."""
    if placed is None or selection is None:
        return None
    point, river, lake = (
        find_point(placed, selection),
        find_river(placed, selection),
        find_lake(placed, selection),
    )
    if point is not None:
        return _goto(float(point["x"]), float(point["y"]), 2.0 * float(point["radius"]))
    if river is not None:
        line = river.points[:, :2]
        if selection.index is not None and selection.index < len(line):
            x, y = line[selection.index].tolist()
            return _goto(x, y, 8.0 * float(river.width[selection.index]))
        inside = ((line >= 0.0) & (line <= np.array(size))).all(axis=1)
        line = line[inside] if inside.any() else line
        x, y = (0.5 * (line.min(axis=0) + line.max(axis=0))).tolist()
        return _goto(x, y, float(np.ptp(line, axis=0).max()))
    if lake is not None:
        x, y = lake_centre(lake).tolist()
        return _goto(x, y, lake.shape.spacing * max(lake.shape.inside.shape))
    return None


def _goto(x: float, y: float, across: float) -> GoTo:
    return GoTo(x, y, max(_DISTANCE * across, _NEAREST))
