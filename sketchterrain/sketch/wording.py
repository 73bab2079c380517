"""How an error shows what a person gave: on one line, short, with the likely typo named."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from sketchterrain.errors import one_line

_LONGEST = 60


def format_value(value: object) -> str:
    """Return `value` as it would be written, on one line and cut to a readable length."""
    try:
        text = str(value).lower() if isinstance(value, bool) else one_line(repr(value))
    except ValueError:  # Python refuses to print integers of more than 4300 digits
        text = "a number of thousands of digits"
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest of the `known` names, or nothing."""
    near = get_close_matches(name.lower(), list(known), n=1, cutoff=0.6)
    return f"; did you mean {near[0]!r}?" if near else ""
