"""How much a launch takes: as much as allowed, and less where the device has no room."""

from __future__ import annotations

from collections.abc import Callable

from sketchterrain.errors import DeviceMemoryError


class Batches:
    """Work on many things, some at once.

    Parameters
    ----------
    most : int
        How many at once, at first. Each time the device has no room it is halved, and stays so.
    """

    def __init__(self, most: int) -> None:
        self.most = most

    def run(
        self, count: int, work: Callable[[slice], None], *, smaller: Callable[[], None] | None = None
    ) -> None:
        """Do the work on all of ``count`` things, in order.

        Parameters
        ----------
        count
        work
            Takes a slice of them; it is called again for a smaller one where it raised DeviceMemoryError.
        smaller
            Called before that, to give back what was allocated for larger batches.

        Raises
        ------
        DeviceMemoryError
            If not even one has room.
        """
        first = 0
        while first < count:
            end = min(first + self.most, count)
            try:
                work(slice(first, end))
            except DeviceMemoryError as error:
                if end - first == 1:
                    raise DeviceMemoryError(f"{error}; the smallest batch has no room either") from error
                self.most = (end - first) // 2
            else:
                first = end
                continue
            # Not in the handler: the error would keep the work's buffers alive.
            if smaller is not None:
                smaller()
