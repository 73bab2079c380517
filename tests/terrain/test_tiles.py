"""Tiles, rasters, single heights, culling, and bounds of omitted detail."""

import itertools

import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.compute.context import ComputeContext
from sketchterrain.errors import InputError
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.box_index import BoxIndex, row_difference
from sketchterrain.geometry.lattice import QUADS
from sketchterrain.io.resources import preset_names
from sketchterrain.terrain.inputs import KernelInputs
from sketchterrain.terrain.noise import NOISE_PEAK, UNSKEW
from sketchterrain.terrain.patches import tile_patches
from tests import terrains
from tests.devices import DEVICES

from .conftest import CASES, LAKES, PLATEAUS, SEAS, assert_same, half_sums, straight_river, tiers


def vertices(tile: st.Tile) -> tuple[np.ndarray, np.ndarray]:
    west, south, east, north = tile.bounds
    x = np.linspace(west, east, QUADS + 1)
    y = np.linspace(north, south, QUADS + 1)
    return np.broadcast_to(x, (65, 65)), np.broadcast_to(y[:, None], (65, 65))


def test_heights_at_vertices_are_those_of_tiles_and_rasters(valley) -> None:
    for level in (-3, 0, 6, 12, 18):
        tile = valley.tile(level, int(0.55 * 2.0**level), int(0.47 * 2.0**level))
        some = slice(None, None, 4)
        x, y = (each[some, some] for each in vertices(tile))
        heights = valley.heights(x, y, cell_size=tile.cell_size)
        np.testing.assert_array_equal(heights, tile.height[some, some], err_msg=str(level))
    for size in (2, 65, 66, 100):
        raster = valley.raster(size)
        assert raster.height.shape == (size, size)
        x = np.linspace(0, valley.size[0], size)
        y = np.linspace(valley.size[1], 0, size)
        some = slice(None, None, size // 16 + 1)  # of every patch
        heights = valley.heights(x[some], y[some, None], cell_size=valley.extent / (size - 1))
        np.testing.assert_array_equal(raster.height[some, some], heights, err_msg=str(size))


def test_culling_changes_no_bit(valley, monkeypatch) -> None:
    keys = [(5, 12, 14), (5, 20, 9), (5, 25, 30), (3, 3, 3)]
    culled = valley.tiles(keys)
    monkeypatch.setattr("sketchterrain.geometry.box_index.BoxIndex.touching", everything_touches)
    # A terrain without caches: all painted features are in the list of every block.
    uncut = Terrain(valley.sketch, valley.recipe, valley.context)
    for one, two in zip(culled, uncut.tiles(keys), strict=True):
        assert_same(one, two, parents=True)


def everything_touches(index, blocks, least=0):
    block, item = np.indices((len(blocks), len(index))).reshape(2, -1)
    return block, item


def test_tiles_alone_together_and_rasters_have_the_same_bits(valley) -> None:
    keys = [(6, c, r) for c in range(20, 30) for r in range(30, 36)]
    together, alone = valley.tiles(keys)[17], valley.tile(*keys[17])
    raster, tile = valley.raster(257), valley.tile(2, 1, 2)
    for name in ("height", "normal", "materials"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))
        np.testing.assert_array_equal(getattr(raster, name)[64:129, 64:129], getattr(tile, name))


def test_normals_are_the_slopes_of_the_heights_and_weights_sum_to_one(valley, desert) -> None:
    for terrain in (valley, desert):
        raster = terrain.raster(257)
        np.testing.assert_allclose(np.linalg.norm(raster.normal, axis=-1), 1, atol=1e-6)
        assert (raster.normal[..., 2] > 0).all()
        np.testing.assert_allclose(raster.materials.sum(axis=-1), 1, atol=1e-5)
        assert (raster.materials >= 0).all()
        z = raster.height.astype(np.float64)
        assert np.isfinite(z).all()
        slope_x = (z[1:-1, 2:] - z[1:-1, :-2]) / (2 * raster.spacing[0])
        slope_y = (z[:-2, 1:-1] - z[2:, 1:-1]) / (2 * raster.spacing[1])
        expected = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1)
        expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
        cosine = (expected * raster.normal[1:-1, 1:-1]).sum(axis=-1)
        # float32 heights of 500 m step by 3e-5 m, over spans of 48 m.
        assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.05


