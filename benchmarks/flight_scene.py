"""What is flown over: valley_river laid over 4096 m, and the flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.benchmarks.screen_error import Picture
from sketchterrain.render.camera import Camera
from sketchterrain.sketch import load_sketch
from sketchterrain.terrain import build

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain import Terrain

Floats = npt.NDArray[np.float64]

__all__ = ["EXTENT", "FINEST_CELL", "PICTURE", "RATE", "Stop", "flight", "open_world"]

EXTENT: Final = 4096.0
"""m; the thesis's terrain (section 7.1)."""
FINEST_CELL: Final = 0.2
"""m; its finest quads."""
PICTURE: Final = Picture(1280, 720)
RATE: Final = 30.0
"""Frames a second."""

_FOV = 45.0
_PRESET = "valley_river"
_RADIUS, _SPEED = 1100.0, 40.0  # m, m/s
_LOWEST, _HIGHEST, _WAVES = 5.0, 250.0, 8.0
_AHEAD = 300.0  # m
_SMOOTH = 40  # frames; so far to both sides the eye heeds the ground


@dataclass(frozen=True)
class Stop:
    """A frame of the flight.

    Attributes
    ----------
    camera : Camera
    ground : float
        Height of the ground below the eye, m.
    velocity : (x, y, z) in m/s
    """

    camera: Camera
    ground: float
    velocity: tuple[float, float, float]


def open_world(context: ComputeContext) -> Terrain:
    """Return valley_river over :data:`EXTENT` metres."""
    return build(load_sketch(_PRESET).replace(extent=EXTENT), device=context)


def flight(terrain: Terrain, frames: int) -> tuple[Stop, ...]:
    """Return the first frames of a round over the middle of the world.

    40 m/s along a circle of 1100 m, 5 to 250 m above the highest ground within 1.3 s; the eye looks ahead,
    and down where it is high. Always the same.
    """
    return _stops(frames, lambda x, y: terrain.heights(x, y).astype(np.float64))


def _stops(frames: int, heights: Callable[[Floats, Floats], Floats]) -> tuple[Stop, ...]:
    turn = np.arange(-_SMOOTH, frames + _SMOOTH + 1) * (_SPEED / RATE / _RADIUS)
    x = EXTENT / 2 + _RADIUS * np.cos(turn)
    y = EXTENT / 2 + _RADIUS * np.sin(turn)
    ground = heights(x, y)
    highest = np.array([ground[i : i + 2 * _SMOOTH + 1].max() for i in range(len(ground) - 2 * _SMOOTH)])
    # The mean of a running maximum over as many frames again never lies below the ground.
    padded = np.concatenate([np.full(_SMOOTH, highest[0]), highest, np.full(_SMOOTH, highest[-1])])
    window = np.ones(_SMOOTH + 1) / (_SMOOTH + 1)
    smooth = np.convolve(padded, window, mode="same")[_SMOOTH:-_SMOOTH]
    inner = slice(_SMOOTH, -_SMOOTH)
    x, y, ground, turn = x[inner], y[inner], ground[inner], turn[inner]
    wave = 0.5 - 0.5 * np.cos(_WAVES * turn)
    z = smooth + _LOWEST + (_HIGHEST - _LOWEST) * wave**2
    look = np.stack([-np.sin(turn), np.cos(turn)], axis=1)
    down = 0.15 + 0.5 * wave
    speeds = np.gradient(np.stack([x, y, z], axis=1), 1.0 / RATE, axis=0)
    stops = []
    for i in range(len(x)):
        eye = (float(x[i]), float(y[i]), float(z[i]))
        east, north = (_AHEAD * look[i]).tolist()
        target = (eye[0] + east, eye[1] + north, eye[2] - _AHEAD * float(down[i]))
        velocity = (float(speeds[i, 0]), float(speeds[i, 1]), float(speeds[i, 2]))
        stops.append(Stop(Camera(eye, target, fov=_FOV), float(ground[i]), velocity))
    return tuple(stops)
