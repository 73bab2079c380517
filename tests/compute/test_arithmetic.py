"""The self-test's arithmetic: right where the options keep it right, and found wrong where they do not."""

import pytest

from sketchterrain import resources
from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.compute.arithmetic import wrong_arithmetic

pytestmark = pytest.mark.skipif(not list_devices(), reason="no OpenCL device")


@pytest.mark.parametrize("device", list_devices(), ids=lambda d: d.platform)
def test_the_arithmetic_is_right(device) -> None:
    assert wrong_arithmetic(ComputeContext(device)) == ()


@pytest.mark.parametrize("device", list_devices(), ids=lambda d: d.platform)
def test_contraction_is_found(device, monkeypatch: pytest.MonkeyPatch) -> None:
    if device.known:  # these compilers fuse where they may
        assert "inverse_sqrt" in wrong_arithmetic(ComputeContext(device, fast=True))
    text = resources.source("self_test.cl")
    fused = text.replace("a[i] * b[i] + c[i];", "fma(a[i], b[i], c[i]);")
    assert fused != text
    monkeypatch.setattr(resources, "source", lambda _: fused)
    assert wrong_arithmetic(ComputeContext(device)) == ("a product and a sum",)


@pytest.mark.parametrize(
    ("right", "wrong", "name"),
    [
        ("mixed(n);", "mixed(n) + 1;", "mixed"),
        ("inverse_sqrt(p);", "rsqrt(p);", "inverse_sqrt"),
        ("far >> (n & 31)", "(ulong)far >> (n & 31)", None),
        ("far >> (n & 31)", "far / (1L << (n & 31))", "a shift"),
        ("(uint)(int)(a[i] * R(1e6))", "(uint)convert_int_rte(a[i] * R(1e6))", "a conversion"),
    ],
)
def test_one_wrong_operation_is_named(
    monkeypatch: pytest.MonkeyPatch, right: str, wrong: str, name: str | None
) -> None:
    text = resources.source("self_test.cl")
    assert right in text
    monkeypatch.setattr(resources, "source", lambda _: text.replace(right, wrong))
    assert wrong_arithmetic(ComputeContext()) == (() if name is None else (name,))
