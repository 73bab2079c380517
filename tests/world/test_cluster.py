"""Shards are the terrain at the vertices of the grid; worlds of dask workers: failures, equal bytes."""

import errno
import os
import pickle
import random
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import choose_device
from sketchterrain.errors import DeviceError, DeviceFailedError, InputError, SketchterrainError
from sketchterrain.export.sampled import quantise_normals, quantise_weights
from sketchterrain.world import cluster as in_worker
from sketchterrain.world import run as running
from sketchterrain.world.cluster import check_scheduler
from sketchterrain.world.grid import SHARD, Shard
from sketchterrain.world.job import Task, iter_tasks
from sketchterrain.world.run import run_world
from sketchterrain.world.task_runner import TaskRunner, round_heights, shard_store

distributed = pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")  # sockets of the library, closed late

_IN_PROCESS = {
    "processes": False,
    "dashboard_address": None,
    "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"},
}

DEVIATING = """
from sketchterrain.compute import context
context._OPTIONS = ("-cl-std=CL1.2", "-cl-fast-relaxed-math", "-DFAST")
"""
OLDER = """
from sketchterrain.world import worker
worker.version = lambda _: "0.0.9"
"""
WRITING = """
import pickle, sys
from pathlib import Path
from sketchterrain.world.run import run_world
from tests.world.conftest import RecordingReporter
reporter = RecordingReporter()
reporter.task_finished = lambda made: print(made.task.kind, made.worker, flush=True)
run_world(pickle.loads(Path(sys.argv[1]).read_bytes()), workers=2, reporter=reporter)
"""


def shuffled(job):
    tasks = list(iter_tasks(job))
    random.Random(3).shuffle(tasks)
    return iter(tasks)


@contextmanager
def process(*words):
    """Run a dask command, and kill it with its children."""
    command = [sys.executable, "-m", "dask", *words]
    started = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        yield started
    finally:
        with suppress(ProcessLookupError):
            os.killpg(started.pid, signal.SIGKILL)
        started.communicate()


@pytest.fixture
def scheduler():
    """The address of a scheduler without workers, and its process."""
    with process("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard") as started:
        for line in started.stderr:
            if "Scheduler at:" in line:
                yield line.split("Scheduler at:")[1].strip(), started
                return
        raise AssertionError("no scheduler")


@contextmanager
def worker(scheduler, folder, name, *, preload=""):
    words = ["worker", scheduler, "--name", name, "--nthreads", "1", "--no-dashboard", "--memory-limit", "0"]
    words += ["--local-directory", str(folder / name), "--no-nanny"]
    if preload:
        patch = folder / f"{name}.py"
        patch.write_text(preload, encoding="utf-8")
        words += ["--preload", str(patch)]
    with process(*words):
        yield


def wait_for_workers(address, count):
    with distributed.Client(address, timeout=300, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=300)


def workers_of(pid):
    """Return the worker processes that a process has started."""
    found = []
    for child in psutil.Process(pid).children(recursive=True):
        with suppress(psutil.ZombieProcess, psutil.NoSuchProcess):
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
    return found


def then(reporter, act):
    """Call `act` with the number of finished tasks."""
    made = reporter.task_finished
    reporter.task_finished = lambda result: (made(result), act(len(reporter.done)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [OSError, ZeroDivisionError])
def test_thread_workers_give_equal_bytes_after_errors(
    kind, job, finished_world, reporter, tree, monkeypatch
) -> None:
    finish = TaskRunner.finish

    def failing(runner, pending):
        if pending.task.level == 0:
            if kind is ZeroDivisionError:
                raise ZeroDivisionError("no space")
            try:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            except OSError as error:
                raise SketchterrainError("0/height: cannot be written (no space)") from error
        return finish(runner, pending)

    monkeypatch.setattr(running, "iter_tasks", shuffled)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=2, **_IN_PROCESS) as cluster:
        with monkeypatch.context() as patch:
            patch.setattr(TaskRunner, "finish", failing)
            with pytest.raises((SketchterrainError, ZeroDivisionError), match="no space"):
                run_world(job, scheduler=cluster.scheduler_address, reporter=reporter)
        run_world(job, scheduler=cluster.scheduler_address, resume=True, reporter=reporter)
        assert not [name for name in cluster.scheduler.worker_plugins if "sketchterrain" in name]
    assert tree(job.output) == tree(finished_world)
    assert {made.worker for made in reporter.done} == {"worker 0", "worker 1"}
    assert reporter.notes == []


@pytest.mark.slow
def test_worker_with_failing_device_is_refused(job, finished_world, reporter, tree, monkeypatch) -> None:
    evaluate = TaskRunner.evaluate

    def failing(runner, task):
        if distributed.get_worker().name == 0:
            raise DeviceFailedError("it gave up")
        while not reporter.notes:  # the run looks at its workers once a second
            time.sleep(0.01)
        return evaluate(runner, task)

    monkeypatch.setattr(TaskRunner, "evaluate", failing)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, **_IN_PROCESS) as cluster:
        run_world(job, scheduler=cluster.scheduler_address, reporter=reporter)
    assert reporter.notes == ["worker 0 is refused: it gave up"]
    assert {made.worker for made in reporter.done} == {"worker 1"}
    assert tree(job.output) == tree(finished_world)


