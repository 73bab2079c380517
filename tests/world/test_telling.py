"""What a person reads while a world is written: lines now and then, a bar on a terminal, honest times."""

from __future__ import annotations

import io
import sys

import pytest

from sketchterrain.world.grid import World
from sketchterrain.world.made import Made, Task
from sketchterrain.world.telling import Remaining, Telling
from sketchterrain.world.verification import Broken

WORLD = World(0.0, 0.0, 4095.0, 4095.0, 1.0)  # 2 × 2 whole shards, one coarser one and three small ones


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def ground(level: int, row: int, column: int, seconds: float) -> Made:
    return Made(Task("ground", level, row, column), (), seconds, {})


def test_nothing_is_told_while_nothing_is_known() -> None:
    assert Remaining(Clock()).seconds({"ground": 100}) is None


def test_time_goes_by_vertices_and_by_kind() -> None:
    clock = Clock()
    remaining = Remaining(clock)
    clock.now = 10.0
    remaining.finished("ground", 1000, 10.0)
    assert remaining.seconds({"ground": 3000}) == pytest.approx(30.0)
    assert remaining.seconds({"ground": 0, "plants": 1000}) == pytest.approx(10.0)  # as others, until known
    clock.now = 12.0
    remaining.finished("plants", 1000, 2.0)
    assert remaining.seconds({"ground": 1000, "plants": 1000}) == pytest.approx(12.0)


def test_tasks_in_work_at_once_share_the_time() -> None:
    clock = Clock()
    remaining = Remaining(clock)
    clock.now = 10.0
    for _ in range(4):  # four workers, ten seconds each
        remaining.finished("ground", 1000, 10.0)
    assert remaining.seconds({"ground": 4000}) == pytest.approx(10.0)


def test_lines_come_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    clock = Clock()
    with Telling(WORLD, plants=False, timer=clock) as telling:
        telling.began(8, 0)
        for task in ((4, 0, 0), (3, 0, 0), (2, 0, 0), (1, 0, 0)):
            clock.now += 4.0
            telling.made(ground(*task, seconds=4.0))
        clock.now += 40.0
        telling.made(ground(0, 0, 0, seconds=40.0))
        telling.note("one\nline")
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == [
        "3 of 8 tasks: 38%",
        "5 of 8 tasks: 62%",
        "sketchterrain: note: one�line",
    ]
    assert "left" in lines[1]


def test_what_is_broken_is_named_and_of_many_counted(capsys: pytest.CaptureFixture[str]) -> None:
    with Telling(WORLD, plants=True) as telling:
        for number in range(13):
            telling.broken(Broken(f"0/height/c/0/{number}", "is missing"))
        telling.began(12, 4)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "0/height/c/0/0 is missing: is made again"
    assert lines[10:] == ["and 3 more files are made again", "4 of 12 tasks are done and their files whole"]


def test_a_terminal_gets_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "160")
    with Telling(WORLD, plants=False) as telling:
        telling.verified(0.5)
        telling.began(8, 1)
        telling.made(ground(0, 0, 0, seconds=4.0))
        telling.note("the device is gone")
        telling.joined(1.0)
    shown = terminal.getvalue()
    for text in ("1 of 8 tasks are done", "note: the device is gone", "Joining"):
        assert text in shown
