"""Rivers end in the sea, at its level, and no paint in it becomes water of its own."""

from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.terrain.host_heights import host_heights
from tests.traced import trace_hydrology

SIZE, PIXEL = 96, 40.0
ROW, COLUMN = np.mgrid[:SIZE, :SIZE]


def random_island(seed: int) -> Sketch:
    """An island with bays and rivers in all directions, some painted into the sea, some across it."""
    rng = np.random.default_rng(seed)
    noise = ndimage.gaussian_filter(rng.normal(size=(SIZE, SIZE)), 7)
    away = np.hypot(COLUMN - rng.uniform(30, 66), ROW - rng.uniform(30, 66))
    land = away / rng.uniform(28, 42) - 0.25 * noise / noise.std() < 1
    river = np.zeros((SIZE, SIZE), np.uint8)
    for label in rng.integers(1, 3, 6):
        at, heading = rng.uniform(20, 76, 2), rng.uniform(0, 2 * np.pi)
        for _ in range(rng.integers(8, 50)):
            heading += rng.uniform(-0.4, 0.4)
            at += 1.2 * np.array([np.cos(heading), np.sin(heading)])
            river[(ROW - at[0]) ** 2 + (COLUMN - at[1]) ** 2 <= 1.0] = label
    mountain = ((COLUMN - 48) ** 2 + (ROW - 48) ** 2 < 11**2).astype(np.uint8)
    lake = (np.hypot(COLUMN - rng.uniform(10, 86), ROW - rng.uniform(10, 86)) < 4).astype(np.uint8)
    layers = {"mountain": mountain, "river": river, "lake": lake}
    level = float(rng.choice([0.0, -7.0, 20.0]))
    if seed % 4:
        layers["sea"] = np.where(land, 0, rng.integers(1, 3)).astype(np.uint8)
    return Sketch(
        extent=SIZE * PIXEL,
        seed=seed,
        fidelity=float(rng.choice([0.5, 0.8, 1.0])),
        layers=layers,
        ground={"relief": 70.0},
        coast={"sea_level": level, "shelf": 400.0},
        labels={("mountain", 1): {"height": 200.0}, ("river", 2): {"width": 30.0, "depth": 4.0}},
    )


@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 12), marks=pytest.mark.slow)])
def test_rivers_of_random_islands_end_at_the_level(seeds) -> None:
    """Water falls all the way down to the sea, never below it; at the mouth nothing dams it."""
    mouths = 0
    for seed in seeds:
        sketch = random_island(seed)
        recipe = make_recipe(sketch)
        level = recipe.sea_level
        assert level is not None
        ends = {round(each.x, 3) for each in recipe.resolutions if "ends in the sea" in each.line}
        for river in recipe.rivers:
            water = river.centreline[:, 2]
            assert (np.diff(water) <= 0).all(), seed
            assert water.min() >= level - 1e-6, seed
            if round(float(river.centreline[-1, 0]), 3) not in ends:
                continue
            mouths += 1
            assert water[-1] == pytest.approx(level, abs=1e-6)
            ground = host_heights(recipe, *river.centreline[:, :2].T)
            assert (ground < water + 0.05)[1:].all(), seed  # its bed is under water down to the end
            assert ground[-1] < level
        assert all(lake.level > level for lake in recipe.lakes), seed
    assert mouths >= len(seeds)


HALF = np.where(COLUMN < 60, 0, 1).astype(np.uint8)


def painted(mask: Any, **more: Any) -> Sketch:
    layers = {"river": mask.astype(np.uint8), "sea": HALF}
    return Sketch(extent=SIZE * PIXEL, fidelity=1.0, layers=layers | more)


def ground(x, _):
    """Land that falls eastward to a sea from x = 2400 m on."""
    return np.where(x < 2400, 0.01 * (2400 - x) + 0.5, -0.02 * (x - 2400))


def test_courses_are_cut_at_the_coast() -> None:
    for last in (62, 80, SIZE):
        found = trace_hydrology(painted((abs(ROW - 40) < 1) & (last > COLUMN)), seed=1, ground=ground)
        (river,) = found.rivers
        assert river.centreline[0, 2] > 10
        assert 2400 < river.centreline[-1, 0] < 2500, last
        width = river.centreline_width
        assert width[-1] == pytest.approx(2 * width[len(width) // 2], rel=0.3)  # an estuary
        assert [each.line for each in found.resolutions] == ["river 1 ends in the sea: water at 0.0 m"]
        assert not found.lakes  # beyond the edge there is only sea


def test_a_strait_ends_a_river_and_a_stream_in_it_is_no_barrier() -> None:
    """What is painted beyond an arm of the sea is left out; a narrow one is crossed."""
    for width, ends in ((50.0, False), (400.0, True)):

        def arm(x, _, width=width):
            return np.where(abs(x - 2000) < width / 2, -3.0, 0.01 * (4000 - x))

        sketch = painted((abs(ROW - 40) < 1) & (COLUMN > 5) & (COLUMN < 90), sea=0 * HALF)
        (river,) = trace_hydrology(sketch.replace(coast={"sea_level": 0.0}), seed=1, ground=arm).rivers
        assert (river.centreline[-1, 0] < 2000) == ends, width


def test_tributaries_that_meet_in_the_sea_end_there_each() -> None:
    mask = (abs(ROW - 40) < 1) & (COLUMN < 85) | (abs(ROW - 40 - (80 - COLUMN)) < 1) & (COLUMN > 35) & (
        ROW > 40
    )
    found = trace_hydrology(painted(mask), seed=1, ground=ground)
    assert len(found.rivers) == 2
    for river in found.rivers:
        assert river.centreline[-1, 2] == pytest.approx(0.0, abs=1e-9)
        assert 2400 < river.centreline[-1, 0] < 2500


def test_paint_in_the_sea_is_ignored_and_reported() -> None:
    strokes = (abs(ROW - 40) < 1) & (COLUMN > 70) & (COLUMN < 90)
    lake = (np.hypot(COLUMN - 80, ROW - 70) < 5).astype(np.uint8)
    found = trace_hydrology(painted(strokes, lake=lake), seed=1, ground=ground)
    assert not found.rivers
    assert not found.lakes
    lines = {each.line: (each.x, each.y) for each in found.resolutions}
    assert set(lines) == {"a river painted in the sea is ignored", "a lake painted in the sea is ignored"}
    np.testing.assert_allclose(lines["a lake painted in the sea is ignored"], (3220, 1020), atol=41)


def test_lakes_and_rivers_beside_the_sea_are_above_it() -> None:
    """Also where the ground is as low as the sea."""
    lake = (np.hypot(COLUMN - 50, ROW - 70) < 5).astype(np.uint8)
    sketch = painted((abs(ROW - 40) < 1) & (COLUMN > 5), lake=lake)
    found = trace_hydrology(sketch, seed=1, ground=lambda x, y: np.where(x < 2400, 0.05, -5.0))
    (level,) = (each.level for each in found.lakes)
    assert level == pytest.approx(0.2)
    assert found.rivers[0].centreline[:, 2].min() == pytest.approx(0.0, abs=1e-9)
