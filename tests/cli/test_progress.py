import io
import sys
import time

import pytest

import sketchterrain.progress
from sketchterrain.progress import Stages


def test_finished_stages_are_timed_in_order():
    with Stages() as stages:
        with stages.stage("a", "First") as tell:
            tell(0.5)
        with stages.stage("b", "Second"):
            pass
        with pytest.raises(ValueError, match="no"), stages.stage("c", "Third"):
            raise ValueError("no")
    assert list(stages.seconds) == ["a", "b"]
    assert all(seconds >= 0 for seconds in stages.seconds.values())


def test_a_quick_stage_says_nothing_and_a_slow_one_a_line(capsys, monkeypatch):
    with Stages() as stages, stages.stage("a", "Quick"):
        pass
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sketchterrain.progress, "_QUIET", 0.001)
    with Stages() as stages, stages.stage("a", "Slow"):
        time.sleep(0.2)
    assert capsys.readouterr() == ("", "Slow …\n")


def test_a_terminal_gets_bars(monkeypatch):
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
