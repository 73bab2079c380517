"""Layers on top of one another, as colours and codes."""

from __future__ import annotations

import numpy as np

from sketchterrain.ui.canvas.flattening import MASK, Flattening, Paint, level_for
from sketchterrain.ui.canvas.layer_brushes import HatchTable, LayerHatch
from sketchterrain.ui.look.layer_colours import HATCHES, hatch, hatch_period


def colours(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random((256, 3)).astype(np.float32)


def sketch_layers(height: int, width: int, labels: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    layers = {}
    for name in "abc":
        coarse = rng.integers(0, labels + 1, (height // 16 + 1, width // 16 + 1))
        coarse[rng.random(coarse.shape) < 0.5] = 0
        layers[name] = np.kron(coarse, np.ones((16, 16)))[:height, :width].astype(np.uint8)
    return layers


PAINTS = tuple(Paint(name, colours(k), 0.3 + 0.25 * k) for k, name in enumerate("abc"))


def mixed(layers: dict[str, np.ndarray]) -> np.ndarray:
    """Straightforward: red, green, blue, alpha of each pixel, premultiplied, 0 … 255."""
    shape = layers["a"].shape
    out = np.zeros((*shape, 4))
    for paint in PAINTS:
        image = layers[paint.layer]
        cover = np.where(image > 0, paint.opacity, 0.0)[..., None]
        top = np.concatenate([paint.colours[image], np.ones((*shape, 1))], axis=-1)
        out = out * (1.0 - cover) + top * cover
    return out * 255.0


def parts(pixels: np.ndarray) -> np.ndarray:
    return np.stack([pixels >> 16 & 255, pixels >> 8 & 255, pixels & 255, pixels >> 24], axis=-1).astype(
        float
    )


def test_colours_and_codes_are_those_of_the_layers_over_one_another() -> None:
    for labels in [2, 200]:
        layers = sketch_layers(300, 530, labels)
        pixels, codes = Flattening(layers.__getitem__, PAINTS).window(0, (0, 0, 300, 530))
        assert np.abs(parts(pixels) - mixed(layers)).max() <= 0.51, labels
        expected = sum((layers[name] > 0).astype(int) << bit for bit, name in enumerate("abc"))
        assert np.array_equal(codes & MASK, expected), labels

    layers = sketch_layers(300, 530, 4)
    _, codes = Flattening(layers.__getitem__, PAINTS).window(0, (0, 0, 300, 530))
    key = sum(layers[name].astype(int) * 10**place for place, name in enumerate("abc"))
    # Equal labels have equal codes in every tile; different ones nearly always differ.
    for value in np.unique(key):
        assert len(np.unique(codes[key == value])) == 1
    distinct = len(np.unique(codes))
    assert distinct >= 0.97 * len(np.unique(key))


def test_a_window_is_a_part_of_the_whole() -> None:
    layers = sketch_layers(700, 530, 3)
    flattening = Flattening(layers.__getitem__, PAINTS)
    for level in (0, 1, 2):
        sides = -(-700 >> level), -(-530 >> level)
        whole = flattening.window(level, (0, 0, *sides))
        part = flattening.window(level, (31, 17, 97, 101))
        assert np.array_equal(part[0], whole[0][31:97, 17:101])
        assert np.array_equal(part[1], whole[1][31:97, 17:101])


def test_what_changed_is_made_anew() -> None:
    layers = sketch_layers(700, 530, 3)
    flattening = Flattening(layers.__getitem__, PAINTS)
    for level in (0, 1, 3):
        flattening.window(level, (0, 0, -(-700 >> level), -(-530 >> level)))
    layers["b"][201:333, 250:301] = 2
    flattening.forget((201, 250, 333, 301))
    fresh = Flattening(layers.__getitem__, PAINTS)
    for level in (0, 1, 3):
        box = (0, 0, -(-700 >> level), -(-530 >> level))
        for kept, made in zip(flattening.window(level, box), fresh.window(level, box), strict=True):
            assert np.array_equal(kept, made)


def test_paint_where_nothing_was_is_seen_at_every_level() -> None:
    layers = {name: np.zeros((2100, 3000), np.uint8) for name in "abc"}
    flattening = Flattening(layers.__getitem__, PAINTS)
    for level in (4, 2, 0):
        sides = -(-2100 >> level), -(-3000 >> level)
        assert not flattening.window(level, (0, 0, *sides))[1].any()
    layers["c"][2050:2060, 1020:1030] = 1
    flattening.forget((2050, 1020, 2060, 1030))
    for level in (0, 2, 3, 4, 5):
        sides = -(-2100 >> level), -(-3000 >> level)
        codes = flattening.window(level, (0, 0, *sides))[1]
        rows, columns = np.nonzero(codes)
        assert (rows.min(), rows.max()) == (2050 >> level, 2059 >> level)
        assert (columns.min(), columns.max()) == (1020 >> level, 1029 >> level)


def test_a_thin_line_stays_visible_from_afar() -> None:
    layers = {name: np.zeros((1000, 900), np.uint8) for name in "abc"}
    layers["b"][:, 333] = 1
    for level in range(6):
        sides = -(-1000 >> level), -(-900 >> level)
        _, codes = Flattening(layers.__getitem__, PAINTS).window(level, (0, 0, *sides))
        assert ((codes > 0).sum(axis=1) == 1).all()


def test_levels_have_pixels_as_large_as_the_screens() -> None:
    assert [level_for(scale) for scale in (8.0, 1.0, 0.99, 0.5, 0.49, 0.25)] == [0, 0, 1, 1, 2, 2]


def test_hatches_have_no_seam_and_differ() -> None:
    for ratio in [1.0, 1.5, 2.0]:
        for kind in HATCHES:
            period = hatch_period(ratio)
            covered = hatch(kind, period)
            assert covered.shape == (period, period), (ratio, kind)
            assert 0.05 < covered.mean() < 0.5, (ratio, kind)
            # What is beyond a border goes on as it does inside: no step is larger there.
            for axis in (0, 1):
                steps = np.abs(np.diff(covered, axis=axis)).max()
                seam = np.abs(np.take(covered, 0, axis=axis) - np.take(covered, -1, axis=axis)).max()
                assert seam <= max(steps, 0.05) + 1e-5, (ratio, kind)

    drawn = [hatch(kind, 32) for kind in HATCHES]
    for k, one in enumerate(drawn):
        for other in drawn[k + 1 :]:
            shared = [(np.roll(one, shift, (0, 1)) * other).sum() for shift in np.ndindex(32, 32)]
            assert max(shared) < 0.93 * max(one.sum(), other.sum())


def test_lines_are_drawn_where_codes_change() -> None:
    table = HatchTable([LayerHatch("dots", (0, 0, 0), 0.0)], 1.0)
    codes = np.zeros((12, 12), np.uint16)
    codes[4:8, 5:9] = 1
    pixels = table.drawn(codes, 0, 0)
    assert pixels.shape == (10, 10)
    inner = pixels > 0
    # Of the border between two pixels of the screen, one is drawn on.
    expected = np.zeros((12, 12), bool)
    expected[3:8, 4:9] = True
    expected[4:7, 5:8] = False
    expected[3, 4] = False
    assert np.array_equal(inner, expected[1:-1, 1:-1])
