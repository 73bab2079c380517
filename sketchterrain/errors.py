"""Errors with their exit codes, checks of tables, and the formatting of values in messages."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any

_MAX_LENGTH = 60  # characters of a value in a message


class SketchterrainError(Exception):
    """Base of errors with a one-line message (exit code 1)."""

    exit_code = 1


class InputError(SketchterrainError):
    """Invalid input: a sketch, a layer, a parameter (exit code 3)."""

    exit_code = 3


class DeviceError(SketchterrainError):
    """No suitable device (exit code 4)."""

    exit_code = 4


class DeviceFailedError(DeviceError):
    """A device failed, or computed non-finite values; another one may succeed (exit code 4)."""


class DeviceMemoryError(DeviceError):
    """A device is out of memory; a smaller batch may fit (exit code 4)."""


class BuildError(SketchterrainError):
    """An OpenCL or GLSL program did not compile, by a defect of it or of the driver (exit code 1)."""


def one_line(text: object) -> str:
    """Return `text` with U+FFFD for each character that is not printable, as line breaks."""
    return "".join(char if char.isprintable() else "\ufffd" for char in str(text))


def format_value(value: object) -> str:
    """Return `value` as a file would have it, on one line and shortened."""
    try:
        text = str(value).lower() if isinstance(value, bool) else one_line(repr(value))
    except ValueError:  # Python refuses to print integers of more than 4300 digits
        text = "a number of thousands of digits"
    return text if len(text) <= _MAX_LENGTH else text[: _MAX_LENGTH - 1] + "…"


def first_few(texts: Sequence[str], most: int, separator: str = ", ") -> str:
    """Return the first of several texts, and how many more there are."""
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return separator.join(texts[:most]) + more


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest of the `known` names, or an empty text."""
    near = get_close_matches(name.lower(), list(known), n=1, cutoff=0.6)
    return f"; did you mean {near[0]!r}?" if near else ""


def check_keys(table: Mapping[str, object], known: Iterable[str], where: str = "") -> None:
    """Raise InputError if a table has a key that is not one of the `known`."""
    names, place = list(known), f" in {where}" if where else ""
    for name, value in table.items():
        if name not in names:
            raise InputError(
                f"unknown key {format_value(name)} = {format_value(value)}{place}: expected "
                f"{', '.join(names)}{did_you_mean(name, names)}"
            )


def check_tables(name: str, value: object, expected: str) -> list[dict[str, Any]]:
    """Return a list of tables; raise InputError for another value, with what is expected above each."""
    if not isinstance(value, list) or not all(isinstance(each, dict) for each in value):
        raise InputError(f"{name} = {format_value(value)}: expected tables, each with {expected}")
    return value


@contextmanager
def prefix_errors(place: str) -> Iterator[None]:
    """Put a place before the message of an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
