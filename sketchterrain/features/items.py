"""Parts of draped features in the order in which they are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.geometry.box_index import expanded

STROKE, FILL, POINT = range(3)

STARTS, ENDS, BEFORE, AFTER = 1, 2, 4, 8
"""Bits of `Items.ends`: the line starts or ends here; the first or last point is only for the join."""

_DTYPES: Final = (np.int64, np.int32, np.int32, np.int8, np.int64, np.float64, np.float64, np.uint8)


class Items(NamedTuple):
    """Parts of features: runs of lines, rings of areas, points.

    A feature may have several fills, whose signed areas add up: shells run counterclockwise, holes clockwise.
    """

    feature: Int64Array  # (n,) id in its layer
    layer: npt.NDArray[np.int32]  # (n,) number of the layer
    style: npt.NDArray[np.int32]  # (n,) row of `Drapes.styles`
    kind: npt.NDArray[np.int8]  # (n,) STROKE, FILL or POINT
    first: Int64Array  # (n + 1,) into `points`
    points: Float64Array  # (k, 2) m from the sketch's south-west corner; rings are closed
    along: Float64Array  # (n,) m along the line to the first of its points that is not BEFORE
    ends: npt.NDArray[np.uint8]  # (n,) bits STARTS, ENDS, BEFORE, AFTER

    @classmethod
    def empty(cls) -> Items:
        """Return no items."""
        sizes = (0, 0, 0, 0, 1, (0, 2), 0, 0)
        return cls(*(np.zeros(size, dtype) for size, dtype in zip(sizes, _DTYPES, strict=True)))

    @classmethod
    def joined(cls, parts: Sequence[Items]) -> Items:
        """Return the items of several, one after the other."""
        if not parts:
            return cls.empty()
        offset = np.cumsum([0, *(len(part.points) for part in parts)])
        first = [part.first[:-1] + start for part, start in zip(parts, offset, strict=False)]
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in cls._fields}
        columns["first"] = np.append(np.concatenate(first), offset[-1])
        return cls._make(columns.values())

    def taken(self, which: npt.NDArray[np.generic]) -> Items:
        """Return some items by their numbers, or by a mask (n,)."""
        count = np.diff(self.first)[which]
        owner, place = expanded(count)
        first, points = np.append(0, np.cumsum(count)), self.points[self.first[:-1][which][owner] + place]
        others = {
            name: getattr(self, name)[which] for name in self._fields if name not in ("first", "points")
        }
        return Items(first=first, points=points, **others)
