"""What is flown over: valley_river laid over 4096 m, and the flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.benchmarks.screen_error import Picture
from sketchterrain.document.store import load_sketch
from sketchterrain.render.camera import Camera
from sketchterrain.render.flight import Flight, Keyframe
from sketchterrain.terrain.building import build

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.terrain import Terrain

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
_HEIGHTS = (4.0, 6.0, 15.0, 40.0, 75.0, 105.0, 120.0, 95.0, 55.0, 20.0, 6.0)  # m above the ground
_APART = 1.0  # s
_AHEAD, _LOOK = 400.0, 20.0  # m: what the eye looks at, and how high that is above the ground


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


def recorded(terrain: Terrain) -> Flight:
    """Return the flight: ten seconds at 40 m/s along a circle, 4 to 120 m above the ground."""
    keys = []
    for number, height in enumerate(_HEIGHTS):
        turn = number * _SPEED * _APART / _RADIUS
        outward, ahead = (
            np.array(pair) for pair in ((np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn)))
        )
        eye = EXTENT / 2 + _RADIUS * outward
        target = eye + _AHEAD * ahead
        keys.append(Keyframe(number * _APART, (*eye.tolist(), height), (*target.tolist(), _LOOK), _FOV))
    flight = Flight(tuple(keys), heights="above ground")
    return flight.over(lambda x, y: terrain.heights(x, y).astype(np.float64), clearance=2.0)


def stops(
    terrain: Terrain, frames: int, *, seconds: float = _APART * (len(_HEIGHTS) - 1)
) -> tuple[Stop, ...]:
    """Return so many frames of the flight, evenly over its first seconds."""
    flight = recorded(terrain)
    views = flight.at(np.linspace(0.0, seconds, frames))
    ground = terrain.heights(views.eye[:, 0], views.eye[:, 1])
    found = []
    for eye, target, fov, velocity, below in zip(*views, ground, strict=True):
        x, y, z = eye.tolist()
        camera = Camera((x, y, z), tuple(target.tolist()), fov=float(fov))
        found.append(Stop(camera, float(below), tuple(velocity.tolist())))
    return tuple(found)
