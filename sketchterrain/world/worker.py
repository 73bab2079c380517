"""What runs in the workers of dask: a plugin that checks its worker, and the tasks."""

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

from sketchterrain.app.console import DEBUG
from sketchterrain.errors import DeviceError, SketchterrainError, one_line
from sketchterrain.world.grid import Shard
from sketchterrain.world.job import Task, TaskResult, code_digest

_VISIBLE = 5.0  # s until a network's file system shows a new file
_SLOTS = {"GPU": 8}  # tasks at once, at most: a GPU evaluates faster than a core packs
_CHUNK = 256  # vertices along the side of the window that is compared


class RefusedError(SketchterrainError):
    """A worker gets no task, or no other one."""


class WorkerSetup(WorkerPlugin):  # type: ignore[misc]  # dask has no types
    """Checks a worker: it must run the same program, see the output's folder and compute the same bits.

    Tasks ask for a resource by the name of the run. An accepted worker offers it, so a refused one gets no
    task. What becomes of each worker is an event of the run's topic.

    `probe` is a file in the output's folder and its text; `device` is a selector or None;
    `bits` are those of `bits_of` on the machine that started the run.
    """

    def __init__(
        self, run: str, job: object, *, probe: tuple[str, str], device: str | None, bits: str
    ) -> None:
        self.name = run
        self._job = pickle.dumps(job)  # unpickled once the program is known to be the same
        self._version, self._code = version("sketchterrain"), code_digest()
        self._probe, self._selector, self._bits = probe, device, bits

    def setup(self, worker: Worker) -> None:
        """Start the checks; they take seconds."""
        self._worker, self._called = worker, _name_of(worker)
        self._device, self._stopped = Lock(), Event()
        self._checks = asyncio.get_running_loop().create_task(self._accept_or_refuse())

    async def teardown(self, worker: Worker) -> None:
        """Stop before the next write, and wait until no task of the run is running."""
        self._stopped.set()
        self._checks.cancel()
        while any(key[0] == self.name for key in worker.active_keys):
            await asyncio.sleep(0.05)

    def run(self, task: Task) -> TaskResult:
        """Run a task; a device that fails sends it to another worker."""
        try:
            with self._device:
                pending = None if self._stopped.is_set() else self._runner.evaluate(task)
            if pending is None or self._stopped.is_set():
                raise SketchterrainError("the run has ended")
            return replace(self._runner.finish(pending), worker=self._called)
        except DeviceError as error:
            sync(self._worker.loop, self._worker.set_resources, **{self.name: 0})
            self._report(refused=one_line(error))
            raise Reschedule from error

    async def _accept_or_refuse(self) -> None:
        try:
            slots = await asyncio.to_thread(self._prepare, await self._local_rank())
            await self._worker.set_resources(**{self.name: slots})
            # The scheduler looks at waiting tasks again when a worker begins to run.
            if self._worker.status == Status.running:
                self._worker.status = Status.paused
                self._worker.status = Status.running
            self._report(slots=slots)
        except Exception as error:  # noqa: BLE001 - whatever it is, this worker cannot do it
            kind = "" if isinstance(error, SketchterrainError) else f"{type(error).__name__}: "
            self._report(refused=one_line(f"{kind}{error}"))

    def _report(self, *, slots: int = 0, refused: str = "") -> None:
        event = {"address": self._worker.address, "name": self._called, "slots": slots, "refused": refused}
        self._worker.log_event(self.name, event)

    async def _local_rank(self) -> int:
        """Return the worker's number among those of its host."""
        if isinstance(self._worker.name, int):
            return self._worker.name
        known = (await self._worker.scheduler.identity(n_workers=-1))["workers"]
        own = self._worker.address
        return sorted(each for each in known if known[each]["host"] == known[own]["host"]).index(own)

    def _prepare(self, rank: int) -> int:
        """Check all and open the device; return how many tasks the worker takes at once."""
        own = version("sketchterrain")
        if own != self._version:
            raise RefusedError(f"it has sketchterrain {own}, not {self._version}")
        if code_digest() != self._code:
            raise RefusedError(f"its sketchterrain {own} has other code of the same version")
        check_folder(*self._probe)
        from sketchterrain.compute.context import ComputeContext
        from sketchterrain.terrain.self_test import self_test
        from sketchterrain.world.task_runner import TaskRunner

        device = own_device(self._selector, rank)
        verdict = self_test(device, compare=not device.known)
        if verdict.bits != "same":
            raise RefusedError(f"self-test of {device.name} ({device.platform}): {verdict.line}")
        self._runner = TaskRunner(pickle.loads(self._job), ComputeContext(device))  # noqa: S301 - dask's way
        if bits_of(self._runner) != self._bits:
            raise RefusedError(f"{device.name} ({device.platform}) computes other bits of this world")
        return min(int(self._worker.state.nthreads), _SLOTS.get(device.type, 2))


def run_task(run: str, task: Task) -> TaskResult:
    """Run a task in the worker that it was sent to."""
    plugin: WorkerSetup = get_worker().plugins[run]
    return plugin.run(Task(*task))


def dask_setup(_: Worker) -> None:
    """Prepare a worker process of this machine: Ctrl-C in the terminal is for its starter alone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if not os.environ.get(DEBUG):
        logging.disable(logging.CRITICAL)


def check_folder(probe: str, text: str) -> None:
    """Refuse a worker that does not see the output's folder, or cannot write into it."""
    path, until = Path(probe), time.monotonic() + _VISIBLE
    while not path.is_file() or path.read_text(encoding="utf-8") != text:
        if time.monotonic() > until:
            seen = "another folder" if path.parent.is_dir() else "nothing"
            raise RefusedError(f"it does not see the output's folder {path.parent}: {seen} is there")
        time.sleep(0.1)
    own = path.with_name(f"{path.name}-{uuid4().hex[:8]}")
    try:
        own.write_bytes(b"")
        own.unlink()
    except OSError as error:
        raise RefusedError(f"it cannot write into {path.parent}: {error.strerror or error}") from error


def own_device(selector: str | None, rank: int) -> Any:
    """Return the device of a worker: by default workers of a host take its GPUs in turn."""
    from sketchterrain.compute.device import choose_device, list_devices
    from sketchterrain.compute.device_check import is_usable

    gpus = [device for device in list_devices() if device.type == "GPU" and is_usable(device)]
    if selector is not None or os.environ.get("PYOPENCL_CTX") or not gpus:
        return choose_device(selector)
    return gpus[rank % len(gpus)]


def bits_of(runner: Any) -> str:
    """Return the SHA-256 of some of a job's ground: its coarsest level, and the middle of its finest."""
    world = runner.job.world
    coarsest, finest = world.levels[-1], world.levels[0]
    whole = runner.ground(Shard(coarsest.number, 0, 0))
    digest = sha256()
    for array in (whole.height, whole.normal, whole.materials):
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
    """Return a worker's name and host; a number is its place on this machine."""
    name = str(worker.name)
    if name.isdigit():
        return f"worker {name}"
    return name if "://" in name else f"{name} on {socket.gethostname()}"
