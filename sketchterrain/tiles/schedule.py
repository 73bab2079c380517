"""How many tiles fit into a span of time: what they cost is learnt as they are made."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError

if TYPE_CHECKING:
    from sketchterrain.tiles.codes import Codes

__all__ = ["CostModel"]

_FIRST_GUESS: Final = (0.001, 0.0005)
"""s a level and s a tile, before anything is known."""
_REMEMBERED: Final = 64
_CAUTION: Final = 0.97
"""Share of what was remembered that stayed below what is planned with."""
_LEARNING: Final = 0.1


class CostModel:
    """Time of a batch: so much for each level in it, and so much for each tile.

    Both are scaled by what batches took; plans allow for all but the slowest few of the last ones.
    """

    def __init__(self) -> None:
        self._level, self._tile = _FIRST_GUESS
        self._ratios: deque[float] = deque([1.0], maxlen=_REMEMBERED)

    def expected(self, levels: int, tiles: int) -> float:
        """Return how many seconds a batch will take."""
        return self._level * levels + self._tile * tiles

    def fitting(self, levels: Codes, budget: float) -> int:
        """Return how many tiles, in their order, fit into a budget.

        Parameters
        ----------
        levels
            Of the tiles, (n,).
        budget
            s; at least one tile is made whatever it is, unless it is 0.

        Raises
        ------
        InputError
            If the budget is negative or no number.
        """
        if not budget >= 0:
            raise InputError(f"expected a budget ≥ 0 s, got {budget:g}")
        if budget == 0 or not len(levels):
            return 0
        _, first = np.unique(levels, return_index=True)
        new = np.zeros(len(levels))
        new[first] = 1
        cost = self._level * np.cumsum(new) + self._tile * np.arange(1, len(levels) + 1)
        slow = float(np.quantile(self._ratios, _CAUTION))
        return max(1, int(np.searchsorted(cost * slow, budget, side="right")))

    def learn(self, levels: Codes, seconds: float) -> None:
        """Note what a batch took (s)."""
        count = len(np.unique(levels))
        ratio = seconds / self.expected(count, len(levels))
        self._ratios.append(ratio)
        # Downward as upward: what is remembered of ratios moves along.
        step = float(np.exp(_LEARNING * np.log(max(ratio, 1e-3))))
        self._level, self._tile = self._level * step, self._tile * step
        self._ratios = deque((each / step for each in self._ratios), maxlen=_REMEMBERED)
