"""Flights: key frames, motion along splines, flight files."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sketchterrain.document.parameter_types import Parameter, check_items, parameter_table
from sketchterrain.document.toml_format import load_toml
from sketchterrain.errors import InputError, did_you_mean, format_value, one_line
from sketchterrain.hydrology.splines import catmull_rom
from sketchterrain.io.files import write_atomic

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sketchterrain.render.camera import Camera, Floats, Ground, Vector


_PER_SEGMENT: Final = 64
"""Samples of the curve between two keys, for the length of its arc."""
_MOMENT: Final = 1e-5
"""s, over which a velocity is measured."""
_APART: Final = 1e-3
"""m between two points of the curve, at least."""


class Motion:
    """An eye that goes along a curve, by a schedule, and looks along directions that turn.

    How far along the curve it is, and where it looks, follow the keys by monotone cubics (Fritsch & Carlson),
    which never overshoot: a camera that halts, halts.
    """

    def __init__(self, times: Floats, eyes: Floats, targets: Floats, fovs: Floats) -> None:
        from scipy.interpolate import PchipInterpolator  # takes half a second: only for whoever flies

        self._end = float(times[-1])
        self._points, knot = _places(eyes)
        if len(self._points) > 1:
            # Centripetal knots: over them the curve's velocity has no jumps.
            self._knots = _sums(np.sqrt(np.linalg.norm(np.diff(self._points, axis=0), axis=1)))
            u = np.linspace(0.0, len(self._points) - 1.0, _PER_SEGMENT * (len(self._points) - 1) + 1)
            curve = catmull_rom(self._points, u)
            arc = _sums(np.linalg.norm(np.diff(curve, axis=0), axis=1))
            self._place = PchipInterpolator(arc, np.interp(u, np.arange(len(self._knots)), self._knots))
            self._arc = PchipInterpolator(times, arc[::_PER_SEGMENT][knot])
        self._look = PchipInterpolator(times, np.column_stack([*_looks(targets - eyes), fovs]))

    def at(self, times: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return eyes (n, 3), targets (n, 3), fields of view (n,) and velocities (n, 3) at times (s)."""
        times = np.clip(times, 0.0, self._end)
        eye = self._eye(times)
        heading, pitch, distance, fov = self._look(times).T
        level = np.cos(pitch)
        along = np.stack([np.sin(heading) * level, np.cos(heading) * level, np.sin(pitch)], axis=1)
        before, after = np.maximum(times - _MOMENT, 0.0), np.minimum(times + _MOMENT, self._end)
        velocity = (self._eye(after) - self._eye(before)) / (after - before)[:, None]
        return eye, eye + np.exp(distance)[:, None] * along, fov, velocity

    def _eye(self, times: Floats) -> Floats:
        if len(self._points) == 1:
            return np.repeat(self._points, len(times), axis=0)
        knot = self._place(self._arc(times))
        return catmull_rom(self._points, np.interp(knot, self._knots, np.arange(len(self._knots))))


def _sums(steps: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(steps)])


def _places(eyes: Floats) -> tuple[Floats, list[int]]:
    """Return the points that a curve goes through, and at which of them each eye is."""
    points, knots = [eyes[0]], [0]
    for eye in eyes[1:]:
        if float(np.abs(eye - points[-1]).max()) > _APART:
            points.append(eye)
        knots.append(len(points) - 1)
    return np.array(points), knots


def _looks(along: Floats) -> tuple[Floats, Floats, Floats]:
    """Return headings without jumps, pitches (radians) and logarithms of lengths of (n, 3) vectors."""
    length = np.linalg.norm(along, axis=1)
    level = np.hypot(along[:, 0], along[:, 1])
    heading = np.arctan2(along[:, 0], along[:, 1])
    # Straight up or down there is no heading: the key before lends its own, or else the first that has one.
    has_one = level > 1e-9 * length
    last = np.maximum.accumulate(np.where(has_one, np.arange(len(along)), -1))
    first = int(np.argmax(has_one))
    heading = np.unwrap(heading[np.where(last < 0, first, last)])
    return heading, np.arctan2(along[:, 2], level), np.log(length)


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


FORMAT: Final = 1
_LARGEST = 8 << 20  # bytes, of a file
_NEEDED = ("time", "eye", "target")
_KNOWN = ("format", "heights", "key")

_HEAD = f"""\
# The flight of a camera, for `sketchterrain fly SKETCH --path`. Metres from the sketch's south-west corner: x
# east, y north, z up. heights says {HEIGHTS.help}.
"""


def load_flight(path: str | Path) -> Flight:
    """Read a flight."""
    place = one_line(path)
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(_LARGEST + 1)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({error.strerror})") from None
    if len(data) > _LARGEST:
        raise InputError(f"{place}: expected at most {_LARGEST >> 20} MiB")
    try:
        return parse_flight(data)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def save_flight(flight: Flight, path: str | Path) -> Path:
    """Write a flight to a file; reading it again gives the same flight."""
    return write_atomic(Path(path), flight_text(flight).encode())


def parse_flight(data: bytes) -> Flight:
    """Return the flight that the content of a file says."""
    document = load_toml(data)
    for name, value in document.items():
        if name not in _KNOWN:
            raise _unknown(name, value, _KNOWN)
    given = document.get("format")
    if isinstance(given, bool) or given != FORMAT:
        got = "no such key" if given is None else format_value(given)
        raise InputError(f"format = {FORMAT} expected, got {got}")
    rows = document.get("key", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(
            f"key = {format_value(rows)}: expected tables, each with [[key]] on a line of its own"
        )
    if len(rows) > MOST_KEYS:
        raise InputError(f"{len(rows)} keys: expected at most {MOST_KEYS}")
    keys = tuple(_key(row, number) for number, row in enumerate(rows, 1))
    return Flight(keys, str(HEIGHTS.check(document.get("heights", HEIGHTS.default))))


def flight_text(flight: Flight) -> str:
    """Return a flight as TOML; numbers are written so that reading gives the same bits."""
    lines = [_HEAD, f"format = {FORMAT}", f'heights = "{flight.heights}"']
    for key in flight.keys:
        lines += ["", "[[key]]", *(f"{name} = {_written(getattr(key, name))}" for name in KEY)]
    return "\n".join(lines) + "\n"


def _key(row: Mapping[str, object], number: int) -> Keyframe:
    try:
        for name, value in row.items():
            if name not in KEY:
                raise _unknown(name, value, tuple(KEY))
        missing = [name for name in _NEEDED if name not in row]
        if missing:
            raise InputError(f"no {missing[0]}: expected {', '.join(_NEEDED)}")
        return Keyframe(**row)  # type: ignore[arg-type] # Keyframe checks every value
    except InputError as error:
        raise InputError(f"[[key]] number {number}: {error}") from None


def _unknown(name: str, value: object, known: tuple[str, ...]) -> InputError:
    return InputError(
        f"unknown key {format_value(name)} = {format_value(value)}: expected {', '.join(known)}"
        f"{did_you_mean(name, known)}"
    )


def _written(value: float | tuple[float, ...]) -> str:
    return repr(list(value) if isinstance(value, tuple) else value)
