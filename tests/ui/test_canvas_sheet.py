"""What the canvas shows: pixels of its picture."""

from __future__ import annotations

import gc
import random
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PyQt6.QtCore import QEvent, QPointF, QTimer
from PyQt6.QtWidgets import QApplication

from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.sketch.label_colours import DRAW_ORDER
from sketchterrain.ui.canvas.canvas import Canvas
from sketchterrain.ui.canvas.canvas_input import CanvasInput
from sketchterrain.ui.canvas.sketch_image import SketchPicture
from sketchterrain.ui.engine.protocol import Adherence, FrameFacts, Placed, Pose, Relief
from sketchterrain.ui.look.layer_colours import label_colour
from sketchterrain.ui.models.document import Document

if TYPE_CHECKING:
    from PyQt6.QtGui import QColor

SIDE = 64


@pytest.fixture
def plain(qapp):
    """A document with a square of mountain in the west and a lake in the east."""
    layers = {name: np.zeros((SIDE, SIDE), np.uint8) for name in LAYERS}
    layers["mountain"][8:56, 8:28] = 1
    layers["lake"][8:56, 36:56] = 2
    return Document(Sketch(layers=layers, extent=6400.0))


@pytest.fixture
def canvas(plain, workspace, link, qtbot):
    link._document = plain
    widget = Canvas(plain, workspace, link)
    qtbot.addWidget(widget)
    widget.resize(400, 360)
    widget.show()
    return widget


