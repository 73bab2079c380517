"""Tasks of a world run by one process, from a terrain on a device to files."""

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import Device, choose_device, fallback_device
from sketchterrain.document.parameters import MATERIALS
from sketchterrain.errors import DeviceFailedError, InputError
from sketchterrain.export.sampled import quantise_normals, quantise_weights
from sketchterrain.terrain.rasters import QuantizedBand
from sketchterrain.terrain.self_test import self_test
from sketchterrain.terrain.surfaces import Band
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.world.grid import SHARD, Ground, Shard
from sketchterrain.world.job import Job, Task, TaskResult
from sketchterrain.world.journal import PLANTS, OutputLayout, file_record
from sketchterrain.world.store import plants_of, store_of


@dataclass(frozen=True, eq=False)
class PendingTask:
    """A task whose ground is evaluated but not written, or whose plants are written already (`names`)."""

    task: Task
    ground: Ground | None
    names: tuple[str, ...]
    seconds: float


class TaskRunner:
    """Runs tasks of a job on one device; every device gives the same bytes.

    `evaluate` takes one task at a time, and raises DeviceFailedError for a device that gives up or computes
    non-finite heights; `finish` may run in any thread.
    """

    def __init__(self, job: Job, context: ComputeContext) -> None:
        self.job = job
        self.terrain = Terrain(job.sketch, job.recipe, context)
        self._store = store_of(job)
        self._plants = plants_of(job)
        self._layout = OutputLayout.of(job)
        self._window = self.terrain.window_bytes if context.device.has_double else self._window_on_host

    def evaluate(self, task: Task) -> PendingTask:
        """Do the part of a task that needs the device."""
        start = time.perf_counter()
        ground, names = None, tuple[str, ...]()
        if task.kind == "ground":
            ground = self.ground(Shard(task.level, task.row, task.column))
        elif self._plants is not None:
            names = tuple(f"{PLANTS}{name}" for name in self._plants.write(task, self.terrain))
        return PendingTask(task, ground, names, time.perf_counter() - start)

    def finish(self, pending: PendingTask) -> TaskResult:
        """Pack, write and hash what `evaluate` has left to do."""
        start = time.perf_counter()
        names = pending.names if pending.ground is None else self._store.write(pending.ground)
        files = tuple(file_record(self._layout.path(name), name) for name in names)
        took = time.perf_counter() - start
        parts = {"evaluate": pending.seconds, "write": took}
        return TaskResult(pending.task, files, pending.seconds + took, parts)

    def ground(self, shard: Shard) -> Ground:
        """Evaluate a shard."""
        world, layers = self.job.world, self.job.layers
        level = world.levels[shard.level]
        rows, columns = level.size_of(shard)
        ground = Ground(
            shard,
            np.empty((rows, columns), np.float32),
            np.empty((3 if "normal" in layers else 0, rows, columns), np.uint8),
            np.empty((len(MATERIALS) if "materials" in layers else 0, rows, columns), np.uint8),
        )
        for band in self._window(
            world.west,
            world.north,
            cell=level.cell,
            left=shard.column * SHARD,
            top=shard.row * SHARD,
            columns=columns,
            rows=rows,
        ):
            here = slice(band.top, band.top + len(band.height))
            ground.height[here] = rounded(band.height, self.job.step)
            if len(ground.normal):
                ground.normal[:, here] = band.normal
            if len(ground.materials):
                ground.materials[:, here] = band.materials
        return ground

    def _window_on_host(self, west: float, north: float, **window: Any) -> Iterator[QuantizedBand]:
        return packed(self.terrain.window(west, north, **window))


def packed(bands: Iterator[Band]) -> Iterator[QuantizedBand]:
    """Yield bands as bytes, rounded on the host: the same as a device with 64-bit floats does it."""
    for band in bands:
        normal, weights = quantise_normals(band.normal), quantise_weights(band.materials)
        yield QuantizedBand(band.top, band.height, normal.transpose(2, 0, 1), weights.transpose(2, 0, 1))


def rounded(height: npt.NDArray[np.float32], step: float) -> npt.NDArray[np.float32]:
    """Return heights as multiples of a power of two, both in m; 0 keeps them as they are."""
    if step == 0:
        return height
    # Exact where both are float32; adding 0 turns −0 into 0.
    return np.asarray(np.rint(height / np.float32(step)) * np.float32(step) + np.float32(0))


class SerialExecutor:
    """Runs tasks on one device, and on a CPU device once that one has failed.

    What the first device made stays: both pass the self-test, so their bits are the same. `begun_on` is what
    `own_bits` returned for the device that made a part of the world already; None: no part is made.
    """

    def __init__(
        self, job: Job, *, device: str | None, note: Callable[[str], None], begun_on: str | None = None
    ) -> None:
        self._job, self._note = job, note
        self._device = choose_device(device)
        self._failed: list[Device] = []
        self.own_bits = ""
        try:
            self.own_bits = own_bits(self._device, fast=job.fast)
        except DeviceFailedError as error:
            self._device = self._spare(error)
        if begun_on is not None and begun_on != self.own_bits:
            raise InputError(
                f"{job.output}: was begun on {begun_on or 'a device that passes the self-test'}, and "
                f"{self.own_bits or self._device.name} has other bits; a world is never made of both"
            )
        if self.own_bits and not job.fast:
            verdict = self_test(self._device)
            note(f"self-test of {self._device.name} ({self._device.platform}): {verdict.line}")

    def __enter__(self) -> Self:
        self._runner = self._opened(self._device)
        self._writer = ThreadPoolExecutor(1, "world")
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.shutdown()

    def run(self, tasks: Iterable[Task]) -> Iterator[TaskResult]:
        """Run tasks in their order; any error of the device or of the writing thread ends it."""
        writing: Future[TaskResult] | None = None
        for task in tasks:
            pending = self._evaluate(task)
            if writing is not None:
                yield writing.result()
            writing = self._writer.submit(self._runner.finish, pending)
            del pending  # the writing thread alone holds the arrays
        if writing is not None:
            yield writing.result()

    def _evaluate(self, task: Task) -> PendingTask:
        while True:
            try:
                return self._runner.evaluate(task)
            except DeviceFailedError as error:
                spare = self._spare(error)
            self._runner = self._opened(spare)

    def _spare(self, error: DeviceFailedError) -> Device:
        """Return the device that replaces a failed one: it must compute the same bits."""
        if self.own_bits:
            raise DeviceFailedError(f"{error}; another device has other bits, so none can go on") from error
        self._failed.append(self._device)
        while (spare := fallback_device(self._failed)) is not None:
            with suppress(DeviceFailedError):
                if not own_bits(spare, fast=False):
                    self._note(f"{error}; {spare.name} ({spare.platform}) goes on")
                    self._device = spare
                    return spare
            self._failed.append(spare)
        raise DeviceFailedError(f"{error}; there is no other device to go on") from error

    def _opened(self, device: Device) -> TaskRunner:
        return TaskRunner(self._job, ComputeContext(device, fast=self._job.fast))


def own_bits(device: Device, *, fast: bool) -> str:
    """Return the name of a device whose bits are its own, empty if it passes the self-test, or raise."""
    if not fast:
        # A known driver is spared the comparison, which takes longer than opening the device.
        verdict = self_test(device, compare=not device.known)
        if verdict.bits == "failed":
            raise DeviceFailedError(f"{device.name} ({device.platform}) failed: {verdict.detail}")
        if verdict.bits == "same":
            return ""
    return f"{device.name} ({device.platform}, {device.driver}){' with --fast' if fast else ''}"
