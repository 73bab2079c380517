"""What mouse and keys mean for the eye: motions for the engine, the same from any widget."""

from __future__ import annotations

from typing import Final

from PyQt6.QtCore import Qt

from sketchterrain.ui.engine.orders import Fly, Pan, Turn, Zoom

__all__ = ["FLYING_KEYS", "Keys", "dragged", "zoomed"]

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

    Parameters
    ----------
    mode
        One of `MODES`.
    right, down
        px that the mouse moved.
    height
        px of the picture.
    pans
        Whether it moves the eye over the ground; else it turns.
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
