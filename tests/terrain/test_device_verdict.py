"""What the self-test says of a device, and that smaller batches and bad values are dealt with."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

import sketchterrain.terrain.device_verdict as verdicts
from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.errors import DeviceFailedError, DeviceMemoryError
from sketchterrain.terrain import Terrain, build, self_test
from sketchterrain.terrain.batches import Batches

# SKETCHTERRAIN_SOAK=1 fails at every call.
SHARE = 1 if os.environ.get("SKETCHTERRAIN_SOAK") else 9
KNOWN = [device for device in list_devices() if device.known]


@pytest.fixture
def fresh() -> Any:
    """Verdicts are kept for the process: forget them before and after."""
    self_test.cache_clear()
    yield
    self_test.cache_clear()


@pytest.mark.parametrize("compare", [True, False])
@pytest.mark.parametrize("device", KNOWN, ids=lambda d: d.platform)
def test_devices_whose_bits_the_tests_hold_pass(device: Any, compare: bool) -> None:
    verdict = self_test(device, compare=compare)
    assert verdict.bits == "same", verdict.line
    assert verdict.line.startswith("same bits (")
    start = time.perf_counter()
    assert self_test(device, compare=compare) is verdict
    assert time.perf_counter() - start < 0.01


def test_the_small_terrain_has_something_of_everything() -> None:
    recipe = verdicts._recipe_of_probe()
    assert set(recipe.painted["type"].tolist()) >= set(range(4))
    assert recipe.rivers
    assert recipe.lakes
    assert recipe.covers
    plants = verdicts._probe(list_devices()[0]).rest["plants"]
    assert len(plants) > 100


def test_without_another_driver_float64_is_near(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    device = list_devices()[0]
    monkeypatch.setattr(verdicts, "list_devices", lambda: (device,))
    verdict = self_test(device)
    assert verdict.bits == "same"
    assert "mm from float64" in verdict.detail


def test_other_bits_are_measured(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    device = list_devices()[0]
    real = Terrain.raster

    def raster(terrain: Terrain, side: int) -> Any:
        found = real(terrain, side)
        if terrain.context.device == device:
            found.height[3, 4] += 0.25
        return found

    monkeypatch.setattr(Terrain, "raster", raster)
    if len(KNOWN) < 2:
        pytest.skip("one driver has nothing to differ from")
    assert self_test(device).bits == "other"
    assert "off by up to 250 mm from" in self_test(device).line


def test_wrong_arithmetic_is_other_bits(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    device = list_devices()[0]
    monkeypatch.setattr(verdicts, "wrong_arithmetic", lambda c: ("cubic",) if c.device == device else ())
    for compare in (True, False):
        assert self_test(device, compare=compare).line.endswith("wrong in cubic")
        assert self_test(device, compare=compare).bits == "other"


def test_a_device_that_fails_its_test(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: object) -> Any:
        raise DeviceFailedError("it is gone")

    monkeypatch.setattr(verdicts, "wrong_arithmetic", refuse)
    assert self_test(list_devices()[0]).line == "failed: it is gone"


@pytest.mark.parametrize("room", [1, 3, 100])
def test_batches_are_halved_until_there_is_room(room: int) -> None:
    done: list[int] = []
    dropped: list[int] = []
    batches = Batches(64)

    def work(part: slice) -> None:
        if part.stop - part.start > room:
            raise DeviceMemoryError("full")
        done.extend(range(part.start, part.stop))

    batches.run(150, work, smaller=lambda: dropped.append(batches.most))
    assert done == list(range(150))
    assert batches.most == {1: 1, 3: 2, 100: 64}[room]
    assert dropped == {1: [32, 16, 8, 4, 2, 1], 3: [32, 16, 8, 4, 2], 100: []}[room]


def test_no_room_for_one_is_an_error() -> None:
    def work(part: slice) -> None:
        raise DeviceMemoryError("full")

    with pytest.raises(DeviceMemoryError, match="full; the smallest batch has no room either"):
        Batches(64).run(5, work)


@pytest.mark.parametrize("room", [1, 5])
def test_little_memory_changes_no_bit(
    room: int, context: ComputeContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Allocation fails for more than so many patches or two hundred points at once."""
    x = np.linspace(0, 1024, 900)
    whole = build(verdicts.probe_terrain(), device=context)
    expected = whole.raster(257), whole.tiles([(4, 3 + i, 5) for i in range(9)]), whole.heights(x, x)
    real = ComputeContext.launch

    def launch(self: ComputeContext, file: str, kernel: str, size: Any, *given: Any, **named: Any) -> None:
        if (len(size) == 2 and size[1] > room) or (len(size) == 1 and size[0] > 256):
            self._call("launching", full)
        real(self, file, kernel, size, *given, **named)

    def full() -> None:
        record = cl._cl._ErrorRecord(
            msg="", code=cl.status_code.MEM_OBJECT_ALLOCATION_FAILURE, routine="clInjected"
        )
        raise cl.MemoryError(record)

    monkeypatch.setattr(ComputeContext, "launch", launch)
    small = build(verdicts.probe_terrain(), device=context)
    found = small.raster(257), small.tiles([(4, 3 + i, 5) for i in range(9)]), small.heights(x, x)
    for name in ("height", "normal", "materials"):
        np.testing.assert_array_equal(getattr(found[0], name), getattr(expected[0], name))
    for one, other in zip(found[1], expected[1], strict=True):
        np.testing.assert_array_equal(one.height, other.height)
        np.testing.assert_array_equal(one.parent_normal, other.parent_normal)
    np.testing.assert_array_equal(found[2], expected[2])


