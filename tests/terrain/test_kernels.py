"""Kernels against NumPy float64 and their own REAL=double build; recipes shifted on the lattice."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.landforms.placement.feature_types import ShapeField
from sketchterrain.schema.geology import Strata
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.schema.parameters import GEOLOGY, defaults
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import HostTerrain
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.layers.covers import CoversLayer
from sketchterrain.terrain.layers.lakes import LakesLayer
from sketchterrain.terrain.layers.layer import MASKS, HostSamples, TerrainLayer
from sketchterrain.terrain.layers.pads import PadsLayer
from sketchterrain.terrain.layers.plateaus import PlateausLayer
from sketchterrain.terrain.layers.roads import RoadsLayer
from sketchterrain.terrain.noise import SKEW_OTHER, SKEW_SAME, OctaveTable, octave_table
from sketchterrain.terrain.recipe import TerrainRecipe
from tests.sample_roads import make_network

from .conftest import (
    CASES,
    LAKES,
    PLATEAUS,
    SEAS,
    cover,
    feature,
    lake,
    river_of,
    straight_river,
    tiers,
    winding_sea,
)

# float32 carries 7 digits; the steepest profile multiplies a distance's error by height / radius.
HEIGHT_TOLERANCE_M = 3e-3
MASK_TOLERANCE = 2e-5
CELLS = (0.0, 8.0, 64.0)
_EXPECTED: dict[tuple[str, float], HostSamples] = {}
REACHED = {
    "eroded": "mountain",
    "plateau": "mountain",
    "crest": "mountain",
    "river": "water",
    "lake": "water",
    "flood": "water",
    "base": "dune",
}
REACHED |= {"sea": "water mountain forest"}


def places(count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.integers(0, 1 << 24, count), rng.integers(0, 1 << 24, count)


def expected_ground(case: tuple[str, TerrainRecipe], cell_size: float) -> HostSamples:
    """Return the host's samples at `places()`, evaluated once per case and cell size."""
    name, recipe = case
    if (name, cell_size) not in _EXPECTED:
        _EXPECTED[name, cell_size] = HostTerrain(recipe).samples(*places(), cell_size=cell_size)
    return _EXPECTED[name, cell_size]


def test_float_kernel_agrees_with_numpy_float64(case, context) -> None:
    name, recipe = case
    for cell_size in CELLS:
        height, masks = Evaluator(recipe, context).points(*places(), cell_size=cell_size)
        expected = expected_ground(case, cell_size)
        np.testing.assert_allclose(height, expected.height, atol=HEIGHT_TOLERANCE_M, rtol=0)
        for number, mask in enumerate(MASKS):
            np.testing.assert_allclose(masks[:, number], getattr(expected, mask), atol=MASK_TOLERANCE, rtol=0)
    # Each case reaches its branch.
    _, masks = Evaluator(recipe, context).points(*places(), cell_size=4.0)
    reached = dict(zip(MASKS, (masks > 0.5).sum(axis=0) > 20, strict=True))
    expected = {"mountain", "wetness", *REACHED.get(name, name).split()}
    assert {mask for mask, some in reached.items() if some} == expected & set(MASKS)


def test_double_kernel_equals_host_evaluation(case, double_context) -> None:
    """Two independent implementations agree, up to the fixed-point fraction's 24 bits."""
    _, recipe = case
    for cell_size in CELLS:
        height, masks = Evaluator(recipe, double_context).points(*places(), cell_size=cell_size)
        expected = expected_ground(case, cell_size)
        np.testing.assert_allclose(height, expected.height, atol=2e-4, rtol=0)
        for number, mask in enumerate(MASKS):
            np.testing.assert_allclose(masks[:, number], getattr(expected, mask), atol=2e-6, rtol=0)


HEIGHT_M = 1e-3
NORMAL_DEGREES = 0.1
EXTENT = 32768.0
FARTHEST = 16_000.0
CORNERS = [(-1, -1), (1, -1), (-1, 1), (1, 1), (0, 0)]
KINDS = ("ground", "mountains", "eroded", "hills", "dunes", "river", "lake", "sea", "flood")
SIDE = 35


def recipe_of(kind, corner, make_recipe) -> tuple[TerrainRecipe, np.ndarray[Any, Any]]:
    """Return one kind of feature, up to a kilometre high, in a far corner, and its centre (m)."""
    x, y = middle = np.array(corner) * (FARTHEST - 1500)
    eroded = {"erosion": 0.8} if kind == "eroded" else {}
    ground = {"relief": 1000.0 if kind == "ground" else 60.0, "wavelength": 2400.0, "roughness": 0.48}
    changes: dict[str, Any] = {"extent": EXTENT, "ground": ground}
    features = {
        "mountains": [("mountain", 0, 0, 1400, 1000), ("mountain", 900, 500, 900, 700)],
        "eroded": [("mountain", 0, 0, 1400, 1000), ("mountain", 900, 500, 900, 700)],
        "hills": [("hill", 0, 0, 900, 250), ("hill", 500, -600, 600, 180)],
        "dunes": [("dune", 0, 0, 1500, 25)],
    }.get(kind, [])
    more = {"mountain": {"peakiness": 0.6} | eroded, "dune": {"wavelength": 150, "wind": 250}}
    placed = [feature(name, x + a, y + b, r, h, **more.get(name, {})) for name, a, b, r, h in features]
    if kind == "river":
        along = np.linspace(-1400, 1400, 300)
        line = np.column_stack([x + along, y + 150 * np.sin(along / 300), 12 - 0.004 * along])
        changes["rivers"] = (river_of(line, 20.0),)
    if kind == "lake":
        changes["lakes"] = (lake(x, y, 400, 3.0),)
    if kind == "sea":
        changes["sea"] = winding_sea(x, y)
    if kind == "flood":
        changes["sea"] = SEAS["flood"]
    return make_recipe(*placed, **changes), middle


