"""A scheduler of dask.distributed, as a world's tasks need it; what is wrong with it is told in one line."""

from __future__ import annotations

import asyncio
import socket
import time
import warnings
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit
from uuid import uuid4

from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.world import worker as done_there
from sketchterrain.world.order import called
from sketchterrain.world.roster import Seen

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Connection", "check_scheduler", "connected_to"]

_SCHEMES = ("tcp", "tls")
_TIMEOUT = 10.0  # s that a scheduler may take to answer
_PAUSE = 0.1  # s between two looks at who is still at work
_WAITING = 60.0  # s that running tasks may take to end


def connected_to(address: str, *, note: Callable[[str], None]) -> Any:
    """Return a client of a scheduler; whoever gets it closes it.

    Parameters
    ----------
    address
        ``tcp://HOST:PORT`` or ``tls://HOST:PORT``; certificates are those of dask's configuration.
    note
        Told if versions of Python or dask differ.

    Raises
    ------
    InputError
        If that is no address.
    SketchterrainError
        If there is no scheduler, or it does not answer.
    """
    from distributed import Client

    # A client that cannot connect is hard to be rid of; so it is made where one can.
    if not address.startswith("inproc://"):
        check_scheduler(address)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        client = Client(address, timeout=_TIMEOUT, set_as_default=False)
    if any("VersionMismatch" in each.category.__name__ for each in caught):
        note(f"scheduler {address} or its workers have other versions of Python or dask than this process")
    return client


def check_scheduler(address: str) -> None:
    """Find out whether a scheduler is there.

    Parameters
    ----------
    address
        As for :func:`connected_to`.

    Raises
    ------
    InputError
        If that is no address.
    SketchterrainError
        If there is no scheduler, or it does not answer.
    """
    _check_address(address)
    _check_answer(address)


def _check_address(address: str) -> None:
    expected = f"expected a scheduler's address such as tcp://HOST:8786, got {one_line(address)!r}"
    try:
        parts = urlsplit(address)
        port = parts.port
    except ValueError as error:
        raise InputError(expected) from error
    if parts.scheme not in _SCHEMES or not parts.hostname or port is None:
        raise InputError(expected)


def _check_answer(address: str) -> None:
    """Ask whoever is there what it is, without a client."""
    parts = urlsplit(address)
    told = f"scheduler {address} cannot be reached"
    try:
        # The library would try again until its time is over.
        with socket.create_connection((parts.hostname, parts.port), timeout=_TIMEOUT):
            pass
        answer = asyncio.run(asyncio.wait_for(_identity(address), _TIMEOUT))
    except socket.gaierror as error:
        raise SketchterrainError(f"{told}: no machine is known as {parts.hostname}") from error
    except ConnectionRefusedError as error:
        raise SketchterrainError(f"{told}: nothing listens there") from error
    except TimeoutError as error:
        raise SketchterrainError(f"{told}: no answer within {_TIMEOUT:.0f} s") from error
    except Exception as error:  # whatever comes of another protocol's answer
        lacks = parts.scheme == "tls" and isinstance(error, TypeError)
        reason = "dask's configuration names no certificates" if lacks else "what listens there is none"
        raise SketchterrainError(f"{told}: {reason}") from error
    if answer.get("type") != "Scheduler":
        raise SketchterrainError(f"{told}: a dask {str(answer.get('type')).lower()} is there")


async def _identity(address: str) -> dict[str, Any]:
    from distributed.core import rpc
    from distributed.security import Security

    arguments = Security().get_connection_args("client")
    async with rpc(address, timeout=_TIMEOUT, connection_args=arguments) as there:
        answer: dict[str, Any] = await there.identity()
        return answer


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
        self._paused: dict[str, float] = {}
        self.order = f"sketchterrain-{uuid4().hex}"

    def post(self, order: dict[str, Any]) -> None:
        """Let the scheduler keep what its workers ask for."""
        self._ask(self._client.scheduler.set_metadata, keys=[self.order], value=order)

    def workers(self) -> dict[str, Seen]:
        """Return the workers that take tasks, by address.

        One without memory may pause for a while, and is back then.

        Raises
        ------
        SketchterrainError
            If the scheduler does not answer.
        """
        told = self._ask(self._client.scheduler.identity, n_workers=-1)["workers"]
        now = time.monotonic()
        paused = [address for address, each in told.items() if each["status"] == "paused"]
        self._paused = {address: self._paused.get(address, now) for address in paused}
        return {
            address: Seen(called(each["name"]), str(each["host"]))
            for address, each in told.items()
            if each["status"] in ("running", "paused") and now - self._paused.get(address, now) < _WAITING
        }

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
            leaving = {worker: self.submit(done_there.leave, worker=worker) for worker in there}
            until = time.monotonic() + _WAITING
            while leaving and time.monotonic() < until:
                time.sleep(_PAUSE)
                there = list(self.workers())
                leaving = {each: left for each, left in leaving.items() if each in there and not left.done()}
            self.cancel(list(leaving.values()))
        self._ask(self._client.scheduler.set_metadata, keys=[self.order], value=None)

    def _ask(self, what: Callable[..., Any], **named: Any) -> Any:
        try:
            return self._client.sync(what, **named, callback_timeout=_TIMEOUT)
        except (OSError, TimeoutError) as error:
            raise SketchterrainError(f"{self.told} does not answer any more") from error
