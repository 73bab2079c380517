"""Rivers and lakes in the terrain: beds never rise, banks hold, valleys cut mountains; cross-sections."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sketchterrain.features import River
from sketchterrain.features.lakes import within
from sketchterrain.features.splines import catmull_rom
from sketchterrain.sketch import Sketch, load_sketch
from sketchterrain.terrain import Terrain, TerrainRecipe, build
from sketchterrain.terrain import make_recipe as recipe_of
from sketchterrain.terrain.arcs import nearest_on_arc
from sketchterrain.terrain.centrelines import TOLERANCE_CELLS, tolerance_cell
from sketchterrain.terrain.evaluation import MASKS, Evaluator
from sketchterrain.terrain.lattice import metres_per_unit, to_lattice
from sketchterrain.terrain.packing import pack_rivers

from .conftest import tiers

RISE_M = 0.01
SIDE = 192
ROW, COLUMN = np.mgrid[:SIDE, :SIDE]


def every_metre(river: River) -> tuple[np.ndarray, np.ndarray]:
    """Metres from the spring, and (x, y, level, width) there."""
    line = np.column_stack([river.centreline, river.centreline_width])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    at = np.append(np.arange(0.0, arc[-1], 1.0), arc[-1])
    return at, np.stack([np.interp(at, arc, line[:, i]) for i in range(4)], axis=-1)


def depth_in_lakes(terrain: Terrain, places: np.ndarray) -> np.ndarray:
    """How far inside the nearest lake (m); negative outside."""
    distances = [within(lake.shape, places) for lake in terrain.recipe.lakes]
    return np.max(distances, axis=0) if distances else np.full(len(places), -np.inf)


def greatest_rise(terrain: Terrain, river: River) -> float:
    """How far the bed lies above a place upstream (m), lakes left out: they are deeper than their outlets."""
    _, line = every_metre(river)
    dry = line[depth_in_lakes(terrain, line[:, :2]) <= 0.0]
    if not len(dry):
        return 0.0
    bed = terrain.heights(dry[:, 0], dry[:, 1]).astype(np.float64)
    return float((bed - np.minimum.accumulate(bed)).max())


def lowest_bank(terrain: Terrain, river: River) -> float:
    """Height (m) of the ground 1.5 widths to either side over the water, away from all other water."""
    at, line = every_metre(river)
    width = line[:, 3]
    free = (at > 3 * width) & (at[-1] - at > 3 * width)
    free &= depth_in_lakes(terrain, line[:, :2]) < -4 * width.max()
    for other in terrain.recipe.rivers:
        if other is not river:
            wider = np.maximum(width, other.centreline_width.max())
            free &= cKDTree(every_metre(other)[1][:, :2]).query(line[:, :2])[0] > 3 * wider + 1.5 * width
    along = np.gradient(line[:, :2], axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.hypot(*along.T)[:, None]
    own, lowest = cKDTree(line[:, :2]), np.inf
    for side in (-1.5, 1.5):
        places = line[free, :2] + side * width[free, None] * across[free]
        if len(places):
            above = terrain.heights(places[:, 0], places[:, 1]) - line[free, 2]
            same_stretch = np.abs(at[own.query(places)[1]] - at[free]) <= 3 * width[free]
            lowest = min(lowest, float(above[same_stretch].min(initial=np.inf)))
    return lowest


def stroke(picture: np.ndarray, points: list[np.ndarray], half: float, label: int) -> None:
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        dx, dy = x1 - x0, y1 - y0
        t = np.clip(((COLUMN - x0) * dx + (ROW - y0) * dy) / max(dx * dx + dy * dy, 1e-9), 0, 1)
        picture[np.hypot(COLUMN - x0 - t * dx, ROW - y0 - t * dy) <= half] = label


def wander(rng: np.random.Generator, start: np.ndarray) -> list[np.ndarray]:
    points, heading = [np.array(start, float)], rng.uniform(0, 2 * np.pi)
    for _ in range(rng.integers(3, 14)):
        heading += rng.normal(0, 0.6)
        points.append(points[-1] + SIDE / 14 * np.array([np.cos(heading), np.sin(heading)]))
    return points


def discs(rng: np.random.Generator, most: int, largest: float) -> np.ndarray:
    picture = np.zeros((SIDE, SIDE), np.uint8)
    for _ in range(rng.integers(0, most)):
        x, y = rng.uniform(0, SIDE, 2)
        picture[np.hypot(COLUMN - x, ROW - y) < rng.uniform(0.03, largest) * SIDE] = 1
    return picture


def random_sketch(seed: int) -> Sketch:
    """Strokes that branch, loop, cross mountains and lakes and run off the edge."""
    rng = np.random.default_rng(seed)
    river = np.zeros((SIDE, SIDE), np.uint8)
    for _ in range(rng.integers(1, 4)):
        points = wander(rng, rng.uniform(0.05, 0.95, 2) * SIDE)
        stroke(river, points, rng.uniform(0.6, 3.5), rng.integers(1, 4))
        for _ in range(rng.integers(0, 3)):
            branch = wander(rng, points[rng.integers(len(points))])
            stroke(river, branch, rng.uniform(0.6, 2), rng.integers(1, 4))
    if rng.random() < 0.3:
        x, y = rng.uniform(0.3, 0.7, 2) * SIDE
        river[np.abs(np.hypot(COLUMN - x, ROW - y) - rng.uniform(0.08, 0.25) * SIDE) < 1.8] = 1
    sizes = {
        ("river", k): {
            "width": float(rng.choice([2, 5, 12, 30, 80])),
            "depth": float(rng.choice([0.5, 2, 4, 8])),
        }
        for k in (1, 2, 3)
    }
    heights = {
        ("mountain", 1): {"height": float(rng.choice([150, 400, 900])), "multitude": int(rng.integers(1, 5))}
    }
    return Sketch(
        extent=float(rng.choice([2000, 5000, 12000])),
        seed=seed,
        layers={
            "river": river,
            "mountain": discs(rng, 4, 0.2),
            "hill": discs(rng, 3, 0.2),
            "lake": discs(rng, 3, 0.1),
        },
        labels={**sizes, **heights, ("hill", 1): {"height": 60.0, "multitude": 5}},
        ground={"relief": float(rng.choice([10, 60, 200]))},
        density={"mountain": 0.03, "hill": 0.3},
    )


@tiers("name", ["valley_river"], ["alpine_range", "rolling_hills"])
def test_in_the_presets_no_bed_rises_and_every_bank_holds(name, context) -> None:
    terrain = build(load_sketch(name), device=context)
    assert terrain.recipe.rivers
    for river in terrain.recipe.rivers:
        assert greatest_rise(terrain, river) <= RISE_M
        assert lowest_bank(terrain, river) > 0


# The last ones failed once: beds at joints and in sharp bends, water beside lakes and in sharp bends.
@tiers("seed", [0, 100, 115, 172, 205], [*range(40), 130, 175, 287])
def test_no_bed_rises_and_every_bank_holds(seed, context) -> None:
    terrain = build(random_sketch(seed), device=context)
    for river in terrain.recipe.rivers:
        assert greatest_rise(terrain, river) <= RISE_M
        assert lowest_bank(terrain, river) > 0


@tiers("poses", [range(4)], [range(4, 100)])
def test_a_river_across_a_mountain_runs_below_the_straight_line(poses, context) -> None:
    """In random poses: the bed between where it enters and leaves is not above the line between."""
    for pose in poses:
        rng = np.random.default_rng(pose)
        centre, angle = rng.uniform(0.4, 0.6, 2) * SIDE, rng.uniform(0, np.pi)
        radius, offset = rng.uniform(0.1, 0.2) * SIDE, rng.uniform(-0.08, 0.08) * SIDE
        ahead = np.array([np.cos(angle), np.sin(angle)])
        middle = centre + offset * np.array([-ahead[1], ahead[0]])
        river = np.zeros((SIDE, SIDE), np.uint8)
        stroke(river, [middle - 0.36 * SIDE * ahead, middle + 0.36 * SIDE * ahead], 1.5, 1)
        mountain = (np.hypot(COLUMN - centre[0], ROW - centre[1]) < radius).astype(np.uint8)
        sketch = Sketch(
            extent=6000.0,
            seed=pose,
            layers={"river": river, "mountain": mountain},
            labels={("mountain", 1): {"height": float(rng.uniform(100, 700))}},
        )
        terrain = build(sketch, device=context)
        (found,) = terrain.recipe.rivers
        _, line = every_metre(found)
        row = np.clip((SIDE - line[:, 1] / sketch.pixel_size).astype(int), 0, SIDE - 1)
        column = np.clip((line[:, 0] / sketch.pixel_size).astype(int), 0, SIDE - 1)
        under = np.flatnonzero(mountain[row, column])
        inside = slice(under[0], under[-1] + 1)
        bed = terrain.heights(line[inside, 0], line[inside, 1]).astype(np.float64)
        straight = np.linspace(bed[0], bed[-1], len(bed))
        assert (bed - straight).max() <= RISE_M
        assert any("crosses mountain 1: valley cut" in each.line for each in terrain.recipe.resolutions)


def test_a_river_ends_in_a_lake_at_its_level(context) -> None:
    river, lake = np.zeros((2, SIDE, SIDE), np.uint8)
    stroke(river, [np.array([90.0, 30.0]), np.array([100.0, 118.0])], 1.5, 1)
    lake[np.hypot(COLUMN - 102, ROW - 140) < 20] = 1
    terrain = build(Sketch(extent=4000.0, seed=3, layers={"river": river, "lake": lake}), device=context)
    (found,), (water,) = terrain.recipe.rivers, terrain.recipe.lakes
    assert within(water.shape, found.centreline[-1:, :2])[0] > 0
    assert found.centreline[-1, 2] == pytest.approx(water.level, abs=0.05)
    (told,) = terrain.recipe.resolutions
    assert told.line == f"river 1 ends in lake 1: water at {water.level:.1f} m"
    assert within(water.shape, np.array([[told.x, told.y]]))[0] > 0
    assert greatest_rise(terrain, found) <= RISE_M


def test_a_lake_in_a_mountain_is_a_tarn_with_a_rim(context) -> None:
    mountain = (np.hypot(COLUMN - 96, ROW - 96) < 60).astype(np.uint8)
    lake = (np.hypot(COLUMN - 120, ROW - 96) < 9).astype(np.uint8)
    terrain = build(Sketch(extent=5000.0, layers={"mountain": mountain, "lake": lake}), device=context)
    (tarn,) = terrain.recipe.lakes
    (told,) = terrain.recipe.resolutions
    assert told.line == f"lake 1 lies in mountain 1: a tarn at {tarn.level:.0f} m"
    assert within(tarn.shape, np.array([[told.x, told.y]]))[0] > 0
    angle, pixel = np.linspace(0, 2 * np.pi, 200), 5000.0 / SIDE
    east, north = (
        120.5 * pixel + np.cos(angle) * 11 * pixel,
        (SIDE - 96.5) * pixel + np.sin(angle) * 11 * pixel,
    )
    assert terrain.heights(east, north).min() > tarn.level
    assert terrain.heights(120.5 * pixel, (SIDE - 96.5) * pixel) < tarn.level


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


@tiers(
    ("gap", "width"), [(40.0, 10.0), (6.0, 40.0)], [(6.0, 10.0), (300.0, 10.0), (40.0, 40.0), (300.0, 40.0)]
)
def test_nothing_jumps_between_branches_equally_near(gap, width, make_recipe, double_context) -> None:
    """In a hairpin narrower or wider than its river."""
    evaluator = Evaluator(make_recipe(rivers=(river(hairpin(gap), width=width),)), double_context)
    for x in (1600.0, 1900.0, 2050.0, 2150.0):
        assert_no_jump(evaluator, (x, 2000.0 - gap), (x, 2000.0 + gap))
    # Along the middle both branches are as far, and one lies higher.
    assert_no_jump(evaluator, (1520.0, 2000.0), (2160.0, 2000.0))


def test_nothing_jumps_between_rivers_that_meet(make_recipe, double_context) -> None:
    main = river([(1400.0 + 150 * k, 2000.0) for k in range(9)], width=24.0)
    end = main.centreline[160]
    other = river([(1550.0, 2300.0), (1700.0, 2220.0), (1900.0, 2090.0), (end[0], end[1])], width=9.0)
    other.centreline[:, 2] += end[2] - other.centreline[-1, 2]
    evaluator = Evaluator(make_recipe(rivers=(main, other)), double_context)
    for x in np.linspace(1850.0, 2080.0, 12):
        assert_no_jump(evaluator, (x, 1960.0), (x, 2160.0))


def test_narrower_than_two_cells_a_river_is_a_material_and_no_trench(make_recipe, context) -> None:
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


def test_a_river_has_no_gaps_at_wide_cells(make_recipe, context) -> None:
    course = river([(1400.0 + 150 * k, 2000.0 + 60 * (-1) ** k) for k in range(9)], width=6.0)
    evaluator = Evaluator(make_recipe(rivers=(course,)), context)
    for cell in (8.0, 16.0, 32.0):
        line = course.centreline[40:-40, :2]
        vertex = np.round(line / cell) * cell
        near = np.hypot(*(vertex - line).T) < 0.5 * cell
        assert ground(evaluator, vertex[near], cell)[1].min() > WATER_EDGE


@tiers(
    ("name", "samples"),
    [("valley_river", 10)],
    [("valley_river", 40), ("alpine_range", 40), ("rolling_hills", 40)],
)
def test_arcs_stay_within_a_hundredth_of_a_cell_of_the_spline(name, samples) -> None:
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
