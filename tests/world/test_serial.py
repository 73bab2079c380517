"""Tasks run by one process: overlap, failing devices, progress."""

import io
import sys
import threading
from dataclasses import replace
from typing import Any

import pytest

from sketchterrain.errors import DeviceFailedError, InputError, SketchterrainError
from sketchterrain.generation.self_test import Verdict
from sketchterrain.world import task_runner
from sketchterrain.world.job import Task, TaskResult
from sketchterrain.world.journal import BrokenFile
from sketchterrain.world.run import ProgressReporter, run_world
from sketchterrain.world.task_runner import SerialExecutor, TaskRunner, deviating_device
from tests.devices import KNOWN, needs_device, needs_known_device

OTHER = Verdict("other", "its bits are its own")


def failing(monkeypatch, after):
    """Let the first device fail after a number of tasks; return the platforms used."""
    begin, begun = TaskRunner.evaluate, []

    def failing_begin(runner: TaskRunner, task: Task) -> Any:
        device = runner.terrain.context.device
        if device == KNOWN[0] and len(begun) >= after:
            raise DeviceFailedError(f"{device.name} gave up")
        begun.append(device.platform)
        return begin(runner, task)

    monkeypatch.setattr(TaskRunner, "evaluate", failing_begin)
    return begun


@needs_known_device
def test_replacement_device_gives_equal_bytes(job, reporter, finished_world, tree, monkeypatch) -> None:
    begun = failing(monkeypatch, 5)
    run_world(job, device=str(KNOWN[0].index), reporter=reporter)
    assert begun == [KNOWN[0].platform] * 5 + [KNOWN[1].platform] * 4
    (note,) = reporter.notes
    assert f"gave up; continuing on {KNOWN[1].name} ({KNOWN[1].platform})" in note
    assert tree(job.output) == tree(finished_world)


@needs_known_device
def test_deviating_device_is_not_replaced(job, reporter, monkeypatch) -> None:
    monkeypatch.setattr(task_runner, "deviating_device", lambda device, *, fast: device.platform)
    monkeypatch.setattr(task_runner, "self_test", lambda *_, **__: OTHER)
    with monkeypatch.context() as amid:
        failing(amid, 2)
        with pytest.raises(DeviceFailedError, match="results of other devices differ"):
            run_world(job, device=str(KNOWN[0].index), reporter=reporter)
    with pytest.raises(InputError, match="resume on the same device"):
        run_world(job, device=str(KNOWN[1].index), resume=True, reporter=reporter)
    again = type(reporter)()
    run_world(job, device=str(KNOWN[0].index), resume=True, reporter=again)
    assert again.counts[0][1] == len(reporter.done) > 0


@needs_known_device
def test_fast_devices_deviate(job, reporter) -> None:
    assert deviating_device(KNOWN[0], fast=False) == ""
    assert deviating_device(KNOWN[0], fast=True).endswith("with --fast")
    with pytest.raises(InputError, match="--fast results differ between devices"):
        run_world(replace(job, fast=True), workers=2, reporter=reporter)
    assert not job.output.exists()


@needs_known_device
def test_deviating_device_is_reported_and_used(job, reporter, monkeypatch) -> None:
    monkeypatch.setattr(task_runner, "self_test", lambda *_, **__: OTHER)
    assert deviating_device(KNOWN[0], fast=False).startswith(KNOWN[0].name)
    executor = SerialExecutor(job, device=str(KNOWN[0].index), note=reporter.notes.append)
    assert executor.deviating_device
    assert reporter.notes == [
        f"self-test of {KNOWN[0].name} ({KNOWN[0].platform}): other bits: its bits are its own"
    ]


@needs_known_device
def test_device_crashing_in_self_test_is_replaced(job, monkeypatch) -> None:
    crashed, same = Verdict("failed", "the self-test crashed (SIGSEGV)"), Verdict("same", "")
    monkeypatch.setattr(task_runner, "self_test", lambda device, **_: crashed if device == KNOWN[0] else same)
    notes = []
    executor = SerialExecutor(job, device=str(KNOWN[0].index), note=notes.append)
    assert executor._device == KNOWN[1]
    assert executor.deviating_device == ""
    (note,) = notes
    assert (
        f"{KNOWN[0].platform}) failed: the self-test crashed (SIGSEGV); continuing on {KNOWN[1].name}" in note
    )


@needs_device
def test_evaluation_overlaps_writing(job, reporter, monkeypatch) -> None:
    end, begin = TaskRunner.finish, TaskRunner.evaluate
    threads, under_way, most = set(), [], []

    def ending(runner: TaskRunner, begun: Any) -> Any:
        threads.add(threading.current_thread())
        made = end(runner, begun)
        under_way.remove(begun.task)
        return made

    def beginning(runner: TaskRunner, task: Task) -> Any:
        under_way.append(task)
        most.append(len(under_way))
        return begin(runner, task)

    monkeypatch.setattr(TaskRunner, "finish", ending)
    monkeypatch.setattr(TaskRunner, "evaluate", beginning)
    run_world(job, reporter=reporter)
    assert len(threads) == 1
    assert threading.main_thread() not in threads
    assert max(most) <= 2


@needs_device
@pytest.mark.parametrize("error", [SketchterrainError("no room"), ZeroDivisionError("no room")])
def test_writer_error_ends_run(error, job, reporter, monkeypatch) -> None:
    def finish(*_: object) -> None:
        raise error

    monkeypatch.setattr(TaskRunner, "finish", finish)
    with pytest.raises(type(error), match="no room"):
        run_world(job, reporter=reporter)
    assert reporter.done == []


RESULT = TaskResult(Task("ground", 0, 0, 0), ())


def test_progress_lines_are_periodic_with_remaining_time(capsys: pytest.CaptureFixture[str]) -> None:
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


def test_broken_files_are_listed_up_to_a_maximum(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressReporter() as reporter:
        for number in range(13):
            reporter.broken(BrokenFile(f"0/height/c/0/{number}", "is missing"))
        reporter.started(12, 4)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "0/height/c/0/0 is missing: will be rewritten"
    assert lines[10:] == ["and 3 more files will be rewritten", "4 of 12 shards are done and verified"]


def test_terminal_shows_bar(monkeypatch: pytest.MonkeyPatch) -> None:
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
    message = terminal.getvalue()
    assert "Joining" in message
    assert "the device is gone" in message
    assert "━" in message
