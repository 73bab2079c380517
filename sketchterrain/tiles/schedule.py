"""How many tiles fit into a span of time: what they cost is learnt as they are made."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError

if TYPE_CHECKING:
    from sketchterrain.tiles.codes import Codes

__all__ = ["CostModel"]

_FIRST_GUESS: Final = (0.0005, 0.0005, 0.0005)
"""s a batch, s a level and s a tile, before anything is known."""
_REMEMBERED: Final = 64
_CAUTION: Final = 0.97
"""Share of what was remembered that stayed below what is planned with."""
_LEAST: Final = 1e-6
"""s."""


class CostModel:
    """Time of a batch: so much for itself, for each level in it and for each tile.

    That is fitted to what the last batches took, by relative errors; plans allow for all but the slowest few
    of those.
    """

    def __init__(self) -> None:
        self._batch, self._level, self._tile = _FIRST_GUESS
        self._seen: deque[tuple[int, int, float]] = deque(maxlen=_REMEMBERED)
        self._slow = 1.0

    def expected(self, levels: int, tiles: int) -> float:
        """Return how many seconds a batch will take."""
        return self._batch + self._level * levels + self._tile * tiles

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
        cost = self._batch + self._level * np.cumsum(new) + self._tile * np.arange(1, len(levels) + 1)
        return max(1, int(np.searchsorted(cost * self._slow, budget, side="right")))

    def learn(self, levels: Codes, seconds: float) -> None:
        """Note what a batch took (s)."""
        self._seen.append((len(np.unique(levels)), len(levels), max(seconds, _LEAST)))
        counts = np.array([(1, *each[:2]) for each in self._seen], np.float64)
        took = np.array([each[2] for each in self._seen])
        # What was known counts as one batch of each kind: batches that are all alike can't tell them apart.
        known = np.diag(1.0 / np.array([self._batch, self._level, self._tile]))
        shares = np.concatenate([counts / took[:, None], known])
        fitted = np.linalg.lstsq(shares, np.ones(len(shares)), rcond=None)[0]
        fitted = np.maximum(fitted, _LEAST)
        self._batch, self._level, self._tile = fitted.tolist()
        self._slow = max(float(np.quantile(took / (counts @ fitted), _CAUTION)), 1.0)
