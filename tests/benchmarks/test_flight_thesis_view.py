"""Tiles as the thesis chooses them: its metric, no holes, neighbours one level apart."""

from __future__ import annotations

import itertools

import numpy as np

from sketchterrain.benchmarks.thesis_view import Disc, ThesisTile, ThesisView
from sketchterrain.tiles.borders import EAST, NORTH, SOUTH, WEST

EYE = (700.0, 1300.0, 60.0)


def levels(view: ThesisView, tiles: list[ThesisTile]) -> np.ndarray:
    """The level at each of the finest tiles' places; each is covered once."""
    side = 2**view.finest
    level, times = np.full((side, side), -1), np.zeros((side, side), int)
    for tile in tiles:
        width = side >> tile.level
        where = np.s_[tile.row * width : (tile.row + 1) * width, tile.col * width : (tile.col + 1) * width]
        level[where] = tile.level
        times[where] += 1
    assert (times == 1).all()
    return level


def test_tiles_cover_the_world_once_in_balance_and_finer_at_features() -> None:
    for discs, tessellation in itertools.product([(), (Disc(3000.0, 3000.0, 200.0, 8.0),)], [0.5, 4.0, 30.0]):
        view = ThesisView(4096.0, 32, tessellation, discs=discs)
        found = levels(view, view.tiles(EYE, 10.0))
        for axis in (0, 1):
            assert np.abs(np.diff(found, axis=axis)).max() <= 1, (discs, tessellation)

    view = ThesisView(4096.0, 64, 2.0)
    near = ThesisView(4096.0, 64, 2.0, discs=(Disc(3000.0, 3000.0, 100.0, 4.0),))
    plain, finer = (levels(each, each.tiles(EYE, 10.0)) for each in (view, near))
    place = int(3000 / 4096 * len(plain))
    assert finer[place, place] > plain[place, place]
    assert finer[0, -1] >= plain[0, -1]


def test_quads_are_as_long_as_the_metric_allows() -> None:
    view = ThesisView(4096.0, 64, 6.0)
    for tile in view.tiles(EYE, 10.0):
        width = view.extent / 2**tile.level
        dx = max(tile.col * width - EYE[0], EYE[0] - (tile.col + 1) * width, 0.0)
        dy = max(tile.row * width - EYE[1], EYE[1] - (tile.row + 1) * width, 0.0)
        longest = np.sqrt(np.sqrt(dx**2 + dy**2 + 50.0**2)) / 6.0
        assert width / 64 <= longest or tile.level == view.finest
        assert width / 64 > longest / 8  # finer only for a neighbour's or a parent's sake

    for quads in (32, 64, 128, 256):
        view = ThesisView(4096.0, quads, 1000.0)
        cell = view.extent / 2**view.finest / quads
        assert 0.2 <= cell < 0.4
    assert {tile.level for tile in ThesisView(64.0, 32, 1000.0).tiles((5.0, 5.0, 0.0), 0.0)} == {3}


def test_cases_say_where_the_coarser_neighbours_are() -> None:
    view = ThesisView(4096.0, 64, 6.0)
    tiles = view.tiles(EYE, 10.0)
    there = {(tile.level, tile.col, tile.row) for tile in tiles}
    steps = {NORTH: (0, 1), SOUTH: (0, -1), WEST: (-1, 0), EAST: (1, 0)}
    for level, col, row, case in tiles:
        for bit, (dx, dy) in steps.items():
            coarser = (level - 1, (col + dx) // 2, (row + dy) // 2) in there
            assert bool(case & bit) == coarser
