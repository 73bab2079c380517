"""Chunks of a stored world that were unpacked lately, so that windows near each other unpack each once."""

from __future__ import annotations

from collections import OrderedDict
from threading import Lock
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    import numpy.typing as npt

__all__ = ["ROOM", "ChunkCache"]

ROOM: Final = 192 << 20
"""Bytes of unpacked chunks that a reader keeps, if nothing else is said."""


class ChunkCache:
    """Arrays by key; the one not asked for the longest time is forgotten first. For any number of threads.

    Parameters
    ----------
    room
        Bytes that they may take together.
    """

    def __init__(self, room: int) -> None:
        self._room = room
        self._taken = 0
        self._held: OrderedDict[Hashable, npt.NDArray[Any]] = OrderedDict()
        self._lock = Lock()

    @property
    def taken(self) -> int:
        """Bytes that are held."""
        return self._taken

    def get(self, key: Hashable, make: Callable[[], npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """Return the array of a key, made if it is not held; two threads may both make it.

        What `make` raises is raised, and nothing is held then.
        """
        with self._lock:
            found = self._held.get(key)
            if found is not None:
                self._held.move_to_end(key)
                return found
        made = make()
        with self._lock:
            old = self._held.pop(key, None)
            self._taken += made.nbytes - (0 if old is None else old.nbytes)
            self._held[key] = made
            while self._taken > self._room and len(self._held) > 1:
                self._taken -= self._held.popitem(last=False)[1].nbytes
        return made
