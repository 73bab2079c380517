"""Flights: keyframes, camera splines, flight files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from sketchterrain.document.toml_format import load_toml
from sketchterrain.errors import InputError, check_keys, check_tables, format_value, one_line, prefix_errors
from sketchterrain.geometry.camera import Camera, Floats, HeightFunction, Vector
from sketchterrain.geometry.splines import catmull_rom
from sketchterrain.io.files import wrap_read_errors, write_atomic
from sketchterrain.schema.parameters import Parameter, check_items, parameter_table

_SAMPLES_PER_SEGMENT: Final = 64  # samples between two keyframes for the arc length
_DIFFERENCE_STEP: Final = 1e-5  # s, step of the finite differences of the velocity
_MIN_DISTANCE: Final = 1e-3  # least distance (m) of two points of the curve


class CameraSpline:
    """Eye along a spline, with view directions, at given times.

    Arc length and direction are interpolated by monotone cubics (Fritsch & Carlson), which never overshoot: a
    camera that halts does halt.
    """

    def __init__(self, times: Floats, eyes: Floats, targets: Floats, fovs: Floats) -> None:
        from scipy.interpolate import PchipInterpolator  # importing takes half a second

        self._end = float(times[-1])
        self._points, knot = _distinct_points(eyes)
        if len(self._points) > 1:
            # Centripetal knots: the velocity is continuous in them.
            self._knots = _cumulative(np.sqrt(np.linalg.norm(np.diff(self._points, axis=0), axis=1)))
            u = np.linspace(0.0, len(self._points) - 1.0, _SAMPLES_PER_SEGMENT * (len(self._points) - 1) + 1)
            curve = catmull_rom(self._points, u)
            arc = _cumulative(np.linalg.norm(np.diff(curve, axis=0), axis=1))
            self._knot_at = PchipInterpolator(arc, np.interp(u, np.arange(len(self._knots)), self._knots))
            self._arc_at = PchipInterpolator(times, arc[::_SAMPLES_PER_SEGMENT][knot])
        self._angles_at = PchipInterpolator(times, np.column_stack([*_view_angles(targets - eyes), fovs]))

    def at(self, times: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return eyes (n, 3), targets (n, 3), fields of view (n,) and velocities (n, 3) at times (s)."""
        times = np.clip(times, 0.0, self._end)
        eye = self._eye(times)
        heading, pitch, distance, fov = self._angles_at(times).T
        level = np.cos(pitch)
        along = np.stack([np.sin(heading) * level, np.cos(heading) * level, np.sin(pitch)], axis=1)
        before, after = (
            np.maximum(times - _DIFFERENCE_STEP, 0.0),
            np.minimum(times + _DIFFERENCE_STEP, self._end),
        )
        velocity = (self._eye(after) - self._eye(before)) / (after - before)[:, None]
        return eye, eye + np.exp(distance)[:, None] * along, fov, velocity

    def _eye(self, times: Floats) -> Floats:
        if len(self._points) == 1:
            return np.repeat(self._points, len(times), axis=0)
        knot = self._knot_at(self._arc_at(times))
        return catmull_rom(self._points, np.interp(knot, self._knots, np.arange(len(self._knots))))


def _cumulative(steps: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(steps)])


def _distinct_points(eyes: Floats) -> tuple[Floats, list[int]]:
    """Return the distinct points of the curve, and the point index of each eye."""
    points, knots = [eyes[0]], [0]
    for eye in eyes[1:]:
        if float(np.abs(eye - points[-1]).max()) > _MIN_DISTANCE:
            points.append(eye)
        knots.append(len(points) - 1)
    return np.array(points), knots


def _view_angles(along: Floats) -> tuple[Floats, Floats, Floats]:
    """Return unwrapped headings, pitches (rad) and logarithms of lengths of (n, 3) vectors."""
    length = np.linalg.norm(along, axis=1)
    level = np.hypot(along[:, 0], along[:, 1])
    heading = np.arctan2(along[:, 0], along[:, 1])
    # Vertical directions take the heading of the keyframe before, or else of the first that has one.
    has_one = level > 1e-9 * length
    last = np.maximum.accumulate(np.where(has_one, np.arange(len(along)), -1))
    first = int(np.argmax(has_one))
    heading = np.unwrap(heading[np.where(last < 0, first, last)])
    return heading, np.arctan2(along[:, 2], level), np.log(length)


MAX_KEYS: Final = 20_000  # keyframes of a flight

_MAX_COORDINATE = 1e9  # m
_MIN_INTERVAL = 1e-3  # s between keyframes
_RAISE_ROUNDS = 40
_RAISE_RATE = 240

