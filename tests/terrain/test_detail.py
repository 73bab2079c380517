"""Bounds of a tile's missing detail hold, and are not much larger than the detail."""

from functools import cache

import numpy as np

import sketchterrain as st
from sketchterrain.compute import ComputeContext
from sketchterrain.resources import preset_names
from sketchterrain.sketch import load_sketch
from sketchterrain.terrain import Terrain, build
from sketchterrain.terrain.detail import NOISE_PEAK
from sketchterrain.terrain.octaves import UNSKEW

from .conftest import CASES, LAKES, straight_river, tiers

LEVELS = range(-4, 13)
MOST_TIMES = 30.0
"""How many times what is there the bound is at most, in the median of a level's tiles."""


@cache
def opened(preset: str) -> Terrain:
    return build(load_sketch(preset), device=ComputeContext())


def missing(terrain: Terrain, tile: st.Tile, rng: np.random.Generator) -> float:
    """The largest difference between a tile's level and full detail at places of it."""
    west, south, east, north = tile.bounds
    x, y = rng.uniform(west, east, 400), rng.uniform(south, north, 400)
    if terrain.recipe.rivers:
        line = np.concatenate([river.centreline[:, :2] for river in terrain.recipe.rivers])
        inside = np.all((line > [west, south]) & (line < [east, north]), axis=-1)
        if inside.any():
            beside = line[inside][rng.integers(inside.sum(), size=400)] + rng.normal(0, 8, (400, 2))
            beside = np.clip(beside, [west, south], [east, north])
            x, y = np.append(x, beside[:, 0]), np.append(y, beside[:, 1])
    full, shown = (terrain.heights(x, y, cell_size=cell).astype(float) for cell in (0.0, tile.cell_size))
    return float(np.abs(full - shown).max())


@tiers("preset", ["valley_river"], preset_names())
def test_full_detail_stays_within_the_bound(preset) -> None:
    terrain = opened(preset)
    rng = np.random.default_rng(8)
    rivers = [river.centreline[:, :2] for river in terrain.recipe.rivers]
    for level in LEVELS[::2] if preset == "valley_river" else LEVELS:
        width = terrain.extent / 2.0**level
        place = rng.uniform(-0.2, 1.2, (9, 2)) * np.array(terrain.size)
        if rivers:
            line = np.concatenate(rivers)
            place[6:] = line[rng.integers(len(line), size=3)]
        keys = [(level, int(column), int(row)) for column, row in np.floor(place / width)]
        tiles = terrain.tiles(keys)
        found = np.array([missing(terrain, tile, rng) for tile in tiles])
        bound = np.array([tile.detail_bound for tile in tiles])
        assert (found <= bound).all(), level
        told = bound[found > 1e-3] / found[found > 1e-3]
        if level >= 2 and len(told) > 4:
            assert np.median(told) < MOST_TIMES, level


@tiers("name", ["eroded", "river", "everything"], CASES)
def test_each_kind_of_feature_stays_within_it(name, make_recipe, valley) -> None:
    features = [one for kind in CASES for one in CASES[kind]] if name == "everything" else CASES[name]
    rivers = (straight_river(), straight_river(900, width=6)) if name in ("river", "everything") else ()
    lakes = LAKES if name in ("lake", "everything") else ()
    terrain = Terrain(valley.sketch, make_recipe(*features, rivers=rivers, lakes=lakes), valley.context)
    rng = np.random.default_rng(3)
    for level in range(-2, 12):
        span = 4096.0 / 2.0**level
        places = rng.uniform(400, 3600, (6, 2)) // span
        for tile in terrain.tiles([(level, int(column), int(row)) for column, row in places]):
            assert missing(terrain, tile, rng) <= tile.detail_bound, level


def test_full_detail_misses_nothing(valley) -> None:
    fine = next(level for level in range(20) if valley.extent / 2.0**level / 64 <= 0.125)
    tile = valley.tile(fine, 2 ** (fine - 1), 2 ** (fine - 1))
    assert tile.detail_bound == 0.0
    coarser = [valley.tile(level, 2**level // 2, 2**level // 2).detail_bound for level in range(2, fine - 1)]
    assert min(coarser) > 0


def test_filling_gives_the_bounds_too(valley) -> None:
    keys = [(6, 20, 31), (2, 1, 2), (6, 21, 31)]
    bounds = valley.fill_tiles(keys, valley.tile_store(3), [0, 1, 2])
    np.testing.assert_array_equal(bounds, [tile.detail_bound for tile in valley.tiles(keys)])


def test_no_octave_of_noise_goes_beyond_its_peak() -> None:
    """All three corners with the gradients that make most of them, and what may be between samples."""
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
