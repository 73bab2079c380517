"""A world's tasks done by the workers of a cluster: this machine's, or those of a scheduler elsewhere."""

from __future__ import annotations

import os
from contextlib import ExitStack
from typing import TYPE_CHECKING, Self
from uuid import uuid4

from sketchterrain.errors import DeviceError
from sketchterrain.world.forms import store_of
from sketchterrain.world.libraries import require
from sketchterrain.world.roster import Roster

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from sketchterrain.world.dispatch import Dispatch
    from sketchterrain.world.job import Job
    from sketchterrain.world.local_workers import LocalWorkers
    from sketchterrain.world.made import Made, Task

__all__ = ["ClusterCrew"]

_CLOSING = 10.0  # s that leaving a scheduler may take
_LIBRARY = "distributed"


class ClusterCrew:
    """Does tasks in the workers of dask.distributed, each with a device of its own; a context manager.

    Workers are checked before they get a task: they must run the same program, see the output's folder, pass
    the self-test, and compute the same bits of this very world as this machine does.

    Parameters
    ----------
    job
    workers
        How many processes to start on this machine.
    scheduler
        Address of a scheduler, instead.
    device
        Selector as for :func:`~sketchterrain.compute.choose_device`; None: each worker takes its own.
    note
        Told a line where something went wrong that does not end the work.
    stopped
        Tells whether what is begun is to be the last.

    Raises
    ------
    SketchterrainError
        If dask.distributed is not installed.
    """

    def __init__(
        self,
        job: Job,
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        device: str | None = None,
        note: Callable[[str], None],
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        require("more than one process", [_LIBRARY])
        self._job, self._device, self._note = job, device, note
        self._workers, self._scheduler, self._stopped = workers, scheduler, stopped
        self._stack = ExitStack()
        self._dispatch: Dispatch | None = None

    def __enter__(self) -> Self:
        """Find or start the workers; the output's folder must be there.

        Raises
        ------
        SketchterrainError
            If the scheduler cannot be reached, or workers cannot be started.
        """
        with ExitStack() as stack:
            self._dispatch = self._opened(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Wait until no worker writes any more, and end those that were started."""
        self._stack.close()

    def make(self, tasks: Iterable[Task]) -> Iterator[Made]:
        """Do tasks, each worker as many at once as suits it; none are taken ahead.

        Raises
        ------
        DeviceError
            If no worker is left.
        SketchterrainError
            If the scheduler is gone, a task cannot be done, or no worker comes.
        """
        if self._dispatch is None:
            raise RuntimeError("the crew is not entered")
        yield from self._dispatch.run(Roster(tasks))

    def _opened(self, stack: ExitStack) -> Dispatch:
        from sketchterrain.world.dispatch import Dispatch
        from sketchterrain.world.order import packed
        from sketchterrain.world.quiet import quiet
        from sketchterrain.world.scheduler import Connection, connected_to

        stack.enter_context(quiet())
        local = self._started(stack) if self._scheduler is None else None
        if local is not None:
            address, told, reason = local.address, "the scheduler in this process", local.told
        else:
            address, told, reason = str(self._scheduler), f"scheduler {self._scheduler}", _unknown
        client = connected_to(address, note=self._note)
        stack.callback(client.close, timeout=_CLOSING)
        connection = Connection(client, told)
        text = uuid4().hex
        token = store_of(self._job).journal.with_name(f".{connection.order}")
        stack.callback(token.unlink, missing_ok=True)
        token.write_text(text, encoding="utf-8")
        order = packed(self._job, token=str(token), text=text, device=self._device)
        dispatch = Dispatch(
            connection, order, bits=self._bits(), note=self._note, stopped=self._stopped, reason=reason
        )
        stack.callback(dispatch.end)
        return dispatch

    def _started(self, stack: ExitStack) -> LocalWorkers:
        from sketchterrain.world.local_workers import local_workers

        count = self._workers or 1
        return stack.enter_context(local_workers(count, threads=_threads(count)))

    def _bits(self) -> str | None:
        """Return the bits of some of the ground on this machine; None where the first worker's count."""
        from sketchterrain.compute import ComputeContext, choose_device, is_usable, list_devices
        from sketchterrain.world.making import Maker
        from sketchterrain.world.worker_checks import bits_of

        try:
            known = (device for device in list_devices() if device.known and is_usable(device))
            device = next(known, None) or choose_device(self._device)
            return bits_of(Maker(self._job, ComputeContext(device)))
        except DeviceError as error:
            self._note(f"the first worker's bits count, for here is no device to compare with: {error}")
            return None


def _threads(workers: int) -> int:
    """Return how many tasks each worker of this machine takes at once.

    A CPU device leaves no core to write beside it; a GPU does.
    """
    from sketchterrain.compute import list_devices

    if all(device.type != "GPU" for device in list_devices()):
        return 1
    return max(1, min(8, (os.cpu_count() or 1) // workers))


def _unknown() -> str:
    return ""
