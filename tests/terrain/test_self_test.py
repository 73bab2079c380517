"""Self-test of a device, smaller batches when memory is short, and non-finite values."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

import sketchterrain.generation.self_test as verdicts
from sketchterrain.compute import device_check
from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device_check import DeviceCheck, check_device, clear_check_results
from sketchterrain.errors import DeviceFailedError, DeviceMemoryError
from sketchterrain.generation.self_test import self_test
from sketchterrain.generation.terrain import Terrain
from sketchterrain.io.system import ChildFailedError
from sketchterrain.terrain.layers.covers import CoversLayer
from sketchterrain.terrain.patches import Batches
from tests.devices import DEVICES, KNOWN, device_params, needs_known_device

from .conftest import tiers

KEYS = [(3, 1, 2), *((4, 2 + i, 4 + j) for i in (0, 1) for j in (0, 1))]
CACHED = (self_test, check_device, verdicts._probe_in_child)


def clear_caches() -> None:
    for function in CACHED:
        function.cache_clear()


def full() -> None:
    """Fail like a device without free memory."""
    code = cl.status_code.MEM_OBJECT_ALLOCATION_FAILURE
    raise cl.MemoryError(cl._cl._ErrorRecord(msg="", code=code, routine="clInjected"))


@pytest.fixture
def fresh(tmp_path, monkeypatch) -> Iterator[None]:
    """Clear verdicts cached in the process and on disk, before and after."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    clear_caches()
    yield
    clear_caches()


@pytest.fixture
def right_arithmetic(fresh, monkeypatch) -> None:
    """Skip the child process that checks arithmetic, with a positive result."""
    monkeypatch.setattr(device_check, "module_result", lambda *_, **__: b"[]")


@pytest.fixture(scope="module")
def probe() -> Any:
    """The small terrain of a device with the right bits."""
    return verdicts._probe(DEVICES[0])


@pytest.mark.slow
@pytest.mark.parametrize("device", device_params(lambda device: device.known))
def test_known_devices_pass_and_the_verdict_is_cached(device) -> None:
    for compare in (True, False):
        verdict = self_test(device, compare=compare)
        assert verdict.bits == "same", verdict.line
        assert verdict.line.startswith("same bits (")
        assert self_test(device, compare=compare) is verdict


def test_the_small_terrain_contains_every_kind_of_feature(probe) -> None:
    recipe = verdicts._probe_recipe()
    assert set(recipe.points.painted["type"].tolist()) >= set(range(4))
    assert recipe.rivers
    assert recipe.lakes
    assert recipe[CoversLayer].covers
    assert len(probe.rest["plants"]) > 100


def test_without_another_driver_heights_are_compared_with_float64(
    right_arithmetic, probe, monkeypatch
) -> None:
    device = DEVICES[0]
    monkeypatch.setattr(verdicts, "list_devices", lambda: (device,))
    monkeypatch.setattr(verdicts, "_probe_in_child", lambda _: probe)
    verdict = self_test(device)
    assert verdict.bits == "same"
    assert "mm from float64" in verdict.detail


@needs_known_device
def test_other_bits_are_measured(right_arithmetic, probe, monkeypatch) -> None:
    device, other = KNOWN[:2]
    height = probe.height.copy()
    height[99] += 0.25
    results = {device: replace(probe, height=height), other: probe}
    monkeypatch.setattr(verdicts, "list_devices", lambda: (device, other))
    monkeypatch.setattr(verdicts, "_probe_in_child", results.__getitem__)
    verdict = self_test(device)
    assert verdict.bits == "other"
    assert f"off by up to 250 mm from {other.platform}" in verdict.line


def test_wrong_arithmetic_is_other_bits(right_arithmetic, probe, monkeypatch) -> None:
    device = DEVICES[0]
    monkeypatch.setattr(
        verdicts, "check_device", lambda d: DeviceCheck("", ("cubic",) if d == device else ())
    )
    monkeypatch.setattr(verdicts, "_probe_in_child", lambda _: probe)
    for compare in (True, False):
        assert self_test(device, compare=compare).line.endswith("wrong in cubic")
        assert self_test(device, compare=compare).bits == "other"


@needs_known_device
def test_a_device_that_fails_its_self_test(right_arithmetic, probe, monkeypatch) -> None:
    """In its arithmetic or in the terrain; other devices that fail are skipped."""
    device = KNOWN[0]

    def in_child(tested: Any) -> Any:
        if tested in failing:
            raise ChildFailedError("the self-test crashed (SIGSEGV)")
        return probe

    monkeypatch.setattr(verdicts, "_probe_in_child", in_child)
    failing = {device}
    assert self_test(device).line == "failed: the self-test crashed (SIGSEGV)"
    clear_check_results()
    self_test.cache_clear()
    failing = set(verdicts.list_devices()) - {device}
    assert "no other driver to compare with" in self_test(device).line
    self_test.cache_clear()
    monkeypatch.setattr(verdicts, "check_device", lambda _: DeviceCheck("it is gone"))
    assert self_test(device, compare=False).line == "failed: it is gone"


