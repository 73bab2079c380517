"""What a world will take, told before: near to what it took, and the same each time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from sketchterrain.errors import InputError
from sketchterrain.terrain import build
from sketchterrain.world import plant_samples
from sketchterrain.world.estimate import Estimate, estimate
from sketchterrain.world.grid import World
from sketchterrain.world.plant_samples import SampledPlants, _seconds, _Timed, _wider, sample_plants
from sketchterrain.world.run import run_world
from sketchterrain.world.samples import evenly

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.world.job import Form, Job


@pytest.fixture(scope="module")
def square(small_job: Job, tmp_path_factory: pytest.TempPathFactory) -> Job:
    """The whole sketch, 1 m apart."""
    output = tmp_path_factory.mktemp("square") / "world.zarr"
    return replace(small_job, world=World(0.0, 0.0, 512.0, 512.0, 1.0), output=output)


@pytest.fixture(scope="module")
def told(square: Job) -> Estimate:
    return estimate(square)


@pytest.mark.slow
@pytest.mark.parametrize(("form", "name"), [("zarr", "w.zarr"), ("tiles", "w"), ("tif", "w.tif")])
def test_bytes_are_what_is_written(square: Job, tmp_path: Path, heard: Any, form: Form, name: str) -> None:
    job = replace(square, form=form, output=tmp_path / name)
    shares: list[float] = []
    told = estimate(job, progress=shares.append)
    assert shares[-1] == 1.0
    assert not list(tmp_path.iterdir())
    done = run_world(job, watcher=heard)
    assert sum(told.disk.values()) == pytest.approx(done.bytes, rel=0.2)
    assert told.tasks == done.tasks
    whole = sum(told.disk.values())
    assert told.disk_needed == pytest.approx(2 * whole if form == "tif" else whole)
    again = estimate(job)
    assert again.disk == told.disk  # the same patches each time
    assert again.done == told.tasks if form != "tif" else again.seconds >= 0
    assert again.disk_needed <= told.disk_needed


@pytest.mark.slow
def test_plants_are_about_as_many(square: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant_samples, "_SQUARES", 6)
    job = replace(square, plants="parquet")
    terrain = build(job.sketch)
    found = sample_plants(job, terrain)
    count = len(terrain.foliage(0.0, 0.0, 512.0, 512.0))
    assert count > 50
    assert found.plants == pytest.approx(count, rel=0.3)
    assert found.bytes > 20 * count


def test_rooms_that_are_too_small_are_refused(told: Estimate) -> None:
    told.refuse_impossible()
    with pytest.raises(InputError, match=r"memory at once, 1\.0 MiB are left"):
        replace(told, memory_left=1 << 20).refuse_impossible()
    replace(told, memory_left=1 << 20, workers=-1).refuse_impossible()  # others have memory of their own
    vast = replace(told, sampled=told.sampled._replace(layers={"height": 1e18}))
    with pytest.raises(InputError, match="the world's files need up to"):
        vast.refuse_impossible()


def test_devices_of_their_own_share_the_time_and_a_processor_does_not(told: Estimate) -> None:
    sampled = told.sampled
    cpu, gpu = (replace(told, device=replace(told.device, type=kind)) for kind in ("CPU", "GPU"))
    assert cpu.device_seconds == pytest.approx(
        (sampled.evaluating + sampled.writing) * told.job.world.vertices
    )
    assert gpu.device_seconds == pytest.approx(
        max(sampled.evaluating, sampled.writing) * told.job.world.vertices
    )
    start = replace(cpu, done=told.tasks).seconds  # opening a device takes its time, too
    assert 0.0 < start < 2.0
    assert cpu.seconds == pytest.approx(cpu.device_seconds + start)
    four = {kind: replace(each, workers=4) for kind, each in (("CPU", cpu), ("GPU", gpu))}
    apart = four["CPU"].seconds - four["GPU"].seconds
    assert apart == pytest.approx(cpu.device_seconds - gpu.device_seconds / 4)


def test_lines_and_json_tell_the_same(told: Estimate) -> None:
    entry = told.as_dict()
    assert (entry["columns"], entry["rows"], entry["levels"]) == (513, 513, 3)
    assert entry["disk"]["needed"] == round(told.disk_needed)
    text = "\n".join(replace(told, plants=SampledPlants(12_345.0, 1e6, 1.0)).lines())
    assert "513 × 513 vertices 1 m apart, 3 levels" in text
    assert "about 12 345 plants" in text
    assert "by 3 workers" in "\n".join(replace(told, workers=3).lines())


def test_places_cover_the_square_evenly() -> None:
    places = [evenly(number) for number in range(64)]
    assert all(0 <= x < 1 and 0 <= y < 1 for x, y in places)
    for part in range(4):
        assert 14 <= sum(part <= 4 * x < part + 1 for x, _ in places) <= 18
        assert 14 <= sum(part <= 4 * y < part + 1 for _, y in places) <= 18


def test_time_of_plants_is_so_much_for_each_place_and_each_plant() -> None:
    bare, dense = _Timed(1.0, 10.0, 0.0), _Timed(3.0, 10.0, 4.0)
    assert _seconds([bare, dense], 100.0, 8.0) == pytest.approx(0.1 * 100.0 + 0.5 * 8.0)
    assert _seconds([bare, bare], 100.0, 0.0) == pytest.approx(10.0)


def test_a_square_that_is_timed_stays_in_the_world() -> None:
    world, square = World(0.0, 0.0, 100.0, 400.0, 1.0), World(80.0, 180.0, 100.0, 200.0, 20.0)
    wider = _wider(world, square, 4.0)
    assert (wider.west, wider.south, wider.east, wider.north) == (50.0, 150.0, 100.0, 230.0)
