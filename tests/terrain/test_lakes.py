"""Lakes hold water and nothing spills; rivers run in and out; covers lie where they are painted."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.compute import ComputeContext
from sketchterrain.features import Cover, Lake, River, ShapeField
from sketchterrain.terrain import TerrainRecipe
from sketchterrain.terrain.evaluation import Evaluator
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.materials import MATERIALS

from .conftest import lake as round_lake
from .conftest import round_field

Make = Callable[..., TerrainRecipe]

EXTENT = 4096.0
CENTRE = 2048.0


def field(radius: float, *, x: float = CENTRE) -> ShapeField:
    return round_field(x, CENTRE, radius)


def lake(radius: float, level: float, *, x: float = CENTRE) -> Lake:
    return round_lake(x, CENTRE, radius, level)


def heights(recipe: TerrainRecipe, context: ComputeContext, x: Any, y: Any, cell: float = 0.0) -> Any:
    x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
    lattice = to_lattice(x.ravel(), EXTENT), to_lattice(y.ravel(), EXTENT)
    return Evaluator(recipe, context).points(*lattice, cell_size=cell)[0].reshape(x.shape)


def river(*, x: tuple[float, float], z: tuple[float, float], width: float = 14.0) -> River:
    """A straight river through the middle of the ground, west to east or back."""
    at = np.linspace(*x, 200)
    line = np.column_stack([at, np.full(200, CENTRE), np.linspace(*z, 200)])
    ones = np.ones(200, np.float32)
    return River(9, 1, line[::20], width * ones[::20], 2 * ones[::20], line, width * ones, 2 * ones)


def test_a_lake_is_deep_within_and_nothing_spills(make_recipe, context) -> None:
    """Whatever the ground was: water stands inside the shore, and flooding from it never gets out."""
    step = np.arange(-500, 501, 2.0)
    radius = np.hypot(step, step[:, None])
    for level in (-25.0, 0.0, 25.0):
        recipe = make_recipe(lakes=(lake(300, level),))
        ground = heights(recipe, context, CENTRE + step, CENTRE + step[:, None])
        assert (ground[radius < 298] < level).all()
        assert (ground[(radius > 302) & (radius < 314)] > level).all()
        np.testing.assert_allclose(level - ground[radius < 200].min(), 8, atol=1e-3)
        regions, _ = ndimage.label(ground <= level)
        flooded = regions == regions[250, 250]
        assert radius[flooded].max() < 302, level


def test_the_shore_is_smooth(make_recipe, context) -> None:
    """Slopes along a line across it change by little from metre to metre: no wall, no step."""
    line = np.arange(1500.0, 2600.0, 0.5)
    bare = np.gradient(heights(make_recipe(), context, line, CENTRE), line)
    slope = np.gradient(heights(make_recipe(lakes=(lake(300, 4.0),)), context, line, CENTRE), line)
    assert np.abs(np.diff(slope)).max() < np.abs(np.diff(bare)).max() + 0.02
    assert np.abs(slope).max() < 1.0


def test_beyond_its_margin_a_lake_changes_no_bit(make_recipe, context) -> None:
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, EXTENT, (2, 20000))
    outside = np.hypot(x - CENTRE, y - CENTRE) > 400
    bare = heights(make_recipe(), context, x, y)
    wet = heights(make_recipe(lakes=(lake(300, 40.0),)), context, x, y)
    np.testing.assert_array_equal(bare[outside], wet[outside])
    assert (bare != wet)[~outside].mean() > 0.9


def test_small_lakes_fade_with_the_cell_size(make_recipe, context) -> None:
    recipe = make_recipe(lakes=(lake(30, 30.0),))
    effect = [
        float(
            np.abs(
                heights(recipe, context, CENTRE, CENTRE, c)
                - heights(make_recipe(), context, CENTRE, CENTRE, c)
            )
        )
        for c in (28, 40, 50, 61, 200)
    ]
    assert effect[0] > 5
    assert effect == sorted(effect, reverse=True)
    assert effect[-2:] == [0, 0]


@pytest.mark.parametrize("inward", [True, False])
def test_a_river_enters_and_leaves_without_a_dam(make_recipe, context, inward) -> None:
    """Its water has a free way between the lake and open country, and the lake keeps its depth."""
    level = 6.0
    ends = (
        {"x": (500.0, 1800.0), "z": (14.0, level)} if inward else {"x": (1800.0, 500.0), "z": (level, -2.0)}
    )
    stream = river(**ends)
    still = make_recipe(lakes=(lake(300, level),))
    running = make_recipe(lakes=(lake(300, level),), rivers=(stream,))
    along = np.interp(
        np.arange(520.0, 1800.0), *stream.centreline[np.argsort(stream.centreline[:, 0])][:, [0, 2]].T
    )
    bed = heights(running, context, np.arange(520.0, 1800.0), CENTRE)
    assert (bed < along).all()
    step = np.arange(-298, 299, 2.0)
    inside = np.hypot(step, step[:, None]) < 298
    before = heights(still, context, CENTRE + step, CENTRE + step[:, None])
    after = heights(running, context, CENTRE + step, CENTRE + step[:, None])
    assert (after - before)[inside].max() < 1e-4
    assert (after[inside] < level).all()


def test_the_nearer_of_two_lakes_wins(make_recipe, context) -> None:
    """Two levels a hundred metres apart: each keeps its water, a ridge between them."""
    pair = (lake(200, 5.0, x=CENTRE - 240), lake(200, 9.0, x=CENTRE + 240))
    line = np.arange(CENTRE - 430, CENTRE + 430)
    ground = heights(make_recipe(lakes=pair), context, line, CENTRE)
    assert (ground[np.abs(line - CENTRE + 240) < 190] < 5).all()
    assert (ground[np.abs(line - CENTRE - 240) < 190] < 9).all()
    assert ground[np.abs(line - CENTRE) < 30].max() > 9
    swapped = heights(make_recipe(lakes=pair[::-1]), context, line, CENTRE)
    np.testing.assert_allclose(swapped, ground, atol=1e-4)


def materials(recipe: TerrainRecipe, context: ComputeContext, radius: float) -> tuple[Any, Any]:
    """Weights on a grid around the centre, and each vertex's distance from it."""
    step = np.linspace(-radius, radius, 131)
    axis = to_lattice(CENTRE + step, EXTENT)[None]
    surface = Evaluator(recipe, context).surface(axis, axis[:, ::-1], cell_size=2 * radius / 130)
    return surface.materials[0], np.hypot(step, step[:, None])[1:-1, 1:-1]


