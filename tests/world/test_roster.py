"""Who does which task, as logic alone: workers come, are lost and refused, and every task is done."""

from __future__ import annotations

import random
from types import SimpleNamespace

import pytest

from sketchterrain.errors import DeviceError, SketchterrainError
from sketchterrain.world.made import Task
from sketchterrain.world.roster import LOSSES, Roster, Seen


def tasks(count: int) -> list[Task]:
    return [Task("ground", 0, 0, column) for column in range(count)]


def seen(*names: str, host: str = "here") -> dict[str, Seen]:
    return {f"tcp://{name}": Seen(name, host) for name in names}


def with_ready(count: int, *names: str, at_once: int = 1) -> Roster:
    roster = Roster(tasks(count))
    roster.update(seen(*names))
    for name in names:
        roster.ready(f"tcp://{name}", name, at_once)
    return roster


def test_a_worker_gets_as_many_tasks_as_it_does_at_once_and_no_other_is_taken() -> None:
    taken = []

    def told():
        for task in tasks(10):
            taken.append(task)
            yield task

    roster = Roster(told())
    roster.update(seen("a", "b"))
    assert list(roster.hand_out()) == []
    roster.ready("tcp://a", "a", 2)
    assert [address for address, _ in roster.hand_out()] == ["tcp://a"] * 2
    assert len(taken) == 2
    assert not roster.over


def test_all_tasks_are_done_whoever_is_lost_refused_or_unprepared() -> None:
    chance = random.Random(7)
    for _ in range(50):
        roster, done, number = Roster(tasks(30)), [], 0
        there = seen("first")
        while not roster.over:
            number += 1
            if chance.random() < 0.3:
                there |= seen(f"w{number}")
            if len(there) > 1 and chance.random() < 0.1:
                del there[chance.choice(list(there))]
            try:
                roster.update(there)
            except SketchterrainError:  # by chance one met many deaths
                break
            for address, member in roster.members.items():
                if not member.at_once and not member.refused:
                    roster.ready(address, member.name, chance.randint(1, 3))
            list(roster.hand_out())
            for address, member in list(roster.members.items()):
                for task in list(member.tasks):
                    if chance.random() < 0.4:
                        roster.finished(address, task)
                        done.append(task)
            if chance.random() < 0.05:
                roster.unprepared(chance.choice(list(roster.members)))
            if chance.random() < 0.05:
                there |= seen(f"r{number}")
                roster.update(there)
                roster.refuse(chance.choice(list(roster.members)[1:]), "x", "it lies")
        else:
            assert sorted(done) == tasks(30)


def test_tasks_of_a_lost_worker_are_done_by_another_and_last() -> None:
    roster = with_ready(4, "a", "b")
    given = dict(roster.hand_out())
    lost = roster.update(seen("b"))
    assert [member.name for member in lost] == ["a"]
    roster.finished("tcp://b", given["tcp://b"])
    order = []
    while not roster.over:
        for address, task in list(roster.hand_out()):
            order.append(task)
            roster.finished(address, task)
    assert order == [*tasks(4)[2:], given["tcp://a"]]


def test_a_task_that_takes_every_worker_along_ends_it_with_its_name() -> None:
    roster = Roster(tasks(1))
    for number in range(LOSSES - 1):
        roster.update(seen(f"w{number}"))
        roster.ready(f"tcp://w{number}", f"w{number}", 1)
        assert len(list(roster.hand_out())) == 1
    roster.update(seen("last"))
    roster.ready("tcp://last", "last", 1)
    list(roster.hand_out())
    with pytest.raises(
        SketchterrainError, match="10 workers died at the ground of shard 0,0 of level 0, last last"
    ):
        roster.update({})


def test_a_worker_that_dies_again_and_again_while_it_prepares_need_not_try() -> None:
    roster = Roster(tasks(1))
    for number in range(LOSSES):
        assert not roster.dies_preparing("a")
        roster.update({f"tcp://{number}": Seen("a", "here")})
        roster.update({})
    assert roster.dies_preparing("a")


def test_refused_workers_get_nothing_and_where_all_are_their_reasons_are_told() -> None:
    roster = with_ready(3, "a", "b")
    given = dict(roster.hand_out())
    roster.refuse("tcp://a", "a", "its device failed")
    roster.check()
    roster.finished("tcp://b", given["tcp://b"])
    assert [address for address, _ in roster.hand_out()] == ["tcp://b"]
    roster.refuse("tcp://b", "b", "so did its")
    with pytest.raises(DeviceError, match="no worker is left: a: its device failed; b: so did its"):
        roster.check()


def test_workers_of_a_machine_take_turns_and_a_new_one_the_place_of_one_lost() -> None:
    roster = Roster([])
    roster.update(seen("a", "b", "c") | seen("far", host="there"))
    turns = {member.name: member.turn for member in roster.members.values()}
    assert turns == {"a": 0, "b": 1, "c": 2, "far": 0}
    roster.update(seen("a", "c", "new") | seen("far", host="there"))
    assert roster.members["tcp://new"].turn == 1


def test_without_tasks_it_is_over_once_someone_could_have_begun() -> None:
    roster = with_ready(0, "a")
    assert list(roster.hand_out()) == []
    assert roster.over


def test_a_worker_that_was_ready_once_may_die_preparing_as_often_again() -> None:
    roster = Roster(tasks(1))
    for number in range(2 * LOSSES - 2):
        roster.update({f"tcp://{number}": Seen("a", "here")})
        if number == LOSSES - 2:
            roster.ready(f"tcp://{number}", "a on here", 1)
        roster.update({})
        assert not roster.dies_preparing("a")


def test_workers_have_their_name_and_host_or_a_number_or_an_address(monkeypatch) -> None:
    pytest.importorskip("distributed")
    from sketchterrain.world import worker

    monkeypatch.setattr(worker.socket, "gethostname", lambda: "rock")
    names = ("big", "tcp://10.0.0.1:8000", 3)
    shown = [worker._name_of(SimpleNamespace(name=name)) for name in names]
    assert shown == ["big on rock", "tcp://10.0.0.1:8000", "worker 3"]
