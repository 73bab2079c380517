"""Python's search for garbage, on the window's thread alone: elsewhere it would take Qt's objects apart."""

from __future__ import annotations

import gc
from typing import Final

from PyQt6.QtCore import QObject, QTimer

__all__ = ["Garbage"]

_OFTEN: Final = 2000
"""ms between two looks."""
_OLD_EVERY: Final = 30
"""Looks, after which what is old is searched, too."""


class Garbage(QObject):
    """Searches for garbage from time to time, for as long as it lives.

    What is there when it is made is left out of every search: of the whole program that takes a tenth of a
    second, and the window would stall.
    """

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._looks = 0
        gc.disable()
        gc.collect()
        gc.freeze()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._timer.start(_OFTEN)

    def end(self) -> None:
        """Leave it to Python again."""
        self._timer.stop()
        gc.unfreeze()
        gc.enable()

    def _look(self) -> None:
        self._looks += 1
        gc.collect(2 if self._looks % _OLD_EVERY == 0 else 1)
