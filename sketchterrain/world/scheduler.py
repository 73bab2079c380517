"""A scheduler of dask.distributed, as a world's tasks need it; what is wrong with it is told in one line."""

from __future__ import annotations

import time
import warnings
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.world import worker as done_there
from sketchterrain.world.roster import Seen

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Connection", "connected_to"]

_TIMEOUT = 10.0  # s that a scheduler may take to answer
_WAITING = 60.0  # s that running tasks may take to end


def connected_to(address: str, *, note: Callable[[str], None]) -> Any:
    """Return a client of a scheduler; whoever gets it closes it.

    Raises
    ------
    SketchterrainError
        If there is none, or it does not answer.
    """
    from distributed import Client

    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            client = Client(address, timeout=_TIMEOUT, set_as_default=False)
    except ValueError as error:
        raise SketchterrainError(
            f"expected a scheduler's address such as tcp://HOST:8786, got {address!r}"
        ) from error
    except (OSError, TypeError, KeyError, AttributeError) as error:
        told = "nothing answers there" if isinstance(error, TimeoutError | OSError) else one_line(error)
        raise SketchterrainError(f"scheduler {address} cannot be reached: {told}") from error
    if any("Mismatch" in each.category.__name__ for each in caught):
        note(f"scheduler {address} or its workers run other versions of Python or dask than this process")
    return client


class Connection:
    """What is asked of a scheduler.

    Parameters
    ----------
    client : distributed.Client
    told : str
        The scheduler, as people are told of it.

    Attributes
    ----------
    order : str
        What the scheduler knows the work by.
    """

    def __init__(self, client: Any, told: str) -> None:
        self._client, self.told = client, told
        self._number = 0
        self.order = f"sketchterrain-{uuid4().hex}"

    def post(self, order: dict[str, Any]) -> None:
        """Let the scheduler keep what its workers ask for."""
        self._ask(self._client.scheduler.set_metadata, keys=[self.order], value=order)

    def workers(self) -> dict[str, Seen]:
        """Return the workers that there are, by address.

        Raises
        ------
        SketchterrainError
            If the scheduler does not answer.
        """
        told = self._ask(self._client.scheduler.identity, n_workers=-1)["workers"]
        return {address: Seen(str(each["name"]), str(each["host"])) for address, each in told.items()}

    def submit(self, work: Callable[..., Any], *given: Any, worker: str) -> Any:
        """Have a function of :mod:`sketchterrain.world.worker` called in one worker; return the future."""
        self._number += 1
        return self._client.submit(
            work,
            self.order,
            *given,
            key=(self.order, self._number),
            workers=[worker],
            allow_other_workers=False,
            pure=False,
        )

    def result(self, future: Any) -> object:
        """Return what came of a future; None if that is lost."""
        if future.status != "finished":
            return None
        try:
            found: object = future.result(timeout=_TIMEOUT)
        except (OSError, TimeoutError, CancelledError):
            return None
        return found

    def cancel(self, futures: list[Any]) -> None:
        """Begin nothing of what was submitted, and tell nothing of it."""
        if futures:
            self._client.cancel(futures, force=True)

    def end(self) -> None:
        """Have workers give up what they do, and wait until they write nothing any more.

        Raises
        ------
        SketchterrainError
            If the scheduler does not answer.
        """
        there = list(self.workers())
        if there:
            self._client.run(done_there.stop, self.order, workers=there, on_error="ignore")
            leaving = [self.submit(done_there.leave, worker=worker) for worker in there]
            until = time.monotonic() + _WAITING
            while time.monotonic() < until and not all(each.done() for each in leaving):
                time.sleep(0.05)
        self._ask(self._client.scheduler.set_metadata, keys=[self.order], value=None)

    def _ask(self, what: Callable[..., Any], **named: Any) -> Any:
        try:
            return self._client.sync(what, **named, callback_timeout=_TIMEOUT)
        except (OSError, TimeoutError) as error:
            raise SketchterrainError(f"{self.told} does not answer any more") from error
