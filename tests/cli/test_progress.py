from __future__ import annotations

import io
import sys

import pytest

import sketchterrain.progress
from sketchterrain.progress import Stages


def test_stages_are_timed_in_order() -> None:
    with Stages() as stages:
        with stages.stage("a", "First") as tell:
            tell(0.5)
        with stages.stage("b", "Second"):
            pass
    assert list(stages.seconds) == ["a", "b"]
    assert all(seconds >= 0 for seconds in stages.seconds.values())


def test_a_stage_that_fails_is_not_timed() -> None:
    with Stages() as stages, pytest.raises(ValueError, match="no"), stages.stage("a", "First"):
        raise ValueError("no")
    assert stages.seconds == {}


def test_a_quick_stage_says_nothing_and_a_slow_one_a_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with Stages() as stages, stages.stage("a", "Quick"):
        pass
    assert capsys.readouterr().err == ""

    class Now:
        daemon = False

        def __init__(self, _: float, call: object, arguments: list[str]) -> None:
            self.call, self.arguments = call, arguments

        def start(self) -> None:
            self.call(*self.arguments)  # type: ignore[operator]

        def cancel(self) -> None:
            pass

        def join(self) -> None:
            pass

    monkeypatch.setattr(sketchterrain.progress, "Timer", Now)
    with Stages() as stages, stages.stage("a", "Slow"):
        pass
    assert capsys.readouterr() == ("", "Slow …\n")


def test_a_terminal_gets_bars(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with Stages() as stages:
        with stages.stage("a", "First") as tell:
            tell(0.5)
        with pytest.raises(ValueError, match="no"), stages.stage("b", "Second"):
            raise ValueError("no")
    assert "First" in terminal.getvalue()
    assert "Second" in terminal.getvalue()
