"""The hand that does not tremble: places told in whole pixels of a screen, as a calmer path."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sketchterrain.ui.painting.shapes import Dab, snapped

_SPACING = 2.0  # grains between nodes
_FARTHEST = 0.5  # of that: how far a node is moved to where its neighbours have it


class SteadyHand:
    """Turns the places of a pen into fewer nodes of its path.

    A slow pen's places are averaged, and each node is moved a little to the middle of its neighbours: a line
    drawn through whole pixels trembles less than half as much then. A quick pen's places stay where they are,
    but for a pixel of the screen.

    Parameters
    ----------
    grain
        Side (px) of the pixels in which places are told; 0: they are exact, and each is a node.
    """

    def __init__(self, grain: float) -> None:
        self._spacing = _SPACING * grain
        self._seen: list[Dab] = []
        self._nodes: list[Dab] = []
        self._anchor: Dab | None = None

    def to(self, place: Dab) -> Dab | None:
        """Go on to a place; return the next node of the path, if one is known now."""
        if self._anchor is None:
            self._anchor = place
            self._nodes = [place]
            return place
        self._seen.append(place)
        way = math.dist(place[:2], self._anchor[:2])
        if way == 0.0 or way < self._spacing:
            return None
        self._anchor = place
        node = _mean(self._seen)
        self._seen = []
        if not self._spacing:
            return node
        self._nodes = [*self._nodes[-2:], node]
        return self._calmed() if len(self._nodes) == 3 else None

    def finish(self) -> list[Dab]:
        """Return the last nodes; the path ends where the pen is."""
        place = self._seen[-1] if self._seen else self._anchor
        if place is None or not self._spacing:
            return []
        self._nodes = [*self._nodes[-2:], place]
        return [self._calmed(), place] if len(self._nodes) == 3 else [place]

    def _calmed(self) -> Dab:
        """Return the middle one of three nodes, moved."""
        (ax, ay, _), (x, y, radius), (bx, by, _) = self._nodes
        dx, dy = 0.25 * (ax + bx) - 0.5 * x, 0.25 * (ay + by) - 0.5 * y
        share = min(1.0, _FARTHEST * self._spacing / max(math.hypot(dx, dy), 1e-9))
        return snapped(x + share * dx), snapped(y + share * dy), radius


def _mean(dabs: Sequence[Dab]) -> Dab:
    if len(dabs) == 1:
        return dabs[0]
    x, y, radius = (snapped(sum(each) / len(dabs)) for each in zip(*dabs, strict=True))
    return x, y, radius
