"""A small world of several shards, written once per session, and a recording reporter."""

import resource
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.world.grid import Shard, ShardData, World
from sketchterrain.world.job import Job, TaskResult
from sketchterrain.world.journal import BrokenFile
from sketchterrain.world.run import ProgressReporter, run_world
from sketchterrain.world.task_runner import TaskRunner


class RecordingReporter(ProgressReporter):
    """A reporter that records all events."""

    def __init__(self) -> None:
        super().__init__()
        self.shares: list[float] = []
        self.found: list[BrokenFile] = []
        self.counts: list[tuple[int, int]] = []
        self.done: list[TaskResult] = []
        self.notes: list[str] = []

    def verified(self, share: float) -> None:
        self.shares.append(share)

    def broken(self, file: BrokenFile) -> None:
        self.found.append(file)

    def started(self, tasks: int, done: int) -> None:
        self.counts.append((tasks, done))

    def task_finished(self, result: TaskResult) -> None:
        self.done.append(result)

    def joined(self, share: float) -> None:
        assert 0 <= share <= 1

    def note(self, line: str) -> None:
        self.notes.append(line)


def _tree(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file in a folder, by name."""
    return {
        path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="session")
def small_job() -> Job:
    """A strip of a mountain with forest: three shards side by side, and five coarser levels."""
    mountain, forest = (np.zeros((32, 32), np.uint8) for _ in range(2))
    mountain[4:10, 20:28] = 1
    forest[18:28, 4:14] = 1
    sketch = Sketch(extent=512.0, layers={"mountain": mountain, "forest": forest})
    world = World(-20.0, 250.0, 492.5, 254.0, 0.125)
    return Job(sketch, make_recipe(sketch), world, Path("nowhere"), "zarr", ("height", "normal", "materials"))


@pytest.fixture(scope="session")
def finished_world(small_job: Job, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That world as a finished Zarr store, read-only."""
    output = tmp_path_factory.mktemp("whole") / "world.zarr"
    run_world(replace(small_job, output=output), reporter=RecordingReporter())
    return output


@pytest.fixture
def job(small_job: Job, tmp_path: Path) -> Job:
    """The same job with an output in the test's folder."""
    return replace(small_job, output=tmp_path / "world.zarr")


_SHARDS: dict[tuple[object, ...], ShardData] = {}


@pytest.fixture
def evaluated_once() -> Iterator[dict[tuple[object, ...], ShardData]]:
    """Evaluate each shard once in all tests that use this; they are of the files. Return the shards."""
    compute = TaskRunner.compute_shard

    def remembered(runner: TaskRunner, shard: Shard) -> ShardData:
        job = runner.job
        key = (id(job.recipe), job.world, job.layers, job.step, shard)
        if key not in _SHARDS:
            _SHARDS[key] = compute(runner, shard)
        return _SHARDS[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TaskRunner, "compute_shard", remembered)
        yield _SHARDS


@pytest.fixture(scope="session")
def tree() -> Callable[[Path], dict[str, str]]:
    """Function that returns the SHA-256 of every file in a folder, by name."""
    return _tree


@pytest.fixture
def reporter() -> RecordingReporter:
    return RecordingReporter()


@contextmanager
def _file_size_limit(size: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def file_size_limit() -> Callable[[int], AbstractContextManager[None]]:
    """A context that limits the size of files (bytes)."""
    return _file_size_limit