def test_invalid_queries_are_errors(valley) -> None:
    for x in (np.nan, np.inf, 1e30):
        with pytest.raises(InputError, match="finite and within"):
            valley.heights(x, 0.0)
    with pytest.raises(InputError, match="cell_size"):
        valley.heights(0.0, 0.0, cell_size=-1)
    with pytest.raises(InputError, match="expected a tile level of -12 … 18, got 19"):
        valley.tile(19, 0, 0)
    with pytest.raises(InputError, match="at least 2"):
        valley.raster(1)
    store = valley.vertex_store(4)
    for slots in ([0], [1, 1], [0, 4], [-1, 0]):
        with pytest.raises(InputError, match="slots"):
            valley.write_tiles([(3, 0, 0), (3, 1, 0)], slots, [-1, -1], store)
    assert valley.heights(np.zeros(0), np.zeros(0)).shape == (0,)


def assert_parent(tile: st.Tile, parent: st.Tile) -> None:
    rows = slice(0, 33) if tile.row % 2 else slice(32, None)
    columns = slice(32, None) if tile.column % 2 else slice(0, 33)
    np.testing.assert_array_equal(tile.parent_height[::2, ::2], parent.height[rows, columns])
    np.testing.assert_array_equal(tile.parent_normal[::2, ::2], parent.normal[rows, columns])