def test_missing_scheduler_is_reported_without_retries(monkeypatch) -> None:
    for word in ("", "localhost", "localhost:8786", "http://a:1", "tcp://a", "tcp://a:99999", "tcp://:1"):
        with pytest.raises(InputError, match=r"^expected a scheduler's address such as tcp://HOST:8786, got"):
            check_scheduler(word)
    connect = Mock(wraps=socket.create_connection)
    monkeypatch.setattr(socket, "create_connection", connect)
    with pytest.raises(SketchterrainError, match=r"^scheduler tcp://127.0.0.1:9 cannot be reached: "):
        check_scheduler("tcp://127.0.0.1:9")
    assert connect.call_count == 1


def test_worker_without_output_folder_is_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(in_worker, "_VISIBLE", 0.0)
    probe = tmp_path / ".probe"
    probe.write_text("this one", encoding="utf-8")
    in_worker.check_folder(str(probe), "this one")
    assert [path.name for path in tmp_path.iterdir()] == [".probe"]
    with pytest.raises(in_worker.RefusedError, match="it does not see the output's folder"):
        in_worker.check_folder(str(probe), "that one")
    with pytest.raises(in_worker.RefusedError, match="it does not see the output's folder"):
        in_worker.check_folder(str(tmp_path / "no" / "where"), "")


def test_local_workers_use_gpus_in_turn(monkeypatch) -> None:
    cpu = replace(choose_device(), type="CPU")
    cards = [replace(cpu, index=number, type="GPU", name=f"Card {number}") for number in range(2)]
    monkeypatch.delenv("PYOPENCL_CTX", raising=False)
    monkeypatch.setattr("sketchterrain.compute.device.list_devices", lambda: (*cards, cpu))
    monkeypatch.setattr("sketchterrain.compute.device_check.is_usable", lambda device: True)
    monkeypatch.setattr(
        "sketchterrain.compute.device.choose_device", lambda selector: f"chosen by {selector}"
    )
    assert [in_worker.choose_worker_device(None, rank).name for rank in range(3)] == [
        "Card 0",
        "Card 1",
        "Card 0",
    ]
    assert in_worker.choose_worker_device("Card 1", 0) == "chosen by Card 1"
    monkeypatch.setattr("sketchterrain.compute.device.list_devices", lambda: (cpu,))
    assert in_worker.choose_worker_device(None, 1) == "chosen by None"


@pytest.mark.soak
def test_killed_workers_are_replaced(job, finished_world, reporter, tree, monkeypatch) -> None:
    monkeypatch.setattr(running, "iter_tasks", shuffled)
    then(reporter, lambda done: workers_of(os.getpid())[0].kill() if done in (1, 4) else None)
    run_world(job, workers=2, reporter=reporter)
    assert tree(job.output) == tree(finished_world)
    assert {note.split(" disconnected")[0] for note in reporter.notes} <= {"worker 0", "worker 1"}
    assert reporter.notes
    assert workers_of(os.getpid()) == []


@pytest.mark.soak
def test_deviating_workers_are_refused_and_dead_scheduler_ends_run(
    job, finished_world, reporter, tree, scheduler, tmp_path
) -> None:
    address, started = scheduler
    with (
        worker(address, tmp_path, "liar", preload=DEVIATING),
        worker(address, tmp_path, "older", preload=OLDER),
    ):
        wait_for_workers(address, 2)
        with pytest.raises(DeviceError, match="all workers are refused: ") as caught:
            run_world(job, scheduler=address, reporter=reporter)
        assert caught.match(r"liar on \S+: (self-test of .*: other bits: |.* computes different results)")
        assert caught.match(r"older on \S+: it has sketchterrain 0\.0\.9, not ")
        assert caught.value.exit_code == 4
        reporter.notes.clear()
        then(reporter, lambda done: started.kill() if done == 5 else None)
        with worker(address, tmp_path, "honest"):
            wait_for_workers(address, 3)
            with pytest.raises(SketchterrainError, match=f"^scheduler {address} does not respond$"):
                run_world(job, scheduler=address, resume=True, reporter=reporter)
    assert {made.worker.split()[0] for made in reporter.done} == {"honest"}
    assert all(note.split()[0] in ("liar", "older") and " is refused: " in note for note in reporter.notes)
    run_world(job, resume=True, reporter=reporter)
    assert tree(job.output) == tree(finished_world)


@pytest.mark.soak
def test_workers_exit_with_killed_run(job, finished_world, reporter, tree, tmp_path) -> None:
    (tmp_path / "job").write_bytes(pickle.dumps(job))
    command = [sys.executable, "-c", WRITING, str(tmp_path / "job")]
    root = Path(__file__).parents[2]
    with subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, text=True) as started:
        assert started.stdout.readline().startswith("ground ")
        workers = workers_of(started.pid)
        started.kill()
    assert len(workers) == 2
    assert psutil.wait_procs(workers, timeout=300)[1] == []
    run_world(job, resume=True, reporter=reporter)
    assert tree(job.output) == tree(finished_world)


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
