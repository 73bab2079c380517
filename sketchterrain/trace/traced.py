"""What tracing gives: a sketch, and what is to be told of how it came about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch

__all__ = ["Traced"]


@dataclass(frozen=True, eq=False)
class Traced:
    """A sketch made from something else.

    Attributes
    ----------
    sketch : Sketch
    notes : tuple of str
        What was taken, what was left out and what was guessed: one line each, for a person.
    """

    sketch: Sketch
    notes: tuple[str, ...]
