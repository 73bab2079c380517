"""Roads and pads as layers: kernels against NumPy, exact zero beyond, tiles, bounds, updates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.generation.terrain import Terrain
from sketchterrain.landforms.base_ground import BaseGround
from sketchterrain.roads.road_types import BRIDGE, GROUND, TUNNEL, axis_points
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.stages.runner import Results
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import HostTerrain
from sketchterrain.terrain.layers.layer import MASKS, WorldSettings
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.layers.roads import RoadsLayer
from sketchterrain.terrain.recipe import TerrainRecipe
from tests.roads.test_profile import random_features
from tests.sample_roads import SCENE, contents, make_road, sketch_with

from .conftest import (
    Waves,
    assert_bounds_hold,
    assert_changed_within,
    assert_same,
    assert_tiles_meet,
    small_base,
    tiers,
    with_roads,
)

EXTENT, UNIT = 4096.0, 4096.0 / 2**24
CELLS = (0.0, 1.0, 2.5, 4.0, 6.0, 16.0)
"""Of which 2.5 and 4 m show carriageways of 6 m in part."""


@pytest.fixture(scope="module")
def bare(make_recipe) -> TerrainRecipe:
    return make_recipe(ground={"relief": 120.0})


def built(bare: TerrainRecipe, *features) -> TerrainRecipe:
    return with_roads(sketch_with(*features, extent=EXTENT), bare)


@pytest.fixture(scope="module")
def recipe(bare) -> TerrainRecipe:
    return built(bare, *SCENE)


def places(recipe: TerrainRecipe, count: int = 3000, wide: float = 12.0) -> tuple[np.ndarray, np.ndarray]:
    """Return lattice positions around the axes of roads and the corners of pads."""
    network, rng = recipe.network, np.random.default_rng(7)
    axes = [axis_points(road, 0.5).position[:, :2] for road in network.roads]
    points = np.concatenate(axes + [pad.outline for pad in network.pads])
    at = points[rng.integers(len(points), size=count)] + rng.normal(0.0, wide, (count, 2))
    x, y = np.rint(at / UNIT).astype(np.int64).T
    return x, y


def test_the_scene_has_every_structure(recipe) -> None:
    lengths = np.bincount(
        [road.structure for road in recipe.network.roads],
        [r.along[-1] - r.along[0] for r in recipe.network.roads],
    )
    assert lengths[[GROUND, BRIDGE, TUNNEL]].min() > 500.0


def test_kernels_agree_with_numpy_float64(recipe, context, double_context) -> None:
    x, y = places(recipe)
    for cell in CELLS:
        expected = HostTerrain(recipe).samples(x, y, cell_size=cell)
        for opened, metres, share in ((context, 3e-4, 1e-5), (double_context, 1e-5, 1e-6)):
            height, masks = Evaluator(recipe, opened).points(x, y, cell_size=cell)
            assert np.abs(height - expected.height).max() < metres, cell
            for number, mask in enumerate(MASKS):
                assert np.abs(masks[:, number] - getattr(expected, mask)).max() < share, (cell, mask)


def distance_to_ground(recipe: TerrainRecipe, x, y) -> np.ndarray:
    """Return distances (m) beyond the reach of roads on the ground and of pads, 0 within."""
    at = np.stack([x, y], axis=1) * UNIT
    beyond = np.full(len(at), np.inf)
    for road in recipe.network.roads:
        if road.structure == GROUND:
            line = axis_points(road, 0.01).position[:, :2]
            away = _to_polyline(at, line)
            beyond = np.minimum(beyond, away - road.reach.max())
    for pad in recipe.network.pads:
        loop = np.concatenate([pad.outline, pad.outline[:1]])
        inside = (at > pad.outline.min(axis=0)).all(axis=1) & (at < pad.outline.max(axis=0)).all(axis=1)
        beyond = np.minimum(beyond, np.where(inside, 0.0, _to_polyline(at, loop) - pad.reach))
    return beyond


def _to_polyline(at: np.ndarray, line: np.ndarray) -> np.ndarray:
    from shapely import LineString, distance, points

    return distance(points(at), LineString(line))


def test_ground_is_bit_equal_where_no_road_reaches(recipe, bare, context) -> None:
    """Also under bridges and over tunnels."""
    x, y = places(recipe, 4000, wide=60.0)
    beyond = distance_to_ground(recipe, x, y) > 0.1
    assert 0.2 < beyond.mean() < 0.8
    for cell in CELLS[::2]:
        one, two = (Evaluator(each, context).points(x, y, cell_size=cell)[0] for each in (recipe, bare))
        assert np.array_equal(one[beyond], two[beyond]), cell
    one, two = (Evaluator(each, context).points(x, y, cell_size=0.0)[0] for each in (recipe, bare))
    assert (one != two).mean() > 0.1


LEVEL = 6
KEYS = [(column, row) for column in range(14, 45) for row in range(11, 24)]
BLOCK = [(column, row) for column in range(24, 36) for row in range(14, 21)]


def test_tiles_meet_and_equal_points_whatever_the_launch(recipe, context) -> None:
    assert_tiles_meet(Evaluator(recipe, context), LEVEL, BLOCK, Evaluator(recipe, context))


@tiers("level", [5], [3, 4, 6])
def test_bounds_hold_of_what_a_cell_size_omits(bare, recipe, context, level) -> None:
    if level == 5:  # earthworks that nowhere meet the ground
        features = random_features(3, 20)
        recipe = built(bare, *((layer, points + 1500.0, own) for layer, points, own in features))
    shift = LEVEL - level
    keys = sorted({(column >> shift, row >> shift) for column, row in KEYS})[:: 3 if level == LEVEL else 1]
    assert_bounds_hold(Evaluator(recipe, context), level, keys)


def test_another_division_into_legs_is_a_change() -> None:
    """Of pieces that stay: beside a steep road there are the earthworks of each leg's nearest point."""
    stations = np.arange(33.0)[:, None] * (6.0, 0.0, 1.8)
    parts = [make_road(stations[k : k + 17], part=k, slope=0.3) for k in (0, 16)]
    layers = [RoadsLayer(MATERIALS, (parts[0], replace(parts[1], leg=leg))) for leg in (1, 2)]
    assert len(layers[0].items(WorldSettings(EXTENT, 0, 0.0))) == 2
    assert layers[0].change(layers[1], WorldSettings(EXTENT, 0, 0.0))


