"""Rivers' cross-sections: where branches are equally near, and where cells are too wide for a channel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from sketchterrain.features import River
from sketchterrain.features.splines import catmull_rom
from sketchterrain.sketch import load_sketch
from sketchterrain.terrain import make_recipe as recipe_of
from sketchterrain.terrain.arcs import nearest_on_arc
from sketchterrain.terrain.centrelines import TOLERANCE_CELLS, tolerance_cell
from sketchterrain.terrain.evaluation import MASKS, Evaluator
from sketchterrain.terrain.lattice import metres_per_unit, to_lattice
from sketchterrain.terrain.packing import pack_rivers

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain import TerrainRecipe

    MakeRecipe = Callable[..., TerrainRecipe]

WATER_EDGE = 0.75


def river(points: list[tuple[float, float]], *, width: float, fall: float = 0.01) -> River:
    """A spline through points, with samples at every 40th of its segments."""
    controls = np.array(points, float)
    u = np.arange(40 * (len(controls) - 1) + 1) / 40.0
    curve = catmull_rom(controls, u)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(curve, axis=0).T))])
    centreline = np.column_stack([curve, 20.0 - fall * arc])
    ones = np.ones(u.size, np.float32)
    return River(
        1, 1, centreline[::40], width * ones[::40], 2 * ones[::40], centreline, width * ones, 2 * ones
    )


def hairpin(gap: float) -> list[tuple[float, float]]:
    side = gap / 2
    there = [(1500.0 + 120 * k, 2000.0 - side) for k in range(5)]
    return [*there, (2100.0, 2000.0), *((x, 2000.0 + side) for x, _ in reversed(there))]


def ground(evaluator: Evaluator, places: np.ndarray, cell_size: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Heights and the water mask at places (m)."""
    x, y = to_lattice(places, evaluator.recipe.extent).T
    height, masks = evaluator.points(x, y, cell_size=cell_size)
    return height.astype(np.float64), masks[:, MASKS.index("water")]


