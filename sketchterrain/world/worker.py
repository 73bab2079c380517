"""Dask workers: plugin that checks a worker, and its tasks."""

import asyncio
import logging
import os
import pickle
import signal
import socket
import time
from dataclasses import replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from threading import Event, Lock
from typing import Any
from uuid import uuid4

from distributed import Reschedule, Worker, WorkerPlugin, get_worker
from distributed.core import Status
from distributed.utils import sync

from sketchterrain.errors import DeviceError, SketchterrainError, one_line
from sketchterrain.io.console import DEBUG
from sketchterrain.io.resources import code_digest
from sketchterrain.world.grid import Shard
from sketchterrain.world.job import Task, TaskResult

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