def edited(rng: np.random.Generator, scene: list[tuple], number: int) -> list[tuple]:
    """Return features with one of them moved, removed, added or given another property."""
    scene, place = list(scene), int(rng.integers(len(scene)))
    layer, points, own = scene[place]
    points = np.array(points, np.float64)
    kind = ("vertex", "end", "whole", "property", "remove", "add")[number % 6]
    if kind == "vertex":
        points[rng.integers(len(points))] += rng.normal(0.0, 3.0, 2)
    elif kind == "end":
        points[-1] += rng.normal(0.0, 30.0, 2) * (layer != "pad")
    elif kind == "whole":
        points += rng.normal(0.0, 30.0, 2)
    elif kind == "property":
        own = (
            own
            | {"cut": float(rng.uniform(0.3, 2.0)), "height": 1.0}
            | ({"grade": 0.07} if layer == "road" else {})
        )
    elif kind == "remove" and len(scene) > 8:
        return [*scene[:place], *scene[place + 1 :]]
    else:
        return [
            *scene,
            ("road", [(1100, 1000 + 9 * number), (1900, 900 + 11 * number)], {"id": 100 + number}),
        ]
    scene[place] = (layer, points, own)
    return scene


@tiers("first", [0], [1, 2, 3])
def test_updates_equal_new_terrains_and_change_their_areas_only(bare, context, first) -> None:
    rng, memory, scene = np.random.default_rng(first), Results(), [*SCENE]
    old = Terrain(
        sketch_with(*scene, extent=EXTENT),
        with_roads(sketch_with(*scene, extent=EXTENT), bare, memory),
        context,
    )
    x, y = places(old.recipe, 1500, wide=20.0)
    keys = [(LEVEL, *key) for key in KEYS[::19]]
    old.tiles(keys)  # fills its caches
    for number in range(6):
        scene = edited(rng, scene, number)
        sketch = sketch_with(*scene, extent=EXTENT)
        fresh = Terrain(sketch, built(bare, *scene), context)
        updated = with_roads(sketch, bare, memory)
        assert contents(updated.network) == contents(fresh.recipe.network), number
        new, areas = old.updated(sketch, updated)
        for cell in (0.0, 4.0):
            assert_changed_within(areas, [each.evaluator for each in (new, fresh, old)], x, y, cell, 0.0)
        for one, two in zip(new.tiles(keys), fresh.tiles(keys), strict=True):
            assert_same(one, two, parents=True)
        old = new


def test_roads_over_voids_of_elevation_are_on_the_ground(make_recipe, context) -> None:
    relief = ReliefLayer(Waves(), base=BaseGround(small_base(), 16.0, Waves()))
    recipe = built(
        make_recipe(relief=relief), ("road", [(1500, 2000), (3300, 2050)], {"structure": "ground"})
    )
    (road,) = recipe.network.roads
    x, y = np.rint(axis_points(road, 0.01).position[:, :2].T / UNIT).astype(np.int64)
    height, _ = Evaluator(recipe, context).points(x, y, cell_size=0.0)
    assert np.abs(height - axis_points(road, 0.01).position[:, 2]).max() < 0.02
    x, y = places(recipe, 2000)
    height, _ = Evaluator(recipe, context).points(x, y, cell_size=0.0)
    assert np.abs(height - HostTerrain(recipe).samples(x, y).height).max() < 3e-3
