"""Running work on a device, restarted on a CPU device if the device fails.

Results never mix bits of two devices.
"""

import sys
from collections.abc import Callable
from threading import Lock
from typing import TypeVar

from sketchterrain.app.console import Stages
from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import Device, choose_device, fallback_device
from sketchterrain.errors import DeviceFailedError, one_line
from sketchterrain.terrain.self_test import self_test

T = TypeVar("T")


def run_with_fallback(
    work: Callable[[ComputeContext, tuple[str, ...]], T],
    *,
    device: str | None,
    fast: bool = False,
    stages: Stages,
) -> T:
    """Run work on the device that a selector names, with a `DeviceFallback` of its own."""
    return DeviceFallback(device, fast=fast).run(work, stages=stages)


class DeviceFallback:
    """The device of jobs, which may be concurrent; once it fails a CPU device replaces it for good."""

    def __init__(self, device: str | None, *, fast: bool = False) -> None:
        self.fast = fast
        self._device = choose_device(device)
        self._failed: list[Device] = []
        self._reported: set[Device] = set()
        self._lock = Lock()

    def run(self, work: Callable[[ComputeContext, tuple[str, ...]], T], *, stages: Stages) -> T:
        """Run work on the device, and all of it again on a CPU device if the device fails.

        `work` gets an open device and a line for each device that failed; it must have no effect before it
        returns. Raise DeviceFailedError if no device remains.
        """
        restarts: list[str] = []
        while True:
            device = self._device
            try:
                with stages.stage("device", "Opening the device"):
                    if not self.fast:
                        self._check_bits(device)
                    context = ComputeContext(device, fast=self.fast)
                return work(context, tuple(restarts))
            except DeviceFailedError as error:
                spare = self._replacement(device, error)
                restarts.append(f"{error}; restarted on {spare.name} ({spare.platform})")
            _print_note(restarts[-1])

    def _replacement(self, failed: Device, error: DeviceFailedError) -> Device:
        """Return the device to use after a failure, which several jobs may report at once."""
        with self._lock:
            if failed not in self._failed:
                self._failed.append(failed)
            if self._device in self._failed:
                spare = fallback_device(self._failed)
                if spare is None:
                    raise DeviceFailedError(f"{error}; there is no other device to restart on") from error
                self._device = spare
            return self._device

    def _check_bits(self, device: Device) -> None:
        # Comparing terrain takes longer than opening, so drivers whose bits the tests hold are exempt.
        with self._lock:
            verdict = self_test(device, compare=not device.known)
            reported = device in self._reported
            self._reported.add(device)
        if verdict.bits == "failed":
            raise DeviceFailedError(f"{device.name} ({device.platform}) failed: {verdict.detail}")
        if verdict.bits != "same" and not reported:
            _print_note(f"self-test of {device.name} ({device.platform}): {verdict.line}")


def _print_note(line: str) -> None:
    sys.stderr.write(f"sketchterrain: note: {one_line(line)}\n")
