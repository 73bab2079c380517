"""Random tiles over twelve levels: each agrees with its neighbours and carries what its parent holds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.resources import preset_names
from sketchterrain.sketch import load_sketch
from sketchterrain.terrain import build

if TYPE_CHECKING:
    import sketchterrain as st
    from sketchterrain.terrain import Terrain

LEVELS = range(1, 13)
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


@pytest.mark.parametrize(
    ("tiles", "devices"),
    [
        (48, range(1)),
        pytest.param(192, range(len(list_devices())), marks=pytest.mark.slow),
        pytest.param(10_000, range(len(list_devices())), marks=pytest.mark.soak),
    ],
    ids=["48 tiles", "192 tiles", "10,000 tiles"],
)
@pytest.mark.parametrize("preset", preset_names())
def test_tiles_agree_with_their_neighbours_and_parents(tiles: int, devices: range, preset: str) -> None:
    """So many tiles a device, over all presets and levels."""
    for device in devices:
        check_tiles(opened(device, preset), preset, tiles)


def check_tiles(terrain: Terrain, preset: str, tiles: int) -> None:
    rng = np.random.default_rng([list(preset_names()).index(preset), 4])
    each = -(-tiles // (len(preset_names()) * len(LEVELS)))
    for level in LEVELS:
        chosen = drawn(terrain, level, each, rng)
        for first in range(0, each, AT_ONCE):
            part = chosen[first : first + AT_ONCE]
            keys = [key for one in part for key in (one.key, one.beside, one.over)]
            found = terrain.tiles(keys)
            for number in range(len(part)):
                check(*found[3 * number : 3 * number + 3])
