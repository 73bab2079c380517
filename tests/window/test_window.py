"""The real program on a virtual display, operated with mouse and keyboard."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.document.store import load_sketch, new_sketch

from .user import centre_of, on_canvas, on_terrain, view_of, wait_for_terrain

pytestmark = pytest.mark.window

HEIGHT_AT = (
    "(lambda r: float(r.height[({row} - 20) // r.step : ({row} + 20) // r.step,"
    " ({column} - 20) // r.step : ({column} + 20) // r.step].max()))(window._link.relief)"
)
RIVERS = "[r for r in window._link.placed.rivers if r.label]"  # without streams
POINT = "[p for p in window._link.placed.points if int(p['id']) == {}][0]"


def dialog_opens(user) -> None:
    user.wait("app.activeModalWidget() is not None")
    user.focus("app.activeModalWidget()")


def step(user, number: int) -> None:
    """Wait until the history is at a step and its terrain is displayed."""
    user.wait(f"window._document.history.position == {number}")
    wait_for_terrain(user)


@pytest.mark.slow
def test_a_stroke_is_rendered_undone_saved_and_recovered_after_a_kill(user, tmp_path):
    folder = tmp_path / "valley"
    new_sketch(folder)
    user.start(str(folder))
    wait_for_terrain(user)
    at = on_canvas(user)
    row, column = 350, 130
    height = HEIGHT_AT.format(row=row, column=column)
    before, flat = view_of(user, user.screenshot()), user.evaluate(height)

    user.key("b")
    user.drag(at(column - 40, row), at(column + 40, row))
    step(user, 1)
    assert user.evaluate(height) > flat + 50.0

    def has_risen() -> bool:
        change = np.abs(view_of(user, user.screenshot()) - before).max(axis=2)
        return float((change > 25).mean()) > 0.005

    user.until(has_risen, "a mountain in the 3-D view")

    user.key("ctrl+z")
    step(user, 0)
    assert user.evaluate(height) == flat
    user.key("ctrl+shift+z")
    step(user, 1)
    assert user.evaluate(height) > flat + 50.0
    user.key("ctrl+s")
    user.wait("not window._document.is_modified")
    assert load_sketch(folder).layers["mountain"][row, column] > 0

    user.drag(at(column - 40, row + 80), at(column + 40, row + 80))
    user.wait("window._document.is_modified")
    user.until(lambda: list((user.home / "xdg_state_home").rglob("*.sketch")), "an autosave")
    user.kill()
    assert load_sketch(folder).layers["mountain"][row + 80, column] == 0

    user.start(str(folder))
    dialog_opens(user)
    user.key("Return")
    user.wait("app.activeModalWidget() is None")
    user.wait(f"int(window._document.sketch.layers['mountain'][{row + 80}, {column}]) > 0")
    assert user.evaluate("window._document.is_modified")
    assert user.leave() == 0


@pytest.mark.soak
def test_a_tour(user, tmp_path):
    """Build, edit, undo, export and reopen a sketch; SKETCHTERRAIN_TOUR is the folder of its pictures."""
    pictures = Path(os.environ.get("SKETCHTERRAIN_TOUR", tmp_path / "tour"))

    def see(name: str) -> None:
        wait_for_terrain(user)
        user.until(lambda: user.evaluate("window._link.frame.converged"), "a converged picture")
        user.screenshot(pictures / f"{name}.png")

    user.start()
    see("preset")
    user.key("ctrl+n")
    dialog_opens(user)
    user.click(*centre_of(user, "app.activeModalWidget().form['name']"), times=3)
    user.write("Two ranges")
    user.key("Return")
    user.wait("app.activeModalWidget() is None and window._document.sketch.name == 'Two ranges'")
    user.focus("window")
    wait_for_terrain(user)
    see("new")
    at = on_canvas(user)

    # Paint two ranges.
    user.key("b", *["bracketright"] * 3)
    user.drag(at(90, 90), at(130, 180), at(110, 290), at(150, 400), steps=24)
    step(user, 1)
    see("range")
    user.drag(at(400, 80), at(380, 190), at(420, 300), at(390, 410), steps=24)
    step(user, 2)
    see("valley")
    mountains = "[p for p in window._link.placed.points if p['painted'] and p['type'] == 0]"
    assert user.evaluate(f"len({mountains})") >= 2

    # Draw a river.
    user.key("3", "l")
    for place in ((262, 20), (230, 130), (280, 250), (240, 370), (270, 500)):
        user.click(*at(*place))
    user.key("Return")
    step(user, 3)
    assert user.evaluate(f"len({RIVERS})") >= 1
    see("river")

    # Paint a forest.
    user.key("5", "b")
    user.drag(at(320, 330), at(310, 400), at(330, 440), steps=16)
    step(user, 4)
    see("forest")

    # Move a mountain.
    user.key("v")
    wait_for_terrain(user)
    x, y, name = user.evaluate(
        "(lambda p: [float(p['x']), float(p['y']), int(p['id'])])("
        f"max({mountains}, key=lambda p: float(p['strength'])))"
    )
    at_metres = on_terrain(user)
    user.click(*at_metres(x, y))
    user.wait(f"window._workspace.selection is not None and window._workspace.selection.id == {name}")
    see("selected")
    user.drag(at_metres(x, y), at_metres(x + 120.0, y - 500.0))
    step(user, 5)
    moved = user.evaluate(f"(lambda p: [float(p['x']), float(p['y'])])({POINT.format(name)})")
    assert np.hypot(moved[0] - x - 120.0, moved[1] - y + 500.0) < 40.0
    see("moved")

    # Widen the river.
    x, y = user.evaluate(f"[float(v) for v in {RIVERS}[0].points[2, :2]]")
    user.click(*at_metres(x, y))
    user.wait("window._workspace.selection is not None and window._workspace.selection.kind == 'river'")
    width = f"max(float(r.width.max()) for r in {RIVERS})"
    before = user.evaluate(width)
    page = "[each for each in app.allWidgets() if type(each).__name__ == 'FeaturePage'][0]"
    user.click(*centre_of(user, f"{page}.form.rows['width'].box"), times=3)
    user.write("130")
    user.key("Return")
    step(user, 6)
    assert user.evaluate(width) > before + 40.0
    see("wider")

    # Undo and redo everything.
    steps = 6
    painted = "int(sum((image > 0).sum() for image in window._document.sketch.layers.values()))"
    full = user.evaluate(painted)
    user.key(*["ctrl+z"] * steps)
    step(user, 0)
    assert user.evaluate(painted) == 0
    assert user.evaluate(f"len({RIVERS})") == 0
    see("undone")
    user.key(*["ctrl+shift+z"] * steps)
    step(user, steps)
    assert user.evaluate(painted) == full
    assert user.evaluate(width) > before + 40.0

    # Export.
    out_folder = tmp_path / "out"
    user.key("ctrl+e")
    user.wait("'export' in window.dialogs.beside")
    user.focus("window.dialogs.beside['export']")
    user.click(*centre_of(user, "window.dialogs.beside['export'].path_field"), times=3)
    user.write(str(out_folder))
    user.screenshot(pictures / "export.png")
    user.key("Return")
    user.wait("window.dialogs.beside['export'].job is not None")
    user.until(lambda: (out_folder / "report.json").exists(), "the export")
    user.wait("not window.dialogs.beside['export'].job.is_running")
    user.screenshot(pictures / "exported.png")
    report = json.loads((out_folder / "report.json").read_text(encoding="utf-8"))
    assert {"height.tif", "foliage.csv", "features.json", "preview.png"} <= set(report["files"])
    user.key("Escape")
    user.wait("'export' not in window.dialogs.beside")

    # Save and reopen.
    user.focus("window")
    file = tmp_path / "two ranges.sketch"
    user.key("ctrl+s")
    dialog_opens(user)
    user.key("ctrl+a")
    user.write(str(file))
    user.key("Return")
    user.wait("not window._document.is_modified")
    assert user.leave() == 0
    user.start(str(file))
    wait_for_terrain(user)
    assert user.evaluate(painted) == full
    assert user.evaluate(width) > before + 40.0
    see("reopened")
    assert user.leave() == 0

    # The dark theme, from the best view.
    user.start("alpine_range")
    user.evaluate("__import__('sketchterrain.ui.look.theme', fromlist=['theme']).apply_theme(app, 'dark')")
    user.evaluate("window.view.see_best()")
    see("dark")
    assert user.leave() == 0
