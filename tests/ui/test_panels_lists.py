"""History, adherence, contradictions and the line at the foot of the window."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from PyQt6.QtCore import QPoint, Qt
from PyQt6.QtTest import QTest

from sketchterrain.sketch import LAYERS
from sketchterrain.system import memory_in_use
from sketchterrain.ui.commands.settings import WORLD, set_setting
from sketchterrain.ui.engine.protocol import (
    Adherence,
    EngineFacts,
    FrameFacts,
    MeasureAdherence,
    Pose,
    Trouble,
)
from sketchterrain.ui.panels.adherence import AdherencePanel
from sketchterrain.ui.panels.lists import PALE, ContradictionsPanel, HistoryPanel
from sketchterrain.ui.panels.status_line import StatusLine

LAYER = {"shapes": 3, "measured": 2, "lost": 1, "iou_mean": 0.912, "spill": 0.051}
FIGURES = {
    "lost": 1,
    "mean_iou": 0.877,
    "layers": {"mountain": LAYER, "hill": {**LAYER, "shapes": 0}},
    "peaks": {"measured": 2, "capped": 1, "least": 0.9, "mean": 1.0, "most": 1.04},
}


@pytest.fixture
def shown(qtbot):
    """Show a panel, and hold it until the test has ended: Qt may still draw it then."""
    held = []

    def show(panel):
        held.append(panel)
        qtbot.addWidget(panel)
        panel.resize(300, 400)
        panel.show()
        return panel

    yield show
    held.clear()


def steps(document, count):
    for seed in range(1, count + 1):
        document.do(f"Step {seed}", set_setting(document.sketch, WORLD, "seed", 1000 + seed))


def texts(panel):
    model = panel.list.model()
    return [model.index(row, 0).data() for row in range(model.rowCount())]


def test_history_marks_the_current_step_and_goes_where_one_clicks(shown, document) -> None:
    panel = shown(HistoryPanel(document))
    steps(document, 5)
    assert texts(panel) == ["Open", *(f"Step {n}" for n in range(1, 6))]
    assert panel.list.currentIndex().row() == 5
    document.undo()
    document.undo()
    assert panel.list.currentIndex().row() == 3
    assert panel.list.selectionModel().selectedIndexes()[0].row() == 3
    model = panel.list.model()
    assert [bool(model.index(row, 0).data(PALE)) for row in range(6)] == [False] * 4 + [True] * 2

    place = panel.list.visualRect(panel.list.model().index(2, 0)).center()
    QTest.mouseClick(panel.list.viewport(), Qt.MouseButton.LeftButton, pos=place)
    assert document.history.position == 2
    assert document.sketch.seed == 1002
    assert len(document.history.titles) == 6
    QTest.keyClick(panel.list, Qt.Key.Key_Down)
    assert document.sketch.seed == 1003
    QTest.keyClick(panel.list, Qt.Key.Key_End)
    assert document.history.position == 5


def test_a_thousand_steps_are_shown_at_once(shown, document):
    panel = shown(HistoryPanel(document))
    steps(document, 200)
    assert panel.list.model().rowCount() == len(document.history.titles)
    bottom = panel.list.visualRect(panel.list.currentIndex())
    assert panel.list.viewport().rect().intersects(bottom), "the last step is in sight"


def test_adherence_of_nothing_painted(shown, workspace, link):
    panel = shown(AdherencePanel(workspace, link))
    nothing = {"measured": 0, "capped": 0, "least": None, "mean": None, "most": None}
    link.adherence = Adherence(1, {"lost": 0, "mean_iou": None, "layers": {}, "peaks": nothing})
    link.adherence_changed.emit(link.adherence)
    assert not any(bar.isVisible() for bar in panel.bars.values())
    thin = {**LAYER, "measured": 0, "iou_mean": None, "spill": None}
    link.adherence = Adherence(1, {"mean_iou": None, "layers": {"hill": thin}, "peaks": nothing})
    link.adherence_changed.emit(link.adherence)
    assert "too thin to measure" in panel.bars["hill"].text
    panel.grab()


def test_adherence_follows_while_it_lies_over_the_sketch(qtbot, shown, workspace, link, placed):
    shown(AdherencePanel(workspace, link))
    link.placed = placed
    link.placed_changed.emit(placed)
    qtbot.wait(700)
    assert link.told == [], "nobody asked"
    workspace.show_overlay("adherence", True)
    qtbot.waitUntil(lambda: link.told == [MeasureAdherence()], timeout=3000)
    link.adherence = Adherence(placed.version, FIGURES)
    link.adherence_changed.emit(link.adherence)
    for version in (2, 3, 4):
        link.placed = dataclasses.replace(placed, version=version)
        link.placed_changed.emit(link.placed)
    qtbot.waitUntil(lambda: len(link.told) == 2, timeout=3000)


def test_adherence_is_measured_on_demand_and_again_after_a_failure(shown, workspace, link) -> None:
    panel = shown(AdherencePanel(workspace, link))
    panel.measure.click()
    link.trouble.emit(Trouble("engine", "it ended"))
    assert panel.measure.isEnabled()
    panel.measure.click()
    assert len(link.told) == 2
    link.told.clear()
    panel = shown(AdherencePanel(workspace, link))
    assert not any(bar.isVisible() for bar in panel.bars.values())
    panel.measure.click()
    assert link.told == [MeasureAdherence()]
    link.adherence = Adherence(1, FIGURES)
    link.adherence_changed.emit(link.adherence)
    assert [name for name, bar in panel.bars.items() if bar.isVisible()] == ["mountain"]
    assert panel.bars["mountain"].text == (
        f"{LAYERS['mountain'].title}, 91 % overlap. 3 shapes · 1 lost · spills over by 5 %"
    )

    panel = shown(AdherencePanel(workspace, link))
    panel.overlay.click()
    assert "adherence" in workspace.overlays
    workspace.show_overlay("adherence", False)
    assert not panel.overlay.isChecked()


def test_contradictions_lead_to_their_places_and_their_marks_are_switched(
    shown, workspace, link, placed
) -> None:
    panel = shown(ContradictionsPanel(workspace, link))
    assert panel.mark.isChecked() == ("contradictions" in workspace.overlays)
    panel.mark.click()
    assert panel.mark.isChecked() == ("contradictions" in workspace.overlays)
    workspace.show_overlay("contradictions", not panel.mark.isChecked())
    assert panel.mark.isChecked() == ("contradictions" in workspace.overlays)

    assert not panel.list.isVisible()
    lines = (("river 1 crosses mountain 2: valley cut 84 m", 100.0, 200.0), ("lake 1 lies high", 5.0, 6.0))
    link.placed = dataclasses.replace(placed, resolutions=lines, orphans=("move of 4711",))
    link.placed_changed.emit(link.placed)
    assert texts(panel) == [
        "River 1 crosses mountain 2: valley cut 84 m",
        "Lake 1 lies high",
        "Edit without its feature: move of 4711",
    ]
    shown_places = []
    panel.show_place.connect(lambda x, y: shown_places.append((x, y)))
    for row in range(3):
        place = panel.list.visualRect(panel.list.model().index(row, 0)).topLeft() + QPoint(30, 5)
        QTest.mouseClick(panel.list.viewport(), Qt.MouseButton.LeftButton, pos=place)
    assert shown_places == [(100.0, 200.0), (5.0, 6.0)]
    link.placed = placed
    link.placed_changed.emit(placed)
    assert panel.list.isVisible() == bool(placed.resolutions)


@pytest.fixture
def line(qtbot, document, workspace, link):
    line = StatusLine(document, workspace, link)
    qtbot.addWidget(line)
    line.resize(1280, 24)
    line.show()
    return line


def frame(seconds):
    pose = Pose((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    return FrameFacts(800, 600, 1, pose, (0.0,) * 16, seconds, 0.021, 120, 400_000, True, 500_000_000)


def test_the_status_line_reports_work_device_pointer_and_memory(line, link) -> None:
    assert line.work.text() == "Ready"
    assert not line.busy.isVisible()
    link.working = "Placing features"
    link.working_changed.emit(link.working)
    assert line.work.text() == "Placing features"
    assert line.busy.isVisible()
    link.working = ""
    link.working_changed.emit("")
    assert not line.busy.isVisible()

    link.facts = EngineFacts(device="EPYC", platform="PoCL", renderer="llvmpipe", sharing="mapped")
    link.facts_changed.emit(link.facts)
    assert line.device.text() == "EPYC · mapped memory"
    for word in ("EPYC", "PoCL", "llvmpipe", "mapped memory"):
        assert word in line.device.toolTip()
    link.facts = EngineFacts(no_device="no OpenCL device: install one", no_picture="no OpenGL")
    link.facts_changed.emit(link.facts)
    assert line.device.text() == "no device"
    assert "install one" in line.device.toolTip()
    assert "no OpenGL" in line.device.toolTip()

    line.hover((1234.5, 3456.7, 512.3))
    assert line.place.text() == "1234 E  3457 N   512 m high"
    line.hover((1234.0, 3456.0, None))
    assert line.place.text() == "1234 E  3456 N"
    line.hover(None)
    assert line.place.text() == ""

    assert 10e6 < memory_in_use() < 1e11


def test_the_line_tells_how_long_things_take(qtbot, line, link, placed):
    link.placed, link.frame = dataclasses.replace(placed, seconds=0.12), frame(0.08)
    link.placed_changed.emit(link.placed)
    link.frame_shown.emit(link.frame)
    qtbot.waitUntil(lambda: line.frame.text() == "Frame 80 ms, 12/s", timeout=2000)
    assert line.placing.text() == "Placing 120 ms"
    assert line.tiles.text() == "Tiles 21 ms"
    assert line.memory.text().endswith((" MB", " GB"))


def test_figures_keep_their_places(qtbot, line, link, placed):
    def places():
        line.layout().activate()
        return [each.geometry() for each in (line.place, line.paint, line.frame, line.memory, line.device)]

    before = places()
    link.frame = frame(1.234)
    link.frame_shown.emit(link.frame)
    link.working = "Measuring how far the terrain does what the sketch says"
    link.working_changed.emit(link.working)
    line.hover((1.0, 2.0, -3.0))
    qtbot.wait(350)
    assert places() == before


def test_the_line_names_the_paint_under_the_pointer(line, workspace, document):
    sketch = document.sketch
    row, column = np.argwhere((sketch.layers["mountain"] == 1) & (sketch.layers["river"] == 0))[0]
    place = ((column + 0.5) * sketch.pixel_size, (sketch.height_px - row - 0.5) * sketch.pixel_size, None)
    line.hover(place)
    assert line.paint.text().startswith("Mountains 1")
    workspace.set_look("mountain", visible=False)
    line.hover(place)
    assert "mountains" not in line.paint.text().lower()
    line.hover((-5.0, 1e9, None))
    assert line.paint.text() == ""
