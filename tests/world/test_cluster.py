"""The same world by workers of a cluster; who may be one; whatever becomes of them, the same bytes."""

from __future__ import annotations

import errno
import os
import pickle
import random
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sketchterrain import compute
from sketchterrain.compute import choose_device
from sketchterrain.errors import DeviceError, InputError, SketchterrainError
from sketchterrain.world import run as running
from sketchterrain.world import worker as in_worker
from sketchterrain.world.cluster import check_scheduler
from sketchterrain.world.run import run_world
from sketchterrain.world.task_runner import PendingTask, TaskRunner
from sketchterrain.world.tasks import tasks_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sketchterrain.world.job import Job
    from sketchterrain.world.tasks import TaskResult
    from tests.world.conftest import Heard

    Tree = Callable[[Path], dict[str, str]]

distributed = pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")  # sockets of the library, closed late

LYING = """
from sketchterrain.compute import context
context._OPTIONS = ("-cl-std=CL1.2", "-cl-fast-relaxed-math", "-DFAST")
"""
WRITING = """
import pickle, sys
from pathlib import Path
from sketchterrain.world.run import run_world
from tests.world.conftest import Heard
heard = Heard()
heard.made = lambda made: print(made.task.kind, made.worker, flush=True)
run_world(pickle.loads(Path(sys.argv[1]).read_bytes()), workers=2, watcher=heard)
"""
OLDER = """
from sketchterrain.world import worker as in_worker
in_worker.version = lambda _: "0.0.9"
"""


def shuffled(job: Job) -> Iterator:
    tasks = list(tasks_of(job))
    random.Random(3).shuffle(tasks)
    return iter(tasks)


