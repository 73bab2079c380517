"""Lists of the features that reach a block equal those of comparing every pair."""

import itertools

import numpy as np

from sketchterrain.terrain import TerrainRecipe
from sketchterrain.terrain.culling import feature_index, features_near
from sketchterrain.terrain.packing import pack_features
from sketchterrain.terrain.reach_index import ReachIndex
from sketchterrain.terrain.surroundings import Surroundings

from .conftest import tiers


def compared(low, high, reach, blocks):
    """Every pair of a block and an item, compared."""
    grow = np.ceil(reach).astype(np.int64)[:, None]
    low, high, blocks = low - grow, high + grow, blocks[:, None]
    touch = (blocks[..., :2] <= high).all(axis=-1) & (blocks[..., 2:] >= low).all(axis=-1)
    return np.nonzero(touch)


def test_an_index_finds_what_comparing_finds(monkeypatch) -> None:
    monkeypatch.setattr("sketchterrain.terrain.reach_index._FEW", -1)
    for seed, far in itertools.product(range(6), (0, -(1 << 50), 1 << 50)):
        rng = np.random.default_rng(seed)
        count, blocks = (int(n) for n in rng.integers(1, (3000, 60)))
        world = int(2 ** rng.uniform(4, 26))
        low = rng.integers(-world, world, (count, 2)) + far
        high = low + rng.integers(0, 1 + world // 50, (count, 2))
        reach = np.where(rng.random(count) < 0.1, 0.0, 2 ** rng.uniform(-2, np.log2(world), count))
        corner = rng.integers(-2 * world, 2 * world, (blocks, 2)) + far
        area = np.concatenate([corner, corner + rng.integers(0, world, (blocks, 2))], axis=1)
        area[0] = [far - 4 * world, far - 4 * world, far + 4 * world, far + 4 * world]
        # One that only shares a corner with the first item.
        area[-1, :2] = area[-1, 2:] = high[0] + int(np.ceil(reach[0]))
        found = ReachIndex(low, high, reach).touching(area)
        for one, other in zip(found, compared(low, high, reach, area), strict=True):
            np.testing.assert_array_equal(one, other, err_msg=f"seed {seed}, far {far}")
    monkeypatch.undo()
    none = np.zeros((0, 2), np.int64)
    block, item = ReachIndex(none, none, np.zeros(0)).touching(np.zeros((3, 4), np.int64))
    assert block.size == item.size == 0


@tiers("level", [1, 7], [4, 11])
def test_surroundings_give_the_lists_of_all_features(valley, level) -> None:
    """The same features for each block, by slot and in the same order, whatever is gathered around it."""
    recipe = valley.recipe
    rng = np.random.default_rng(level)
    step = 1 << (24 - level)
    column, row = rng.integers(-(2**level), 2 ** (level + 1), (2, 5))
    blocks = np.stack([column, row, column + 1, row + 1], axis=-1) * step
    cell = recipe.extent / 2.0**level / 64
    gathered = Surroundings(recipe, valley.context).gathered(blocks, cell)
    whole = np.array([[*blocks[:, :2].min(axis=0), *blocks[:, 2:].max(axis=0)]])
    every = features_near(recipe, whole, cell)
    every = np.concatenate([recipe.painted, every[~np.isin(every["id"], recipe.painted["id"])]])
    every = every[np.argsort(every["id"], kind="stable")]
    packed = pack_features(recipe, every, cell)
    unit = recipe.extent / 2.0**24
    block, item = compared(packed.at, packed.at, packed.support / unit, blocks)
    starts, members = gathered.lists(blocks)
    at = valley.context.download(gathered.at, (len(gathered.packed.slot), 2), np.int64)
    for number in range(len(blocks)):
        expected = item[block == number]
        expected = expected[np.argsort(packed.slot[expected], kind="stable")]
        listed = members[starts[number, 0] : starts[number, -1]]
        np.testing.assert_array_equal(at[listed], packed.at[expected])
        np.testing.assert_array_equal(gathered.packed.shape[listed, 1], packed.shape[expected, 1])
        sizes = np.bincount(packed.slot[expected], minlength=gathered.slots)
        np.testing.assert_array_equal(np.diff(starts[number]), sizes)


def test_surroundings_do_not_depend_on_earlier_queries(valley) -> None:
    near = np.array([[1 << 22, 1 << 22, (1 << 22) + (1 << 18), (1 << 22) + (1 << 18)]])
    asked = Surroundings(valley.recipe, valley.context)
    for shift in (-(1 << 25), 1 << 23, 1 << 20):
        asked.gathered(near + shift, 2.0)
    one, two = asked.gathered(near, 2.0), Surroundings(valley.recipe, valley.context).gathered(near, 2.0)
    np.testing.assert_array_equal(one.packed.shape, two.packed.shape)
    np.testing.assert_array_equal(one.order, two.order)
    assert asked.gathered(near, 2.0) is one


def test_features_near_a_place_are_few(make_recipe) -> None:
    """Of many painted features only those that reach the block are looked at."""
    recipe: TerrainRecipe = make_recipe()
    rng = np.random.default_rng(1)
    painted = np.zeros(4000, recipe.painted.dtype)
    painted["id"] = np.arange(painted.size)
    painted["x"], painted["y"] = rng.uniform(0, 4096, (2, painted.size))
    painted["radius"], painted["strength"] = 20.0, 5.0
    recipe = make_recipe(painted=painted)
    block = np.array([[1 << 22, 1 << 22, (1 << 22) + (1 << 20), (1 << 22) + (1 << 20)]])
    near = features_near(recipe, block, 0.0)
    assert 10 < len(near) < 80
    index, _ = feature_index(recipe, pack_features(recipe, near, 0.0))
    assert len(index.touching(block)[1]) == len(near)
