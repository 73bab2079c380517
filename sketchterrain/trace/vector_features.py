"""What a file of vectors holds: features with a shape and properties, in a coordinate reference system."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    import numpy.typing as npt
    from rasterio.crs import CRS

__all__ = ["MOST_VERTICES", "Kind", "Source", "VectorFeature", "too_many"]

MOST_VERTICES: Final = 4_000_000
"""In one file."""

Kind = Literal["point", "line", "area"]


class VectorFeature(NamedTuple):
    """One shape.

    Attributes
    ----------
    kind : {'point', 'line', 'area'}
    parts : sequence of (n, 2) float64
        Vertices of each: a point alone, a line, or the closed rings of an area (what an odd number of them
        goes around belongs to it).
    properties : mapping
        What the file says of it.
    """

    kind: Kind
    parts: Sequence[npt.NDArray[np.float64]]
    properties: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Source:
    """One layer of a file, or all of a file that has none.

    Attributes
    ----------
    name : str
    crs : CRS or None
        None: coordinates are metres that lie nowhere on Earth.
    features : list of VectorFeature
    left_out : Counter
        How many features were not taken, by why.
    """

    name: str
    crs: CRS | None
    features: list[VectorFeature]
    left_out: Counter[str] = field(default_factory=Counter)


def too_many(place: str, count: float) -> str:
    """Return the line that refuses a file of so many vertices."""
    return (
        f"{place}: about {count:.2g} vertices: expected at most {MOST_VERTICES / 1e6:g} million, "
        "simplify it or cut it to the area first"
    )
