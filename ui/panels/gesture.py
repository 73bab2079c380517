"""Which changes are one step of the history: those of a drag, or of keys in quick succession."""

from __future__ import annotations

import time

_PAUSE = 0.8
"""s after which another press of a key is a step of its own."""


class Gesture:
    """Keys by which `Document.do` tells one change from the next."""

    def __init__(self) -> None:
        self._key = object()
        self._held = False
        self._last = 0.0

    def begin(self) -> None:
        """Begin a drag: all until `end` is one step."""
        self._key, self._held = object(), True

    def end(self) -> None:
        """End the drag."""
        self._held, self._last = False, 0.0

    @property
    def key(self) -> object:
        """The key of a change that is made now."""
        now = time.monotonic()
        if not self._held and now - self._last > _PAUSE:
            self._key = object()
        self._last = now
        return self._key
