"""A recipe shifted by any whole number of lattice units, its noise with it, gives the same bits."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sketchterrain.features import ShapeField
from sketchterrain.terrain import TerrainRecipe, packing
from sketchterrain.terrain.evaluation import Evaluator
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.octaves import SKEW_OTHER, SKEW_SAME, OctaveTable, octave_table

from .conftest import CASES, LAKES, cover, straight_river, tiers

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


def moved(recipe: TerrainRecipe, shift: Shift) -> TerrainRecipe:
    painted = recipe.painted.copy()
    painted["x"] += metres(shift)[0]
    painted["y"] += metres(shift)[1]
    by = np.array([*metres(shift), 0.0])
    rivers = tuple(
        replace(river, points=river.points + by, centreline=river.centreline + by) for river in recipe.rivers
    )
    lakes = tuple(replace(lake, shape=moved_field(lake.shape, shift)) for lake in recipe.lakes)
    covers = tuple(replace(each, shape=moved_field(each.shape, shift)) for each in recipe.covers)
    return replace(recipe, painted=painted, rivers=rivers, lakes=lakes, covers=covers)


def on_the_lattice(recipe: TerrainRecipe) -> TerrainRecipe:
    """The same recipe with all places whole units, so that floats far away lose nothing of them."""
    painted = recipe.painted.copy()
    for axis in ("x", "y"):
        painted[axis] = np.rint(painted[axis] / UNIT) * UNIT
    rivers = []
    for river in recipe.rivers:
        line = river.centreline.copy()
        line[:, :2] = np.rint(line[:, :2] / UNIT) * UNIT
        rivers.append(replace(river, centreline=line, points=line[::20]))
    return replace(recipe, painted=painted, rivers=tuple(rivers))


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

        monkeypatch.setattr(packing, "octave_table", shifted)

    return to


def everything(make_recipe: Callable[..., TerrainRecipe], *names: str) -> TerrainRecipe:
    recipe = make_recipe(
        *(feature for name in names for feature in CASES[name]),
        rivers=(straight_river(), straight_river(900, width=6)),
        lakes=LAKES,
        covers=(cover(1900.0, 2000.0, 60.0, 4, 0.8),),
    )
    assert metres_per_unit(recipe.extent) == UNIT
    return on_the_lattice(recipe)


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
def test_a_shifted_recipe_is_the_same_terrain(shift, make_recipe, shift_noise, context) -> None:
    """Hills, mountains, forest, rivers, lakes and painted ground, heights to materials."""
    compare(everything(make_recipe, "hill", "mountain", "forest"), shift, shift_noise, context)


@tiers("shift", [(19 * PERIOD, -20 * PERIOD)], [(PERIOD, 0)])
def test_dunes_shift_by_their_periods(shift, make_recipe, shift_noise, context) -> None:
    compare(everything(make_recipe, "dune", "hill"), shift, shift_noise, context)


def test_detail_goes_down_to_a_tenth_of_a_metre(make_recipe, context) -> None:
    """Along a line of cells of 0.1 m, far away, there are waves of half a metre, and no steps."""
    x = FAR + np.arange(8192) * 409
    height, _ = Evaluator(make_recipe(), context).points(x, np.full(x.size, -FAR), cell_size=0.1)
    fine = height - Evaluator(make_recipe(), context).points(x, np.full(x.size, -FAR), cell_size=1.0)[0]
    power = np.abs(np.fft.rfft(fine * np.hanning(fine.size))) ** 2
    wavelength = 409 * UNIT * fine.size / np.maximum(np.arange(power.size), 0.5)
    of_detail = power[(wavelength > 0.4) & (wavelength < 1.0)].sum()
    assert of_detail > 20 * power[wavelength < 0.25].sum()
    assert 1e-4 < np.abs(fine).max() < 0.2
