"""A flight: where a camera is at which time, as keys and as smooth motion between them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.render.flight_motion import Motion
from sketchterrain.sketch.parameter import Parameter, check_items, parameter_table
from sketchterrain.sketch.wording import format_value

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from sketchterrain.render.camera import Camera, Floats, Ground, Vector

MOST_KEYS: Final = 20_000
"""Of one flight."""

_FARTHEST = 1e9  # m
_SOONEST = 1e-3  # s from one key to the next
_ROUNDS = 40
_SAMPLES_PER_SECOND = 240

HEIGHTS: Final = Parameter(
    "heights",
    str,
    "absolute",
    0,
    20,
    "",
    "what heights (z) are counted from: the world's zero, or the ground below each point",
    choices=("absolute", "above ground"),
)

KEY: Final[Mapping[str, Parameter]] = parameter_table(
    Parameter("time", float, 0.0, 0.0, 1e6, "s", "when the camera is there"),
    Parameter("eye", float, 0.0, -_FARTHEST, _FARTHEST, "m", "where it is: x, y, z"),
    Parameter(
        "target", float, 0.0, -_FARTHEST, _FARTHEST, "m", "a point in the middle of the picture: x, y, z"
    ),
    Parameter("fov", float, 50.0, 5.0, 120.0, "°", "vertical field of view"),
)
"""What a key of a flight says; of ``eye`` and ``target`` each of three numbers."""


@dataclass(frozen=True)
class Keyframe:
    """Where the camera is at one time."""

    time: float
    eye: Vector
    target: Vector
    fov: float = float(KEY["fov"].default)

    def __post_init__(self) -> None:
        for name in ("time", "fov"):
            object.__setattr__(self, name, KEY[name].check(getattr(self, name)))
        for name in ("eye", "target"):
            object.__setattr__(self, name, _point(name, getattr(self, name)))
        if self.eye == self.target:
            raise InputError(
                f"target = {format_value(list(self.target))}: expected another point than the eye"
            )


class CameraStates(NamedTuple):
    """What a camera is like at several times."""

    eye: Floats  # (n, 3) m
    target: Floats  # (n, 3) m
    fov: Floats  # (n,) degrees
    velocity: Floats  # (n, 3) of the eye, m/s


@dataclass(frozen=True)
class Flight:
    """The way of a camera.

    The eye goes along a centripetal Catmull-Rom spline through the keys, which has no loops and no cusps, and
    is at each key at its time; its speed has no jumps. The look turns from one key's direction to that of the
    next, the shorter way.
    """

    keys: tuple[Keyframe, ...]
    heights: str = str(HEIGHTS.default)

    def __post_init__(self) -> None:
        object.__setattr__(self, "heights", HEIGHTS.check(self.heights))
        object.__setattr__(self, "keys", check_items(Keyframe, self.keys, "keys", most=MOST_KEYS))
        if len(self.keys) < 2:
            raise InputError(f"{len(self.keys)} keys: expected two or more")
        for number, (before, key) in enumerate(zip(self.keys, self.keys[1:], strict=False), 2):
            if key.time < before.time + _SOONEST:
                raise InputError(
                    f"key {number}: time = {format_value(key.time)}: expected {_SOONEST:g} s or more "
                    f"after the key before, which is at {format_value(before.time)} s"
                )

    @classmethod
    def recorded(cls, shots: Iterable[tuple[float, Camera]], *, interval: float = 0.25) -> Flight:
        """Return the flight of cameras at rising times (s), with a key about each `interval` (s)."""
        kept: list[tuple[float, Camera]] = []
        last: tuple[float, Camera] | None = None
        for time, camera in shots:
            last = (time, camera)
            if not kept or time >= kept[-1][0] + interval:
                kept.append(last)
        if last is not None and last[0] >= kept[-1][0] + _SOONEST:
            kept.append(last)
        return cls(tuple(Keyframe(time, camera.eye, camera.target, camera.fov) for time, camera in kept))

    @property
    def duration(self) -> float:
        """From the first key to the last one, s."""
        return self.keys[-1].time - self.keys[0].time

    def at(self, times: Any) -> CameraStates:
        """Return the views at times (s) since the first key; before it and after the end nothing moves."""
        return CameraStates(*self._motion.at(np.atleast_1d(np.asarray(times, np.float64))))

    def times(self, fps: float, seconds: float | None = None) -> Floats:
        """Return the times (s) of frames, the first at 0, for all of the flight or its first seconds."""
        length = self.duration if seconds is None else min(seconds, self.duration)
        return np.arange(max(1, round(length * fps))) / fps

    def over(self, ground: Ground, *, clearance: float = 2.0) -> Flight:
        """Return the flight with absolute heights."""
        if self.heights == "absolute":
            return self
        places = np.array([[*key.eye, *key.target] for key in self.keys])
        places[:, 2] += ground(places[:, 0], places[:, 1])
        places[:, 5] += ground(places[:, 3], places[:, 4])
        return _with_places(self, places).raised(ground, clearance=clearance)

    def raised(self, ground: Ground, *, clearance: float) -> Flight:
        """Return the flight with keys (eye and target) so far raised that it never is under the ground."""
        flight = self
        times = np.linspace(0.0, self.duration, max(2, round(self.duration * _SAMPLES_PER_SECOND) + 1))
        moments = np.array([key.time for key in self.keys]) - self.keys[0].time
        segment = np.clip(np.searchsorted(moments, times, side="right") - 1, 0, len(moments) - 2)
        for _ in range(_ROUNDS):
            eye = flight.at(times).eye
            missing = np.asarray(ground(eye[:, 0], eye[:, 1]), np.float64) + clearance - eye[:, 2]
            if (missing <= 0.0).all():
                break
            lift = np.zeros(len(moments))
            # A hundredth more, so that what nearly does it does not take many rounds.
            np.maximum.at(lift, segment, 1.01 * missing)
            np.maximum.at(lift, segment + 1, 1.01 * missing)
            places = np.array([[*key.eye, *key.target] for key in flight.keys])
            places[:, [2, 5]] += lift[:, None]
            flight = _with_places(flight, places)
        return flight

    @cached_property
    def _motion(self) -> Motion:
        return Motion(
            np.array([key.time for key in self.keys]) - self.keys[0].time,
            np.array([key.eye for key in self.keys], np.float64),
            np.array([key.target for key in self.keys], np.float64),
            np.array([key.fov for key in self.keys], np.float64),
        )


def _with_places(flight: Flight, places: Floats) -> Flight:
    """Return a flight of absolute heights whose keys are at (n, 6) other eyes and targets."""
    keys = [
        dataclasses.replace(key, eye=tuple(place[:3]), target=tuple(place[3:]))
        for key, place in zip(flight.keys, places.tolist(), strict=True)
    ]
    return Flight(tuple(keys))


def _point(name: str, value: object) -> tuple[object, ...]:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise InputError(f"{name} = {format_value(value)}: expected three numbers, x, y and z")
    return tuple(
        float(KEY[name].check(each, f"{name} {axis}")) for axis, each in zip("xyz", value, strict=True)
    )