def test_a_cover_takes_its_share(make_recipe, context) -> None:
    snow = MATERIALS.index("snow")
    bare, _ = materials(make_recipe(), context, 200.0)
    for strength in (1.0, 0.4):
        recipe = make_recipe(covers=(Cover(1, 1, field(120), snow, strength),))
        weights, distance = materials(recipe, context, 200.0)
        under = bare[distance < 100] * (1 - strength) + strength * np.eye(8)[snow]
        np.testing.assert_allclose(weights.sum(axis=-1), 1, atol=1e-6)
        np.testing.assert_allclose(weights[distance < 100, snow], strength, atol=1e-5)
        np.testing.assert_allclose(weights[distance < 100], under, atol=1e-6)
        np.testing.assert_array_equal(weights[distance > 140], bare[distance > 140])


def test_sand_mud_and_grass_share_a_lakes_shore_and_its_bed_is_not_grass(make_recipe, context) -> None:
    weights, distance = materials(make_recipe(lakes=(lake(120, 10.0),)), context, 200.0)
    shore = (distance > 121) & (distance < 127)
    for material in ("sand", "soil", "grass"):
        assert weights[shore, MATERIALS.index(material)].max() > 0.6, material
        assert weights[shore, MATERIALS.index(material)].mean() < 0.6, material
    assert weights[distance < 118, MATERIALS.index("river_bed")].min() > 0.9
