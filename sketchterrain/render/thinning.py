"""Which plants stay far away, where all of them would be too many to draw or to see.

A plant's whim is the share of plants that go before it does: all of a level of the Poisson-disk sets before
those of the next, within a level by chance. So whatever stays is spread evenly. Of plants n times as small
one in n² is kept, as many in each part of the picture; those grow wider, to cover what all covered.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import FloatArray


LEVELS_KEEP: Final = 0.25
"""Share of a level's plants that are of a higher one: as many as stand at twice the distance."""
TALL: Final = 12.0
"""m, of a plant that counts as large as it is; lower ones count for more, higher ones for less."""
LONE: Final = 1.5
"""By how much more a plant counts that stands alone: nothing covers its place when it goes."""
SOFT: Final = 0.15
"""Share of the distance at which a plant goes over which it does."""
WIDEST: Final = 1.8
"""Times its own width that a plant is drawn at most."""
FILL: Final = 0.85
"""Of the budget, what is aimed at: the rest is for what comes while the scale follows."""
PACE: Final = 0.8
"""s in which the scale covers two thirds of its way."""
STEP: Final = 0.8
"""The scale falls to no less of itself in a frame: plants that come then are looked for only so far."""
NEAR: Final = 1e-3
"""Share by which the scale may be off when it has arrived."""


def whim_of(level: npt.NDArray[np.integer], chance: FloatArray) -> npt.NDArray[np.float64]:
    """Return the share of plants, 0..1, that go before plants of some levels do.

    Parameters
    ----------
    level
        (n,) of the Poisson-disk sets, a quarter of the plants in each set are in the next.
    chance
        (n,) 0..1, decides within a level.
    """
    return 1.0 - LEVELS_KEEP ** level.astype(np.float64) * (1.0 - (1.0 - LEVELS_KEEP) * chance)


def bulk_of(tall: FloatArray, crowding: FloatArray) -> npt.NDArray[np.float64]:
    """Return how large plants count (m), by their heights (m) and how much others crowd them (0..1)."""
    return np.asarray(np.sqrt(tall * TALL) * (1.0 + LONE * (1.0 - crowding)), np.float64)


def hold_of(bulk: FloatArray, whim: FloatArray) -> npt.NDArray[np.float64]:
    """Return at what distance (m) plants go if those of whim 0 go where their bulk is 1 rad."""
    return np.asarray(bulk / np.sqrt(np.maximum(1.0 - whim, 1e-9)), np.float64)


def share_of(hold: FloatArray, away: FloatArray, angle: float) -> npt.NDArray[np.float64]:
    """Return how much of plants is there, 0..1, where those of whim 0 go at an angle (rad) of their bulk."""
    return np.clip((hold / (np.maximum(away, 1.0) * angle) - 1.0) / SOFT, 0.0, 1.0)


def width_of(bulk: FloatArray, away: FloatArray, angle: float) -> npt.NDArray[np.float64]:
    """Return how many times as wide plants are that stay, so that they cover what all did."""
    return np.clip(np.maximum(away, 1.0) * angle / bulk, 1.0, WIDEST)


class Thinning:
    """The angle of a plant's bulk below which it may go: what is asked for, more where a budget needs it.

    It follows what is in view softly, so that no crowd of plants comes or goes at once.

    Parameters
    ----------
    most
        Instances that may be drawn.

    Attributes
    ----------
    angle : float
        rad; 0 before the first view.
    settled : bool
        Whether it is where the last view wants it.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self.angle = 0.0
        self.settled = False

    def floor(self, least: float, *, still: bool) -> float:
        """Return the angle (rad), `least` or more, under which no plants need to be looked for."""
        return least if still else max(least, STEP * self.angle)

    def follow(
        self, held: FloatArray, copies: npt.NDArray[np.integer], *, least: float, elapsed: float | None
    ) -> None:
        """Go on to what a view needs.

        Parameters
        ----------
        held
            (n,) rad, holds over distances of all plants in view that are above the floor of `least`.
        copies
            (n,) how many instances each of them is drawn as.
        least
            rad, the angle wherever the budget allows it.
        elapsed
            s since the last view; None: be there at once.
        """
        still = elapsed is None or self.angle == 0.0
        floor = self.floor(least, still=still)
        aimed, allowed = _fitting(held, copies, [FILL * self._most, self._most])
        wanted = max(aimed, floor)
        if elapsed is None or still:
            self.angle, self.settled = wanted, True
            return
        angle = wanted + (self.angle - wanted) * float(np.exp(-elapsed / PACE))
        arrived = abs(angle - wanted) < NEAR * wanted
        self.settled = arrived and (wanted > floor or floor == least)
        self.angle = max(wanted if arrived else angle, allowed)


def _fitting(held: FloatArray, copies: npt.NDArray[np.integer], budgets: list[float]) -> list[float]:
    """Return the angles above which no more instances are than budgets, rising ones, allow; 0 for all."""
    most = int(budgets[-1])
    if copies.sum() <= budgets[0]:
        return [0.0] * len(budgets)
    if len(held) > most + 1:  # each plant is an instance at least
        first = np.argpartition(-held, most)[: most + 1]
        held, copies = held[first], copies[first]
    order = np.argsort(-held, kind="stable")
    kept = np.searchsorted(np.cumsum(copies[order]), np.floor(budgets), side="right")
    angles = np.append(held[order], 0.0)[kept]
    return [float(angle) for angle in angles]
