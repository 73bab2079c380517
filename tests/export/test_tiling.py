from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from sketchterrain.errors import InputError
from sketchterrain.export.tiling import Piece, Tiling

COUNTS = some.integers(1, 9)


def test_tiles_are_counted_and_named() -> None:
    tiling = Tiling()
    assert list(tiling.pieces(33, 17)) == [Piece(0, 0, 0, 0, 33, 17)]
    assert tiling.name("valley", Piece(0, 0, 0, 0, 33, 17)) == "valley"

    tiling = Tiling(2, 3)
    pieces = list(tiling.pieces(5, 13))
    assert pieces[0] == Piece(0, 0, 0, 0, 3, 5)
    assert pieces[1] == Piece(1, 0, 2, 0, 3, 5)
    assert pieces[-1] == Piece(1, 2, 2, 8, 3, 5)
    assert [tiling.name("valley", each) for each in pieces[:3]] == [
        "valley_x0_y0",
        "valley_x1_y0",
        "valley_x0_y1",
    ]

    tiling = Tiling(2, 2, first=1, from_south=True, pattern="{name}_{y:02}_{x}")
    names = [tiling.name("a", each) for each in tiling.pieces(5, 5)]
    assert names == ["a_02_1", "a_02_2", "a_01_1", "a_01_2"]


@settings(deadline=None)
@given(COUNTS, COUNTS, some.integers(0, 5), some.integers(1, 9))
def test_tiles_cover_the_whole_and_agree_where_they_overlap(
    columns: int, rows: int, overlap: int, step: int
) -> None:
    side = max(step + overlap, 2)
    tiling = Tiling(columns, rows, overlap=overlap)
    width, height = tiling.whole(side, columns), tiling.whole(side, rows)
    whole = np.arange(width * height).reshape(height, width)
    seen = np.zeros_like(whole)
    for piece in tiling.pieces(width, height):
        assert (piece.columns, piece.rows) == (side, side)
        part = seen[piece.top : piece.top + side, piece.left : piece.left + side]
        assert part.shape == (side, side)
        part += 1
    assert (seen > 0).all()
    if overlap == 0:
        assert (seen == 1).all()


@settings(deadline=None)
@given(some.integers(2, 200), some.integers(1, 9), some.integers(0, 5))
def test_the_nearest_sizes_can_be_cut_and_none_is_nearer(vertices: int, tiles: int, overlap: int) -> None:
    tiling = Tiling(tiles, tiles, overlap=overlap)
    near = tiling.nearest(vertices, tiles)
    for each in near:
        tiling.side(each, tiles)
    least = min(abs(each - vertices) for each in near)
    for nearer in range(max(vertices - least + 1, 2), vertices + least):
        with pytest.raises(InputError, match="nearest: "):
            tiling.side(nearer, tiles)


def test_unusable_patterns_numbers_and_sizes_are_refused_in_one_line() -> None:
    for pattern, reason in [
        ("{name}", "expected {x} and {y}"),
        ("{name}_{x}", "expected {x} and {y}"),
        ("{x}{y}", "two tiles would have the same name"),
        ("../{x}_{y}", "can be a file's name"),
        ("a/{x}_{y}", "can be a file's name"),
        ("a\\{x}_{y}", "can be a file's name"),
        ("..{x}_{y}", "can be a file's name"),
        (".{x}_{y}", "can be a file's name"),
        ("a{x}_{y}:b", "can be a file's name"),
        ("a\n{x}_{y}", "can be a file's name"),
        ("a\0{x}_{y}", "can be a file's name"),
        ("{x}_{y}" + "a" * 200, "can be a file's name"),
        ("{x}_{y}_{z}", "expected only"),
        ("{x}_{y}_{}", "expected only"),
        ("{x.real}_{y}", "expected only"),
        ("{x!r}_{y}", "expected only"),
        ("{x:>9}_{y}", "expected only"),
        ("{name:9}_{x}_{y}", "expected only"),
        ("{x}_{y:{x}}", "expected only"),
        ("{x_{y}", "expected only|no pattern"),
        ("{x}_{y}}", "no pattern"),
    ]:
        with pytest.raises(InputError, match=reason) as caught:
            Tiling(12, 12, pattern=pattern)
        assert str(caught.value).isprintable(), pattern

    for change in [{"columns": 0}, {"rows": -1}, {"overlap": -1}, {"first": -1}, {"columns": 99999}]:
        with pytest.raises(InputError, match="expected"):
            Tiling(**change)

    with pytest.raises(
        InputError, match=r"^1024 vertices .* 2 equal tiles that share an edge.* 1023 or 1025$"
    ):
        Tiling(2, 2).pieces(1024, 1025)
    with pytest.raises(InputError, match=r"that share nothing; nearest: 1024 or 1026$"):
        Tiling(2, 2, overlap=0).pieces(1025, 1024)
