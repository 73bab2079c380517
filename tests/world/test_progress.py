"""Progress of a world: lines now and then, a bar on a terminal."""

import io
import sys

import pytest

from sketchterrain.world.job import Task, TaskResult
from sketchterrain.world.journal import BrokenFile
from sketchterrain.world.run import ProgressReporter

RESULT = TaskResult(Task("ground", 0, 0, 0), (), 4.0, {})


def test_lines_come_now_and_then_with_the_time_left(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    with ProgressReporter(timer=lambda: now) as reporter:
        reporter.started(8, 2)
        for seconds in (4.0, 4.0, 4.0, 40.0):
            now += seconds
            reporter.task_finished(RESULT)
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
            reporter.broken(BrokenFile(f"0/height/c/0/{number}", "is missing"))
        reporter.started(12, 4)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "0/height/c/0/0 is missing: will be rewritten"
    assert lines[10:] == ["and 3 more files will be rewritten", "4 of 12 shards are done and verified"]


def test_a_terminal_gets_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "160")
    with ProgressReporter() as reporter:
        reporter.verified(0.5)
        reporter.started(8, 1)
        reporter.task_finished(RESULT)
        reporter.note("the device is gone")
        reporter.joined(1.0)
    told = terminal.getvalue()
    assert "Joining" in told
    assert "the device is gone" in told
    assert "━" in told
