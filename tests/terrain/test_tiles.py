"""Tiles, rasters and single heights: one function of place and cell size, on every device."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.errors import InputError
from sketchterrain.resources import preset_names
from sketchterrain.sketch import load_sketch
from sketchterrain.terrain import Terrain, build
from sketchterrain.terrain.kernel_arguments import KernelArguments, Reaching
from sketchterrain.terrain.lattice import QUADS
from sketchterrain.terrain.patch_places import tile_patches

from .conftest import assert_same, half_sums, launches, tiers

LEVELS = range(12)


def vertices(tile: st.Tile) -> tuple[np.ndarray, np.ndarray]:
    west, south, east, north = tile.bounds
    x = np.linspace(west, east, QUADS + 1)
    y = np.linspace(north, south, QUADS + 1)
    return np.broadcast_to(x, (65, 65)), np.broadcast_to(y[:, None], (65, 65))


def test_heights_at_a_tiles_vertices_are_the_tiles(valley) -> None:
    for level in (-3, 0, 3, 6, 9, 12, 16, 18):
        tile = valley.tile(level, int(0.55 * 2.0**level), int(0.47 * 2.0**level))
        heights = valley.heights(*vertices(tile), cell_size=tile.cell_size)
        np.testing.assert_array_equal(heights, tile.height, err_msg=str(level))


def test_culling_changes_no_bit(valley, monkeypatch) -> None:
    keys = [(5, 12, 14), (5, 20, 9), (5, 25, 30), (3, 3, 3)]
    culled = valley.tiles(keys)
    monkeypatch.setattr("sketchterrain.terrain.reach_index.ReachIndex.touching", everything_touches)
    # A terrain that has gathered nothing yet: all painted features stand in the list of every block.
    uncut = Terrain(valley.sketch, valley.recipe, valley.context)
    for one, two in zip(culled, uncut.tiles(keys), strict=True):
        assert_same(one, two, parents=True)


def everything_touches(index, blocks):
    block, item = np.indices((len(blocks), len(index))).reshape(2, -1)
    return block, item


def test_tiles_alone_together_and_rasters_have_the_same_bits(valley) -> None:
    keys = [(6, c, r) for c in range(20, 30) for r in range(30, 36)]
    together, alone = valley.tiles(keys)[17], valley.tile(*keys[17])
    raster, tile = valley.raster(257), valley.tile(2, 1, 2)
    for name in ("height", "normal", "materials"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))
        np.testing.assert_array_equal(getattr(raster, name)[64:129, 64:129], getattr(tile, name))


def test_raster_of_any_size(valley) -> None:
    for size in (2, 3, 64, 65, 66, 100, 130):
        raster = valley.raster(size)
        assert raster.height.shape == (size, size)
        x = np.linspace(0, valley.size[0], size)
        y = np.linspace(valley.size[1], 0, size)
        heights = valley.heights(x, y[:, None], cell_size=valley.extent / (size - 1))
        np.testing.assert_array_equal(raster.height, heights, err_msg=str(size))


def test_normals_are_the_slopes_of_the_heights_and_weights_sum_to_one(valley, desert) -> None:
    for terrain in (valley, desert):
        raster = terrain.raster(513)
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
        # float32 heights of 500 m step by 3e-5 m, over spans of 24 m.
        assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.05


def test_coarser_cells_only_lose_detail(valley) -> None:
    """The ground at a cell size differs from full detail by less the finer the cells."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, valley.extent, (2, 3000))
    full = valley.heights(x, y)
    rms = [float(np.sqrt(np.mean((valley.heights(x, y, cell_size=c) - full) ** 2))) for c in (1, 4, 16, 64)]
    assert rms == sorted(rms)
    assert rms[0] < 0.2
    np.testing.assert_array_equal(valley.heights(x, y, cell_size=0.05), full)


def test_the_world_goes_on_outside_the_sketch(valley) -> None:
    heights = valley.heights(np.linspace(-2e5, -1e5, 2000), np.linspace(3e5, 1e5, 2000), cell_size=20)
    assert heights.max() - heights.min() > 60
    assert np.isfinite(heights).all()
    for level in (-12, -8, -5):
        tile = valley.tile(level, 0, -1)
        assert np.isfinite(tile.height).all(), level
        assert np.abs(tile.height).max() < 1000, level


