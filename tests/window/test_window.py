"""The real program on a screen, used with mouse and keyboard: what a new user does in the first minutes."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.document.store import load_sketch, new_sketch

from .places import HANDLES, middle_of, on_canvas, on_ground, view_of, wait_for_terrain

pytestmark = pytest.mark.window

HEIGHT_AT = "(lambda r: float(r.height[{row} // r.step, {column} // r.step]))(window._link.relief)"
POINT = "[p for p in window._link.placed.points if int(p['id']) == {}][0]"


def dialog_opens(person) -> None:
    person.wait("app.activeModalWidget() is not None")
    person.focus("app.activeModalWidget()")


def step(person, number: int) -> None:
    """Wait until the history stands at a step and its terrain is shown."""
    person.wait(f"window._document.history.position == {number}")
    wait_for_terrain(person)


@pytest.mark.slow
def test_paint_see_undo_save_kill_and_recover(person, tmp_path):
    folder = tmp_path / "valley"
    new_sketch(folder)
    person.start(str(folder))
    wait_for_terrain(person)
    at = on_canvas(person)
    row, column = 350, 130
    height = HEIGHT_AT.format(row=row, column=column)
    before, flat = view_of(person, person.see()), person.ask(height)

    person.key("b")
    person.drag(at(column - 40, row), at(column + 40, row))
    step(person, 1)
    assert person.ask(height) > flat + 50.0

    def rose() -> bool:
        change = np.abs(view_of(person, person.see()) - before).max(axis=2)
        return float((change > 25).mean()) > 0.005

    person.until(rose, "a mountain in the 3-D view")

    person.key("ctrl+z")
    step(person, 0)
    assert person.ask(height) == flat
    person.key("ctrl+shift+z")
    step(person, 1)
    assert person.ask(height) > flat + 50.0
    person.key("ctrl+s")
    person.wait("not window._document.is_modified")
    assert load_sketch(folder).layers["mountain"][row, column] > 0

    person.drag(at(column - 40, row + 80), at(column + 40, row + 80))
    person.wait("window._document.is_modified")
    kept = person.home / "xdg_state_home"
    person.until(lambda: list(kept.rglob("*.sketch")), "an autosave")
    person.kill()
    assert load_sketch(folder).layers["mountain"][row + 80, column] == 0

    person.start(str(folder))
    dialog_opens(person)
    person.key("Return")
    person.wait("app.activeModalWidget() is None")
    person.wait(f"int(window._document.sketch.layers['mountain'][{row + 80}, {column}]) > 0")
    assert person.ask("window._document.is_modified")
    assert person.leave() == 0


@pytest.mark.soak
def test_a_tour(person, tmp_path):
    """With SKETCHTERRAIN_TOUR the pictures of docs/tour.md are taken into that folder."""
    pictures = Path(os.environ.get("SKETCHTERRAIN_TOUR", tmp_path / "tour"))

    def see(name: str) -> None:
        wait_for_terrain(person)
        person.until(lambda: person.ask("window._link.frame.converged"), "a whole picture")
        person.see(pictures / f"{name}.png")

    person.start()
    person.key("ctrl+n")
    dialog_opens(person)
    person.click(*middle_of(person, "app.activeModalWidget().form['name']"), times=3)
    person.write("Two ranges")
    person.key("Return")
    person.wait("app.activeModalWidget() is None and window._document.sketch.name == 'Two ranges'")
    person.focus("window")
    wait_for_terrain(person)
    see("new")
    at = on_canvas(person)

    # Two ranges, and between them a valley.
    person.key("b", *["bracketright"] * 3)
    person.drag(at(90, 90), at(130, 180), at(110, 290), at(150, 400), steps=24)
    step(person, 1)
    see("range")
    person.drag(at(400, 80), at(380, 190), at(420, 300), at(390, 410), steps=24)
    step(person, 2)
    see("valley")
    assert person.ask("len([p for p in window._link.placed.points if p['painted'] and p['type'] == 0])") >= 2

    # A river through it.
    person.key("3", "l")
    for place in ((262, 20), (230, 130), (280, 250), (240, 370), (270, 500)):
        person.click(*at(*place))
    person.key("Return")
    step(person, 3)
    assert person.ask("len(window._link.placed.rivers)") >= 1
    see("river")

    # A forest beside it.
    person.key("5", "b")
    person.drag(at(320, 330), at(310, 400), at(330, 440), steps=16)
    step(person, 4)
    see("forest")

    # A mountain is moved.
    person.key("v")
    wait_for_terrain(person)
    x, y, name = person.ask(
        "(lambda p: [float(p['x']), float(p['y']), int(p['id'])])("
        "max((p for p in window._link.placed.points if p['painted'] and p['type'] == 0), "
        "key=lambda p: float(p['strength'])))"
    )
    ground = on_ground(person)
    person.click(*ground(x, y))
    person.wait(f"window._workspace.selection is not None and window._workspace.selection.id == {name}")
    see("chosen")
    person.drag(ground(x, y), ground(x + 120.0, y - 500.0))
    step(person, 5)
    moved = person.ask(f"(lambda p: [float(p['x']), float(p['y'])])({POINT.format(name)})")
    assert np.hypot(moved[0] - x - 120.0, moved[1] - y + 500.0) < 40.0
    see("moved")

    # The river gets wider.
    x, y = person.ask("[float(v) for v in window._link.placed.rivers[0].points[2, :2]]")
    person.click(*ground(x, y))
    person.wait("window._workspace.selection is not None and window._workspace.selection.kind == 'river'")
    width = "max(float(r.width.max()) for r in window._link.placed.rivers)"
    before = person.ask(width)
    grip, base = person.ask(
        f"(lambda h: [[h.x, h.y], [h.base_x, h.base_y]])([h for h in {HANDLES} if h.role == 'width'][0])"
    )
    away = np.subtract(grip, base) / np.hypot(*np.subtract(grip, base))
    # The handle stands 12 px off the bank, so that it can be seen.
    grip = np.add(grip, away * 12.0 / np.hypot(*np.subtract(ground(1.0, 0.0), ground(0.0, 0.0))))
    person.drag(ground(*grip), ground(*(grip + 60.0 * away)))
    step(person, 6)
    assert person.ask(width) > before + 40.0
    see("wider")

    # All is undone, all is done again.
    steps = 6
    painted = "int(sum((image > 0).sum() for image in window._document.sketch.layers.values()))"
    full = person.ask(painted)
    person.key(*["ctrl+z"] * steps)
    step(person, 0)
    assert person.ask(painted) == 0
    assert person.ask("len(window._link.placed.rivers)") == 0
    see("undone")
    person.key(*["ctrl+shift+z"] * steps)
    step(person, steps)
    assert person.ask(painted) == full
    assert person.ask(width) > before + 40.0

    # It is exported.
    out_folder = tmp_path / "out"
    person.key("ctrl+e")
    person.wait("'export' in window.dialogs.beside")
    person.focus("window.dialogs.beside['export']")
    person.click(*middle_of(person, "window.dialogs.beside['export'].path_field"), times=3)
    person.write(str(out_folder))
    person.see(pictures / "export.png")
    person.key("Return")
    person.wait("window.dialogs.beside['export'].job is not None")
    person.until(lambda: (out_folder / "report.json").exists(), "the export")
    person.wait("not window.dialogs.beside['export'].job.is_running")
    person.see(pictures / "exported.png")
    report = json.loads((out_folder / "report.json").read_text(encoding="utf-8"))
    assert {"height.tif", "foliage.csv", "features.json", "preview.png"} <= set(report["files"])
    person.key("Escape")
    person.wait("'export' not in window.dialogs.beside")

    # It is saved, and opened again.
    person.focus("window")
    file = tmp_path / "two ranges.sketch"
    person.key("ctrl+s")
    dialog_opens(person)
    person.key("ctrl+a")
    person.write(str(file))
    person.key("Return")
    person.wait("not window._document.is_modified")
    assert person.leave() == 0
    person.start(str(file))
    wait_for_terrain(person)
    assert person.ask(painted) == full
    assert person.ask(width) > before + 40.0
    see("reopened")
    assert person.leave() == 0
