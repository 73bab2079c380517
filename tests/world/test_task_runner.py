"""Shards are the terrain at the vertices of the grid."""

from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest

from sketchterrain.compute.context import ComputeContext
from sketchterrain.export.sampled import quantise_normals, quantise_weights
from sketchterrain.world.grid import SHARD, Shard
from sketchterrain.world.job import Task, iter_tasks
from sketchterrain.world.task_runner import TaskRunner, round_heights, shard_store


@pytest.fixture(scope="module")
def runner(small_job, tmp_path_factory) -> TaskRunner:
    job = replace(small_job, output=tmp_path_factory.mktemp("running") / "world.zarr")
    shard_store(job).create()
    return TaskRunner(job, ComputeContext())


def test_shard_heights_equal_terrain_at_level_cell(runner) -> None:
    world = runner.job.world
    for shard in (Shard(0, 0, 1), Shard(0, 0, 2), Shard(1, 0, 0), Shard(5, 0, 0)):
        ground, level = runner.compute_shard(shard), world.levels[shard.level]
        rows, columns = level.size_of(shard)
        x = world.west + (shard.column * SHARD + np.arange(columns)) * level.cell
        y = world.north - (shard.row * SHARD + np.arange(rows)) * level.cell
        expected = runner.terrain.heights(*np.meshgrid(x, y), cell_size=level.cell)
        np.testing.assert_array_equal(ground.height, expected)
        assert (ground.materials.sum(axis=0, dtype=int) == 255).all()
        assert ground.normal.shape == (3, rows, columns)


def test_normals_and_weights_equal_exports(runner) -> None:
    world, shard = runner.job.world, Shard(1, 0, 1)
    ground, level = runner.compute_shard(shard), runner.job.world.levels[1]
    rows, columns = level.size_of(shard)
    west, north = world.west + SHARD * level.cell, world.north
    east, south = west + (columns - 1) * level.cell, north - (rows - 1) * level.cell
    (band,) = runner.terrain.grid(west, south, east, north, columns=columns, rows=rows)
    np.testing.assert_array_equal(ground.normal, quantise_normals(band.normal).transpose(2, 0, 1))
    np.testing.assert_array_equal(ground.materials, quantise_weights(band.materials).transpose(2, 0, 1))


def test_host_rounding_equals_device_rounding(runner) -> None:
    context = ComputeContext()
    plain = TaskRunner(runner.job, context)
    plain._window = plain._window_on_host  # as where the device has none
    for name in ("height", "normal", "materials"):
        one, other = (getattr(each.compute_shard(Shard(2, 0, 0)), name) for each in (plain, runner))
        np.testing.assert_array_equal(one, other)


def test_task_result_lists_written_files(runner) -> None:
    made = runner.finish(runner.evaluate(Task("ground", 3, 0, 0)))
    assert [file.file.split("/")[1] for file in made.files] == ["height", "normal", "materials"]
    for file in made.files:
        content = (runner.job.output / file.file).read_bytes()
        assert (file.bytes, file.sha256) == (len(content), sha256(content).hexdigest())


def test_heights_are_rounded_to_multiples_of_a_step() -> None:
    height = np.random.default_rng(2).normal(0, 300, 1000).astype(np.float32)
    assert round_heights(height, 0.0) is height
    for step in (0.25, 1 / 1024):
        found = round_heights(height, step)
        assert found.dtype == np.float32
        assert np.abs(found - height).max() <= step / 2
        assert (np.mod(found.astype(np.float64), step) == 0).all()
        assert not np.signbit(round_heights(np.float32([-step / 4]), step)).any()


def test_tasks_are_unique_and_coarse_first(small_job) -> None:
    tasks = list(iter_tasks(small_job))
    assert len(set(tasks)) == len(tasks) == small_job.world.shard_count == 9
    assert [task.level for task in tasks] == sorted((task.level for task in tasks), reverse=True)