@contextmanager
def process(*words: str) -> Iterator[subprocess.Popen[str]]:
    """Run a command of dask's, and end it and all that it started."""
    command = [sys.executable, "-m", "dask", *words]
    started = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        yield started
    finally:
        with suppress(ProcessLookupError):
            os.killpg(started.pid, signal.SIGKILL)
        started.communicate()


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of a scheduler that has no worker yet, and its process."""
    with process("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard") as started:
        assert started.stderr is not None
        for line in started.stderr:
            if "Scheduler at:" in line:
                yield line.split("Scheduler at:")[1].strip(), started
                return
        raise AssertionError("no scheduler")


@contextmanager
def worker(scheduler: str, folder: Path, name: str, *, preload: str = "") -> Iterator[None]:
    words = ["worker", scheduler, "--name", name, "--nthreads", "1", "--no-dashboard", "--memory-limit", "0"]
    words += ["--local-directory", str(folder / name), "--no-nanny"]
    if preload:
        patch = folder / f"{name}.py"
        patch.write_text(preload, encoding="utf-8")
        words += ["--preload", str(patch)]
    with process(*words):
        yield


def workers_of(pid: int) -> list[psutil.Process]:
    """Return the worker processes that a process has started, those that serve first."""
    found = []
    for child in psutil.Process(pid).children(recursive=True):
        with suppress(psutil.ZombieProcess, psutil.NoSuchProcess):
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
    return found


@pytest.mark.slow
def test_workers_in_this_process_in_shuffled_order_give_the_same_bytes_also_after_a_full_disk(
    job: Job, whole_world: Path, heard: Heard, tree: Tree, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = TaskRunner.finish

    def full(self: TaskRunner, begun: PendingTask) -> TaskResult:
        if begun.task.level == 0:
            try:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            except OSError as error:
                raise SketchterrainError("0/height: cannot be written (no space)") from error
        return honest(self, begun)

    monkeypatch.setattr(running, "tasks_of", shuffled)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        with monkeypatch.context() as patch:
            patch.setattr(TaskRunner, "finish", full)
            with pytest.raises(SketchterrainError, match="no space"):
                run_world(job, scheduler=cluster.scheduler_address, watcher=heard)
        run_world(job, scheduler=cluster.scheduler_address, resume=True, watcher=heard)
        assert not [name for name in cluster.scheduler.worker_plugins if "sketchterrain" in name]
    assert tree(job.output) == tree(whole_world)
    assert {made.worker for made in heard.done} == {"worker 0", "worker 1"}
    assert heard.notes == []


@pytest.mark.parametrize(
    "word", ["", "localhost", "localhost:8786", "http://a:1", "tcp://a", "tcp://a:99999", "tcp://:1"]
)
def test_what_is_no_address_is_told(word: str) -> None:
    with pytest.raises(InputError, match=r"^expected a scheduler's address such as tcp://HOST:8786, got '"):
        check_scheduler(word)


def test_a_scheduler_that_is_not_there_is_one_line_and_at_once() -> None:
    start = time.perf_counter()
    with pytest.raises(
        SketchterrainError, match=r"^scheduler tcp://127.0.0.1:9 cannot be reached: Connection refused"
    ):
        check_scheduler("tcp://127.0.0.1:9")
    assert time.perf_counter() - start < 5


def test_a_worker_that_does_not_see_the_folder_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(in_worker, "_VISIBLE", 0.0)
    token = tmp_path / ".token"
    token.write_text("this one", encoding="utf-8")
    in_worker.check_folder(str(token), "this one")
    assert [path.name for path in tmp_path.iterdir()] == [".token"]
    token.write_text("that one", encoding="utf-8")
    with pytest.raises(in_worker.RefusedError, match="another folder is there"):
        in_worker.check_folder(str(token), "this one")
    with pytest.raises(in_worker.RefusedError, match="nothing is there"):
        in_worker.check_folder(str(tmp_path / "no" / "where"), "")


def then(heard: Heard, act: Callable[[int], None]) -> None:
    """Act whenever a task is done, given how many there are by then."""
    told = heard.made

    def made(made: TaskResult) -> None:
        told(made)
        act(len(heard.done))

    heard.made = made


def test_workers_of_a_machine_share_its_gpus_out(monkeypatch: pytest.MonkeyPatch) -> None:
    cpu = replace(choose_device(), type="CPU")
    cards = [replace(cpu, index=number, type="GPU", name=f"Card {number}") for number in range(2)]
    monkeypatch.delenv("PYOPENCL_CTX", raising=False)
    monkeypatch.setattr(compute, "list_devices", lambda: (*cards, cpu))
    monkeypatch.setattr(compute, "choose_device", lambda selector: f"chosen by {selector}")
    assert [in_worker.own_device(None, turn).name for turn in range(3)] == ["Card 0", "Card 1", "Card 0"]
    assert in_worker.own_device("Card 1", 0) == "chosen by Card 1"
    monkeypatch.setattr(compute, "list_devices", lambda: (cpu,))
    assert in_worker.own_device(None, 1) == "chosen by None"


@pytest.mark.soak
def test_processes_of_which_some_are_killed_give_the_same_bytes_in_shuffled_order(
    job: Job, whole_world: Path, heard: Heard, tree: Tree, monkeypatch: pytest.MonkeyPatch
) -> None:
    def kill(done: int) -> None:
        if done in (1, 4):
            workers_of(os.getpid())[0].kill()

    monkeypatch.setattr(running, "tasks_of", shuffled)
    then(heard, kill)
    run_world(job, workers=2, watcher=heard)
    assert tree(job.output) == tree(whole_world)
    assert {note.split(" is lost")[0] for note in heard.notes} <= {"worker 0", "worker 1"}
    assert heard.notes
    assert workers_of(os.getpid()) == []


@pytest.mark.soak
def test_workers_that_lie_are_refused_by_name_and_others_do_the_work_until_the_scheduler_dies(
    job: Job,
    whole_world: Path,
    heard: Heard,
    tree: Tree,
    scheduler: tuple[str, subprocess.Popen[str]],
    tmp_path: Path,
) -> None:
    address, started = scheduler
    with (
        worker(address, tmp_path, "liar", preload=LYING),
        worker(address, tmp_path, "older", preload=OLDER),
    ):
        wait_for_workers(address, 2)
        with pytest.raises(DeviceError, match="no worker is left: ") as caught:
            run_world(job, scheduler=address, watcher=heard)
        assert caught.match(
            r"liar on \S+: (self-test of .*: other bits: |.* computes other bits of this world)"
        )
        assert caught.match(r"older on \S+: it has sketchterrain 0\.0\.9, not ")
        assert caught.value.exit_code == 4
        heard.notes.clear()
        then(heard, lambda done: started.kill() if done == 5 else None)
        with worker(address, tmp_path, "honest"):
            wait_for_workers(address, 3)
            with pytest.raises(SketchterrainError, match=f"^scheduler {address} does not answer any more$"):
                run_world(job, scheduler=address, resume=True, watcher=heard)
    assert {made.worker.split()[0] for made in heard.done} == {"honest"}
    assert all(note.split()[0] in ("liar", "older") and " is refused: " in note for note in heard.notes)
    run_world(job, resume=True, watcher=heard)
    assert tree(job.output) == tree(whole_world)


@pytest.mark.soak
def test_no_worker_outlives_a_run_that_is_killed_and_resume_goes_on(
    job: Job, whole_world: Path, heard: Heard, tree: Tree, tmp_path: Path
) -> None:
    asked = tmp_path / "job"
    asked.write_bytes(pickle.dumps(job))
    command = [sys.executable, "-c", WRITING, str(asked)]
    root = Path(__file__).parents[2]
    with subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, text=True) as started:
        assert started.stdout is not None
        assert started.stdout.readline().startswith("ground ")
        workers = workers_of(started.pid)
        started.kill()
    assert len(workers) == 2
    assert psutil.wait_procs(workers, timeout=20)[1] == []
    run_world(job, resume=True, watcher=heard)
    assert tree(job.output) == tree(whole_world)


def wait_for_workers(address: str, count: int) -> None:
    with distributed.Client(address, timeout=20, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=60)
