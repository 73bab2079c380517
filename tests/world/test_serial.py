"""Tasks done in one process: what is written meanwhile, and what becomes of a device that fails."""

import threading
from dataclasses import replace
from typing import Any

import pytest

from sketchterrain.compute.device import list_devices
from sketchterrain.errors import DeviceFailedError, InputError, SketchterrainError
from sketchterrain.terrain.self_test import Verdict
from sketchterrain.world import task_runner
from sketchterrain.world.job import Task
from sketchterrain.world.run import run_world
from sketchterrain.world.task_runner import SerialExecutor, TaskRunner, deviating_device

KNOWN = [device for device in list_devices() if device.known]
two_devices = pytest.mark.skipif(len(KNOWN) < 2, reason="needs two CPU drivers")
OTHER = Verdict("other", "its bits are its own")


def failing(monkeypatch, after):
    """Let the first device fail once it has begun so many tasks; return the names of platforms at work."""
    begin, begun = TaskRunner.evaluate, []

    def failing_begin(runner: TaskRunner, task: Task) -> Any:
        device = runner.terrain.context.device
        if device == KNOWN[0] and len(begun) >= after:
            raise DeviceFailedError(f"{device.name} gave up")
        begun.append(device.platform)
        return begin(runner, task)

    monkeypatch.setattr(TaskRunner, "evaluate", failing_begin)
    return begun


@two_devices
def test_another_device_goes_on_with_the_same_bytes(job, reporter, finished_world, tree, monkeypatch) -> None:
    begun = failing(monkeypatch, 5)
    run_world(job, device=str(KNOWN[0].index), reporter=reporter)
    assert begun == [KNOWN[0].platform] * 5 + [KNOWN[1].platform] * 4
    (note,) = reporter.notes
    assert f"gave up; continuing on {KNOWN[1].name} ({KNOWN[1].platform})" in note
    assert tree(job.output) == tree(finished_world)


@two_devices
def test_with_bits_of_its_own_a_device_is_replaced_by_none(job, reporter, monkeypatch) -> None:
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


@pytest.mark.skipif(not KNOWN, reason="needs a CPU driver")
def test_bits_that_are_traded_for_speed_are_a_devices_own(job, reporter) -> None:
    assert deviating_device(KNOWN[0], fast=False) == ""
    assert deviating_device(KNOWN[0], fast=True).endswith("with --fast")
    with pytest.raises(InputError, match="--fast results differ between devices"):
        run_world(replace(job, fast=True), workers=2, reporter=reporter)
    assert not job.output.exists()


@two_devices
def test_without_a_device_that_passes_the_self_test_the_run_ends(job, reporter, monkeypatch) -> None:
    failing(monkeypatch, 1)
    monkeypatch.setattr(
        task_runner, "deviating_device", lambda device, *, fast: "" if device == KNOWN[0] else "its own"
    )
    with pytest.raises(DeviceFailedError, match="gave up; no other device can continue"):
        run_world(job, device=str(KNOWN[0].index), reporter=reporter)


@pytest.mark.skipif(not KNOWN, reason="needs a CPU driver")
def test_a_device_that_fails_the_self_test_is_told_and_kept(job, reporter, monkeypatch) -> None:
    monkeypatch.setattr(task_runner, "self_test", lambda *_, **__: OTHER)
    assert deviating_device(KNOWN[0], fast=False).startswith(KNOWN[0].name)
    executor = SerialExecutor(job, device=str(KNOWN[0].index), note=reporter.notes.append)
    assert executor.deviating_device
    assert reporter.notes == [
        f"self-test of {KNOWN[0].name} ({KNOWN[0].platform}): other bits: its bits are its own"
    ]


@two_devices
def test_a_device_that_crashes_in_its_self_test_is_replaced(job, monkeypatch) -> None:
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


def test_the_next_is_evaluated_while_one_is_written(job, reporter, monkeypatch) -> None:
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


@pytest.mark.parametrize("error", [SketchterrainError("no room"), ZeroDivisionError("no room")])
def test_an_error_of_the_writing_thread_ends_the_run(error, job, reporter, monkeypatch) -> None:
    def finish(*_: object) -> None:
        raise error

    monkeypatch.setattr(TaskRunner, "finish", finish)
    with pytest.raises(type(error), match="no room"):
        run_world(job, reporter=reporter)
    assert reporter.done == []
