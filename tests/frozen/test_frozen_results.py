"""Results of frozen sketches are bit-equal to the stored hashes, on any device and NumPy dispatch."""

import os
import subprocess
import sys

import pytest
from numpy._core import _multiarray_umath

from sketchterrain.compute.context import ComputeContext
from sketchterrain.generation.self_test import self_test
from tests.devices import DEVICES, device_params, needs_device

from . import frozen_results as frozen

SLICE = {
    "presets/valley_river": (4,),
    "random/010": None,
}
"""Frozen sketches of the default suite, and their tile levels."""


def check(sketches: dict[str, tuple[int, ...] | None], context: ComputeContext) -> None:
    device = f"{context.device.name} ({context.device.platform})"
    lines = []
    for name, levels in sketches.items():
        lines += frozen.differences(name, frozen.hashes_of(name, context, levels=levels), device)
    assert not lines, "\n".join(["", *lines, frozen.HOW_TO_REGENERATE])


@needs_device
def test_a_slice_of_the_frozen_results_holds() -> None:
    check(SLICE, ComputeContext())


@pytest.mark.slow
@pytest.mark.parametrize("device", device_params(lambda device: device.type == "CPU"))
def test_all_frozen_results_hold_on_every_cpu_driver(device) -> None:
    """An eighth of them on all but the first."""
    if self_test(device).bits != "same":
        pytest.skip("not a CPU driver that computes the same bits")
    some = frozen.sketches() if device == DEVICES[0] else frozen.sketches()[::8]
    check(dict.fromkeys(some), ComputeContext(device))


@pytest.mark.slow
@needs_device
def test_frozen_results_hold_without_avx512() -> None:
    features, dispatched = _multiarray_umath.__cpu_features__, _multiarray_umath.__cpu_dispatch__
    avx512 = [name for name in dispatched if name.startswith(("AVX512", "X86_V4")) and features[name]]
    if not avx512:
        pytest.skip("NumPy uses no AVX-512 on this CPU")
    environment = os.environ | {"NPY_DISABLE_CPU_FEATURES": " ".join(avx512)}
    child = subprocess.run(
        [sys.executable, frozen.__file__, "--every", "8"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert child.returncode == 0, child.stdout + child.stderr
