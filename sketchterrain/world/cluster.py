"""Tasks run by dask.distributed workers, of this machine or of another scheduler, and what runs in them."""

import asyncio
import logging
import os
import pickle
import signal
import socket
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, suppress
from dataclasses import replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from threading import Event, Lock
from typing import Any, Final, Self
from urllib.parse import urlsplit
from uuid import uuid4

import dask
from distributed import Client, LocalCluster, Reschedule, Worker, WorkerPlugin, as_completed, get_worker
from distributed.core import Status, rpc
from distributed.protocol.pickle import dumps
from distributed.scheduler import KilledWorker
from distributed.security import Security
from distributed.utils import sync

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import choose_device, list_devices
from sketchterrain.compute.device_check import is_usable
from sketchterrain.errors import DeviceError, InputError, SketchterrainError, one_line
from sketchterrain.io.console import DEBUG
from sketchterrain.io.resources import code_digest
from sketchterrain.world.grid import Shard
from sketchterrain.world.job import Job, Task, TaskResult
from sketchterrain.world.task_runner import TaskRunner

_VISIBLE = 5.0  # s until a network file system shows a new file
_SLOTS = {"GPU": 8}  # most tasks at once: a GPU evaluates faster than a core compresses
_CHUNK = 256  # vertices along a side of the compared window


class RefusedError(SketchterrainError):
    """A worker is not usable for the run."""


class WorkerSetup(WorkerPlugin):  # type: ignore[misc]  # dask has no types
    """Worker plugin: checks program version, output folder and results before offering the run's resource.

    Tasks require that resource, so a refused worker gets none; the outcome is an event of the run's topic.
    `probe` is a file in the output folder and its text, `bits` the `sample_digest` of the starting machine.
    """

    def __init__(
        self, run: str, job: object, *, probe: tuple[str, str], device: str | None, bits: str
    ) -> None:
        self.name = run
        self._job = pickle.dumps(job)  # unpickled after the version check
        self._version, self._code = version("sketchterrain"), code_digest()
        self._probe, self._selector, self._bits = probe, device, bits

    def setup(self, worker: Worker) -> None:
        """Start the checks, which take seconds."""
        self._worker, self._label = worker, _name_of(worker)
        self._device, self._stopped = Lock(), Event()
        self._checks = asyncio.get_running_loop().create_task(self._accept_or_refuse())

    async def teardown(self, worker: Worker) -> None:
        """Stop before the next write, and wait for running tasks."""
        self._stopped.set()
        self._checks.cancel()
        while any(key[0] == self.name for key in worker.active_keys):
            await asyncio.sleep(0.05)

    def run(self, task: Task) -> TaskResult:
        """Run a task; a failing device reschedules it on another worker."""
        try:
            with self._device:
                pending = None if self._stopped.is_set() else self._runner.evaluate(task)
            if pending is None or self._stopped.is_set():
                raise SketchterrainError("the run has ended")
            return replace(self._runner.finish(pending), worker=self._label)
        except DeviceError as error:
            sync(self._worker.loop, self._worker.set_resources, **{self.name: 0})
            self._report(refused=one_line(error))
            raise Reschedule from error

    async def _accept_or_refuse(self) -> None:
        try:
            slots = await asyncio.to_thread(self._prepare, await self._local_rank())
            await self._worker.set_resources(**{self.name: slots})
            # The scheduler reconsiders waiting tasks when a worker changes to running.
            if self._worker.status == Status.running:
                self._worker.status = Status.paused
                self._worker.status = Status.running
            self._report(slots=slots)
        except Exception as error:  # noqa: BLE001 - any error makes the worker unusable
            kind = "" if isinstance(error, SketchterrainError) else f"{type(error).__name__}: "
            self._report(refused=one_line(f"{kind}{error}"))

    def _report(self, *, slots: int = 0, refused: str = "") -> None:
        event = {"address": self._worker.address, "name": self._label, "slots": slots, "refused": refused}
        self._worker.log_event(self.name, event)

    async def _local_rank(self) -> int:
        """Return the worker's index among those of its host."""
        if isinstance(self._worker.name, int):
            return self._worker.name
        known = (await self._worker.scheduler.identity(n_workers=-1))["workers"]
        own = self._worker.address
        return sorted(each for each in known if known[each]["host"] == known[own]["host"]).index(own)

    def _prepare(self, rank: int) -> int:
        """Check program, folder and device; return the number of concurrent tasks."""
        own = version("sketchterrain")
        if own != self._version:
            raise RefusedError(f"it has sketchterrain {own}, not {self._version}")
        if code_digest() != self._code:
            raise RefusedError(f"its sketchterrain {own} has different code of the same version")
        check_folder(*self._probe)
        from sketchterrain.compute.context import ComputeContext
        from sketchterrain.generation.self_test import self_test
        from sketchterrain.world.task_runner import TaskRunner

        device = choose_worker_device(self._selector, rank)
        verdict = self_test(device, compare=not device.known)
        if verdict.bits != "same":
            raise RefusedError(f"self-test of {device.name} ({device.platform}): {verdict.line}")
        self._runner = TaskRunner(pickle.loads(self._job), ComputeContext(device))  # noqa: S301 - as dask does
        if sample_digest(self._runner) != self._bits:
            raise RefusedError(f"{device.name} ({device.platform}) computes different results")
        return min(int(self._worker.state.nthreads), _SLOTS.get(device.type, 2))


