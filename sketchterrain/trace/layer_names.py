"""What people call layers in a paint program, and which of a sketch's layers that is."""

from __future__ import annotations

import re

from sketchterrain.sketch import LAYERS
from sketchterrain.trace.legend import Meaning

__all__ = ["meant_by"]

_NAMED = re.compile(r"([a-z]+)[\s._#:(-]*(\d{1,3})?\)?(?:\.png)?", re.IGNORECASE)


def meant_by(name: str) -> Meaning | None:
    """Return the layer and label that a name means, or None.

    ``mountain``, ``Mountains``, ``river 2``, ``forest.1`` and ``lake_3.png`` do; a name without a number
    means label 1.
    """
    match = _NAMED.fullmatch(name.strip())
    if match is None:
        return None
    word, label = match[1].lower(), int(match[2] or 1)
    known = {**{each: each for each in LAYERS}, **{LAYERS[each].title.lower(): each for each in LAYERS}}
    return Meaning(known[word], label) if word in known and 1 <= label <= 255 else None
