"""What the process behind a world's window tells it besides what an engine does."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["WorldFacts"]


@dataclass(frozen=True)
class WorldFacts:
    """The world that is shown.

    Attributes
    ----------
    corner : (float, float)
        Of its north-west corner, the origin of what is shown: m from the sketch's south-west corner.
    size : (float, float)
        m from west to east, from south to north.
    cell : float
        m between its vertices.
    middle : float
        Height of the ground in its middle, m.
    lacks : tuple of str
        A line for each thing that it does not hold.
    """

    corner: tuple[float, float]
    size: tuple[float, float]
    cell: float
    middle: float
    lacks: tuple[str, ...] = ()
