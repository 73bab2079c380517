"""Tasks of a world run by one process: evaluated on a device, written by a thread."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import Device, choose_device, fallback_device
from sketchterrain.errors import DeviceFailedError, InputError
from sketchterrain.export.sampled import quantise_normals, quantise_weights
from sketchterrain.generation.self_test import self_test
from sketchterrain.generation.terrain import Terrain
from sketchterrain.terrain.rasters import QuantizedBand
from sketchterrain.terrain.surfaces import Band
from sketchterrain.world.geotiff_store import TiffStore, TileStore
from sketchterrain.world.grid import SHARD, GridLevel, Shard, ShardData
from sketchterrain.world.job import PLANTS, Job, Task, TaskResult, WrittenFile, check_libraries
from sketchterrain.world.zarr_store import ZarrStore

if TYPE_CHECKING:  # it loads a library of the extra ``world``
    from sketchterrain.world.plants import PlantStore

Store: TypeAlias = TileStore | ZarrStore


def shard_store(job: Job) -> Store:
    """Return the writer of a job's form, created in each process; raise SketchterrainError without a library.

    Names are relative to its `folder`. Its methods raise SketchterrainError if a file cannot be written.
    """
    check_libraries(job)
    stores: dict[str, type[Store]] = {"zarr": ZarrStore, "tiles": TileStore, "tif": TiffStore}
    return stores[job.form](job)


def plant_store(job: Job) -> PlantStore | None:
    """Return the store of a job's plants, None without plants; raise SketchterrainError as `shard_store`."""
    if job.plants == "none":
        return None
    check_libraries(job)
    from sketchterrain.world.plants import PlantStore

    return PlantStore(job)


@dataclass(frozen=True, eq=False)
class PendingTask:
    """A task whose shard is evaluated but not written, or whose plants are written already (`names`)."""

    task: Task
    shard: ShardData | None
    names: tuple[str, ...]


