"""Tiles, rasters and single heights: one function of place and cell size."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.terrain import Terrain
from sketchterrain.terrain.kernel_arguments import KernelArguments, Reaching
from sketchterrain.terrain.lattice import QUADS
from sketchterrain.terrain.patch_places import tile_patches

if TYPE_CHECKING:
    import sketchterrain as st

LEVELS = range(12)


def vertices(tile: st.Tile) -> tuple[np.ndarray, np.ndarray]:
    west, south, east, north = tile.bounds
    x = np.linspace(west, east, QUADS + 1)
    y = np.linspace(north, south, QUADS + 1)
    return np.broadcast_to(x, (65, 65)), np.broadcast_to(y[:, None], (65, 65))


def test_neighbours_share_border_vertices(valley: st.Terrain) -> None:
    """Heights, normals, materials and parents of 200 random pairs, bit for bit."""
    rng = np.random.default_rng(9)
    for level in (2, 4, 7, 10, 13):
        span = 2**level
        columns, rows = rng.integers(-span // 4, span + span // 4 + 1, (2, 40))
        sides = rng.integers(0, 2, 40)
        keys = [(level, int(c), int(r)) for c, r in zip(columns, rows, strict=True)]
        beside = [(level, c + int(s), r + 1 - int(s)) for (_, c, r), s in zip(keys, sides, strict=True)]
        for one, two, east in zip(valley.tiles(keys), valley.tiles(beside), sides, strict=True):
            for name in ("height", "normal", "materials", "parent_height", "parent_normal"):
                a, b = getattr(one, name), getattr(two, name)
                shared = (a[:, -1], b[:, 0]) if east else (a[0], b[-1])
                np.testing.assert_array_equal(*shared)


def test_heights_at_a_tiles_vertices_are_the_tiles(valley: st.Terrain) -> None:
    for level in (-3, 0, 3, 6, 9, 12, 16, 18):
        tile = valley.tile(level, int(0.55 * 2.0**level), int(0.47 * 2.0**level))
        heights = valley.heights(*vertices(tile), cell_size=tile.cell_size)
        np.testing.assert_array_equal(heights, tile.height, err_msg=str(level))


def test_one_vertex_is_one_value(valley: st.Terrain) -> None:
    """Through its four tiles, and through heights alone."""
    for level in LEVELS:
        column, row = 2**level // 2 + (level > 2), 2**level // 3
        tiles = valley.tiles([(level, column - i, row - j) for j in (0, 1) for i in (0, 1)])
        corner = [
            tile.height[0 if j else -1, -1 if i else 0]
            for tile, (j, i) in zip(tiles, np.ndindex(2, 2), strict=True)
        ]
        x, y = tiles[0].bounds[:2]
        alone = valley.heights(x, y, cell_size=tiles[0].cell_size)
        assert {float(z) for z in corner} == {float(alone)}, level


def test_culling_changes_no_bit(valley: st.Terrain, monkeypatch: pytest.MonkeyPatch) -> None:
    keys = [(5, 12, 14), (5, 20, 9), (5, 25, 30), (3, 3, 3)]
    culled = valley.tiles(keys)
    monkeypatch.setattr("sketchterrain.terrain.reach_index.ReachIndex.touching", everything_touches)
    # A terrain that has gathered nothing yet: all painted features stand in the list of every block.
    uncut = Terrain(valley.sketch, valley.recipe, valley.context)
    for one, two in zip(culled, uncut.tiles(keys), strict=True):
        for name in ("height", "normal", "materials", "parent_height", "parent_normal"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def everything_touches(index, blocks):
    block, item = np.indices((len(blocks), len(index))).reshape(2, -1)
    return block, item


def test_tiles_alone_together_and_rasters_have_the_same_bits(valley: st.Terrain) -> None:
    keys = [(6, c, r) for c in range(20, 30) for r in range(30, 36)]
    together, alone = valley.tiles(keys)[17], valley.tile(*keys[17])
    raster, tile = valley.raster(257), valley.tile(2, 1, 2)
    for name in ("height", "normal", "materials"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))
        np.testing.assert_array_equal(getattr(raster, name)[64:129, 64:129], getattr(tile, name))


def test_raster_of_any_size(valley: st.Terrain) -> None:
    for size in (2, 3, 64, 65, 66, 100, 130):
        raster = valley.raster(size)
        assert raster.height.shape == (size, size)
        x = np.linspace(0, valley.size[0], size)
        y = np.linspace(valley.size[1], 0, size)
        heights = valley.heights(x, y[:, None], cell_size=valley.extent / (size - 1))
        np.testing.assert_array_equal(raster.height, heights, err_msg=str(size))


def test_normals_are_the_slopes_of_the_heights_and_weights_sum_to_one(
    valley: st.Terrain, desert: st.Terrain
) -> None:
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


def test_coarser_cells_only_lose_detail(valley: st.Terrain) -> None:
    """The ground at a cell size differs from full detail by less the finer the cells."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, valley.extent, (2, 3000))
    full = valley.heights(x, y)
    rms = [float(np.sqrt(np.mean((valley.heights(x, y, cell_size=c) - full) ** 2))) for c in (1, 4, 16, 64)]
    assert rms == sorted(rms)
    assert rms[0] < 0.2
    np.testing.assert_array_equal(valley.heights(x, y, cell_size=0.05), full)


