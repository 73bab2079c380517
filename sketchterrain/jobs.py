"""Work on a device, and where the device misbehaves, all of it again on a CPU: never a mixture."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

from sketchterrain.compute import ComputeContext, choose_device, spare_device
from sketchterrain.errors import DeviceFailedError, one_line
from sketchterrain.terrain import self_test

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.compute import Device
    from sketchterrain.progress import Stages

__all__ = ["run_job"]

T = TypeVar("T")


def run_job(
    work: Callable[[ComputeContext, tuple[str, ...]], T],
    *,
    device: str | None,
    fast: bool = False,
    stages: Stages,
) -> T:
    """Do work on a device, and where that fails all of it again on a CPU device that has not failed yet.

    Parameters
    ----------
    work
        Takes an open device and a line for each device that failed before it; it must have no effect until
        it is through.
    device
        Selector as for :func:`~sketchterrain.compute.choose_device`.
    fast
        Whether the kernels may trade bits for speed.
    stages
        Told and timed: ``device``.

    Raises
    ------
    DeviceFailedError
        If no device is left.
    DeviceError
        If there is no such device, or it has no room.
    """
    chosen = choose_device(device)
    failed: list[Device] = []
    told: list[str] = []
    while True:
        try:
            with stages.stage("device", "Opening the device"):
                context = ComputeContext(chosen, fast=fast)
            if not fast:
                _tell_other_bits(chosen)
            return work(context, tuple(told))
        except DeviceFailedError as error:
            failed.append(chosen)
            spare = spare_device(failed)
            if spare is None:
                raise DeviceFailedError(f"{error}; there is no other device to start again on") from error
            told.append(f"{error}; all of it is done again on {spare.name} ({spare.platform})")
            chosen = spare
        _note(told[-1])


def _tell_other_bits(device: Device) -> None:
    # A driver whose bits the tests hold is spared the terrain, which takes it longer than opening.
    verdict = self_test(device, compare=not device.known)
    if verdict.bits != "same":
        _note(f"self-test of {device.name} ({device.platform}): {verdict.line}")


def _note(line: str) -> None:
    sys.stderr.write(f"sketchterrain: note: {one_line(line)}\n")
