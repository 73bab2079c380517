"""What is done with the answers of workers, by a scheduler that is played: no process, no device."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import pytest

from sketchterrain.errors import DeviceError, SketchterrainError
from sketchterrain.world import dispatch as dispatching
from sketchterrain.world import worker as done_there
from sketchterrain.world.dispatch import Dispatch
from sketchterrain.world.made import Made, Task
from sketchterrain.world.order import Failed, Ready, Refused
from sketchterrain.world.roster import Roster, Seen

if TYPE_CHECKING:
    from collections.abc import Callable

scheduling = pytest.importorskip("distributed.scheduler")

TASKS = [Task("ground", 0, 0, column) for column in range(6)]


class Future:
    """An answer that is there at once."""

    def __init__(self, key: int, answer: object) -> None:
        self.key, self.answer = key, answer
        self.status = "error" if isinstance(answer, Exception) else "finished"

    def add_done_callback(self, told: Callable[[Future], None]) -> None:
        if self.answer is not None:
            told(self)

    def exception(self) -> object:
        return self.answer


class Cluster:
    """Plays a connection; a worker is what answers the functions that would run there."""

    order, told = "order", "scheduler tcp://far:8786"

    def __init__(self, **workers: Callable[..., Any]) -> None:
        self.there = workers
        self.posted: list[dict[str, Any]] = []
        self.cancelled: list[Future] = []
        self._numbers = itertools.count()

    def post(self, order: dict[str, Any]) -> None:
        self.posted.append(order)

    def workers(self) -> dict[str, Seen]:
        return {name: Seen(name, "here") for name in self.there}

    def submit(self, work: Callable[..., Any], *given: Any, worker: str) -> Future:
        return Future(next(self._numbers), self.there[worker](work, *given))

    def result(self, future: Future) -> object:
        return None if future.answer == "lost" else future.answer

    def cancel(self, futures: list[Future]) -> None:
        self.cancelled += futures

    def end(self) -> None:
        pass


def good(name: str, bits: str = "right") -> Callable[..., Any]:
    def answer(work: object, *given: Any) -> object:
        if work is done_there.prepare:
            return Ready(name, f"device of {name}", bits, 1)
        return Made(Task(*given), (), 1.0, {}, name)

    return answer


def at_work(name: str, *answers: object) -> Callable[..., Any]:
    """A worker that answers tasks with what is given, then as a good one."""
    left, rest = list(answers), good(name)

    def answer(work: object, *given: Any) -> object:
        return left.pop(0) if left and work is done_there.make else rest(work, *given)

    return answer


def dispatch_of(cluster: Cluster, notes: list[str], *, bits: str | None = "right", **given: Any) -> Dispatch:
    given = {"stopped": lambda: False, "reason": lambda: "", **given}
    return Dispatch(cluster, {}, bits=bits, note=notes.append, **given)


def made_by(cluster: Cluster, *, bits: str | None = "right") -> tuple[list[tuple[Task, str]], list[str]]:
    notes: list[str] = []
    dispatch = dispatch_of(cluster, notes, bits=bits)
    made = [(made.task, made.worker) for made in dispatch.run(Roster(TASKS))]
    assert sorted(task for task, _ in made) == TASKS
    return made, notes


@pytest.fixture(autouse=True)
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_LOOK", "_EARLY_LOOK"):
        monkeypatch.setattr(dispatching, name, 0.01)


def test_all_is_done_by_all() -> None:
    made, notes = made_by(Cluster(a=good("a"), b=good("b")))
    assert {worker for _, worker in made} == {"a", "b"}
    assert notes == []


def test_a_worker_of_other_bits_is_refused_by_name() -> None:
    made, notes = made_by(Cluster(a=good("a"), b=good("b", "wrong")))
    assert {worker for _, worker in made} == {"a"}
    assert notes == ["b is refused: device of b computes other bits of this world"]


def test_without_a_device_here_the_first_bits_count() -> None:
    made, notes = made_by(Cluster(a=good("a", "other"), b=good("b", "right")), bits=None)
    assert {worker for _, worker in made} == {"a"}
    assert len(notes) == 1


def test_a_worker_whose_device_fails_at_work_gets_nothing_more_and_others_do_its_shard() -> None:
    broken = at_work("a", Refused("a", "Card failed at launching patches"))
    made, notes = made_by(Cluster(a=broken, b=good("b")))
    assert {worker for _, worker in made} == {"b"}
    assert notes == ["a is refused: Card failed at launching patches"]


def test_an_exception_while_it_prepares_refuses_a_worker() -> None:
    made, notes = made_by(
        Cluster(a=lambda *_: ModuleNotFoundError("No module named 'sketchterrain'"), b=good("b"))
    )
    assert {worker for _, worker in made} == {"b"}
    assert notes == ["a is refused: ModuleNotFoundError: No module named 'sketchterrain'"]


@pytest.mark.parametrize("answer", ["lost", scheduling.KilledWorker(("order", 1), None, 3)])
def test_lost_answers_are_asked_for_again(answer: object) -> None:
    made, notes = made_by(Cluster(a=at_work("a", answer, answer)))
    assert {worker for _, worker in made} == {"a"}
    assert notes == []


def test_a_worker_that_is_gone_costs_what_it_was_at() -> None:
    cluster = Cluster(a=at_work("a", None), b=good("b"))  # a never answers
    notes: list[str] = []
    made = []
    for each in dispatch_of(cluster, notes).run(Roster(TASKS)):
        made.append(each.task)
        cluster.there.pop("a", None)
    assert sorted(made) == TASKS
    assert notes == ["a is lost: what it was at is done again"]
    assert len(cluster.cancelled) == 1


def test_a_worker_that_never_answers_is_refused_after_a_long_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatching, "_LATE", 0.1)
    made, notes = made_by(Cluster(a=at_work("a", None), b=good("b")))
    assert {worker for _, worker in made} == {"b"}
    assert notes == ["a is refused: no answer for 0 s"]


def test_a_full_disk_ends_it() -> None:
    full = SketchterrainError("/out/0/height/c/3/4: No space left on device")
    with pytest.raises(SketchterrainError, match="No space left"):
        made_by(Cluster(a=at_work("a", Failed("a", full)), b=good("b")))


def test_a_defect_is_raised_as_it_is() -> None:
    with pytest.raises(ZeroDivisionError):
        made_by(Cluster(a=at_work("a", ZeroDivisionError())))


def test_a_scheduler_without_the_program_is_told() -> None:
    error = RuntimeError("Error during deserialization of the task graph. This frequently …")
    with pytest.raises(
        SketchterrainError, match="tcp://far:8786 cannot load sketchterrain: it must be installed"
    ):
        made_by(Cluster(a=lambda *_: error))


def test_no_worker_left_is_one_line() -> None:
    with pytest.raises(
        DeviceError, match=r"no worker is left: a: device of a computes other bits of this world$"
    ):
        made_by(Cluster(a=good("a", "wrong")))


def test_no_worker_at_all_is_waited_for_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatching, "_PATIENCE", 0.05)
    with pytest.raises(SketchterrainError, match="scheduler tcp://far:8786 has had no worker for 0 s"):
        made_by(Cluster())


def test_what_the_workers_wrote_tells_why_none_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatching, "_PATIENCE", 0.05)
    dispatch = dispatch_of(Cluster(), [], reason=lambda: "ImportError: no distributed")
    with pytest.raises(SketchterrainError, match="for 0 s: ImportError: no distributed"):
        list(dispatch.run(Roster(TASKS)))


def test_once_it_is_to_stop_what_is_begun_is_the_last_and_nothing_is_waited_for() -> None:
    stop: list[bool] = []
    made = []
    cluster = Cluster(a=good("a"), b=good("b"))
    for each in dispatch_of(cluster, [], stopped=lambda: bool(stop)).run(Roster(TASKS)):
        made.append(each.task)
        stop.append(True)
    assert len(made) == 2
    assert list(dispatch_of(Cluster(), [], stopped=lambda: True).run(Roster(TASKS))) == []
