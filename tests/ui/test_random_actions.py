"""Random actions in the window leave no exception, no widget and no memory behind."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from collections import Counter
from pathlib import Path

import pytest
from PyQt6.QtCore import QEvent
from PyQt6.QtWidgets import QApplication, QWidget

from sketchterrain.sketch import LAYERS, load_sketch

from .monkey import Monkey

WARM = 0.5
"""Share of the actions after which memory is weighed: until then histories and caches fill."""
GROWTH = 1.05


@pytest.fixture
def window(window, link, placed):
    link.placed = placed
    link.placed_changed.emit(placed)
    return window


def settle() -> None:
    """Let all that was to be deleted be deleted."""
    for _ in range(3):
        QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        QApplication.processEvents()
        gc.collect()


def resident() -> int:
    """Bytes of this process in memory, what the allocator keeps for itself apart."""
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def widgets() -> Counter[str]:
    """Count all widgets by what they are, and in what."""

    def name(widget) -> str:
        return f"{type(widget).__name__} {widget.objectName()}".rstrip()

    kinds = ((each, each.parentWidget()) for each in QApplication.allWidgets())
    return Counter(f"{name(each)} in {name(parent) if parent else 'nothing'}" for each, parent in kinds)


def at_rest(window, document, workspace) -> None:
    """Bring the window into one state, whatever was done."""
    document.open(load_sketch("valley_river"))
    workspace.chosen = None
    workspace.tool = "brush"
    for layer in reversed(LAYERS):  # forms are made when they are needed first; mountains come last
        workspace.use_label(layer, 1)
    window.actions_by_name["reset-layout"].trigger()
    window.resize(1500, 920)
    window.canvas.fit()
    settle()


@pytest.mark.parametrize(
    "actions", [pytest.param(600, marks=pytest.mark.slow), pytest.param(10_000, marks=pytest.mark.soak)]
)
def test_random_actions_leave_no_widget_and_no_memory_behind(
    window, document, workspace, monkeypatch, tmp_path, actions
):
    monkeypatch.chdir(tmp_path)
    monkey = Monkey(window, document, workspace, seed=8)
    weighed = counted = None
    for number in range(actions):
        monkey.act()
        if number == int(WARM * actions):
            at_rest(window, document, workspace)
            weighed, counted = resident(), widgets()
    at_rest(window, document, workspace)
    grown = resident() / weighed
    more = widgets() - counted
    stray = [each for each in QApplication.topLevelWidgets() if type(each) is QWidget]
    told = [(each.size(), [type(child).__name__ for child in each.children()]) for each in stray]
    print(f"{actions} actions: memory {weighed >> 20} MiB, {grown:.3f} times as much at the end")  # noqa: T201
    assert not more, f"widgets that stayed: {more}, {told}"
    assert grown < GROWTH
