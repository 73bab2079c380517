"""Quantization on a device: the bytes that NumPy rounds the same values to."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from sketchterrain.compute.context import ComputeContext
from sketchterrain.errors import DeviceError, DeviceFailedError, InputError
from sketchterrain.export.sampled import quantise_weights
from sketchterrain.generation.terrain import Terrain
from sketchterrain.terrain.rasters import GridWindow, quantized_bands
from sketchterrain.world.task_runner import quantised_bands
from tests.devices import DEVICES, each_other_device

from .conftest import assert_same

SIDE, ACROSS = 5, 3
# Within one patch, over borders of patches and of bands, a whole number of patches, a single vertex.
WINDOWS = {
    "one": {"left": -3, "top": 9, "columns": 1, "rows": 1},
    "small": {"left": 700, "top": 650, "columns": 40, "rows": 33},
    "whole": {"left": 512, "top": 512, "columns": 129, "rows": 65},
    "bands": {"left": 100, "top": -77, "columns": 350, "rows": 300},
    "far": {"left": 50_000, "top": 90_000, "columns": 70, "rows": 70},
}

WITH_DOUBLE = [device for device in DEVICES if device.has_double]
WITHOUT_DOUBLE = [device for device in DEVICES if not device.has_double]
pytestmark = pytest.mark.skipif(not WITH_DOUBLE, reason="no device with 64-bit floats")


@pytest.fixture(scope="module")
def with_double() -> ComputeContext:
    return ComputeContext(WITH_DOUBLE[0])


@pytest.fixture(scope="module")
def valley(valley, with_double) -> Terrain:
    return Terrain(valley.sketch, valley.recipe, with_double)


@pytest.fixture(scope="module")
def desert(desert, with_double) -> Terrain:
    return Terrain(desert.sketch, desert.recipe, with_double)


def test_devices_without_doubles_are_errors_and_the_host_packs(desert) -> None:
    window = {"cell": 8.0, **WINDOWS["whole"]}
    for device in WITHOUT_DOUBLE:
        other = Terrain(desert.sketch, desert.recipe, ComputeContext(device))
        with pytest.raises(DeviceError, match="has no 64-bit floats"):
            other.window_bytes(0.0, 4096.0, **window)
        (one,), (two,) = (
            list(quantised_bands(each.window(0.0, 4096.0, **window))) for each in (desert, other)
        )
        np.testing.assert_array_equal(one.normal, two.normal)
        np.testing.assert_array_equal(one.materials, two.materials)


def test_bytes_are_those_of_the_host(valley, monkeypatch) -> None:
    monkeypatch.setattr("sketchterrain.terrain.rasters._PATCHES_PER_BAND", 12)
    for window, place in WINDOWS.items():
        here = {"cell": 4.0, **place}
        found = list(valley.window_bytes(0.0, 4096.0, **here))
        expected = list(quantised_bands(valley.window(0.0, 4096.0, **here)))
        assert [band.top for band in found] == [band.top for band in expected], window
        for name in ("height", "normal", "materials"):
            for one, other in zip(found, expected, strict=True):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=window)
                assert getattr(one, name).dtype == getattr(other, name).dtype
        assert all((band.materials.sum(axis=0, dtype=int) == 255).all() for band in found)


@each_other_device
def test_bytes_are_the_same_on_every_device(desert, other) -> None:
    if not other.has_double:
        pytest.skip("no 64-bit floats")
    window = {"cell": 8.0, **WINDOWS["whole"]}
    terrains = (desert, Terrain(desert.sketch, desert.recipe, ComputeContext(other)))
    (one,), (two,) = (each.window_bytes(0.0, 4096.0, **window) for each in terrains)
    np.testing.assert_array_equal(one.normal, two.normal)
    np.testing.assert_array_equal(one.materials, two.materials)


def test_smaller_batches_change_no_byte(valley) -> None:
    window = {"cell": 4.0, **WINDOWS["whole"]}
    (one,) = valley.window_bytes(0.0, 4096.0, **window)
    other = Terrain(valley.sketch, valley.recipe, valley.context)
    other._evaluator._patches_at_once.limit = 1
    (two,) = other.window_bytes(0.0, 4096.0, **window)
    assert_same(one, two)


def launched(
    context, ground, weights
) -> tuple[npt.NDArray[Any], npt.NDArray[np.uint8], npt.NDArray[np.uint8], int]:
    """Pack patches of SIDE² vertices, ACROSS of them side by side, all at once."""
    count, real = len(ground), context.real_dtype
    rows, columns = count // ACROSS * (SIDE - 1) + 1, ACROSS * (SIDE - 1) + 1
    size = rows * columns
    number = weights.shape[-1]
    planes = [context.empty(size, real), *(context.empty(each * size, np.uint8) for each in (3, number))]
    nonfinite = context.upload(np.zeros(1, np.int32), writable=True)
    arrays = [context.upload(np.ascontiguousarray(each, real)) for each in (ground, weights)]
    scalars = [np.int32(each) for each in (0, ACROSS, rows, columns)]
    size3 = (SIDE, SIDE, count)
    given = (*scalars, *arrays, *planes, nonfinite)
    context.launch("ground_bytes.cl", "ground_bytes", size3, *given, defines=(("MATERIALS", number),))
    height = context.download(planes[0], (rows, columns), real)
    normal = context.download(planes[1], (3, rows, columns), np.uint8)
    weight = context.download(planes[2], (number, rows, columns), np.uint8)
    return height, normal, weight, int(context.download(nonfinite, 1, np.int32)[0])


def patches_of(plane: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Cut a plane into the patches that share its rows and columns."""
    rows, columns = plane.shape[0] // (SIDE - 1), plane.shape[1] // (SIDE - 1)
    starts = [(row * (SIDE - 1), column * (SIDE - 1)) for row in range(rows) for column in range(columns)]
    return np.stack([plane[top : top + SIDE, left : left + SIDE] for top, left in starts])