def test_batches_are_halved_until_they_fit() -> None:
    for capacity, most, halvings in ((1, 1, [32, 16, 8, 4, 2, 1]), (3, 2, [32, 16, 8, 4, 2]), (100, 64, [])):
        done: list[int] = []
        dropped: list[int] = []
        batches = Batches(64)

        def work(part: slice, capacity: int = capacity, done: list[int] = done) -> None:
            if part.stop - part.start > capacity:
                raise DeviceMemoryError("full")
            done.extend(range(part.start, part.stop))

        def smaller(batches: Batches = batches, dropped: list[int] = dropped) -> None:
            dropped.append(batches.limit)

        batches.run(150, work, on_shrink=smaller)
        assert done == list(range(150))
        assert batches.limit == most
        assert dropped == halvings
    with pytest.raises(DeviceMemoryError, match="full; not even a batch of one fits"):
        Batches(64).run(5, lambda _: work(slice(0, 999)))


def new_terrain(context: ComputeContext) -> Terrain:
    """Return the small terrain without anything on the device."""
    return Terrain(verdicts.probe_terrain(), verdicts._probe_recipe(), context)


def evaluations(context: ComputeContext, x: np.ndarray) -> list[np.ndarray]:
    """A raster, tiles and single heights of the small terrain."""
    terrain = new_terrain(context)
    raster, tiles = terrain.raster(257), terrain.tiles([(4, 3 + i, 5) for i in range(9)])
    found = [part for tile in tiles for part in (tile.height, tile.parent_normal)]
    return [raster.height, raster.normal, raster.materials, *found, terrain.heights(x, x)]


def packed_vertices(context: ComputeContext) -> list[np.ndarray]:
    terrain = new_terrain(context)
    store = terrain.vertex_store(5)
    return [terrain.write_tiles(KEYS, range(5), [-1, 0, 0, 0, 0], store), store.download()]


@pytest.mark.parametrize("capacity", [1, 5])
def test_short_memory_changes_no_bit(capacity, context, monkeypatch) -> None:
    """Allocation fails for more than so many patches or two hundred points at once."""
    x = np.linspace(0, 1024, 900)
    expected = evaluations(context, x) + packed_vertices(context)
    real = ComputeContext.launch

    def launch(self: ComputeContext, file: str, kernel: str, size: Any, *given: Any, **named: Any) -> None:
        if (len(size) == 2 and size[1] > capacity) or (len(size) == 1 and size[0] > 256):
            self._call("launching", full)
        real(self, file, kernel, size, *given, **named)

    monkeypatch.setattr(ComputeContext, "launch", launch)
    for one, other in zip(evaluations(context, x) + packed_vertices(context), expected, strict=True):
        np.testing.assert_array_equal(one, other)


@tiers("which", ["first of each kind"], ["every ninth"], ["every"])
def test_one_failed_allocation_changes_no_value(which, context, monkeypatch) -> None:
    """At any call: the same bits from smaller batches, or one clear error."""
    x = np.linspace(0, 1024, 700)
    calls: list[str] = []
    failing = -1
    real = ComputeContext._call

    def call(self: ComputeContext, doing: str, work: Any, *given: Any, **named: Any) -> Any:
        calls.append(doing)
        return (
            real(self, doing, full) if len(calls) - 1 == failing else real(self, doing, work, *given, **named)
        )

    def job() -> list[Any]:
        calls.clear()
        return evaluations(context, x)

    monkeypatch.setattr(ComputeContext, "_call", call)
    expected, kinds = job(), list(calls)
    errors = []
    selected = {
        "first of each kind": [kinds.index(kind) for kind in dict.fromkeys(kinds)],
        "every ninth": range(0, len(kinds), 9),
        "every": range(len(kinds)),
    }[which]
    for failing in selected:  # `call` reads it
        try:
            found = job()
        except DeviceMemoryError as error:
            errors.append((kinds[failing], str(error)))
            continue
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one, other)
    assert len(errors) < len(selected)
    assert all(f"has no memory left for {kind}" in line for kind, line in errors)


def test_non_finite_values_are_errors(context, monkeypatch) -> None:
    terrain = new_terrain(context)
    real = ComputeContext.download_into
    for value in (np.nan, np.inf):

        def download_into(self: ComputeContext, buffer: Any, array: Any, value: float = value) -> None:
            real(self, buffer, array)
            array.flat[-1] = value

        monkeypatch.setattr(ComputeContext, "download_into", download_into)
        for query in (
            lambda: terrain.heights(1, 2),
            lambda: terrain.tile(3, 1, 1),
            lambda: terrain.raster(9),
        ):
            with pytest.raises(DeviceFailedError, match="produced non-finite"):
                query()
