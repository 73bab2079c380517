"""Work on a device, and where the device misbehaves, all of it again on a CPU: never a mixture."""

from __future__ import annotations

import sys
from threading import Lock
from typing import TYPE_CHECKING, TypeVar

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import choose_device, fallback_device
from sketchterrain.errors import DeviceFailedError, one_line
from sketchterrain.terrain.self_test import self_test

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.app.progress import Stages
    from sketchterrain.compute.device import Device

T = TypeVar("T")


def run_with_fallback(
    work: Callable[[ComputeContext, tuple[str, ...]], T],
    *,
    device: str | None,
    fast: bool = False,
    stages: Stages,
) -> T:
    """Do work on a device, and where that fails all of it again on a CPU device that has not failed yet."""
    return DeviceFallback(device, fast=fast).run(work, stages=stages)


class DeviceFallback:
    """The device that jobs are done on, one after the other or at once; one that failed is left for good."""

    def __init__(self, device: str | None, *, fast: bool = False) -> None:
        self.fast = fast
        self._chosen = choose_device(device)
        self._failed: list[Device] = []
        self._lock = Lock()
        self._told: set[Device] = set()

    @property
    def chosen(self) -> Device:
        """The one that the next job begins on."""
        return self._chosen

    def run(self, work: Callable[[ComputeContext, tuple[str, ...]], T], *, stages: Stages) -> T:
        """Do work as :func:`run_with_fallback` does it, on the device that did not fail in any job yet."""
        told: list[str] = []
        while True:
            chosen = self._chosen
            try:
                with stages.stage("device", "Opening the device"):
                    if not self.fast:
                        self._tell_other_bits(chosen)
                    context = ComputeContext(chosen, fast=self.fast)
                return work(context, tuple(told))
            except DeviceFailedError as error:
                spare = self._after(chosen, error)
                told.append(f"{error}; all of it is done again on {spare.name} ({spare.platform})")
            _note(told[-1])

    def _after(self, failed: Device, error: DeviceFailedError) -> Device:
        """Return the device that takes the place of one that failed; several jobs may tell it at once."""
        with self._lock:
            if failed not in self._failed:
                self._failed.append(failed)
            if self._chosen in self._failed:
                spare = fallback_device(self._failed)
                if spare is None:
                    raise DeviceFailedError(f"{error}; there is no other device to start again on") from error
                self._chosen = spare
            return self._chosen

    def _tell_other_bits(self, device: Device) -> None:
        # A driver whose bits the tests hold is spared the terrain, which takes it longer than opening.
        with self._lock:
            verdict = self_test(device, compare=not device.known)
            told = device in self._told
            self._told.add(device)
        if verdict.bits == "failed":
            raise DeviceFailedError(f"{device.name} ({device.platform}) failed: {verdict.detail}")
        if verdict.bits != "same" and not told:
            _note(f"self-test of {device.name} ({device.platform}): {verdict.line}")


def _note(line: str) -> None:
    sys.stderr.write(f"sketchterrain: note: {one_line(line)}\n")
