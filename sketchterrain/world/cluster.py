"""Tasks run by the workers of dask.distributed: this machine's, or those of a scheduler elsewhere."""

import asyncio
import logging
import os
import socket
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, suppress
from typing import Any, Final, Self
from urllib.parse import urlsplit
from uuid import uuid4

import dask
from distributed import Client, LocalCluster, as_completed
from distributed.core import rpc
from distributed.protocol.pickle import dumps
from distributed.scheduler import KilledWorker
from distributed.security import Security

from sketchterrain.app.console import DEBUG
from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import choose_device, list_devices
from sketchterrain.compute.device_check import is_usable
from sketchterrain.errors import DeviceError, InputError, SketchterrainError, one_line
from sketchterrain.world.job import Job, Task, TaskResult
from sketchterrain.world.store import store_of
from sketchterrain.world.task_runner import TaskRunner
from sketchterrain.world.worker import WorkerSetup, bits_of, run_task

_TIMEOUT: Final = 10.0  # s that a scheduler may take to answer
_ENDING: Final = 60.0  # s that running tasks may take to end
_LOOK: Final = 1.0  # s between two looks at the workers
_PAUSE: Final = 0.02  # s between two looks at finished tasks
_PATIENCE: Final = 300.0  # s without an accepted worker
_RETRIES: Final = 2  # of a task that failed
_LOCAL: Final = {
    "distributed.scheduler.allowed-failures": 10,  # workers that die at one task
    "distributed.worker.profile.enabled": False,
    "distributed.worker.use-file-locking": False,
}