def run_task(run: str, task: Task) -> TaskResult:
    """Run a task in the worker that it was sent to."""
    plugin: WorkerSetup = get_worker().plugins[run]
    return plugin.run(Task(*task))


def dask_setup(_: Worker) -> None:
    """Prepare a local worker process: ignore Ctrl-C, which its parent handles."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if not os.environ.get(DEBUG):
        logging.disable(logging.CRITICAL)


def check_folder(probe: str, text: str) -> None:
    """Raise RefusedError unless the worker sees the output's folder and can write to it."""
    path, until = Path(probe), time.monotonic() + _VISIBLE
    while not path.is_file() or path.read_text(encoding="utf-8") != text:
        if time.monotonic() > until:
            raise RefusedError(f"it does not see the output's folder {path.parent}")
        time.sleep(0.1)
    test = path.with_name(f"{path.name}-{uuid4().hex[:8]}")
    try:
        test.write_bytes(b"")
        test.unlink()
    except OSError as error:
        raise RefusedError(f"it cannot write to {path.parent}: {error.strerror or error}") from error


def choose_worker_device(selector: str | None, rank: int) -> Any:
    """Return the device of a worker; by default the GPUs of a host are assigned in turn."""
    from sketchterrain.compute.device import choose_device, list_devices
    from sketchterrain.compute.device_check import is_usable

    gpus = [device for device in list_devices() if device.type == "GPU" and is_usable(device)]
    if selector is not None or os.environ.get("PYOPENCL_CTX") or not gpus:
        return choose_device(selector)
    return gpus[rank % len(gpus)]


def sample_digest(runner: Any) -> str:
    """Return the SHA-256 of a job's coarsest level and of the centre of its finest level."""
    world = runner.job.world
    coarsest, finest = world.levels[-1], world.levels[0]
    data = runner.compute_shard(Shard(coarsest.number, 0, 0))
    digest = sha256()
    for array in (data.height, data.normal, data.materials, data.appearance):
        digest.update(array.tobytes())
    columns, rows = min(_CHUNK, finest.columns), min(_CHUNK, finest.rows)
    for band in runner.terrain.window(
        world.west,
        world.north,
        cell=finest.cell,
        left=(finest.columns - columns) // 2,
        top=(finest.rows - rows) // 2,
        columns=columns,
        rows=rows,
    ):
        digest.update(band.height.tobytes())
    return digest.hexdigest()


def _name_of(worker: Worker) -> str:
    name = str(worker.name)
    if name.isdigit():
        return f"worker {name}"
    return name if "://" in name else f"{name} on {socket.gethostname()}"


_TIMEOUT: Final = 10.0  # s for an answer of the scheduler
_SHUTDOWN_TIMEOUT: Final = 60.0  # s for running tasks to end
_POLL_INTERVAL: Final = 1.0  # s between two polls of the workers
_PAUSE: Final = 0.02  # s between two polls of finished tasks
_WORKER_TIMEOUT: Final = 300.0  # s without an accepted worker
_RETRIES: Final = 2  # of a task that failed
_LOCAL: Final = {
    "distributed.scheduler.allowed-failures": 10,  # workers that die during a task
    "distributed.worker.profile.enabled": False,
    "distributed.worker.use-file-locking": False,
}