def weights_of(kind: str, shape: tuple[int, int], count: int = 8) -> npt.NDArray[np.float32]:
    rng = np.random.default_rng(3)
    if kind == "one":
        return np.eye(count, dtype=np.float32)[rng.integers(0, count, shape)]
    if kind == "equal":
        return np.full((*shape, count), 1 / count, np.float32)
    if kind == "ties":
        return np.eye(count, dtype=np.float32)[rng.integers(0, count, shape)] * 0.25 + np.float32(
            0.75 / count
        )
    if kind == "tiny":
        return np.where(rng.random((*shape, count)) < 0.5, np.float32(1e-42), np.float32(0.2)).astype(
            np.float32
        )
    return (rng.random((*shape, count)) ** 4).astype(np.float32)


@pytest.mark.parametrize("real", ["float", "double"])
def test_weights_are_rounded_as_numpy_rounds_them(real) -> None:
    context = ComputeContext(WITH_DOUBLE[0], real=real)
    cases = [(kind, 8) for kind in ("one", "equal", "ties", "tiny")] + [("random", n) for n in (1, 3, 7, 16)]
    for kind, count in cases:
        shape = (4 * (SIDE - 1) + 1, ACROSS * (SIDE - 1) + 1)
        plane = weights_of(kind, shape, count).astype(context.real_dtype)
        ground = np.zeros((*plane.shape[:2], 4), context.real_dtype)
        _, _, weight, nonfinite = launched(context, patches_of(ground), patches_of(plane))
        assert nonfinite == 0
        np.testing.assert_array_equal(weight, quantise_weights(plane).transpose(2, 0, 1), err_msg=f"{count}")


def test_non_finite_values_are_counted(with_double) -> None:
    shape = (SIDE, ACROSS * (SIDE - 1) + 1)
    for value in (np.nan, np.inf, -np.inf):
        for where in ("height", "normal", "weight"):
            plane, weights = np.zeros((*shape, 4), np.float32), weights_of("equal", shape)
            target, part = {"height": (plane, 3), "normal": (plane, 1), "weight": (weights, 7)}[where]
            target[2, 2, part] = value
            assert launched(with_double, patches_of(plane), patches_of(weights))[3] == 1, (where, value)


def test_non_finite_ground_and_empty_windows_are_errors(valley, monkeypatch) -> None:
    with pytest.raises(InputError, match="at least 1 × 1 vertices"):
        quantized_bands(valley._evaluator, GridWindow(0.0, 0.0, 1.0, 0, 0, 0, 5))
    read = ComputeContext.read

    def nonfinite(context: ComputeContext, buffer: Any, array: npt.NDArray[Any]) -> Any:
        context.wait(read(context, buffer, array))
        if array.dtype == np.int32:
            array[0] = 7
        return read(context, buffer, np.empty_like(array))

    monkeypatch.setattr(ComputeContext, "read", nonfinite)
    with pytest.raises(DeviceFailedError, match=r"produced non-finite values .*: 7"):
        list(valley.window_bytes(0.0, 0.0, cell=4.0, **WINDOWS["one"]))