def test_no_room_once_anywhere(context: ComputeContext, monkeypatch: pytest.MonkeyPatch) -> None:
    """At any call: the same bits from smaller batches, or one clear error; never other values."""
    x = np.linspace(0, 1024, 700)
    calls: list[str] = []
    failing = -1
    real = ComputeContext._call

    def call(self: ComputeContext, doing: str, work: Any, *given: Any, **named: Any) -> Any:
        calls.append(doing)
        return (
            real(self, doing, full) if len(calls) - 1 == failing else real(self, doing, work, *given, **named)
        )

    def full() -> None:
        code = cl.status_code.MEM_OBJECT_ALLOCATION_FAILURE
        raise cl.MemoryError(cl._cl._ErrorRecord(msg="", code=code, routine="clInjected"))

    def job() -> list[Any]:
        calls.clear()
        terrain = build(verdicts.probe_terrain(), device=context)
        raster, tiles = terrain.raster(257), terrain.tiles([(4, 3 + i, 5) for i in range(9)])
        rest = [part for tile in tiles for part in (tile.height, tile.parent_normal)]
        return [raster.height, raster.normal, raster.materials, *rest, terrain.heights(x, x)]

    monkeypatch.setattr(ComputeContext, "_call", call)
    expected, kinds = job(), list(calls)
    errors = []
    chosen = range(0, len(kinds), SHARE)
    for failing in chosen:  # `call` reads it
        try:
            found = job()
        except DeviceMemoryError as error:
            errors.append((kinds[failing], str(error)))
            continue
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one, other)
    assert len(errors) < len(chosen)
    assert all(f"has no memory left for {kind}" in line for kind, line in errors)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_no_number_is_refused(
    value: float, context: ComputeContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    terrain = build(verdicts.probe_terrain(), device=context)
    real = ComputeContext.download_into

    def download_into(self: ComputeContext, buffer: Any, array: Any) -> None:
        real(self, buffer, array)
        array.flat[-1] = value

    monkeypatch.setattr(ComputeContext, "download_into", download_into)
    for ask in (
        lambda: terrain.heights(1.0, 2.0),
        lambda: terrain.tile(3, 1, 1),
        lambda: terrain.raster(9),
    ):
        with pytest.raises(DeviceFailedError, match="of them no numbers"):
            ask()
