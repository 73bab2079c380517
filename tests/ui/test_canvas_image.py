"""The canvas image: viewport transforms, compositing of layers, and the displayed pixels."""

import itertools
import random

import numpy as np
import pytest
from PyQt6.QtCore import QPointF
from PyQt6.QtGui import QColor, QImage

from sketchterrain.document.sketch import Sketch
from sketchterrain.geometry.camera import Camera
from sketchterrain.schema.layers import DRAW_ORDER, PAINTED_LAYERS
from sketchterrain.ui.canvas.canvas import Canvas
from sketchterrain.ui.canvas.compositing import (
    MASK,
    HatchTable,
    LayerCompositor,
    LayerPaint,
    level_for,
)
from sketchterrain.ui.canvas.tool_context import LARGEST, Viewport
from sketchterrain.ui.engine.protocol import Agreement, FrameFacts, Placement, Relief
from sketchterrain.ui.look.layer_colours import HATCHES, hatch, hatch_period, label_colour
from sketchterrain.ui.models.document import Document


def test_a_fitted_sketch_is_centred_and_no_sketch_leaves_the_screen():
    for size, sides in (((800, 600), (512, 512)), ((300, 900), (4096, 1024)), ((900, 300), (7, 5))):
        viewport = Viewport(*size, *sides).fitted(margin=20)
        lows = (viewport.left, viewport.top)
        for low, side, extent in zip(lows, viewport.sketch_size, size, strict=True):
            assert 19 <= low <= extent - 19 - side
            assert abs(low - (extent - low - side)) <= 2
    rng = random.Random(4)
    for sides in ((512, 512), (2048, 700), (3, 9), (16384, 16384)):
        viewport = Viewport(700, 500, *sides).fitted(margin=20)
        for _ in range(2000):
            action = rng.random()
            if action < 0.4:
                viewport = viewport.moved(rng.uniform(-900, 900), rng.uniform(-900, 900))
            elif action < 0.9:
                viewport = viewport.zoomed(rng.uniform(0.3, 3.0), rng.uniform(0, 700), rng.uniform(0, 500))
            else:
                viewport = viewport.resized(rng.randint(60, 1500), rng.randint(60, 1500))
            assert 0.0 < viewport.scale <= LARGEST
            lows, extents = (viewport.left, viewport.top), (viewport.width, viewport.height)
            for low, side, extent in zip(lows, viewport.sketch_size, extents, strict=True):
                assert min(low + side, extent) - max(low, 0) >= min(40, side - 1)


COLOURS = [np.random.default_rng(k).random((256, 3)).astype(np.float32) for k in range(3)]
PAINTS = tuple(LayerPaint(name, COLOURS[k], 0.3 + 0.25 * k) for k, name in enumerate("abc"))


