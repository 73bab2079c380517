"""Where an export is sampled and how it is cut; nothing is computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from sketchterrain.errors import InputError
from sketchterrain.export.planning import option_names, plan
from sketchterrain.export.sampled import Grid
from sketchterrain.export.target import ExportOptions, Target, Written
from sketchterrain.export.targets import TARGET_NAMES, target_named
from sketchterrain.export.tiling import Tiling
from sketchterrain.sketch import Sketch

TILED = frozenset({"tiles", "overlap"})
PLAIN = Target("plain", "Plain", "…", lambda _: Written({}), knows=TILED, tiling=Tiling())
SQUARE = replace(PLAIN, square=True, sizes=(33, 65, 129), size=65)
SPACED = replace(PLAIN, spacing=1.0)
WIDE, HIGH = (
    Sketch(name="A", extent=1024.0, layers={"hill": np.zeros(shape, np.uint8)})
    for shape in ((48, 64), (64, 48))
)


def grid_of(sketch: Sketch, target: Target, **options: object) -> Grid:
    return plan(sketch, target, ExportOptions(**options)).grid  # type: ignore[arg-type]


def test_grids_follow_the_rectangle_and_the_tiles() -> None:
    assert grid_of(WIDE, PLAIN, size=65) == Grid(0.0, 0.0, 1024.0, 768.0, 65, 49)
    assert grid_of(HIGH, PLAIN, size=65) == Grid(0.0, 0.0, 768.0, 1024.0, 49, 65)

    grid = grid_of(WIDE, PLAIN, size=65, tiles=(4, 5))
    assert (grid.columns, grid.rows) == (65, 51)
    assert grid.area == (0.0, 0.0, 1024.0, 768.0)

    assert grid_of(WIDE, PLAIN, tiles=(3, 1)).columns == 1024
    assert grid_of(WIDE, PLAIN, tiles=(4, 3)).columns == 1025

    assert grid_of(WIDE, SQUARE) == Grid(0.0, 0.0, 1024.0, 1024.0, 65, 65)
    assert grid_of(HIGH, SQUARE, size=33) == Grid(0.0, 0.0, 1024.0, 1024.0, 33, 33)
    assert grid_of(WIDE, SQUARE, tiles=(4, 4)).columns == 4 * 64 + 1


@settings(deadline=None)
@given(some.integers(1, 6), some.integers(1, 6), some.sampled_from([WIDE, HIGH]))
def test_square_tiles_cover_the_sketch_with_square_quads(columns: int, rows: int, sketch: Sketch) -> None:
    made = plan(sketch, SQUARE, ExportOptions(tiles=(columns, rows)))
    dx, dy = made.grid.spacing
    assert dx == pytest.approx(dy, rel=1e-12)
    assert made.tile_side == (65, 65)
    east, north = sketch.size
    assert made.grid.east >= east
    assert made.grid.north >= north
    assert made.grid.east == east or made.grid.north == north


def test_fixed_spacing_and_multiples_are_kept() -> None:
    assert grid_of(WIDE, SPACED) == Grid(0.0, 0.0, 1024.0, 768.0, 1025, 769)
    odd = WIDE.replace(extent=1000.5)
    grid = grid_of(odd, SPACED, tiles=(4, 1))
    assert grid.spacing == (1.0, 1.0)
    assert grid.columns == 1005
    assert grid.east >= odd.size[0]
    assert grid.north >= odd.size[1]

    regions = replace(SPACED, multiple=256)
    assert grid_of(WIDE, regions) == Grid(0.0, 0.0, 1023.0, 767.0, 1024, 768)
    assert grid_of(WIDE.replace(extent=1025.0), regions).columns == 1280


def test_refusals_name_the_option_and_the_nearest_size() -> None:
    for size, tiles, nearest in [
        (64, (1, 1), "33 or 65"),
        (130, (1, 1), "129 "),
        (2, (1, 1), "33 "),
        (100, (2, 2), "65 or 129"),
    ]:
        with pytest.raises(InputError, match=f"nearest: {nearest}"):
            grid_of(WIDE, SQUARE, size=size, tiles=tiles)

    with pytest.raises(InputError, match="cannot share 70 vertices"):
        grid_of(WIDE, SQUARE, tiles=(2, 2), overlap=70)
    with pytest.raises(InputError, match="size = 1: expected 2 or more vertices"):
        grid_of(WIDE, PLAIN, size=1)
    with pytest.raises(InputError, match="expected two finite numbers, m"):
        grid_of(WIDE, target_named("geotiff"), origin=(np.nan, 0.0))
    with pytest.raises(InputError, match="only 16-bit numbers have a range"):
        grid_of(WIDE, target_named("raw"), format="r32", heights=(0.0, 1.0))
    with pytest.raises(InputError, match=r"expected one of .* as target, got 'quake'"):
        target_named("quake")


def test_every_target_declares_known_options_and_sizes_that_can_be_planned() -> None:
    for name in TARGET_NAMES:
        target = target_named(name)
        assert target.knows <= set(vars(ExportOptions())), name
        assert set(option_names(target)) >= {"plants", "grass"}, name
        assert (target.tiling is not None) == ("tiles" in target.knows), name
        assert not target.sizes or target.size in target.sizes, name
        assert target.title, name
        assert target.line, name
        assert ("format" in target.knows) == bool(target.formats), name

    for name in TARGET_NAMES:
        target = target_named(name)
        for size in target.sizes:
            assert plan(WIDE, target, ExportOptions(size=size)).tile_side == (size, size), (name, size)


NUMBERS = some.none() | some.integers(-2, 10_000)
METRES = some.floats(allow_nan=True, allow_infinity=True)
OPTIONS = some.builds(
    ExportOptions,
    size=NUMBERS,
    tiles=some.tuples(some.integers(-1, 12), some.integers(-1, 12)),
    overlap=NUMBERS,
    tile_name=some.none() | some.text(max_size=30) | some.sampled_from(["{name}_{x}_{y}", "{x:03}{y:03}"]),
    tile_first=NUMBERS,
    tiles_from_south=some.none() | some.booleans(),
    format=some.none() | some.text(max_size=5) | some.sampled_from(["r16", "exr", "png"]),
    heights=some.none() | some.tuples(METRES, METRES),
    error=some.none() | METRES,
    crs=some.none() | some.text(max_size=10),
    origin=some.tuples(METRES, METRES),
    plants=some.booleans(),
    grass=some.booleans(),
)


@settings(deadline=None)
@given(some.sampled_from(TARGET_NAMES), OPTIONS)
def test_any_options_are_a_plan_or_one_line(name: str, options: ExportOptions) -> None:
    target = target_named(name)
    heeded = {each: getattr(options, each) for each in option_names(target)}
    for asked in (options, ExportOptions(**heeded)):
        told = None
        try:
            made = plan(WIDE, target, asked)
        except InputError as error:
            told = str(error)
        if told is not None:
            assert told.isprintable()
            continue
        side = made.tile_side
        assert not target.sizes or side[0] == side[1] in target.sizes
        pieces = list(made.tiling.pieces(made.grid.columns, made.grid.rows))
        assert len({made.tiling.name("a", each).casefold() for each in pieces}) == len(pieces)