class TaskRunner:
    """Runner of a job's tasks on one device; every device gives the same bytes.

    `evaluate` is for one thread; it raises DeviceFailedError for a failing device. `finish` is thread-safe.
    """

    def __init__(self, job: Job, context: ComputeContext) -> None:
        self.job = job
        self.terrain = Terrain(job.sketch, job.recipe, context)
        self._painted = self.terrain.draped_appearance
        self._store, self._plants = shard_store(job), plant_store(job)
        self._layout = job.layout
        self._window = self.terrain.window_bytes if context.device.has_double else self._window_on_host

    def evaluate(self, task: Task) -> PendingTask:
        """Run the part of a task that needs the device."""
        if task.kind == "ground" or self._plants is None:
            return PendingTask(task, self.compute_shard(Shard(task.level, task.row, task.column)), ())
        written = self._plants.write(task, self.terrain)
        return PendingTask(task, None, tuple(f"{PLANTS}{name}" for name in written))

    def finish(self, pending: PendingTask) -> TaskResult:
        """Compress, write and hash the files of an evaluated task."""
        names = pending.names if pending.shard is None else self._store.write(pending.shard)
        return TaskResult(
            pending.task, tuple(WrittenFile.from_path(self._layout.path(name), name) for name in names)
        )

    def compute_shard(self, shard: Shard) -> ShardData:
        """Evaluate a shard; layers that are not requested are empty."""
        world, layers = self.job.world, self.job.layers
        level = world.levels[shard.level]
        rows, columns = level.size_of(shard)
        data = ShardData(
            shard,
            np.empty((rows, columns), np.float32),
            np.empty((3 if "normal" in layers else 0, rows, columns), np.uint8),
            np.empty(
                (len(self.job.recipe.materials) if "materials" in layers else 0, rows, columns), np.uint8
            ),
            self._appearance(level, shard) if "appearance" in layers else np.zeros((0, 0, 0), np.uint8),
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
            band_rows = slice(band.top, band.top + len(band.height))
            data.height[band_rows] = round_heights(band.height, self.job.step)
            if len(data.normal):
                data.normal[:, band_rows] = band.normal
            if len(data.materials):
                data.materials[:, band_rows] = band.materials
        return data

    def _appearance(self, level: GridLevel, shard: Shard) -> npt.NDArray[np.uint8]:
        """Return the appearance of a shard, (4, rows, columns)."""
        west = self.job.world.west + shard.column * SHARD * level.cell
        north = self.job.world.north - shard.row * SHARD * level.cell
        rows, columns = level.size_of(shard)
        cell = level.cell, level.cell
        found = self._painted.window(west, north, cell=cell, columns=columns, rows=rows)
        return np.ascontiguousarray(found.transpose(2, 0, 1))

    def _window_on_host(self, west: float, north: float, **window: Any) -> Iterator[QuantizedBand]:
        return quantised_bands(self.terrain.window(west, north, **window))


def quantised_bands(bands: Iterator[Band]) -> Iterator[QuantizedBand]:
    """Yield bands as bytes, rounded on the host exactly as by a device with 64-bit floats."""
    for band in bands:
        normal, weights = quantise_normals(band.normal), quantise_weights(band.materials)
        yield QuantizedBand(band.top, band.height, normal.transpose(2, 0, 1), weights.transpose(2, 0, 1))


def round_heights(height: npt.NDArray[np.float32], step: float) -> npt.NDArray[np.float32]:
    """Return heights rounded to multiples of `step` (m, a power of two); unchanged for 0."""
    if step == 0:
        return height
    # Exact, as both are float32; adding 0 turns −0 into 0.
    return np.asarray(np.rint(height / np.float32(step)) * np.float32(step) + np.float32(0))


class SerialExecutor:
    """Executor on one device, replaced by a CPU device with the same results if it fails.

    `written_on` is the `deviating_device` that wrote a part of the world; None: nothing is written.
    """

    def __init__(
        self, job: Job, *, device: str | None, note: Callable[[str], None], written_on: str | None = None
    ) -> None:
        self._job, self._note = job, note
        self._device = choose_device(device)
        self._failed: list[Device] = []
        self.deviating_device = ""
        try:
            self.deviating_device = deviating_device(self._device, fast=job.fast)
        except DeviceFailedError as error:
            self._device = self._replacement(error)
        if written_on is not None and written_on != self.deviating_device:
            raise InputError(
                f"{job.output}: was started on {written_on or 'a device that passes the self-test'}, whose "
                f"results differ from those of {self.deviating_device or self._device.name}; "
                "resume on the same device"
            )
        if self.deviating_device and not job.fast:
            verdict = self_test(self._device)
            note(f"self-test of {self._device.name} ({self._device.platform}): {verdict.line}")

    def __enter__(self) -> Self:
        self._runner = self._open(self._device)
        self._writer = ThreadPoolExecutor(1, "world")
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.shutdown()

    def run(self, tasks: Iterable[Task]) -> Iterator[TaskResult]:
        """Run tasks in order, evaluating one while the previous one is written."""
        writing: Future[TaskResult] | None = None
        for task in tasks:
            pending = self._evaluate(task)
            if writing is not None:
                yield writing.result()
            writing = self._writer.submit(self._runner.finish, pending)
            del pending  # only the writing thread holds the arrays
        if writing is not None:
            yield writing.result()

    def _evaluate(self, task: Task) -> PendingTask:
        while True:
            try:
                return self._runner.evaluate(task)
            except DeviceFailedError as error:
                replacement = self._replacement(error)
            self._runner = self._open(replacement)

    def _replacement(self, error: DeviceFailedError) -> Device:
        """Return a device with the same results as a failed one."""
        if self.deviating_device:
            raise DeviceFailedError(f"{error}; results of other devices differ: cannot continue") from error
        self._failed.append(self._device)
        while (device := fallback_device(self._failed)) is not None:
            with suppress(DeviceFailedError):
                if not deviating_device(device, fast=False):
                    self._note(f"{error}; continuing on {device.name} ({device.platform})")
                    self._device = device
                    return device
            self._failed.append(device)
        raise DeviceFailedError(f"{error}; no other device can continue") from error

    def _open(self, device: Device) -> TaskRunner:
        return TaskRunner(self._job, ComputeContext(device, fast=self._job.fast))


def deviating_device(device: Device, *, fast: bool) -> str:
    """Return the name of a device whose results deviate, empty if it passes the self-test; or raise."""
    if not fast:
        # A known driver needs no comparison, which takes longer than opening the device.
        verdict = self_test(device, compare=not device.known)
        if verdict.bits == "failed":
            raise DeviceFailedError(f"{device.name} ({device.platform}) failed: {verdict.detail}")
        if verdict.bits == "same":
            return ""
    return f"{device.name} ({device.platform}, {device.driver}){' with --fast' if fast else ''}"