def sketch_layers(height: int, width: int, labels: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    layers = {}
    for name in "abc":
        coarse = rng.integers(0, labels + 1, (height // 16 + 1, width // 16 + 1))
        coarse[rng.random(coarse.shape) < 0.5] = 0
        layers[name] = np.kron(coarse, np.ones((16, 16)))[:height, :width].astype(np.uint8)
    return layers


def full_box(rows: int, columns: int, level: int) -> tuple:
    return 0, 0, -(-rows >> level), -(-columns >> level)


def blend_reference(layers: dict[str, np.ndarray]) -> np.ndarray:
    """Reference: red, green, blue, alpha of each pixel, premultiplied, 0 … 255."""
    shape = layers["a"].shape
    out = np.zeros((*shape, 4))
    for paint in PAINTS:
        image = layers[paint.layer]
        cover = np.where(image > 0, paint.opacity, 0.0)[..., None]
        top = np.concatenate([paint.colours[image], np.ones((*shape, 1))], axis=-1)
        out = out * (1.0 - cover) + top * cover
    return out * 255.0


def test_colours_are_blended_and_codes_distinguish_mixtures_of_labels():
    for labels in [2, 4, 200]:
        layers = sketch_layers(300, 530, labels)
        pixels, codes = LayerCompositor(layers.__getitem__, PAINTS).read(0, (0, 0, 300, 530))
        rgba = np.stack([pixels >> shift & 255 for shift in (16, 8, 0, 24)], axis=-1).astype(float)
        assert np.abs(rgba - blend_reference(layers)).max() <= 0.51, labels
        expected = sum((layers[name] > 0).astype(int) << bit for bit, name in enumerate("abc"))
        assert np.array_equal(codes & MASK, expected), labels
        if labels == 4:  # equal mixtures have equal codes, different ones nearly always differ
            key = sum(layers[name].astype(int) * 10**place for place, name in enumerate("abc"))
            assert all(len(np.unique(codes[key == value])) == 1 for value in np.unique(key))
            assert len(np.unique(codes)) >= 0.97 * len(np.unique(key))


def test_a_box_is_a_part_of_the_whole_and_an_invalidated_one_is_composited_again():
    layers = sketch_layers(700, 530, 3)
    compositor = LayerCompositor(layers.__getitem__, PAINTS)
    for level in (0, 1, 3):
        everything = compositor.read(level, full_box(700, 530, level))
        for cut, image in zip(compositor.read(level, (31, 17, 77, 61)), everything, strict=True):
            assert np.array_equal(cut, image[31:77, 17:61])
    layers["b"][201:333, 250:301] = 2
    compositor.invalidate((201, 250, 333, 301))
    fresh = LayerCompositor(layers.__getitem__, PAINTS)
    for level in (0, 1, 3):
        box = full_box(700, 530, level)
        for updated, expected in zip(compositor.read(level, box), fresh.read(level, box), strict=True):
            assert np.array_equal(updated, expected)


def test_small_paint_is_visible_at_every_level():
    layers = {name: np.zeros((2100, 3000), np.uint8) for name in "abc"}
    compositor = LayerCompositor(layers.__getitem__, PAINTS)
    for level in (4, 2, 0):
        assert not compositor.read(level, full_box(2100, 3000, level))[1].any()
    layers["c"][2050:2060, 1020:1030] = 1
    compositor.invalidate((2050, 1020, 2060, 1030))
    for level in (0, 2, 3, 4, 5):
        codes = compositor.read(level, full_box(2100, 3000, level))[1]
        rows, columns = np.nonzero(codes)
        assert (rows.min(), rows.max()) == (2050 >> level, 2059 >> level)
        assert (columns.min(), columns.max()) == (1020 >> level, 1029 >> level)

    layers = {name: np.zeros((1000, 900), np.uint8) for name in "abc"}
    layers["b"][:, 333] = 1
    for level in range(6):
        _, codes = LayerCompositor(layers.__getitem__, PAINTS).read(level, full_box(1000, 900, level))
        assert ((codes > 0).sum(axis=1) == 1).all()
    assert [level_for(scale) for scale in (8.0, 1.0, 0.99, 0.5, 0.49, 0.25)] == [0, 0, 1, 1, 2, 2]


def test_hatches_tile_without_a_seam():
    for ratio, kind in itertools.product([1.0, 1.5, 2.0], HATCHES):
        period = hatch_period(ratio)
        covered = hatch(kind, period)
        assert covered.shape == (period, period), (ratio, kind)
        assert 0.05 < covered.mean() < 0.5, (ratio, kind)
        for axis in (0, 1):
            steps = np.abs(np.diff(covered, axis=axis)).max()
            seam = np.abs(np.take(covered, 0, axis=axis) - np.take(covered, -1, axis=axis)).max()
            assert seam <= max(steps, 0.05) + 1e-5, (ratio, kind)


def test_outlines_are_drawn_where_codes_change():
    table = HatchTable([], 1.0)
    codes = np.zeros((12, 12), np.uint32)
    codes[4:8, 5:9] = 1
    expected = np.zeros((12, 12), bool)  # one of the two pixels at a border
    expected[3:8, 4:9] = True
    expected[4:7, 5:8] = False
    expected[3, 4] = False
    assert np.array_equal(table.render(codes, 0, 0) > 0, expected[1:-1, 1:-1])


SIDE = 64


@pytest.fixture
def plain(qapp):
    """A document with a square of mountain in the west and a lake in the east."""
    layers = {name: np.zeros((SIDE, SIDE), np.uint8) for name in PAINTED_LAYERS}
    layers["mountain"][8:56, 8:28] = 1
    layers["lake"][8:56, 36:56] = 2
    return Document(Sketch(layers=layers, extent=6400.0))


@pytest.fixture
def canvas(plain, workspace, link, show_widget):
    link._document = plain
    return show_widget(Canvas(plain, workspace, link), 400, 360)


def pixels(canvas: Canvas) -> np.ndarray:
    image = canvas.grab().toImage().convertToFormat(QImage.Format.Format_RGB32)
    bits = image.constBits().asstring(image.sizeInBytes())
    flat = np.frombuffer(bits, np.uint8).reshape(image.height(), image.bytesPerLine() // 4, 4)
    return flat[:, : image.width(), 2::-1].astype(int)


def patch(canvas: Canvas, column: float, row: float, radius: int = 14) -> np.ndarray:
    x, y = canvas.viewport.to_screen(column, row)
    return pixels(canvas)[int(y) - radius : int(y) + radius, int(x) - radius : int(x) + radius]


def mean(canvas: Canvas, column: float, row: float, radius: int = 14) -> np.ndarray:
    return patch(canvas, column, row, radius).mean(axis=(0, 1))


def rgb(colour: QColor) -> np.ndarray:
    return np.array([colour.red(), colour.green(), colour.blue()], float)


def show_relief(link, version, shade, height, level=None):
    link.relief = Relief(version, 1, height, shade, level)
    link.relief_changed.emit(link.relief)


def hide(workspace, *layers):
    for name in ("relief", "features", "eye", "contradictions", "adherence", "realism"):
        workspace.show_overlay(name, False)
    for name in layers:
        workspace.set_look(name, visible=False)


def test_paint_has_its_labels_colour_and_its_layer_s_hatch(canvas, workspace):
    patterns = []
    for layer, label, column in (("mountain", 1, 18.0), ("lake", 2, 46.0)):
        workspace.set_look(layer, opacity=1.0)
        displayed, own = mean(canvas, column, 32.0), rgb(label_colour(layer, label))
        assert np.abs(displayed - own).max() < 45.0  # darkened by the hatch
        others = [rgb(label_colour(name, 1)) for name in DRAW_ORDER if name != layer]
        assert np.abs(displayed - own).sum() < min(np.abs(displayed - other).sum() for other in others)
        grey = patch(canvas, column, 32.0, 24).mean(axis=2)
        patterns.append((grey - grey.mean()) / max(grey.std(), 1e-9))
    assert min(pattern.std() for pattern in patterns) > 0.9
    shared = [(np.roll(patterns[0], (i, j), (0, 1)) * patterns[1]).mean() for i, j in np.ndindex(8, 8)]
    assert max(shared) < 0.6


def test_incremental_redraws_equal_a_full_one(canvas, plain, workspace):
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
        for end in (lambda: None, draft.cancel):
            end()
            incremental = pixels(canvas)
            canvas._sketch_view.refresh()
            assert np.array_equal(incremental, pixels(canvas))


def test_panning_equals_a_full_redraw(canvas, link, placed):
    link.placed = Placement(1, placed.points[:12], (), ())
    canvas.zoom(2.0, QPointF(100.0, 100.0))
    rng = random.Random(3)
    for _ in range(8):
        canvas.scroll_by(rng.randint(-90, 90), rng.randint(-90, 90))
        moved = pixels(canvas)
        canvas._sketch_view.refresh()
        canvas._decorations._features._key = ()
        # Qt rounds fractions of pixels from where a strip begins.
        assert np.abs(moved - pixels(canvas)).max() <= 2


def test_the_relief_shades_the_paper_and_is_redrawn_where_it_changed(canvas, link, workspace):
    def show(version, shade):
        show_relief(link, version, shade, np.zeros(shade.shape, np.float32))
        return pixels(canvas)

    before = pixels(canvas)
    assert np.array_equal(before, show(1, np.zeros((9, 9), np.uint8)))  # of another sketch

    light = np.full((SIDE, SIDE), 190, np.uint8)
    dark, spot = light.copy(), light.copy()
    dark[:, 28:34], spot[20:30, 29:35] = 20, 60
    before = mean(canvas, 31.0, 32.0, radius=3)
    show(1, dark)
    assert mean(canvas, 31.0, 32.0, radius=3).mean() < before.mean() - 60.0
    workspace.show_overlay("relief", False)
    assert np.abs(mean(canvas, 31.0, 32.0, radius=3) - before).max() < 1.0
    workspace.show_overlay("relief", True)
    show(1, light)
    incremental = show(2, spot)
    canvas._sketch_view.refresh()
    assert np.abs(incremental - pixels(canvas)).max() <= 2


def test_the_relief_has_the_sea_below_its_level(canvas, link):
    def show(version, height, level):
        show_relief(link, version, np.full((SIDE, SIDE), 190, np.uint8), height.copy(), level)
        return [mean(canvas, column, 32.0, radius=3) for column in (10.0, 50.0)]

    height = np.full((SIDE, SIDE), 5.0, np.float32)
    height[:, :20] = -3.0
    (dry, _), (wet, beside) = show(1, height, None), show(1, height, 0.0)
    assert wet[0] - wet[2] < dry[0] - dry[2] - 10.0  # bluer
    height[:, :20] = -60.0
    deep, as_before = show(2, height, 0.0)
    assert deep.mean() < wet.mean() - 5.0
    assert np.abs(as_before - beside).max() < 1.0
    incremental = pixels(canvas)
    canvas._sketch_view.refresh()
    assert np.abs(incremental - pixels(canvas)).max() <= 2


def test_adherence_is_tinted_in_its_legends_colours(canvas, link, workspace):
    hide(workspace, "mountain", "lake")
    painted, present = np.zeros((2, SIDE, SIDE), bool)
    painted[:32] = present[16:48] = True
    figures = {"layers": {"mountain": {"iou_mean": 0.5, "spill": 0.5}}}
    before = pixels(canvas)
    link.adherence = Agreement(1, figures, {"mountain": (painted, present)})
    workspace.show_overlay("adherence", True)
    missing, right, spill, neither = (mean(canvas, 20.0, row, radius=4) for row in (10.0, 24.0, 40.0, 56.0))
    assert missing[0] > missing[1] > missing[2]  # orange
    assert right[1] > right[0]  # green
    assert spill[1] < min(spill[0], spill[2])  # purple
    assert neither.min() > 200.0
    workspace.show_overlay("adherence", False)
    assert np.array_equal(before, pixels(canvas))


def test_faults_of_landforms_are_tinted_in_their_legends_colours(canvas, link, workspace):
    hide(workspace, "mountain", "lake")
    faults = np.repeat(np.arange(4, dtype=np.uint8), SIDE // 4)[:, None].repeat(SIDE, axis=1)
    before = pixels(canvas)
    workspace.show_overlay("realism", True)
    link.adherence = Agreement(1, {}, realism={"distance": 1.0, "kind": "hills 90 m"}, faults=faults)
    link.adherence_changed.emit(link.adherence)
    nothing, wall, hollow, rising = (mean(canvas, 20.0, row, radius=4) for row in (8.0, 24.0, 40.0, 56.0))
    assert nothing.min() > 200.0
    assert wall[0] > wall[1] > wall[2]  # orange
    assert hollow[2] > hollow[1] > hollow[0]  # blue
    assert rising[0] > rising[2] > rising[1]  # pink
    workspace.show_overlay("realism", False)
    assert np.array_equal(before, pixels(canvas))


def test_each_overlay_is_drawn_and_removed(canvas, link, placed, workspace):
    hide(workspace)
    resolutions = (("a river crosses", 320.0, 320.0),)
    link.placed = Placement(1, placed.points, placed.rivers, placed.lakes, resolutions)
    pose = Camera((100.0, 100.0, 50.0), (300.0, 300.0, 0.0))
    link.frame = FrameFacts(9, 9, 1, pose, 0.1, 0.1, 1, 1, True, 1)
    for name in ("features", "contradictions", "eye"):
        before = pixels(canvas)
        workspace.show_overlay(name, True)
        assert not np.array_equal(before, pixels(canvas)), name
        workspace.show_overlay(name, False)
        assert np.array_equal(before, pixels(canvas)), name


def test_positions_are_inverse_at_any_pixel_ratio_and_zoom(canvas, monkeypatch):
    for ratio in [1.0, 1.25, 2.0]:
        monkeypatch.setattr(type(canvas), "devicePixelRatioF", lambda _, ratio=ratio: ratio)
        canvas._resize(fitted=True)
        for zoom in (1.0, 0.3, 7.0):
            canvas.zoom(zoom, QPointF(150.0, 120.0))
            context = canvas._context
            for x, y in ((0.0, 0.0), (31.25, 12.5), (64.0, 64.0)):
                position = context.sketch_from_screen(context.screen_from_sketch(x, y))
                assert position == pytest.approx((x, y), abs=1e-6), ratio
                position = context.sketch_from_world(*context.world_from_sketch(x, y))
                assert position == pytest.approx((x, y), abs=1e-9), ratio
            pixels(canvas)