def test_refused_queries(valley) -> None:
    for x in (np.nan, np.inf, 1e30):
        with pytest.raises(InputError, match="finite and within"):
            valley.heights(x, 0.0)
    with pytest.raises(InputError, match="cell_size"):
        valley.heights(0.0, 0.0, cell_size=-1)
    with pytest.raises(InputError, match="level must be -12 … 18, not 19"):
        valley.tile(19, 0, 0)
    with pytest.raises(InputError, match="at least 2"):
        valley.raster(1)
    store = valley.tile_store(4)
    for slots in ([0], [1, 1], [0, 4], [-1, 0]):
        with pytest.raises(InputError, match="slots"):
            valley.fill_tiles([(3, 0, 0), (3, 1, 0)], store, slots)
    assert valley.heights(np.zeros(0), np.zeros(0)).shape == (0,)


@tiers("level", [-12, 0, 5, 13], [-3, 2, 9, 18])
def test_a_tile_carries_its_parent(valley, level) -> None:
    """Bit-equal where they share vertices; between them half the sum along an edge or the diagonal."""
    half = QUADS // 2
    for column, row in ((3, 2), (2, 3), (-1, -5)):
        tile = valley.tile(level, column, row)
        if level > -12:
            parent = valley.tile(level - 1, column // 2, row // 2)
            rows = slice(0, half + 1) if row % 2 else slice(half, None)
            columns = slice(half, None) if column % 2 else slice(0, half + 1)
            np.testing.assert_array_equal(tile.parent_height[::2, ::2], parent.height[rows, columns])
            np.testing.assert_array_equal(tile.parent_normal[::2, ::2], parent.normal[rows, columns])
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


def test_tiles_are_filled_where_they_live(valley) -> None:
    """In slots of a store, of several levels in one call; other slots stay as they are."""
    keys = [(6, 20, 31), (6, 21, 31), (2, 1, 2), (9, -4, 700), (6, 30, 30)]
    slots = [7, 0, 3, 6, 2]
    store = valley.tile_store(9)
    buffers = {"ground": (store.ground, 4), "materials": (store.materials, 8), "parent": (store.parent, 4)}
    for buffer, width in buffers.values():
        valley.context.write(buffer, np.full(9 * 65 * 65 * width, np.nan, np.float32)).wait()
    valley.fill_tiles(keys, store, slots)
    filled = {
        name: valley.context.download(buffer, (9, 65, 65, width), np.float32)
        for name, (buffer, width) in buffers.items()
    }
    for tile, slot in zip(valley.tiles(keys), slots, strict=True):
        np.testing.assert_array_equal(filled["ground"][slot, ..., 3], tile.height)
        np.testing.assert_array_equal(filled["ground"][slot, ..., :3], tile.normal)
        np.testing.assert_array_equal(filled["materials"][slot], tile.materials)
        np.testing.assert_array_equal(filled["parent"][slot, ..., 3], tile.parent_height)
        np.testing.assert_array_equal(filled["parent"][slot, ..., :3], tile.parent_normal)
    assert all(np.isnan(part[[1, 4, 5, 8]]).all() for part in filled.values())


@pytest.mark.parametrize("bare", [False, True])
def test_filling_allocates_nothing_and_waits_for_nothing(bare, valley, make_recipe, calls) -> None:
    """Once there is room, a batch is one transfer a launch of heights.

    Ground with features must have been looked at before; without any, no ground is new.
    """
    terrain = Terrain(valley.sketch, make_recipe(), valley.context) if bare else valley
    keys = [(5, c, r) for c in range(10, 18) for r in range(10, 18)]
    store = terrain.tile_store(len(keys))
    terrain.fill_tiles(keys, store, range(len(keys)))
    calls.clear()
    again = [(5, c + 10 * bare, r) for _, c, r in keys]
    terrain.fill_tiles(again, store, range(len(keys)))
    assert launches(calls) == ["patches", "surfaces", "patches", "parents"]
    # A transfer may wait for the one three before it.
    assert {call for call in calls if not call.startswith("launching")} == {"uploading"}


def test_rules_that_are_left_out_would_cover_nothing(valley, desert, monkeypatch) -> None:
    """Materials' rules on tiles without mountain, dune, forest or water: the same bits as with all rules."""
    for terrain in (valley, desert):
        keys = [(5, c, r) for c in range(0, 32, 5) for r in range(0, 32, 5)]
        left_out = terrain.tiles(keys)
        blocks = tile_patches(5, [key[1:] for key in keys], terrain.extent, up=0).blocks
        absent = KernelArguments(terrain.recipe, terrain.context).reaching(blocks, 4.0).absent
        assert len(np.unique(absent)) > 2
        with monkeypatch.context() as patch:
            patch.setattr(Reaching, "absent", np.zeros(len(keys), np.int32))
            every = terrain.tiles(keys)
        for one, two in zip(left_out, every, strict=True):
            np.testing.assert_array_equal(one.materials, two.materials)


DRAWN_LEVELS = range(1, 13)
FAR = 1e7  # m
AT_ONCE = 96


@dataclass(frozen=True)
class Drawn:
    """A tile, the one east or north of it, and the one over it."""

    key: tuple[int, int, int]
    beside: tuple[int, int, int]
    over: tuple[int, int, int]


@cache
def opened(device: int, preset: str) -> Terrain:
    return build(load_sketch(preset), device=ComputeContext(list_devices()[device]))


def drawn(terrain: Terrain, level: int, count: int, rng: np.random.Generator) -> list[Drawn]:
    """Half of them in and around the sketch, the others up to 10,000 km away, some of these on the axes."""
    width = terrain.extent / 2.0**level
    near = rng.uniform(-0.25, 1.25, (count, 2)) * np.array(terrain.size)
    away = rng.choice([-1.0, 0.0, 1.0], (count, 2)) * FAR * rng.choice([1.0, rng.random()], (count, 1))
    place = np.where(rng.random((count, 1)) < 0.5, near, near + away)
    tiles = []
    for column, row in np.floor(place / width).astype(np.int64).tolist():
        east = int(rng.integers(2))
        beside = (level, column + east, row + 1 - east)
        tiles.append(Drawn((level, column, row), beside, (level - 1, column // 2, row // 2)))
    return tiles


def check(tile: st.Tile, beside: st.Tile, over: st.Tile) -> None:
    east = beside.column > tile.column
    for name in ("height", "normal", "materials", "parent_height", "parent_normal"):
        one, two = getattr(tile, name), getattr(beside, name)
        np.testing.assert_array_equal(*((one[:, -1], two[:, 0]) if east else (one[0], two[-1])))
    rows = slice(0, 33) if tile.row % 2 else slice(32, None)
    columns = slice(32, None) if tile.column % 2 else slice(0, 33)
    np.testing.assert_array_equal(tile.parent_height[::2, ::2], over.height[rows, columns])
    np.testing.assert_array_equal(tile.parent_normal[::2, ::2], over.normal[rows, columns])


@tiers(("tiles", "devices"), [(96, 1)], [(192, None)], [(10_000, None)])
@pytest.mark.parametrize("preset", preset_names())
def test_tiles_agree_with_their_neighbours_and_parents(tiles, devices, preset) -> None:
    """So many tiles a device, over all presets and levels."""
    for device in range(devices or len(list_devices())):
        check_tiles(opened(device, preset), preset, tiles)


def check_tiles(terrain: Terrain, preset: str, tiles: int) -> None:
    rng = np.random.default_rng([list(preset_names()).index(preset), 4])
    each = -(-tiles // (len(preset_names()) * len(DRAWN_LEVELS)))
    for level in DRAWN_LEVELS:
        chosen = drawn(terrain, level, each, rng)
        for first in range(0, each, AT_ONCE):
            part = chosen[first : first + AT_ONCE]
            keys = [key for one in part for key in (one.key, one.beside, one.over)]
            found = terrain.tiles(keys)
            for number in range(len(part)):
                check(*found[3 * number : 3 * number + 3])


def test_the_same_seed_gives_the_same_bits_and_another_another_terrain(context) -> None:
    one, two, other = (
        build(load_sketch("valley_river"), seed=seed, device=context).raster(129) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one.height, two.height)
    np.testing.assert_array_equal(one.materials, two.materials)
    assert np.abs(one.height - other.height).mean() > 5
    # The mountains are painted at the same places, so the broad shape stays.
    assert np.corrcoef(one.height.ravel(), other.height.ravel())[0, 1] > 0.75