@tiers("corners", [CORNERS[:1]], [CORNERS[1:]])
@pytest.mark.parametrize("kind", KINDS)
def test_heights_are_within_a_millimetre_of_numpy(kind, corners, make_recipe, context) -> None:
    for corner in corners:
        recipe, middle = recipe_of(kind, corner, make_recipe)
        unit = metres_per_unit(recipe.extent)
        places = middle + np.random.default_rng(2).uniform(-1400, 1400, (6000, 2))
        x, y = (np.rint(axis / unit).astype(np.int64) for axis in places.T)
        height, _ = Evaluator(recipe, context).points(x, y, cell_size=0.0)
        error = np.abs(height - HostTerrain(recipe).samples(x, y).height)
        assert np.ptp(height) > 20
        assert error.max() < HEIGHT_M, corner
        assert np.percentile(error, 99.9) < HEIGHT_M / 2, corner


@tiers("cells", [[2.0]], [[0.25, 16.0]])
@pytest.mark.parametrize("kind", KINDS)
def test_normals_are_within_a_tenth_of_a_degree(kind, cells, make_recipe, context, double_context) -> None:
    recipe, middle = recipe_of(kind, CORNERS[0], make_recipe)
    for cell_size in cells:
        step = 1 << round(np.log2(cell_size / metres_per_unit(recipe.extent)))
        places = middle + np.random.default_rng(2).uniform(-900, 900, (12, 2))
        first = np.floor(places / cell_size).astype(np.int64) * step
        offsets = np.arange(SIDE) * step
        x, y = first[:, :1] + offsets, first[:, 1:] - offsets
        found, expected = (
            Evaluator(recipe, opened).surface(x, y, cell_size=cell_size)
            for opened in (context, double_context)
        )
        assert np.abs(found.height - expected.height).max() < HEIGHT_M, cell_size
        chord = np.linalg.norm(found.normal.astype(np.float64) - expected.normal, axis=-1)
        assert np.degrees(2 * np.arcsin(chord.max() / 2)) < NORMAL_DEGREES, cell_size


Shift = tuple[int, int]

UNIT = 4096.0 / 2**24
FAR = round(1e7 / UNIT)
# One unit; no whole step of any tile; whole steps of the coarser ones; 10,000 km and a bit.
SHIFTS = [(1, 0), (-12_345, 678_901), (1 << 23, -(3 << 24)), (FAR + 1, -FAR - 12_347), (-FAR, FAR)]
# The dunes' waves are the world's own: they repeat after so many units, whatever the wind.
PERIOD = 1 << 31


def metres(shift: Shift) -> np.ndarray:
    return np.array(shift) * UNIT


def moved_field(field: ShapeField, shift: Shift) -> ShapeField:
    east, north = metres(shift)
    return replace(field, west=field.west + east, south=field.south + north)


def ways_at(recipe: TerrainRecipe, east: float, north: float) -> list[TerrainLayer]:
    """Return the roads and pads of a recipe, moved (m)."""
    roads, pads = recipe[RoadsLayer], recipe[PadsLayer]
    by = np.array([east, north, 0.0])
    return [
        replace(roads, roads=tuple(replace(road, axis=road.axis + by) for road in roads.roads)),
        replace(pads, pads=tuple(replace(pad, outline=pad.outline + by[:2]) for pad in pads.pads)),
    ]


def moved(recipe: TerrainRecipe, shift: Shift) -> TerrainRecipe:
    painted = recipe.points.painted.copy()
    painted["x"] += metres(shift)[0]
    painted["y"] += metres(shift)[1]
    by = np.array([*metres(shift), 0.0])
    rivers = tuple(
        replace(river, points=river.points + by, centreline=river.centreline + by) for river in recipe.rivers
    )
    lakes = tuple(replace(lake, shape=moved_field(lake.shape, shift)) for lake in recipe.lakes)
    covers, plateaus = (
        tuple(replace(each, shape=moved_field(each.shape, shift)) for each in items)
        for items in (recipe[CoversLayer].covers, recipe[PlateausLayer].plateaus)
    )
    there = recipe.with_layers([PlateausLayer(plateaus), *ways_at(recipe, *metres(shift))])
    return rebuilt(there, painted, rivers, lakes, covers)


