"""Memory for pictures that two processes see: one is drawn into while another is shown."""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
from typing import Final

__all__ = ["PLACES", "FrameMemory"]

PLACES: Final = 2
"""Pictures that the memory holds."""
_GRAIN: Final = 1 << 20  # bytes; sizes are rounded up to it, so that a window that is resized asks rarely


class FrameMemory:
    """A nameless file in memory, mapped; it is gone with the last process that has it open.

    Parameters
    ----------
    number
        File descriptor of the memory that another process made; None makes one.
    """

    def __init__(self, number: int | None = None) -> None:
        self.number = _nameless() if number is None else number
        self._map: mmap.mmap | None = None

    def place(self, index: int, nbytes: int) -> tuple[int, int]:
        """Make room for pictures of a size (bytes); return where the place begins, and bytes in all."""
        each = -(-nbytes // _GRAIN) * _GRAIN
        capacity = PLACES * each
        if os.fstat(self.number).st_size < capacity:
            os.ftruncate(self.number, capacity)
        return index * each, os.fstat(self.number).st_size

    def view(self, start: int, nbytes: int, capacity: int) -> memoryview:
        """Return bytes of the memory, of which there are `capacity`; it must be released after use."""
        if self._map is None or len(self._map) < capacity:
            self._unmap()
            self._map = mmap.mmap(self.number, capacity)
        return memoryview(self._map)[start : start + nbytes]

    def close(self) -> None:
        """Give it back; nothing of it may be in use."""
        self._unmap()
        os.close(self.number)

    def _unmap(self) -> None:
        if self._map is not None:
            self._map.close()
            self._map = None


def _nameless() -> int:
    if sys.platform == "linux":
        return os.memfd_create("frames")
    else:  # noqa: RET505 # mypy knows only branches to belong to a platform
        with tempfile.TemporaryFile() as file:
            return os.dup(file.fileno())
