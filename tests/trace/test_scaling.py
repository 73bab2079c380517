"""Labels in another size, thinned lines, gaps, specks and mixed colours."""

from __future__ import annotations

import numpy as np

from sketchterrain.trace.label_image import (
    NO_VOTE,
    fill_gaps,
    joined,
    majority,
    scaled_size,
    thinned,
    without_specks,
    without_threads,
)
from sketchterrain.trace.picture_colours import mixtures


def test_scaling_by_majority_inverts_whole_factors_and_keeps_uniform_images() -> None:
    small = np.random.default_rng(3).integers(0, 5, (17, 23), dtype=np.uint8)
    for factor in (1, 2, 3, 7):
        large = np.kron(small, np.ones((factor, factor), np.uint8))
        assert np.array_equal(majority(large, (23, 17)), small)
        assert np.array_equal(majority(small, (23 * factor, 17 * factor)), large)

    for size in [(100, 50), (33, 17), (1, 1), (7, 300)]:
        assert (majority(np.full((40, 80), 7, np.uint8), size, thin=(7,)) == 7).all(), size

    assert scaled_size(800, 600, 400) == (400, 300)
    assert scaled_size(600, 800, 400) == (300, 400)
    assert scaled_size(10_000, 1, 100) == (100, 1)


def test_each_pixel_is_what_covers_most_of_it() -> None:
    rng = np.random.default_rng(4)
    values = rng.integers(0, 3, (30, 50), dtype=np.uint8)
    scaled = majority(values, (20, 12))  # 2.5 by 2.5 pixels each
    fine = np.kron(values, np.ones((2, 2), np.uint8))
    for row in range(12):
        for column in range(20):
            block = fine[5 * row : 5 * row + 5, 5 * column : 5 * column + 5]
            counts = np.bincount(block.ravel(), minlength=3)
            assert counts[scaled[row, column]] == counts.max()

    values = np.full((4, 4), NO_VOTE, np.uint8)
    values[0, 0] = 3
    assert majority(values, (2, 2)).tolist() == [[3, NO_VOTE], [NO_VOTE, NO_VOTE]]


def test_scaling_in_bands_changes_no_pixel(monkeypatch) -> None:
    values = np.random.default_rng(5).integers(0, 4, (97, 61), dtype=np.uint8)
    whole = majority(values, (40, 63), thin=(2,))
    monkeypatch.setattr("sketchterrain.trace.label_image._PIXELS", 1)
    assert np.array_equal(majority(values, (40, 63), thin=(2,)), whole)


def test_a_gap_is_bridged_and_connected_parts_get_no_bridge(parts) -> None:
    line = np.zeros((40, 60), bool)
    line[20, :28] = line[20, 32:] = True
    line[5:9, 5:9] = True  # a pond far away
    whole = joined(line, 4)
    assert parts(whole) == 2
    assert np.array_equal(np.argwhere(whole & ~line), [[20, column] for column in range(28, 32)])
    wide = line.copy()
    wide[20, 26:34] = False
    assert np.array_equal(joined(wide, 4), wide)

    bend = np.zeros((40, 40), bool)
    bend[10, 5:30] = bend[13, 5:30] = bend[10:14, 29] = True
    assert np.array_equal(joined(bend, 4), bend)


def test_a_thinned_line_reaches_the_border_and_is_as_connected(parts) -> None:
    wide = np.zeros((50, 50), bool)
    for column in range(50):
        row = round(25 + 12 * np.sin(column / 8))
        wide[row - 2 : row + 3, column] = True
    thin = thinned(wide)
    assert not (thin & ~wide).any()
    assert parts(thin) == 1
    assert thin[:, 0].any()
    assert thin[:, -1].any()
    assert thin.sum() < 0.4 * wide.sum()
    assert not thinned(np.zeros((5, 5), bool)).any()


def test_gaps_take_the_nearest_value_as_far_as_that_reaches() -> None:
    values = np.full((1, 20), NO_VOTE, np.uint8)
    values[0, 0], values[0, 19] = 4, 9
    assert fill_gaps(values, reach=5, beyond=0)[0].tolist() == [4] * 6 + [0] * 8 + [9] * 6
    nothing = np.full((3, 3), NO_VOTE, np.uint8)
    assert (fill_gaps(nothing, reach=5, beyond=0) == 0).all()


def test_specks_take_what_is_beside_them() -> None:
    values = np.zeros((30, 30), np.uint8)
    values[5:20, 5:20] = 2
    values[10, 10] = values[11, 11] = 1  # two pixels that touch at a corner
    values[25:28, 25:28] = 3
    cleaned = without_specks(values, 9)
    assert (cleaned[5:20, 5:20] == 2).all()
    assert (cleaned == 3).sum() == 9
    assert np.array_equal(without_specks(cleaned, 9), cleaned)
    tiny = np.arange(9, dtype=np.uint8).reshape(3, 3)
    assert np.array_equal(without_specks(tiny, 5), tiny)


def test_threads_go_and_corners_stay() -> None:
    values = np.zeros((40, 40), np.uint8)
    values[5:20, 5:20] = 2
    values[30:32, 3:37] = 2
    values[24, 3:37] = 3
    kept = without_threads(values, {0, 2, 3})
    assert (kept[30:32, 3:37] == NO_VOTE).all()
    values[30:32, 3:37] = NO_VOTE
    assert np.array_equal(kept, values)  # the third value is nowhere wide: it is meant


def test_a_mixture_lies_between_its_sides_and_a_line_does_not() -> None:
    pixels = np.zeros((9, 9, 3), np.uint8)
    pixels[:, :4], pixels[:, 4], pixels[:, 5:] = (255, 255, 255), (150, 180, 160), (38, 104, 58)
    assert np.array_equal(mixtures(pixels), np.arange(81).reshape(9, 9) % 9 == 4)
    pixels[:, 5:] = 255
    assert not mixtures(pixels).any()
    assert not mixtures(np.full((4, 4, 3), 90, np.uint8)).any()