HEIGHTS: Final = Parameter(
    *("heights", str, "absolute", 0, 20, ""),
    "reference of heights (z): the world's zero, or the terrain below each point",
    choices=("absolute", "above ground"),
)

KEYFRAME: Final[Mapping[str, Parameter]] = parameter_table(
    Parameter("time", float, 0.0, 0.0, 1e6, "s", "time of the keyframe"),
    Parameter("eye", float, 0.0, -_MAX_COORDINATE, _MAX_COORDINATE, "m", "position of the camera: x, y, z"),
    Parameter(
        *("target", float, 0.0, -_MAX_COORDINATE, _MAX_COORDINATE, "m"),
        "point in the centre of the picture: x, y, z",
    ),
    Parameter("fov", float, 50.0, 5.0, 120.0, "°", "vertical field of view"),
)
"""Parameters of a keyframe; ``eye`` and ``target`` have three components."""


@dataclass(frozen=True)
class Keyframe:
    """Camera at one time (s): `eye` and `target` (m), vertical `fov` (degrees)."""

    time: float
    eye: Vector
    target: Vector
    fov: float = float(KEYFRAME["fov"].default)

    def __post_init__(self) -> None:
        for name in ("time", "fov"):
            object.__setattr__(self, name, KEYFRAME[name].check(getattr(self, name)))
        for name in ("eye", "target"):
            object.__setattr__(self, name, _point(name, getattr(self, name)))
        if self.eye == self.target:
            raise InputError(
                f"target = {format_value(list(self.target))}: expected another point than the eye"
            )


class CameraStates(NamedTuple):
    """Camera states at several times."""

    eye: Floats  # (n, 3) m
    target: Floats  # (n, 3) m
    fov: Floats  # (n,) degrees
    velocity: Floats  # (n, 3) of the eye, m/s

    @property
    def cameras(self) -> list[Camera]:
        """A camera for each of them."""
        rows = zip(self.eye.tolist(), self.target.tolist(), self.fov.tolist(), strict=True)
        return [Camera(tuple(eye), tuple(target), fov=fov) for eye, target, fov in rows]


@dataclass(frozen=True)
class Flight:
    """Camera path through two or more keyframes in the order of their times.

    The eye follows a centripetal Catmull-Rom spline (no loops, no cusps) with continuous speed; the view
    direction turns from keyframe to keyframe along the shorter arc. Resolve heights ``"above ground"`` with
    `with_absolute_heights` before sampling.
    """

    keys: tuple[Keyframe, ...]
    heights: str = str(HEIGHTS.default)

    def __post_init__(self) -> None:
        object.__setattr__(self, "heights", HEIGHTS.check(self.heights))
        object.__setattr__(self, "keys", check_items(Keyframe, self.keys, "keys", most=MAX_KEYS))
        if len(self.keys) < 2:
            raise InputError(f"{len(self.keys)} keys: expected two or more")
        for number, (before, key) in enumerate(zip(self.keys, self.keys[1:], strict=False), 2):
            if key.time < before.time + _MIN_INTERVAL:
                raise InputError(
                    f"key {number}: time = {format_value(key.time)}: expected {_MIN_INTERVAL:g} s or more "
                    f"after the key before, which is at {format_value(before.time)} s"
                )

    @property
    def duration(self) -> float:
        """Seconds from the first to the last keyframe."""
        return self.keys[-1].time - self.keys[0].time

    def at(self, times: Any) -> CameraStates:
        """Return the camera at times (s) since the first keyframe, clamped to the flight."""
        return CameraStates(*self._spline.at(np.atleast_1d(np.asarray(times, np.float64))))

    def times(self, fps: float, seconds: float | None = None) -> Floats:
        """Return the times (s) of the frames of the flight, or of its first `seconds`."""
        length = self.duration if seconds is None else min(seconds, self.duration)
        return np.arange(max(1, round(length * fps))) / fps

    def with_absolute_heights(self, heights_at: HeightFunction, *, clearance: float = 2.0) -> Flight:
        """Return the flight with absolute heights, raised to stay `clearance` m above the terrain."""
        if self.heights == "absolute":
            return self
        positions = self._rows[:, 1:7].copy()
        positions[:, 2] += heights_at(positions[:, 0], positions[:, 1])
        positions[:, 5] += heights_at(positions[:, 3], positions[:, 4])
        return self._moved(positions).raised_above(heights_at, clearance=clearance)

    def raised_above(self, heights_at: HeightFunction, *, clearance: float) -> Flight:
        """Return the flight with keyframes raised until the eye stays `clearance` m above the terrain.

        The terrain is sampled 240 times per second of the flight, in several rounds.
        """
        flight = self
        times = np.linspace(0.0, self.duration, max(2, round(self.duration * _RAISE_RATE) + 1))
        moments = self._rows[:, 0]
        segment = np.clip(np.searchsorted(moments, times, side="right") - 1, 0, len(moments) - 2)
        for _ in range(_RAISE_ROUNDS):
            eye = flight.at(times).eye
            missing = np.asarray(heights_at(eye[:, 0], eye[:, 1]), np.float64) + clearance - eye[:, 2]
            if (missing <= 0.0).all():
                break
            lift = np.zeros(len(moments))
            # 1 % more, for fewer rounds.
            np.maximum.at(lift, segment, 1.01 * missing)
            np.maximum.at(lift, segment + 1, 1.01 * missing)
            positions = flight._rows[:, 1:7].copy()
            positions[:, [2, 5]] += lift[:, None]
            flight = flight._moved(positions)
        return flight

    @cached_property
    def _rows(self) -> Floats:
        """Seconds since the first keyframe, eye, target and field of view, (n, 8)."""
        start = self.keys[0].time
        return np.array([[key.time - start, *key.eye, *key.target, key.fov] for key in self.keys], np.float64)

    @cached_property
    def _spline(self) -> CameraSpline:
        times, fovs = self._rows[:, 0], self._rows[:, 7]
        return CameraSpline(times, self._rows[:, 1:4], self._rows[:, 4:7], fovs)

    def _moved(self, positions: Floats) -> Flight:
        """Return the flight with absolute heights and other eyes and targets, (n, 6)."""
        rows = zip(self.keys, positions.tolist(), strict=True)
        return Flight(tuple(replace(key, eye=tuple(row[:3]), target=tuple(row[3:])) for key, row in rows))


