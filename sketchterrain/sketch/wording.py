"""Values and names in error messages: on one line, shortened, with the likely typo named."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from sketchterrain.errors import InputError, one_line

_MAX_LENGTH = 60


def format_value(value: object) -> str:
    """Return `value` as a file would have it, on one line and shortened."""
    try:
        text = str(value).lower() if isinstance(value, bool) else one_line(repr(value))
    except ValueError:  # Python refuses to print integers of more than 4300 digits
        text = "a number of thousands of digits"
    return text if len(text) <= _MAX_LENGTH else text[: _MAX_LENGTH - 1] + "…"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest of the `known` names, or an empty text."""
    near = get_close_matches(name.lower(), list(known), n=1, cutoff=0.6)
    return f"; did you mean {near[0]!r}?" if near else ""


def unknown_key(name: str, value: object, known: Iterable[str], where: str = "") -> InputError:
    """Return the error that a table has a key that is not one of the `known`."""
    names, place = list(known), f" in {where}" if where else ""
    return InputError(
        f"unknown key {format_value(name)} = {format_value(value)}{place}: expected {', '.join(names)}"
        f"{did_you_mean(name, names)}"
    )
