"""Flights as TOML files: read strictly, written whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from sketchterrain.errors import InputError, one_line
from sketchterrain.render.flight import HEIGHTS, KEY, MOST_KEYS, Flight, Keyframe
from sketchterrain.sketch.toml_reading import load_toml
from sketchterrain.sketch.wording import did_you_mean, format_value
from sketchterrain.whole_files import write_atomic

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