@tiers("level", [-12, 0, 5, 13], [-3, 2, 9, 18])
def test_a_tile_carries_its_parent(valley, level) -> None:
    """Bit-equal at shared vertices; between them half the sum along an edge or the diagonal."""
    for column, row in ((3, 2), (2, 3), (-1, -5)):
        tile = valley.tile(level, column, row)
        if level > -12:
            parent = valley.tile(level - 1, column // 2, row // 2)
            assert_parent(tile, parent)
        else:
            x, y = vertices(tile)
            coarse = valley.heights(x[::2, ::2], y[::2, ::2], cell_size=2 * tile.cell_size)
            np.testing.assert_array_equal(tile.parent_height[::2, ::2], coarse)
        z = tile.parent_height[::2, ::2]
        for (south, east), twice in half_sums(z).items():
            between = tile.parent_height[south::2, east::2]
            np.testing.assert_array_equal(between, np.float32(0.5) * twice)
        np.testing.assert_allclose(np.linalg.norm(tile.parent_normal, axis=-1), 1, atol=1e-6)


@pytest.mark.parametrize("level", [4, 9])
def test_32_and_64_bit_positions_give_the_same_bits(valley, level, monkeypatch) -> None:
    """Positions in 32 bits from a tile's corner, and in 64 bits from the origin."""
    keys = [(level, c, r) for c in (-2, 5, 2**level // 2) for r in (3, -1)]
    near = valley.tiles(keys)
    monkeypatch.setattr("sketchterrain.terrain.patches.fits_patches", lambda *_: False)
    for one, two in zip(near, valley.tiles(keys), strict=True):
        assert_same(one, two, parents=True)


def test_omitted_rules_have_no_weight(valley, desert, monkeypatch) -> None:
    """Tiles without mountain, dune, forest or water: the same bits as with all rules."""
    for terrain in (valley, desert):
        keys = [(5, c, r) for c in range(0, 32, 5) for r in range(0, 32, 5)]
        left_out = terrain.tiles(keys)
        blocks = tile_patches(5, [key[1:] for key in keys], terrain.extent, up=0).blocks
        inputs = KernelInputs(terrain.recipe, terrain.context)
        empty_masks = inputs.empty_masks(inputs.cull(blocks, 4.0), len(blocks))
        assert len(np.unique(empty_masks)) > 2
        with monkeypatch.context() as patch:
            patch.setattr(KernelInputs, "empty_masks", lambda _, __, blocks: np.zeros(blocks, np.int32))
            every = terrain.tiles(keys)
        for one, two in zip(left_out, every, strict=True):
            np.testing.assert_array_equal(one.materials, two.materials)


DRAWN_LEVELS = range(1, 13, 2)  # with their parents all levels
FAR = 1e7  # m
AT_ONCE = 96


def opened(device: int, preset: str) -> Terrain:
    terrain = terrains.preset(preset)
    return Terrain(terrain.sketch, terrain.recipe, ComputeContext(DEVICES[device])) if device else terrain


def random_tiles(
    terrain: Terrain, level: int, count: int, rng: np.random.Generator
) -> list[tuple[int, int, int]]:
    """Return tiles, each followed by the one east or north of it and by its parent.

    Half of them in and around the sketch, the others up to 10,000 km away, some of these on the axes.
    """
    width = terrain.extent / 2.0**level
    near = rng.uniform(-0.25, 1.25, (count, 2)) * np.array(terrain.size)
    away = rng.choice([-1.0, 0.0, 1.0], (count, 2)) * FAR * rng.choice([1.0, rng.random()], (count, 1))
    place = np.where(rng.random((count, 1)) < 0.5, near, near + away)
    tiles = []
    for column, row in np.floor(place / width).astype(np.int64).tolist():
        east = int(rng.integers(2))
        beside = (level, column + east, row + 1 - east)
        tiles += [(level, column, row), beside, (level - 1, column // 2, row // 2)]
    return tiles


def check(tile: st.Tile, beside: st.Tile, over: st.Tile) -> None:
    east = beside.column > tile.column
    for name in ("height", "normal", "materials", "parent_height", "parent_normal"):
        one, two = getattr(tile, name), getattr(beside, name)
        np.testing.assert_array_equal(*((one[:, -1], two[:, 0]) if east else (one[0], two[-1])))
    assert_parent(tile, over)


@tiers(
    ("preset", "tiles", "devices"),
    [("valley_river", 1, 1)],
    [(name, 1, 1) for name in ("andorra", "canyon_mesa", "island_coast")],
    [(name, 100, None) for name in preset_names()],
)
def test_tiles_agree_with_their_neighbours_and_parents(preset, tiles, devices) -> None:
    """So many tiles of each level on a device."""
    for device in range(devices or len(DEVICES)):
        check_tiles(opened(device, preset), preset, tiles)


def check_tiles(terrain: Terrain, preset: str, tiles: int) -> None:
    rng = np.random.default_rng([list(preset_names()).index(preset), 4])
    for level in DRAWN_LEVELS:
        keys = random_tiles(terrain, level, tiles, rng)
        for first in range(0, len(keys), 3 * AT_ONCE):
            found = terrain.tiles(keys[first : first + 3 * AT_ONCE])
            for number in range(0, len(found), 3):
                check(*found[number : number + 3])


def brute_force(low, high, reach, blocks):
    """Return all pairs (block, item) that touch, by comparing them all."""
    grow = np.ceil(reach).astype(np.int64)[:, None]
    low, high, blocks = low - grow, high + grow, blocks[:, None]
    touch = (blocks[..., :2] <= high).all(axis=-1) & (blocks[..., 2:] >= low).all(axis=-1)
    return np.nonzero(touch)


def test_the_index_equals_brute_force(monkeypatch) -> None:
    monkeypatch.setattr("sketchterrain.geometry.box_index._FEW", -1)
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
        grow = np.ceil(reach).astype(np.int64)[:, None]
        found = BoxIndex(np.concatenate([low - grow, high + grow], axis=1)).touching(area)
        for one, other in zip(found, brute_force(low, high, reach, area), strict=True):
            np.testing.assert_array_equal(one, other, err_msg=f"seed {seed}, far {far}")
    monkeypatch.undo()
    none = np.zeros((0, 4), np.int64)
    block, item = BoxIndex(none).touching(np.zeros((3, 4), np.int64))
    assert block.size == item.size == 0


def test_an_updated_index_equals_a_new_one(monkeypatch) -> None:
    """Rows of sorted ids are removed, added and changed, in many rounds."""
    monkeypatch.setattr("sketchterrain.geometry.box_index._FEW_ITEMS", 8)
    rng = np.random.default_rng(5)
    layout = np.dtype([("id", "u8"), ("box", "i8", 4)])

    def rows(count: int) -> np.ndarray:
        found = np.zeros(count, layout)
        found["id"] = rng.choice(100_000, count, replace=False)
        low = rng.integers(-5000, 5000, (count, 2))
        found["box"] = np.concatenate([low, low + rng.integers(0, 300, (count, 2))], axis=1)
        return found

    old, blocks = np.sort(rows(2000), order="id"), np.array([[-900, -700, 100, 50], [2000, 0, 2100, 90]])
    index, whole = BoxIndex(old["box"]), 0
    for number in range(60):
        new = np.delete(old, rng.choice(len(old), int(rng.integers(0, 9)), replace=False))
        new["box"][rng.integers(len(new))] += 70
        more = rows(int(rng.integers(0, 9)))
        new = np.sort(np.concatenate([new, more[~np.isin(more["id"], new["id"])]]), order="id")
        if number == 30:  # nearly everything changes
            new["box"][::2] += 3
        removed, added = row_difference(old, new)
        before, index = index, index.updated(removed, added, new["box"][added])
        for one, other in zip(index.touching(blocks), BoxIndex(new["box"]).touching(blocks), strict=True):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(before.touching(blocks), BoxIndex(old["box"]).touching(blocks))
        whole += index._boxes is not before._boxes
        old = new
    assert 0 < whole < 20  # rebuilt at times only


BOUND_LEVELS = range(-4, 13)
MAX_RATIO = 30.0
MAX_CLIFF_RATIO = 60.0  # noise seldom moves a cliff by a quarter of what it may
CLIFFS = ("canyon_mesa", "island_coast")
"""Greatest ratio of the bound to the actual difference, in the median of a level's tiles."""


def omitted_detail(terrain: Terrain, tile: st.Tile, rng: np.random.Generator) -> float:
    """Return the largest difference between a tile's level and full detail at random points.

    In wide tiles they are in a few places: each place far from the others is drained for itself.
    """
    west, south, east, north = tile.bounds
    width = min(east - west, terrain.extent / 8)
    place = rng.uniform([west, south], [east - width, north - width], (4, 2)).repeat(100, axis=0)
    x, y = (place + rng.uniform(0, width, (400, 2))).T
    lines = [river.centreline[:, :2] for river in terrain.recipe.rivers]
    lines += [road.axis[:, :2] for road in terrain.recipe.network.roads]
    if lines:
        line = np.concatenate(lines)
        inside = np.all((line > [west, south]) & (line < [east, north]), axis=-1)
        if inside.any():
            beside = line[inside][rng.integers(inside.sum(), size=400)] + rng.normal(0, 8, (400, 2))
            beside = np.clip(beside, [west, south], [east, north])
            x, y = np.append(x, beside[:, 0]), np.append(y, beside[:, 1])
    full, coarse = (terrain.heights(x, y, cell_size=cell).astype(float) for cell in (0.0, tile.cell_size))
    return float(np.abs(full - coarse).max())


@tiers("preset", ["valley_river"], ["canyon_mesa", "island_coast", "andorra"], ["alpine_range"])
def test_omitted_detail_is_within_the_bound(preset) -> None:
    terrain = opened(0, preset)
    rng = np.random.default_rng(8)
    rivers = [river.centreline[:, :2] for river in terrain.recipe.rivers]
    for level in BOUND_LEVELS[2::5]:
        width = terrain.extent / 2.0**level
        place = rng.uniform(-0.2, 1.2, (7, 2)) * np.array(terrain.size)
        if rivers:
            line = np.concatenate(rivers)
            place[4:] = line[rng.integers(len(line), size=3)]
        keys = [(level, int(column), int(row)) for column, row in np.floor(place / width)]
        tiles = terrain.tiles(keys)
        found = np.array([omitted_detail(terrain, tile, rng) for tile in tiles])
        bound = np.array([tile.detail_bound for tile in tiles])
        assert (found <= bound).all(), level
        ratio = bound[found > 1e-3] / found[found > 1e-3]
        if level >= 2 and len(ratio) > 4:
            assert np.median(ratio) < (MAX_CLIFF_RATIO if preset in CLIFFS else MAX_RATIO), level


@tiers("name", ["sea", "everything"], CASES)
def test_each_kind_of_feature_is_within_the_bound(name, make_recipe, valley) -> None:
    features = [one for kind in CASES for one in CASES[kind]] if name == "everything" else CASES[name]
    rivers = (straight_river(), straight_river(900, width=6)) if name in ("river", "everything") else ()
    lakes = LAKES if name in ("lake", "everything") else ()
    plateaus = PLATEAUS if name in ("plateau", "everything") else ()
    recipe = make_recipe(*features, rivers=rivers, lakes=lakes, plateaus=plateaus, sea=SEAS.get(name))
    terrain = Terrain(valley.sketch, recipe, valley.context)
    rng = np.random.default_rng(3)
    for level in range(-2, 12, 2):
        span = 4096.0 / 2.0**level
        places = rng.uniform(400, 3600, (6, 2)) // span
        for tile in terrain.tiles([(level, int(column), int(row)) for column, row in places]):
            assert omitted_detail(terrain, tile, rng) <= tile.detail_bound, level


def test_noise_is_within_its_peak() -> None:
    """All three corners with the worst gradients, and the greatest change between samples."""
    step = np.linspace(0.0, 1.0, 1001)
    u, v = np.meshgrid(step, step)
    back = (u + v) * UNSKEW
    lower = u > v
    corners = (
        (u - back, v - back),
        (u - back + np.where(lower, UNSKEW - 1, UNSKEW), v - back + np.where(lower, UNSKEW, UNSKEW - 1)),
        (u - back + 2 * UNSKEW - 1, v - back + 2 * UNSKEW - 1),
    )
    most = sum(70 * np.maximum(0.5 - (x * x + y * y), 0) ** 4 * (np.abs(x) + np.abs(y)) for x, y in corners)
    steepest = 70 * 3 * (0.5**4 * 1.5 + 8 * 0.5**3 * 0.3)
    assert most.max() < 1.0 < NOISE_PEAK
    assert np.abs(np.diff(most, axis=0)).max() < steepest / 1000
    assert most.max() + np.abs(np.diff(most, axis=0)).max() + np.abs(np.diff(most, axis=1)).max() < NOISE_PEAK
