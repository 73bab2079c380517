"""The ground around a sketch, which is asked about most: its fill is worked out once, and remembered."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sketchterrain.features.recent import LRUCache

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.features.fill_proposals import CandidateRule
    from sketchterrain.sketch.document import Sketch

_EXTENTS, _RADII = 0.4, 2.0  # around the sketch: as far as rivers run on, and what reaches them there
_MOST_CANDIDATES = 6000


@dataclass(frozen=True)
class HomeMemory:
    """Candidates around the sketch, and which of them have room, by what these depend on."""

    answers: LRUCache = field(default_factory=lambda: LRUCache(128))


def cached_bounds(
    sketch: Sketch, proposals: Sequence[CandidateRule]
) -> tuple[float, float, float, float] | None:
    """Return the rectangle (west, south, east, north, m) worth keeping; None if too many stand in it."""
    east, north = sketch.size
    wide = _EXTENTS * sketch.extent + _RADII * max((each.high for each in proposals), default=0.0)
    rate = sum(each.per_cell / (each.cell * each.cell) for each in proposals)
    if (east + 2.0 * wide) * (north + 2.0 * wide) * rate > _MOST_CANDIDATES:
        return None
    return -wide, -wide, east + wide, north + wide
