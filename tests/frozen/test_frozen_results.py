"""What frozen sketches give keeps its bits, on every device and whatever NumPy uses of the CPU."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from numpy._core import _multiarray_umath

from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.terrain import self_test

SLICE = {
    "presets/valley_river": (4,),
    "presets/desert_mountains": (4,),
    "random/010": None,
    "random/017": None,
    "random/030": None,
}
"""Frozen sketches of the default suite, and their tile levels."""
PROGRAM = Path(__file__).with_name("frozen_results.py")


@pytest.fixture(scope="session")
def frozen() -> ModuleType:
    spec = importlib.util.spec_from_file_location("frozen_results", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def check(frozen: ModuleType, sketches: dict[str, tuple[int, ...] | None], context: ComputeContext) -> None:
    device = f"{context.device.name} ({context.device.platform})"
    lines = []
    for name, levels in sketches.items():
        lines += frozen.differences(name, frozen.hashes_of(name, context, levels=levels), device)
    assert not lines, "\n".join(["", *lines, frozen.HOW_TO_REGENERATE])


@pytest.mark.skipif(not list_devices(), reason="no OpenCL device")
def test_a_slice_of_the_frozen_results_holds(frozen: ModuleType) -> None:
    check(frozen, SLICE, ComputeContext())


def test_weights_are_hashed_by_material_name(frozen: ModuleType) -> None:
    class Weights:
        def __init__(self, *layers: list[float]) -> None:
            self.materials = frozen.np.array(layers, "f4").T

    tile = Weights([0.25, 1.0], [0.75, 0.0])
    digest = frozen.weights([tile], ["rock", "sand"])
    assert frozen.weights([Weights([0.75, 0.0], [0.25, 1.0])], ["sand", "rock"]) == digest
    assert frozen.weights([Weights([0.25, 1.0], [0, 0], [0.75, 0.0])], ["rock", "ice", "sand"]) == digest
    assert frozen.weights([tile], ["sand", "rock"]) != digest
    assert frozen.weights([Weights([0.25, 1.0], [0.75, 1e-7])], ["rock", "sand"]) != digest


@pytest.mark.slow
@pytest.mark.parametrize("device", list_devices(), ids=lambda device: device.platform)
def test_all_frozen_results_hold_on_every_cpu_driver(frozen: ModuleType, device) -> None:
    if device.type != "CPU" or self_test(device).bits != "same":
        pytest.skip("not a CPU driver that computes the same bits")
    check(frozen, dict.fromkeys(frozen.sketches()), ComputeContext(device))


@pytest.mark.slow
@pytest.mark.skipif(not list_devices(), reason="no OpenCL device")
def test_all_frozen_results_hold_without_avx512() -> None:
    features, chosen = _multiarray_umath.__cpu_features__, _multiarray_umath.__cpu_dispatch__
    avx512 = [name for name in chosen if name.startswith(("AVX512", "X86_V4")) and features[name]]
    if not avx512:
        pytest.skip("NumPy uses no AVX-512 on this CPU")
    environment = os.environ | {"NPY_DISABLE_CPU_FEATURES": " ".join(avx512)}
    child = subprocess.run(
        [sys.executable, PROGRAM], env=environment, capture_output=True, text=True, check=False
    )
    assert child.returncode == 0, child.stdout + child.stderr
