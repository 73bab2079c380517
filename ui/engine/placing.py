"""When placing a sketch is given up for a newer one, and when it is not."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Abandoned", "Patience"]

SHORT: Final = 0.1
"""s; work that will probably be done sooner is finished in any case."""


class Abandoned(Exception):  # noqa: N818 # nothing is wrong
    """There is a newer sketch to place."""


class Patience:
    """Decides whether to go on placing when something newer waits.

    Whoever paints without a pause must see the terrain follow: of two attempts in a row one is finished, and
    so is what is more than half done, by what the last one took.

    Parameters
    ----------
    newer
        Whether a newer sketch waits.
    """

    def __init__(self, newer: Callable[[], bool]) -> None:
        self._newer = newer
        self._usual = 0.0
        self._begun = 0.0
        self._given_up = False

    def begin(self) -> None:
        """Begin to place a sketch."""
        self._begun = time.monotonic()

    def checkpoint(self) -> None:
        """Go on, or raise.

        Raises
        ------
        Abandoned
            If what is being placed shall not be finished.
        """
        spent = time.monotonic() - self._begun
        if self._given_up or spent > 0.5 * self._usual or self._usual - spent < SHORT:
            return
        if self._newer():
            self._given_up = True
            raise Abandoned

    def end(self) -> float:
        """Remember how long it took; return it, s."""
        self._usual = time.monotonic() - self._begun
        self._given_up = False
        return self._usual
