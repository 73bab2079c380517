"""A world's tasks done by this process: the device works on one while a thread writes the one before."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from sketchterrain.compute import ComputeContext, choose_device, spare_device
from sketchterrain.errors import DeviceFailedError, InputError
from sketchterrain.terrain import self_test
from sketchterrain.world.making import Maker

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from concurrent.futures import Future

    from sketchterrain.compute import Device
    from sketchterrain.world.job import Job
    from sketchterrain.world.made import Made, Task
    from sketchterrain.world.making import Begun

__all__ = ["AloneCrew", "own_bits"]


class AloneCrew:
    """Does tasks one after the other on one device, and on a CPU device once that has failed.

    What the first one made stays where both pass the self-test: their bits are the same.

    Parameters
    ----------
    job : Job
    device : str or None
        Selector as for :func:`~sketchterrain.compute.choose_device`.
    note : callable
        Takes a line about what happens to devices.
    begun_on : str or None
        What `own_bits` says of the device that a part of the world is made on already; None: no part is.

    Raises
    ------
    DeviceError
        If there is no such device.
    InputError
        If the world was begun on a device with other bits.
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
        self._maker = self._opened(self._device)
        self._aside = ThreadPoolExecutor(1, "world")
        return self

    def __exit__(self, *_: object) -> None:
        self._aside.shutdown()  # what is being written becomes whole

    def make(self, tasks: Iterable[Task]) -> Iterator[Made]:
        """Do tasks in their order.

        Raises
        ------
        DeviceFailedError
            If no device is left.
        SketchterrainError
            If the system cannot write files.
        """
        writing: Future[Made] | None = None
        for task in tasks:
            begun = self._begun(task)
            if writing is not None:
                yield writing.result()
            writing = self._aside.submit(self._maker.end, begun)
            del begun
        if writing is not None:
            yield writing.result()

    def _begun(self, task: Task) -> Begun:
        while True:
            try:
                return self._maker.begin(task)
            except DeviceFailedError as error:
                spare = self._spare(error)
            self._maker = self._opened(spare)

    def _spare(self, error: DeviceFailedError) -> Device:
        """Return the device that goes on where one failed.

        Raises
        ------
        DeviceFailedError
            If there is none with its bits.
        """
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

    def _opened(self, device: Device) -> Maker:
        return Maker(self._job, ComputeContext(device, fast=self._job.fast))


def own_bits(device: Device, *, fast: bool) -> str:
    """Return what names a device's bits: nothing for those that every device has that passes the self-test.

    Raises
    ------
    DeviceFailedError
        If the device fails the self-test altogether.
    """
    if not fast:
        # A driver whose bits the tests hold is spared the terrain, which takes it longer than opening.
        verdict = self_test(device, compare=not device.known)
        if verdict.bits == "failed":
            raise DeviceFailedError(f"{device.name} ({device.platform}) failed: {verdict.detail}")
        if verdict.bits == "same":
            return ""
    return f"{device.name} ({device.platform}, {device.driver}){' with --fast' if fast else ''}"
