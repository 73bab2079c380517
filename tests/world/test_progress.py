"""Progress of a world: lines now and then, a bar on a terminal."""

import io
import sys

import pytest

from sketchterrain.world.job import Task, TaskResult
from sketchterrain.world.journal import Broken
from sketchterrain.world.run import ProgressReporter

RESULT = TaskResult(Task("ground", 0, 0, 0), (), 4.0, {})


def test_lines_come_now_and_then_with_the_time_left(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    with ProgressReporter(timer=lambda: now) as reporter:
        reporter.began(8, 2)
        for seconds in (4.0, 4.0, 4.0, 40.0):
            now += seconds
            reporter.made(RESULT)
        reporter.note("one\nline")
    assert capsys.readouterr().err.splitlines() == [
        "2 of 8 shards are done and verified",
        "5 of 8 shards: 62%, about 12 s left",
        "6 of 8 shards: 75%, about 26 s left",
        "sketchterrain: note: one�line",
    ]


def test_broken_files_are_named_and_of_many_counted(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressReporter() as reporter:
        for number in range(13):
            reporter.broken(Broken(f"0/height/c/0/{number}", "is missing"))
        reporter.began(12, 4)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "0/height/c/0/0 is missing: is made again"
    assert lines[10:] == ["and 3 more files are made again", "4 of 12 shards are done and verified"]


def test_a_terminal_gets_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "160")
    with ProgressReporter() as reporter:
        reporter.verified(0.5)
        reporter.began(8, 1)
        reporter.made(RESULT)
        reporter.note("the device is gone")
        reporter.joined(1.0)
    told = terminal.getvalue()
    assert "Joining" in told
    assert "the device is gone" in told
    assert "━" in told