class ClusterExecutor:
    """Runs tasks in the workers of a scheduler, each with a device of its own; a context manager.

    Each worker is checked by :class:`~sketchterrain.world.worker.WorkerSetup` before it gets a task. No more
    tasks are submitted than accepted workers take at once, so a world of any size needs no list of them. The
    tasks of a worker that dies go to others.
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
        self._job, self._device, self._note, self._stopped = job, device, note, stopped
        self._workers, self._scheduler = workers, scheduler
        self._run = f"sketchterrain-{uuid4().hex}"
        self._title = f"scheduler {scheduler}" if scheduler else "the scheduler in this process"
        self._accepted: dict[str, tuple[str, int]] = {}  # names and slots, by address
        self._refused: dict[str, tuple[str, str]] = {}  # names and reasons
        self._events = 0
        self._looked = self._ready = time.monotonic()
        self._pending: set[Any] = set()
        self._cluster: Any = None

    def __enter__(self) -> Self:
        """Find or start the workers; the output's folder must be there."""
        with ExitStack() as stack:
            if not os.environ.get(DEBUG):  # what matters of dask's log is reported in lines of our own
                logging.disable(logging.CRITICAL)
                stack.callback(logging.disable, logging.NOTSET)
                stack.enter_context(warnings.catch_warnings())
                warnings.filterwarnings("ignore", module="(distributed|dask|tornado)")
            self._client = self._connect(stack)
            probe = store_of(self._job).journal.with_name(f".{self._run}")
            stack.callback(probe.unlink, missing_ok=True)
            probe.write_text(self._run, encoding="utf-8")
            self._set_up((str(probe), self._run))
            stack.callback(self._leave)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Wait until no worker writes any more, and end those that were started."""
        self._stack.close()

    def run(self, tasks: Iterable[Task]) -> Iterator[TaskResult]:
        """Yield results in the order in which they come; see `run_world` for the errors."""
        todo, more, completed = iter(tasks), True, as_completed(loop=self._client.loop)
        self._look()
        while more or self._pending:
            if time.monotonic() - self._looked > (_LOOK if self._accepted else _LOOK / 5):
                self._look()
            if self._stopped() and not self._accepted:
                return
            while more and len(self._pending) < sum(slots for _, slots in self._accepted.values()):
                task = next(todo, None)
                if task is None:
                    more = False
                    break
                future = self._client.submit(
                    run_task,
                    self._run,
                    tuple(task),
                    key=(self._run, *task),
                    resources={self._run: 1},
                    retries=_RETRIES,
                )
                self._pending.add(future)
                completed.add(future)
            batch = completed.next_batch(block=False) if self._pending else ()
            for future in batch:
                try:
                    result = self._result(future)
                except TimeoutError:  # the worker died with the result: the task is run again
                    if future.status == "error":
                        raise
                    completed.add(future)
                    continue
                self._pending.discard(future)
                yield result
            if not batch:
                time.sleep(_PAUSE)

    def _result(self, future: Any) -> TaskResult:
        try:
            result: TaskResult = future.result(timeout=_TIMEOUT)
        except KilledWorker as error:
            shard = "{} of shard {},{} of level {}".format(*(future.key[place] for place in (1, 3, 4, 2)))
            raise SketchterrainError(f"{error.allowed_failures + 1} workers died at the {shard}") from error
        except CancelledError as error:
            raise SketchterrainError(f"{self._title} does not answer any more") from error
        except RuntimeError as error:
            if "deserialization of the task graph" not in str(error):
                raise
            raise SketchterrainError(
                f"{self._title} cannot load sketchterrain: it must be installed there, too"
            ) from error
        return result

    def _look(self) -> None:
        """See which workers there are, and which were accepted or refused."""
        if self._cluster is not None:  # also those that died while they started
            self._cluster.scale(self._workers or 1)
        present = self._ask(self._client.scheduler.identity, n_workers=-1)["workers"]
        events = self._ask(self._client.scheduler.events, topic=self._run)
        self._looked = time.monotonic()
        for _, event in events[self._events :]:
            address, name = event["address"], event["name"]
            if event["refused"]:
                self._refuse(address, name, event["refused"])
            else:
                self._accepted[address] = name, event["slots"]
        self._events = len(events)
        for address in self._accepted.keys() - present.keys():
            name, _ = self._accepted.pop(address)
            self._note(f"{name} is lost: its tasks are run again")
        if present and present.keys() <= self._refused.keys():
            reasons = "; ".join(f"{name}: {why}" for name, why in map(self._refused.__getitem__, present))
            raise DeviceError(f"no worker is left: {reasons}")
        self._ready = self._looked if self._accepted else self._ready
        if self._looked - self._ready > _PATIENCE:
            raise SketchterrainError(f"{self._title} has had no worker that is ready for {_PATIENCE:.0f} s")

    def _refuse(self, address: str, name: str, reason: str) -> None:
        self._accepted.pop(address, None)
        self._refused[address] = name, reason
        self._note(f"{name} is refused: {reason}")

    def _ask(self, what: Callable[..., Any], *, timeout: float = _TIMEOUT, **named: Any) -> Any:
        try:
            return self._client.sync(what, **named, callback_timeout=timeout)
        except (OSError, TimeoutError, CancelledError) as error:
            raise SketchterrainError(f"{self._title} does not answer any more") from error

    def _connect(self, stack: ExitStack) -> Any:
        """Return a client of the scheduler, or of one that is started here with its workers."""
        if self._scheduler is None:
            count = self._workers or 1
            try:
                with dask.config.set(_LOCAL):
                    cluster = LocalCluster(
                        n_workers=0,
                        threads_per_worker=_threads(count),
                        memory_limit=None,
                        dashboard_address=None,
                        scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                        silence_logs=logging.CRITICAL + 1,
                        preload="sketchterrain.world.worker",
                    )
            except (OSError, RuntimeError) as error:
                raise SketchterrainError(f"workers cannot be started: {one_line(error)}") from error
            stack.enter_context(suppress(TimeoutError))
            stack.callback(cluster.close, timeout=_TIMEOUT)
            self._cluster = cluster
            address = cluster.scheduler_address
        else:
            address = self._scheduler
            # A client that cannot connect is hard to be rid of; so it is made where one can.
            if not address.startswith("inproc://"):
                check_scheduler(address)
        client = Client(address, timeout=_TIMEOUT, set_as_default=False)
        stack.callback(client.close, timeout=_TIMEOUT)
        return client

    def _set_up(self, probe: tuple[str, str]) -> None:
        """Have all workers checked, now and when they come."""
        # Workers must compute what this machine does, on a device with known bits if there is one.
        known = (device for device in list_devices() if device.known and is_usable(device))
        device = next(known, None) or choose_device(self._device)
        bits = bits_of(TaskRunner(self._job, ComputeContext(device)))
        plugin = WorkerSetup(self._run, self._job, probe=probe, device=self._device, bits=bits)
        answers = self._ask(
            self._client.scheduler.register_worker_plugin,
            timeout=_ENDING,
            plugin=dumps(plugin),
            name=self._run,
            idempotent=False,
        )
        for address, answer in answers.items():
            if answer["status"] != "OK":
                self._refuse(
                    address, address, "it cannot load sketchterrain: it must be installed there, too"
                )

    def _leave(self) -> None:
        """Have no worker do anything more; return once none writes."""
        with suppress(SketchterrainError):
            self._ask(self._client.scheduler.identity, n_workers=0)
            self._client.cancel(list(self._pending), force=True)
            if self._scheduler is not None:
                self._ask(self._client.scheduler.unregister_worker_plugin, timeout=_ENDING, name=self._run)


def check_scheduler(address: str) -> None:
    """Raise an error in one line if there is no scheduler at an address, at once.

    The address is ``tcp://HOST:PORT`` or ``tls://HOST:PORT``; certificates are those of dask's configuration.
    """
    parts, port = None, None
    with suppress(ValueError):
        parts = urlsplit(address)
        port = parts.port
    if parts is None or parts.scheme not in ("tcp", "tls") or not parts.hostname or port is None:
        raise InputError(f"expected a scheduler's address such as tcp://HOST:8786, got {one_line(address)!r}")
    try:
        # dask would try again until its time is over.
        with socket.create_connection((parts.hostname, port), timeout=_TIMEOUT):
            pass
        kind = asyncio.run(asyncio.wait_for(_kind_of(address), _TIMEOUT))
        reason = "" if kind == "Scheduler" else "what answers is no scheduler"
    except OSError as error:
        reason = "no answer" if isinstance(error, TimeoutError) else error.strerror or str(error)
    except Exception:  # noqa: BLE001 - whatever comes of another protocol's answer
        reason = "no dask scheduler answers, or dask's configuration lacks its certificates"
    if reason:
        raise SketchterrainError(f"scheduler {address} cannot be reached: {one_line(reason)}")


async def _kind_of(address: str) -> str:
    arguments = Security().get_connection_args("client")
    async with rpc(address, timeout=_TIMEOUT, connection_args=arguments) as there:
        return str((await there.identity()).get("type"))


def _threads(workers: int) -> int:
    """Return the tasks that each worker of this machine takes at once: a CPU device leaves no core free."""
    if all(device.type != "GPU" for device in list_devices()):
        return 1
    return max(1, min(8, (os.cpu_count() or 1) // workers))