def assert_no_jump(evaluator: Evaluator, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Ten times finer steps make a tenth of the difference, nearly."""
    largest = []
    for count in (601, 6001):
        height, water = ground(evaluator, np.linspace(start, end, count))
        largest.append([np.abs(np.diff(height)).max(), np.abs(np.diff(water)).max()])
    assert np.all(np.array(largest[1]) < 0.16 * np.array(largest[0]) + 1e-3)


@pytest.mark.parametrize(
    "cases",
    [
        [(40.0, 10.0), (6.0, 40.0)],
        pytest.param([(6.0, 10.0), (300.0, 10.0), (40.0, 40.0), (300.0, 40.0)], marks=pytest.mark.slow),
    ],
    ids=["two", "others"],
)
def test_nothing_jumps_between_branches_equally_near(
    cases: list[tuple[float, float]], make_recipe: MakeRecipe, double_context: ComputeContext
) -> None:
    """In a hairpin narrower or wider than its river."""
    for gap, width in cases:
        course = river(hairpin(gap), width=width)
        evaluator = Evaluator(make_recipe(rivers=(course,)), double_context)
        for x in (1600.0, 1900.0, 2050.0, 2150.0):
            assert_no_jump(evaluator, (x, 2000.0 - gap), (x, 2000.0 + gap))
        # Along the middle both branches are as far, and one lies higher.
        assert_no_jump(evaluator, (1520.0, 2000.0), (2160.0, 2000.0))


def test_nothing_jumps_between_rivers_that_meet(
    make_recipe: MakeRecipe, double_context: ComputeContext
) -> None:
    main = river([(1400.0 + 150 * k, 2000.0) for k in range(9)], width=24.0)
    end = main.centreline[160]
    other = river([(1550.0, 2300.0), (1700.0, 2220.0), (1900.0, 2090.0), (end[0], end[1])], width=9.0)
    other.centreline[:, 2] += end[2] - other.centreline[-1, 2]
    evaluator = Evaluator(make_recipe(rivers=(main, other)), double_context)
    for x in np.linspace(1850.0, 2080.0, 12):
        assert_no_jump(evaluator, (x, 1960.0), (x, 2160.0))


def test_narrower_than_two_cells_a_river_is_a_material_and_no_trench(
    make_recipe: MakeRecipe, context: ComputeContext
) -> None:
    for width in (3.0, 10.0, 30.0):
        course = river([(1400.0 + 150 * k, 2000.0 + 40 * (-1) ** k) for k in range(9)], width=width)
        evaluator = Evaluator(make_recipe(rivers=(course,)), context)
        line = course.centreline[60:-60, :2]
        along = np.gradient(line, axis=0)
        across = width * np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.hypot(*along.T)[:, None]
        for cells in (0.25, 0.6, 1.0, 1.5, 1.99, 2.5, 4.0, 8.0):
            bed, water = ground(evaluator, line, width / cells)
            banks = [ground(evaluator, line + side * across, width / cells)[0] for side in (-1.0, 1.0)]
            deep = np.minimum(*banks) - bed
            if cells < 2.0:
                assert np.abs(deep).max() < 0.02 * width  # the floodplain's slope, levels beside a bend
            if cells >= 4.0:
                assert deep.min() > 2.9  # 2 m of water, 1 m of bank
            assert water.min() > 0.99, (width, cells)


def test_a_river_has_no_gaps_at_wide_cells(make_recipe: MakeRecipe, context: ComputeContext) -> None:
    course = river([(1400.0 + 150 * k, 2000.0 + 60 * (-1) ** k) for k in range(9)], width=6.0)
    evaluator = Evaluator(make_recipe(rivers=(course,)), context)
    for cell in (8.0, 16.0, 32.0):
        line = course.centreline[40:-40, :2]
        vertex = np.round(line / cell) * cell
        near = np.hypot(*(vertex - line).T) < 0.5 * cell
        assert ground(evaluator, vertex[near], cell)[1].min() > WATER_EDGE


@pytest.mark.parametrize(
    ("name", "samples"),
    [
        ("valley_river", 10),
        pytest.param("valley_river", 40, marks=pytest.mark.slow),
        pytest.param("alpine_range", 40, marks=pytest.mark.slow),
        pytest.param("rolling_hills", 40, marks=pytest.mark.slow),
    ],
)
def test_arcs_stay_within_a_hundredth_of_a_cell_of_the_spline(name: str, samples: int) -> None:
    recipe = recipe_of(load_sketch(name))
    unit = metres_per_unit(recipe.extent)
    controls = [each.points[:, :2] for each in recipe.rivers]
    curve = np.concatenate([catmull_rom(c, np.linspace(0, len(c) - 1, samples * len(c))) for c in controls])
    counts = []
    for cell in (*TOLERANCE_CELLS[::2], 3.0, 1000.0):
        packed = pack_rivers(recipe, cell)
        counts.append(len(packed.start))
        square = np.full(len(curve), np.inf)
        for start, along in zip(packed.start * unit, packed.along, strict=True):
            square = np.minimum(square, nearest_on_arc(along[:2], along[4], curve - start)[1])
        assert np.sqrt(square.max()) <= 0.01 * cell
    finest_first = counts[:-2]
    assert finest_first == sorted(finest_first, reverse=True)


def test_a_cell_size_is_flattened_for_one_not_above_it() -> None:
    assert [tolerance_cell(cell) for cell in TOLERANCE_CELLS] == list(TOLERANCE_CELLS)
    assert tolerance_cell(0.0) == TOLERANCE_CELLS[0]
    assert tolerance_cell(1e9) == TOLERANCE_CELLS[-1]
    for cell in np.geomspace(0.2, 20.0, 50):
        assert cell / 2 < tolerance_cell(cell) <= cell
