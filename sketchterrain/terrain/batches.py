"""Batch sizes that shrink when the device is out of memory."""

from __future__ import annotations

from collections.abc import Callable

from sketchterrain.errors import DeviceMemoryError


class Batches:
    """Process items in slices of at most ``limit``, halved for good each time the device is out of memory."""

    def __init__(self, limit: int) -> None:
        self.limit = limit

    def run(
        self, count: int, work: Callable[[slice], None], *, on_shrink: Callable[[], None] | None = None
    ) -> None:
        """Call ``work`` on slices of ``count`` items in order, retrying smaller ones after DeviceMemoryError.

        ``on_shrink`` is called in between to release larger allocations. A batch of one that fails is an
        error.
        """
        first = 0
        while first < count:
            end = min(first + self.limit, count)
            try:
                work(slice(first, end))
            except DeviceMemoryError as error:
                if end - first == 1:
                    raise DeviceMemoryError(f"{error}; not even a batch of one fits") from error
                self.limit = (end - first) // 2
            else:
                first = end
                continue
            # Not in the handler: the error would keep the work's buffers alive.
            if on_shrink is not None:
                on_shrink()
