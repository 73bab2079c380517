"""Tasks run by this process: the device evaluates one while a thread writes the one before."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import Self

from sketchterrain.compute import ComputeContext, Device, choose_device, spare_device
from sketchterrain.errors import DeviceFailedError, InputError
from sketchterrain.terrain import self_test
from sketchterrain.world.job import Job
from sketchterrain.world.task_runner import PendingTask, TaskRunner
from sketchterrain.world.tasks import Task, TaskResult


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
        while (spare := spare_device(self._failed)) is not None:
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
    """Return the name of a device whose bits are its own; empty if it passes the self-test.

    Raises DeviceFailedError if the device fails the self-test altogether.
    """
    if not fast:
        # A known driver is spared the comparison, which takes longer than opening the device.
        verdict = self_test(device, compare=not device.known)
        if verdict.bits == "failed":
            raise DeviceFailedError(f"{device.name} ({device.platform}) failed: {verdict.detail}")
        if verdict.bits == "same":
            return ""
    return f"{device.name} ({device.platform}, {device.driver}){' with --fast' if fast else ''}"
