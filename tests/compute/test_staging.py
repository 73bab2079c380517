"""Small arrays in one transfer: what was put comes out, whatever was put before and without room."""

import numpy as np
import pytest

from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.compute.staging import Staging
from sketchterrain.errors import DeviceMemoryError

pytestmark = pytest.mark.skipif(not list_devices(), reason="no OpenCL device")


@pytest.mark.parametrize("device", list_devices(), ids=lambda d: d.platform)
def test_what_was_put_comes_out(device) -> None:
    context, draw = ComputeContext(device), np.random.default_rng(3)
    staging = Staging(context)
    for count in (1, 7, 3, 4000, 2, 4001):
        arrays = {
            "reals": draw.normal(size=(count, 4)).astype(np.float32),
            "nothing": np.zeros(0, np.int32),
            "longs": draw.integers(0, 1 << 60, 3 * count),
        }
        parts = staging.put(arrays)
        for name, array in arrays.items():
            found = context.download(parts[name], array.shape, array.dtype)
            np.testing.assert_array_equal(found, array)


def test_without_room_what_there_was_still_works(monkeypatch: pytest.MonkeyPatch) -> None:
    context = ComputeContext()
    staging = Staging(context)
    staging.put({"a": np.arange(10)})

    def full(*_: object) -> None:
        raise DeviceMemoryError("full")

    with monkeypatch.context() as patch:
        patch.setattr(context, "empty", full)
        with pytest.raises(DeviceMemoryError):
            staging.put({"a": np.arange(10_000)})
        small = staging.put({"a": np.arange(20)})
    np.testing.assert_array_equal(context.download(small["a"], 20, np.int64), np.arange(20))
    large = staging.put({"a": np.arange(10_000)})
    np.testing.assert_array_equal(context.download(large["a"], 10_000, np.int64), np.arange(10_000))
