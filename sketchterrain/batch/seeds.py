"""Which seeds are meant by a text: ``1-100``, ``1,5,9-12``."""

from __future__ import annotations

import re

from sketchterrain.errors import InputError
from sketchterrain.sketch import SKETCH
from sketchterrain.sketch.wording import shown

__all__ = ["MOST_SEEDS", "seeds_of"]

MOST_SEEDS = 10_000
"""In one batch."""
_EXPECTED = "expected numbers and ranges such as 1-100 or 1,5,9-12"
_RANGE = re.compile(r"(\d{1,19})(?:\s*-\s*(\d{1,19}))?", re.ASCII)


def seeds_of(text: str) -> tuple[int, ...]:
    """Return the seeds that a text names, in its order, each once.

    Parameters
    ----------
    text
        Numbers and ranges, both ends included, with commas between them.

    Raises
    ------
    InputError
        If it is something else, a range runs backward, a seed is out of range, or there are too many.
    """
    highest = int(SKETCH["seed"].high)
    seeds: dict[int, None] = {}
    for part in text.split(","):
        match = _RANGE.fullmatch(part.strip())
        if match is None:
            raise InputError(f"seeds {shown(text)}: {_EXPECTED}")
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first:
            raise InputError(f"seeds {shown(text)}: {part.strip()} runs backward; {_EXPECTED}")
        if last > highest:
            raise InputError(f"seeds {shown(text)}: expected seeds from 0 to {highest}")
        if last - first >= MOST_SEEDS or len(seeds) + last - first >= MOST_SEEDS:
            raise InputError(f"seeds {shown(text)}: expected at most {MOST_SEEDS} of them")
        seeds |= dict.fromkeys(range(first, last + 1))
    return tuple(seeds)