def pixels(canvas: Canvas) -> np.ndarray:
    image = canvas.grab().toImage().convertToFormat(canvas.grab().toImage().Format.Format_RGB32)
    bits = image.constBits()
    assert bits is not None
    bits.setsize(image.sizeInBytes())
    flat = np.frombuffer(bytes(bits), np.uint8).reshape(image.height(), image.bytesPerLine() // 4, 4)
    return flat[:, : image.width(), 2::-1].astype(int)


def around(canvas: Canvas, column: float, row: float, reach: int = 14) -> np.ndarray:
    """Mean colour around a place of the sketch, hatch and all."""
    x, y = canvas.viewport.to_screen(column, row)
    return pixels(canvas)[int(y) - reach : int(y) + reach, int(x) - reach : int(x) + reach].mean(axis=(0, 1))


def rgb(colour: QColor) -> np.ndarray:
    return np.array([colour.red(), colour.green(), colour.blue()], float)


def quiet(workspace) -> None:
    for name in ("relief", "features", "eye", "contradictions", "adherence"):
        workspace.show_overlay(name, False)


def test_paint_has_the_colour_of_its_label(canvas, workspace) -> None:
    for layer, label, column in (("mountain", 1, 18.0), ("lake", 2, 46.0)):
        workspace.set_look(layer, opacity=1.0)
        seen = around(canvas, column, 32.0)
        # Hatching darkens it somewhat, by the same share everywhere.
        assert np.abs(seen - rgb(label_colour(layer, label))).max() < 45.0
        others = [label_colour(name, 1) for name in DRAW_ORDER if name != layer]
        own = np.abs(seen - rgb(label_colour(layer, label))).sum()
        assert own < min(np.abs(seen - rgb(other)).sum() for other in others)


def test_visibility_and_opacity_mix_paint_with_paper(canvas, workspace) -> None:
    bare = around(canvas, 32.0, 32.0, reach=3)
    assert np.abs(around(canvas, 18.0, 32.0) - bare).max() > 40.0
    workspace.set_look("mountain", visible=False)
    assert np.abs(around(canvas, 18.0, 32.0) - bare).max() < 1.0
    workspace.set_look("mountain", visible=True)
    assert np.abs(around(canvas, 18.0, 32.0) - bare).max() > 40.0

    bare = around(canvas, 32.0, 32.0, reach=3)
    far = []
    for opacity in (0.2, 0.5, 0.9):
        workspace.set_look("mountain", opacity=opacity)
        far.append(np.abs(around(canvas, 18.0, 32.0) - bare).sum())
    assert far[0] < far[1] < far[2]


def test_layers_are_told_apart_without_colour(canvas, workspace) -> None:
    workspace.set_look("mountain", opacity=1.0)
    workspace.set_look("lake", opacity=1.0)
    patterns = []
    for column in (18.0, 46.0):
        x, y = canvas.viewport.to_screen(column, 32.0)
        patch = pixels(canvas)[int(y) - 24 : int(y) + 24, int(x) - 24 : int(x) + 24].mean(axis=2)
        patterns.append((patch - patch.mean()) / max(patch.std(), 1e-9))
    assert min(patch.std() for patch in patterns) > 0.9
    shared = [(np.roll(patterns[0], (i, j), (0, 1)) * patterns[1]).mean() for i, j in np.ndindex(8, 8)]
    assert max(shared) < 0.6


def test_painting_repaints_what_changed_and_nothing_is_left_behind(canvas, plain, workspace) -> None:
    rng = random.Random(2)
    for zoom in (1.0, 0.11, 1.7, 9.0):
        canvas.fit()
        canvas.zoom(zoom, QPointF(200.0, 180.0))
        pixels(canvas)
        draft = plain.begin_draft("mountain")
        for _ in range(12):
            top, left = rng.randint(0, SIDE - 9), rng.randint(0, SIDE - 9)
            bottom, right = top + rng.randint(1, 8), left + rng.randint(1, 8)
            draft.image[top:bottom, left:right] = rng.randint(0, 3)
            draft.touch((top, left, bottom, right))
            pixels(canvas)
        kept = pixels(canvas)
        canvas._shown.refresh()
        assert np.array_equal(kept, pixels(canvas))
        draft.cancel()
        assert np.array_equal(canvas._desk.document.layer("mountain"), plain.sketch.layers["mountain"])
        kept = pixels(canvas)
        canvas._shown.refresh()
        assert np.array_equal(kept, pixels(canvas))


def test_moving_the_sheet_shows_what_a_fresh_picture_does(canvas, link, placed) -> None:
    link.placed = Placed(1, placed.points[:12], (), ())
    canvas.zoom(2.0, QPointF(100.0, 100.0))
    rng = random.Random(3)
    for _ in range(8):
        canvas.scroll_by(rng.randint(-90, 90), rng.randint(-90, 90))
        moved = pixels(canvas)
        canvas._shown.refresh()
        canvas._marks._of = (None, None, False)
        # Qt counts shares of pixels from where a strip begins: they round differently.
        assert np.abs(moved - pixels(canvas)).max() <= 2


def test_the_relief_lies_beneath_the_paint_and_is_redrawn_where_it_changed(canvas, link, workspace) -> None:
    before = pixels(canvas)
    link.relief = Relief(1, 1, np.zeros((9, 9), np.float32), np.zeros((9, 9), np.uint8))
    link.relief_changed.emit(link.relief)
    assert np.array_equal(before, pixels(canvas))

    shade = np.full((SIDE, SIDE), 190, np.uint8)
    shade[:, 28:34] = 20
    height = np.zeros((SIDE, SIDE), np.float32)
    before = around(canvas, 31.0, 32.0, reach=3)
    link.relief = Relief(1, 1, height, shade)
    link.relief_changed.emit(link.relief)
    assert around(canvas, 31.0, 32.0, reach=3).mean() < before.mean() - 60.0
    workspace.show_overlay("relief", False)
    assert np.abs(around(canvas, 31.0, 32.0, reach=3) - before).max() < 1.0
    workspace.show_overlay("relief", True)
    shade = np.full((SIDE, SIDE), 190, np.uint8)
    link.relief = Relief(1, 1, height, shade)
    link.relief_changed.emit(link.relief)
    pixels(canvas)
    shade = shade.copy()
    shade[20:30, 29:35] = 60
    link.relief = Relief(2, 1, height, shade)
    link.relief_changed.emit(link.relief)
    kept = pixels(canvas)
    canvas._shown.refresh()
    assert np.abs(kept - pixels(canvas)).max() <= 2


def test_adherence_has_the_colours_of_the_report(canvas, link, workspace) -> None:
    quiet(workspace)
    painted = np.zeros((SIDE, SIDE), bool)
    painted[:32] = True
    shown = np.zeros((SIDE, SIDE), bool)
    shown[16:48] = True
    figures = {"layers": {"mountain": {"iou_mean": 0.5, "spill": 0.5}}}
    workspace.set_look("mountain", visible=False)
    workspace.set_look("lake", visible=False)
    before = pixels(canvas)
    link.adherence = Adherence(1, figures, {"mountain": (painted, shown)})
    workspace.show_overlay("adherence", True)
    missing, right, spill, neither = (around(canvas, 20.0, row, reach=4) for row in (10.0, 24.0, 40.0, 56.0))
    assert missing[0] > missing[1] > missing[2]  # orange
    assert right[1] > right[0]  # green
    assert spill[0] > spill[1]
    assert spill[2] > spill[1]  # purple
    assert neither.min() > 200.0
    workspace.show_overlay("adherence", False)
    assert np.array_equal(before, pixels(canvas))


def test_everything_that_can_lie_over_the_sketch_is_drawn(canvas, link, placed, workspace) -> None:
    quiet(workspace)
    link.placed = Placed(1, placed.points, placed.rivers, placed.lakes, (("a river crosses", 320.0, 320.0),))
    pose = Pose((100.0, 100.0, 50.0), (300.0, 300.0, 0.0))
    link.frame = FrameFacts(9, 9, 1, pose, (0.0,) * 16, 0.1, 0.1, 1, 1, True, 1)
    for name in ("features", "contradictions", "eye"):
        before = pixels(canvas)
        workspace.show_overlay(name, True)
        assert not np.array_equal(before, pixels(canvas)), name
        workspace.show_overlay(name, False)
        assert np.array_equal(before, pixels(canvas)), name


def test_another_document_is_shown_whole(canvas, plain) -> None:
    canvas.zoom(5.0, QPointF(10.0, 10.0))
    layers = {name: np.zeros((40, 90), np.uint8) for name in LAYERS}
    plain.open(Sketch(layers=layers))
    viewport = canvas.viewport
    assert (viewport.columns, viewport.rows) == (90, 40)
    width, height = viewport.sheet_size
    assert viewport.left >= 0
    assert viewport.top >= 0
    assert viewport.left + width <= viewport.width
    assert viewport.top + height <= viewport.height
    pixels(canvas)


def test_places_of_the_mouse_are_those_of_the_sketch(canvas, monkeypatch) -> None:
    for ratio in [1.0, 1.25, 2.0]:
        monkeypatch.setattr(type(canvas), "devicePixelRatioF", lambda _, ratio=ratio: ratio)
        canvas._resize(fits=True)
        for zoom in (1.0, 0.3, 7.0):
            canvas.zoom(zoom, QPointF(150.0, 120.0))
            desk = canvas._desk
            for x, y in ((0.0, 0.0), (31.25, 12.5), (64.0, 64.0)):
                assert desk.on_sketch(desk.at(x, y)) == pytest.approx((x, y), abs=1e-6), ratio
                assert desk.pixels(*desk.metres(x, y)) == pytest.approx((x, y), abs=1e-9), ratio
            pixels(canvas)


def test_random_zooming_and_moving_never_loses_the_sheet(canvas) -> None:
    rng = random.Random(8)
    for _ in range(150):
        canvas.zoom(rng.uniform(0.3, 3.0), QPointF(rng.uniform(0, 400), rng.uniform(0, 360)))
        canvas.scroll_by(rng.uniform(-300, 300), rng.uniform(-300, 300))
        width, height = canvas.viewport.sheet_size
        assert canvas.viewport.left < canvas.viewport.width
        assert canvas.viewport.left + width > 0
        assert canvas.viewport.top < canvas.viewport.height
        assert canvas.viewport.top + height > 0
    canvas.fit()
    pixels(canvas)


def test_no_timer_goes_on(canvas, workspace) -> None:
    workspace.set_look("mountain", locked=True)
    canvas._desk.may_paint()
    canvas.zoom(2.0, QPointF(9.0, 9.0))
    pixels(canvas)
    assert not any(timer.isActive() for timer in canvas.findChildren(QTimer))


def test_canvases_go_away(plain, workspace, link, qtbot) -> None:
    def living() -> int:
        gc.collect()
        return sum(isinstance(each, Canvas | CanvasInput | SketchPicture) for each in gc.get_objects())

    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)  # of the test before
    before, widgets = living(), len(QApplication.allWidgets())
    for _ in range(20):
        canvas = Canvas(plain, workspace, link)
        canvas.resize(200, 200)
        canvas.show()
        canvas.grab()
        canvas.close()
        canvas.deleteLater()
        del canvas
        QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        workspace.tool = "pan" if workspace.tool == "brush" else "brush"
        workspace.brush += 1.0
        plain.open(plain.sketch)
    assert living() == before
    assert len(QApplication.allWidgets()) == widgets
