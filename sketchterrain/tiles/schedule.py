"""Cost model of tile generation, learnt from measured batches: how many tiles fit into a time budget."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Int64Array


_FIRST_GUESS: Final = (0.0005, 0.0005, 0.0005, 0.004)
"""s a batch, a level, a tile and a wide tile, before anything is known."""
_WIDE: Final = -2
"""Tiles of coarser levels are wide: so much of the world takes longer to look through."""
_REMEMBERED: Final = 64
_AIM: Final = 0.8
"""Share of a budget that is planned with."""
_CAUTION: Final = 0.97
"""Share of what was remembered that stayed below what is planned with."""
_LEAST: Final = 1e-6
"""s."""


class CostModel:
    """Seconds of a batch: a constant, and costs per level in it, per tile and per wide tile.

    Fitted to the last batches by relative errors; plans allow for all but the slowest few of them.
    """

    def __init__(self) -> None:
        self._cost = np.array(_FIRST_GUESS)
        self._seen: deque[tuple[npt.NDArray[np.float64], float]] = deque(maxlen=_REMEMBERED)
        self._slow = 1.0

    def expected(self, levels: Int64Array) -> float:
        """Return the expected seconds of a batch of tiles of these levels."""
        return float(_counts(levels)[-1] @ self._cost) if len(levels) else 0.0

    def count_within(self, levels: Int64Array, budget: float) -> int:
        """Return how many of the first tiles fit into a budget (s); at least one unless it is 0."""
        if not budget >= 0:
            raise InputError(f"expected a budget ≥ 0 s, got {budget:g}")
        if budget == 0 or not len(levels):
            return 0
        seconds = _counts(levels) @ self._cost * self._slow
        return max(1, int(np.searchsorted(seconds, _AIM * budget, side="right")))

    def record(self, levels: Int64Array, seconds: float) -> None:
        """Record the seconds that a batch took."""
        self._seen.append((_counts(levels)[-1], max(seconds, _LEAST)))
        counts = np.stack([each for each, _ in self._seen])
        took = np.array([each for _, each in self._seen])
        # What was known counts as one batch of each kind: batches that are all alike can't tell them apart.
        shares = np.concatenate([counts / took[:, None], np.diag(1.0 / self._cost)])
        fitted = np.linalg.lstsq(shares, np.ones(len(shares)), rcond=None)[0]
        self._cost = np.maximum(fitted, _LEAST)
        self._slow = max(float(np.quantile(took / (counts @ self._cost), _CAUTION)), 1.0)


def _counts(levels: Int64Array) -> npt.NDArray[np.float64]:
    """Return batches, levels, tiles and wide tiles among the first 1, 2, … n tiles: (n, 4)."""
    _, first = np.unique(levels, return_index=True)
    new = np.zeros(len(levels))
    new[first] = 1
    one = np.ones(len(levels))
    wide = np.asarray(levels) < _WIDE
    return np.stack([one, np.cumsum(new), np.cumsum(one), np.cumsum(wide)], axis=1)