def rebuilt(
    recipe: TerrainRecipe, painted: np.ndarray, rivers: Any, lakes: Any, covers: Any
) -> TerrainRecipe:
    """Return the recipe with other features, rivers, lakes and covers."""
    radii = [course.valley_radius for course in recipe[CorridorsLayer].courses]
    return recipe.with_layers(
        [
            replace(recipe.points, painted=painted),
            LakesLayer(tuple(lakes)),
            CorridorsLayer.of(rivers, radii, recipe.extent),
            CoversLayer(tuple(covers)),
        ]
    )


def snap_to_lattice(recipe: TerrainRecipe) -> TerrainRecipe:
    """Return the recipe with all positions rounded to whole units, exact as floats far away."""
    painted = recipe.points.painted.copy()
    for axis in ("x", "y"):
        painted[axis] = np.rint(painted[axis] / UNIT) * UNIT
    rivers = []
    for river in recipe.rivers:
        line = river.centreline.copy()
        line[:, :2] = np.rint(line[:, :2] / UNIT) * UNIT
        rivers.append(replace(river, centreline=line, points=line[::20]))
    return rebuilt(recipe, painted, rivers, recipe.lakes, recipe[CoversLayer].covers)


@pytest.fixture
def shift_noise(monkeypatch) -> Callable[[Shift], None]:
    """Move the origin of all noise."""

    def to(shift: Shift) -> None:
        x, y = shift
        plain = np.array([SKEW_SAME * x + SKEW_OTHER * y, SKEW_OTHER * x + SKEW_SAME * y])
        turned = np.array([SKEW_SAME * y - SKEW_OTHER * x, SKEW_OTHER * y - SKEW_SAME * x])

        def shifted(*stacks: Any, **options: Any) -> OctaveTable:
            table = octave_table(*stacks, **options)
            return replace(table, offset=table.offset - np.where(table.form[:, 2:3] == 1, turned, plain))

        monkeypatch.setattr("sketchterrain.terrain.recipe.octave_table", shifted)

    return to


def complete_recipe(make_recipe: Callable[..., TerrainRecipe], *names: str) -> TerrainRecipe:
    recipe = make_recipe(
        *(feature for name in names for feature in CASES[name]),
        rivers=(straight_river(), straight_river(900, width=6)),
        lakes=LAKES,
        plateaus=PLATEAUS,
        covers=(cover(1900.0, 2000.0, 60.0, 4, 0.8),),
        ground={"relief": 0.0},  # nodes do not shift by less than their spacing
    )
    recipe = replace(
        recipe, strata=Strata.from_settings(defaults(GEOLOGY) | {"dip": 0.0})
    )  # beds that dip do not shift
    assert metres_per_unit(recipe.extent) == UNIT
    network = make_network()
    ways = RoadsLayer(MATERIALS, network.roads), PadsLayer(MATERIALS, network.pads)
    recipe = recipe.with_layers(ways_at(recipe.with_layers(ways), 1500.0, 1500.0))
    return snap_to_lattice(recipe)


def compare(recipe, shift, shift_noise, context) -> None:
    rng = np.random.default_rng(6)
    x, y = rng.integers(0, 1 << 24, (2, 3000))
    offset = np.arange(-1, 66)
    steps = (256, 409, 1 << 12, 1 << 16)  # 6 cm, 0.1 m, 1 m, 16 m
    here, there = Evaluator(recipe, context), Evaluator(moved(recipe, shift), context)

    def answers(evaluator: Evaluator, by: Shift) -> list[np.ndarray]:
        found: list[np.ndarray] = []
        for cell in (0.0, 0.1, 6.0, 40.0):
            found += evaluator.points(x + by[0], y + by[1], cell_size=cell)
        for step in steps:
            column, row = np.array([[29, 31], [32, 30]]) * (1 << 18) + np.array(by)[:, None]
            axes = column[:, None] + offset * step, row[:, None] - offset * step
            surface = evaluator.surface(*axes, cell_size=step * UNIT)
            found += [surface.height, surface.normal, surface.materials]
        return found

    one = answers(here, (0, 0))
    shift_noise(shift)
    two = answers(there, shift)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)
    assert all(np.ptp(part) > 0 for part in one)


@tiers("shift", [SHIFTS[1], SHIFTS[3]], SHIFTS)
def test_a_shifted_recipe_gives_the_same_terrain(shift, make_recipe, shift_noise, context) -> None:
    """Hills, mountains, forest, rivers, lakes, covers, roads and pads, heights to materials."""
    compare(complete_recipe(make_recipe, "hill", "mountain", "forest"), shift, shift_noise, context)


@tiers("shift", [(19 * PERIOD, -20 * PERIOD)], [(PERIOD, 0)])
def test_dunes_shift_by_their_periods(shift, make_recipe, shift_noise, context) -> None:
    compare(complete_recipe(make_recipe, "dune", "hill"), shift, shift_noise, context)