def _point(name: str, value: object) -> tuple[object, ...]:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise InputError(f"{name} = {format_value(value)}: expected three numbers, x, y and z")
    return tuple(
        float(KEYFRAME[name].check(each, f"{name} {axis}")) for axis, each in zip("xyz", value, strict=True)
    )


FORMAT: Final = 1
_MAX_BYTES = 8 << 20  # bytes, of a file
_REQUIRED = ("time", "eye", "target")
_KNOWN = ("format", "heights", "key")

_HEAD = f"""\
# The flight of a camera, for `sketchterrain fly SKETCH --path`. Metres from the sketch's south-west corner: x
# east, y north, z up. heights is the {HEIGHTS.help}.
"""


def load_flight(path: str | Path) -> Flight:
    """Read a flight file; raise InputError with file, key and value."""
    name = one_line(path)
    with wrap_read_errors(Path(path)), Path(path).open("rb") as stream:
        data = stream.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise InputError(f"{name}: expected at most {_MAX_BYTES >> 20} MiB")
    with prefix_errors(name):
        return parse_flight(data)


def save_flight(flight: Flight, path: str | Path) -> Path:
    """Write a flight to a file; reading it returns an equal flight."""
    return write_atomic(Path(path), flight_text(flight).encode())


def parse_flight(data: bytes) -> Flight:
    """Return the flight of a file's content; raise InputError for unknown keys or wrong values."""
    document = load_toml(data)
    check_keys(document, _KNOWN)
    given = document.get("format")
    if isinstance(given, bool) or given != FORMAT:
        got = "no such key" if given is None else format_value(given)
        raise InputError(f"format = {FORMAT} expected, got {got}")
    rows = check_tables("key", document.get("key", []), "[[key]] on a line of its own")
    if len(rows) > MAX_KEYS:
        raise InputError(f"{len(rows)} keys: expected at most {MAX_KEYS}")
    keys = tuple(_key(row, number) for number, row in enumerate(rows, 1))
    return Flight(keys, str(HEIGHTS.check(document.get("heights", HEIGHTS.default))))


def flight_text(flight: Flight) -> str:
    """Return a flight as TOML, with numbers that are read back bit for bit."""
    lines = [_HEAD, f"format = {FORMAT}", f'heights = "{flight.heights}"']
    for key in flight.keys:
        values = ((name, getattr(key, name)) for name in KEYFRAME)
        rows = (f"{name} = {list(value) if isinstance(value, tuple) else value!r}" for name, value in values)
        lines += ["", "[[key]]", *rows]
    return "\n".join(lines) + "\n"


def _key(row: Mapping[str, object], number: int) -> Keyframe:
    with prefix_errors(f"[[key]] number {number}"):
        check_keys(row, KEYFRAME)
        missing = [name for name in _REQUIRED if name not in row]
        if missing:
            raise InputError(f"no {missing[0]}: expected {', '.join(_REQUIRED)}")
        return Keyframe(**row)  # type: ignore[arg-type] # Keyframe checks every value