class ClusterExecutor:
    """Executor on the workers of a scheduler, each with its own device; a context manager.

    `WorkerSetup` checks each worker before its first task. Only as many tasks are submitted as workers run
    at once. The tasks of a worker that dies are run by others.
    """

    def __init__(
        self,
        job: Job,
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        device: str | None = None,
        note: Callable[[str], None],
        should_stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self._job, self._device, self._note, self._should_stop = job, device, note, should_stop
        self._workers, self._scheduler = workers, scheduler
        self._run = f"sketchterrain-{uuid4().hex}"
        self._title = f"scheduler {scheduler}" if scheduler else "the scheduler in this process"
        self._accepted: dict[str, tuple[str, int]] = {}  # names and slots, by address
        self._refused: dict[str, tuple[str, str]] = {}  # names and reasons
        self._events = 0
        self._polled = self._ready = time.monotonic()
        self._pending: set[Any] = set()
        self._cluster: Any = None

    def __enter__(self) -> Self:
        """Connect to or start the workers; the output's folder must exist."""
        with ExitStack() as stack:
            if not os.environ.get(DEBUG):  # events are reported by `note` instead
                logging.disable(logging.CRITICAL)
                stack.callback(logging.disable, logging.NOTSET)
                stack.enter_context(warnings.catch_warnings())
                warnings.filterwarnings("ignore", module="(distributed|dask|tornado)")
            self._client = self._connect(stack)
            probe = self._job.layout.journal.with_name(f".{self._run}")
            stack.callback(probe.unlink, missing_ok=True)
            probe.write_text(self._run, encoding="utf-8")
            self._set_up((str(probe), self._run))
            stack.callback(self._release_workers)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Wait until no worker writes, and stop local workers."""
        self._stack.close()

    def run(self, tasks: Iterable[Task]) -> Iterator[TaskResult]:
        """Yield results as they are completed; see `run_world` for errors."""
        todo, more, completed = iter(tasks), True, as_completed(loop=self._client.loop)
        self._poll()
        while more or self._pending:
            if time.monotonic() - self._polled > (_POLL_INTERVAL if self._accepted else _POLL_INTERVAL / 5):
                self._poll()
            if self._should_stop() and not self._accepted:
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
                except TimeoutError:  # the worker died: the task is run again
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
            shard = "{} of shard {},{} of level {}".format(*(future.key[index] for index in (1, 3, 4, 2)))
            raise SketchterrainError(f"{error.allowed_failures + 1} workers died during {shard}") from error
        except CancelledError as error:
            raise SketchterrainError(f"{self._title} does not respond") from error
        except RuntimeError as error:
            if "deserialization of the task graph" not in str(error):
                raise
            raise SketchterrainError(
                f"{self._title} cannot load sketchterrain: it must be installed there"
            ) from error
        return result

    def _poll(self) -> None:
        if self._cluster is not None:  # replaces those that died during startup
            self._cluster.scale(self._workers or 1)
        present = self._ask(self._client.scheduler.identity, n_workers=-1)["workers"]
        events = self._ask(self._client.scheduler.events, topic=self._run)
        self._polled = time.monotonic()
        for _, event in events[self._events :]:
            address, name = event["address"], event["name"]
            if event["refused"]:
                self._refuse(address, name, event["refused"])
            else:
                self._accepted[address] = name, event["slots"]
        self._events = len(events)
        for address in self._accepted.keys() - present.keys():
            name, _ = self._accepted.pop(address)
            self._note(f"{name} disconnected: its tasks are run again")
        if present and present.keys() <= self._refused.keys():
            reasons = "; ".join(
                f"{name}: {reason}" for name, reason in map(self._refused.__getitem__, present)
            )
            raise DeviceError(f"all workers are refused: {reasons}")
        self._ready = self._polled if self._accepted else self._ready
        if self._polled - self._ready > _WORKER_TIMEOUT:
            raise SketchterrainError(f"{self._title} has had no usable worker for {_WORKER_TIMEOUT:.0f} s")

    def _refuse(self, address: str, name: str, reason: str) -> None:
        self._accepted.pop(address, None)
        self._refused[address] = name, reason
        self._note(f"{name} is refused: {reason}")

    def _ask(self, what: Callable[..., Any], *, timeout: float = _TIMEOUT, **named: Any) -> Any:
        try:
            return self._client.sync(what, **named, callback_timeout=timeout)
        except (OSError, TimeoutError, CancelledError) as error:
            raise SketchterrainError(f"{self._title} does not respond") from error

    def _connect(self, stack: ExitStack) -> Any:
        """Return a client of the scheduler, or of a local one that is started with its workers."""
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
                        preload="sketchterrain.world.cluster",
                    )
            except (OSError, RuntimeError) as error:
                raise SketchterrainError(f"workers cannot be started: {one_line(error)}") from error
            stack.enter_context(suppress(TimeoutError))
            stack.callback(cluster.close, timeout=_TIMEOUT)
            self._cluster = cluster
            address = cluster.scheduler_address
        else:
            address = self._scheduler
            # A client that cannot connect retries in the background.
            if not address.startswith("inproc://"):
                check_scheduler(address)
        client = Client(address, timeout=_TIMEOUT, set_as_default=False)
        stack.callback(client.close, timeout=_TIMEOUT)
        return client

    def _set_up(self, probe: tuple[str, str]) -> None:
        # Workers must reproduce the results of this machine, if possible of a known device.
        known = (device for device in list_devices() if device.known and is_usable(device))
        device = next(known, None) or choose_device(self._device)
        bits = sample_digest(TaskRunner(self._job, ComputeContext(device)))
        plugin = WorkerSetup(self._run, self._job, probe=probe, device=self._device, bits=bits)
        answers = self._ask(
            self._client.scheduler.register_worker_plugin,
            timeout=_SHUTDOWN_TIMEOUT,
            plugin=dumps(plugin),
            name=self._run,
            idempotent=False,
        )
        for address, answer in answers.items():
            if answer["status"] != "OK":
                self._refuse(address, address, "it cannot load sketchterrain: it must be installed there")

    def _release_workers(self) -> None:
        """Cancel all tasks, and return once no worker writes."""
        with suppress(SketchterrainError):
            self._ask(self._client.scheduler.identity, n_workers=0)
            self._client.cancel(list(self._pending), force=True)
            if self._scheduler is not None:
                self._ask(
                    self._client.scheduler.unregister_worker_plugin, timeout=_SHUTDOWN_TIMEOUT, name=self._run
                )


def check_scheduler(address: str) -> None:
    """Raise an error without retries unless a dask scheduler answers at ``tcp://HOST:PORT`` or ``tls://…``."""
    parts, port = None, None
    with suppress(ValueError):
        parts = urlsplit(address)
        port = parts.port
    if parts is None or parts.scheme not in ("tcp", "tls") or not parts.hostname or port is None:
        raise InputError(f"expected a scheduler's address such as tcp://HOST:8786, got {one_line(address)!r}")
    try:
        # dask would retry until its timeout.
        with socket.create_connection((parts.hostname, port), timeout=_TIMEOUT):
            pass
        kind = asyncio.run(asyncio.wait_for(_kind_of(address), _TIMEOUT))
        reason = "" if kind == "Scheduler" else "not a dask scheduler"
    except OSError as error:
        reason = "no answer" if isinstance(error, TimeoutError) else error.strerror or str(error)
    except Exception:  # noqa: BLE001 - any answer of another protocol
        reason = "not a dask scheduler, or certificates missing in dask's configuration"
    if reason:
        raise SketchterrainError(f"scheduler {address} cannot be reached: {one_line(reason)}")


async def _kind_of(address: str) -> str:
    arguments = Security().get_connection_args("client")
    async with rpc(address, timeout=_TIMEOUT, connection_args=arguments) as scheduler:
        return str((await scheduler.identity()).get("type"))


def _threads(workers: int) -> int:
    """Return the concurrent tasks of each local worker; a CPU device uses all cores for one."""
    if not any(device.type == "GPU" and is_usable(device) for device in list_devices()):
        return 1
    return max(1, min(8, (os.cpu_count() or 1) // workers))