def test_the_world_goes_on_outside_the_sketch(valley: st.Terrain) -> None:
    heights = valley.heights(np.linspace(-2e5, -1e5, 2000), np.linspace(3e5, 1e5, 2000), cell_size=20)
    assert heights.max() - heights.min() > 60
    assert np.isfinite(heights).all()
    for level in (-12, -8, -5):
        tile = valley.tile(level, 0, -1)
        assert np.isfinite(tile.height).all(), level
        assert np.abs(tile.height).max() < 1000, level


def test_refused_queries(valley: st.Terrain) -> None:
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


@pytest.mark.parametrize(
    "level", [-12, 0, 5, 13, *(pytest.param(n, marks=pytest.mark.slow) for n in (-3, 2, 9, 18))]
)
def test_a_tile_carries_its_parent(valley: st.Terrain, level: int) -> None:
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
        np.testing.assert_array_equal(tile.parent_height[::2, 1::2], np.float32(0.5) * (z[:, :-1] + z[:, 1:]))
        np.testing.assert_array_equal(tile.parent_height[1::2, ::2], np.float32(0.5) * (z[:-1] + z[1:]))
        np.testing.assert_array_equal(
            tile.parent_height[1::2, 1::2], np.float32(0.5) * (z[:-1, :-1] + z[1:, 1:])
        )
        np.testing.assert_allclose(np.linalg.norm(tile.parent_normal, axis=-1), 1, atol=1e-6)


@pytest.mark.parametrize("level", [4, 9])
def test_32_and_64_bit_positions_give_the_same_bits(
    valley: st.Terrain, level: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Positions in 32 bits from a tile's corner, and in 64 bits from the origin."""
    keys = [(level, c, r) for c in (-2, 5, 2**level // 2) for r in (3, -1)]
    near = valley.tiles(keys)
    monkeypatch.setattr("sketchterrain.terrain.patches.fits_patches", lambda *_: False)
    for one, two in zip(near, valley.tiles(keys), strict=True):
        for name in ("height", "normal", "materials", "parent_height", "parent_normal"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_tiles_are_filled_where_they_live(valley: st.Terrain) -> None:
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
def test_filling_allocates_nothing_and_waits_for_nothing(
    bare: bool, valley: st.Terrain, make_recipe: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once there is room, a batch is one transfer a launch of heights.

    Ground with features must have been looked at before; without any, no ground is new.
    """
    terrain = Terrain(valley.sketch, make_recipe(), valley.context) if bare else valley
    keys = [(5, c, r) for c in range(10, 18) for r in range(10, 18)]
    store = terrain.tile_store(len(keys))
    terrain.fill_tiles(keys, store, range(len(keys)))
    calls: list[str] = []
    whole = type(terrain.context)._call

    def counted(self: object, doing: str, *given: object, **named: object) -> object:
        calls.append(doing)
        return whole(self, doing, *given, **named)

    monkeypatch.setattr(type(terrain.context), "_call", counted)
    again = [(5, c + 10 * bare, r) for _, c, r in keys]
    terrain.fill_tiles(again, store, range(len(keys)))
    launches = [call.removeprefix("launching ") for call in calls if call.startswith("launching")]
    assert launches == ["patches", "surfaces", "patches", "parents"]
    # A transfer may wait for the one three before it.
    assert set(calls) - {f"launching {name}" for name in launches} == {"uploading"}


def test_rules_that_are_left_out_would_cover_nothing(
    valley: st.Terrain, desert: st.Terrain, monkeypatch: pytest.MonkeyPatch
) -> None:
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
