"""Thinning of far plants: evenly by level, steadily, within a budget, with the same cover."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.render import Camera, Quality, Sun
from sketchterrain.render.allowance import Allowance
from sketchterrain.render.forest import Forest
from sketchterrain.render.plant_stand import CELL, stand_of
from sketchterrain.render.thinning import (
    FILL,
    SOFT,
    WIDEST,
    Thinning,
    bulk_of,
    hold_of,
    share_of,
    whim_of,
    width_of,
)
from sketchterrain.terrain.plant import PLANT

SIZE = (320, 180)
EYE = (3000.0, 300.0, 160.0)
CAMERA = Camera(EYE, (3000.0, 1700.0, -200.0), fov=60.0)
SPACING = 5.0
LEVELS = 5


class Taiga:
    """A level forest without an end: a lattice of which every second row and column is a level up."""

    extent = 6000.0
    context = None

    def heights(self, x, y, *, cell_size=0.0):
        return np.zeros(np.broadcast(x, y).shape, np.float32)

    def foliage(self, west, south, east, north):
        i, j = np.meshgrid(
            np.arange(np.ceil(west / SPACING), np.ceil(east / SPACING)).astype(np.int64),
            np.arange(np.ceil(south / SPACING), np.ceil(north / SPACING)).astype(np.int64),
        )
        i, j = i.ravel(), j.ravel()
        plants = np.zeros(i.size, PLANT)
        plants["x"], plants["y"] = SPACING * i + 0.3, SPACING * j + 0.3
        plants["scale"] = 1.0
        for level in range(1, LEVELS):
            plants["level"] += ((i % 2**level == 0) & (j % 2**level == 0)).astype(np.uint8)
        return plants

    def foliage_steps(self, west, south, east, north):
        yield
        return self.foliage(west, south, east, north)


def drawn(forest):
    """Feet (m in the world), widths and shares of what the last view chose, each plant once."""
    rows = [
        np.frombuffer(batch._instances.read(), np.float32).reshape(-1, 8)[: batch.count]
        for batch in forest._batches
    ]
    rows = np.concatenate(rows).astype(float)
    place = np.round((rows[:, :2] + forest._origin) / SPACING).astype(np.int64)
    code, first, back = np.unique(place @ [1, 1 << 32], return_index=True, return_inverse=True)
    share = np.bincount(back.ravel(), rows[:, 7])
    return code, place[first] * SPACING, np.hypot(rows[first, 4], rows[first, 5]), share


def test_whims_are_even_and_go_by_level():
    rng = np.random.default_rng(1)
    chance = rng.uniform(0.0, 1.0, 400_000)
    level = np.floor(-np.log(rng.uniform(0.0, 1.0, chance.size)) / np.log(4.0)).astype(np.uint8)
    whim = whim_of(level, chance)
    shares = np.histogram(whim, bins=20, range=(0.0, 1.0))[0] / whim.size
    assert np.abs(shares - 0.05).max() < 0.002
    for above in range(4):
        assert whim[level == above].max() <= whim[level > above].min()


def test_plants_are_kept_by_the_square_of_their_size_and_fade_gradually():
    rng = np.random.default_rng(2)
    whim = rng.uniform(0.0, 1.0, 200_000)
    hold = hold_of(np.full(whim.size, 10.0), whim)
    for ratio in (0.5, 1.0, 2.0, 4.0):
        away = np.full(whim.size, 1000.0 * ratio)
        kept = (share_of(hold, away, 0.01) > 0.0).mean()
        assert kept == pytest.approx(min(ratio**-2, 1.0), rel=0.05)
        width = width_of(np.full(whim.size, 10.0), away, 0.01)
        assert width == pytest.approx(np.clip(ratio, 1.0, WIDEST))
        assert ratio > WIDEST or kept * width[0] ** 2 == pytest.approx(1.0, rel=0.05)  # cover

    away = np.linspace(500.0, 2500.0, 4001)
    share = share_of(np.full(away.size, 10.0), away, 0.01)
    width = width_of(np.full(away.size, 10.0), away, 0.01)
    assert share[0] == 1.0
    assert share[-1] == 0.0
    step = np.abs(np.diff(away) / away[1:]).max()
    assert np.abs(np.diff(share)).max() < 2.0 * step / SOFT
    assert np.abs(np.diff(width)).max() < 2.0 * step


def test_plants_of_a_cell_are_sorted_by_how_long_they_stay():
    stand = stand_of(Taiga().foliage(0.0, 0.0, CELL, CELL), np.zeros(2))
    assert (np.diff(stand.hold) <= 0.0).all()
    assert (stand.whim[:4] > 0.98).all()
    # Plants that stand alone count for more.
    assert bulk_of(np.array([12.0]), np.array([1.0])) == pytest.approx(12.0)
    assert bulk_of(np.array([12.0]), np.array([0.0])) > bulk_of(np.array([12.0]), np.array([0.9]))


def test_the_scale_keeps_the_budget_at_once():
    rng = np.random.default_rng(3)
    held, copies = rng.pareto(2.0, 5000) + 0.001, rng.integers(1, 3, 5000)
    for most in (1, 40, 1000, 10_000):
        for elapsed in (None, 0.05):
            thinning = Thinning(most)
            for _ in range(3):
                thinning.follow(held, copies, least=1e-3, elapsed=elapsed)
                assert copies[held > thinning.angle].sum() <= most
        if most < 5000:
            assert copies[held > thinning.angle].sum() > (FILL - 0.01) * most - 2
        else:
            assert thinning.angle == 1e-3


def test_the_scale_follows_smoothly_and_converges_to_that_of_a_still():
    rng = np.random.default_rng(4)
    held = rng.pareto(2.0, 20_000) + 0.001
    crowd, few = held, held[:1500]
    still, thinning = Thinning(1000), Thinning(1000)
    thinning.follow(few, np.ones(1500, int), least=1e-3, elapsed=0.05)
    angles = []
    for _ in range(200):
        floor = thinning.floor(1e-3, still=False)
        seen = few[few > floor]
        thinning.follow(seen, np.ones(len(seen), int), least=1e-3, elapsed=0.05)
        angles.append(thinning.angle)
    assert thinning.settled
    still.follow(few, np.ones(1500, int), least=1e-3, elapsed=None)
    assert thinning.angle == pytest.approx(still.angle, rel=1e-6)
    thinning.follow(crowd, np.ones(20_000, int), least=1e-3, elapsed=0.05)
    assert not thinning.settled
    steps = []
    for _ in range(400):  # out of the crowd again
        before = thinning.angle
        seen = few[few > thinning.floor(1e-3, still=False)]
        thinning.follow(seen, np.ones(len(seen), int), least=1e-3, elapsed=0.05)
        steps.append(thinning.angle / before)
    assert min(steps) > 0.9
    assert thinning.angle == pytest.approx(still.angle, rel=1e-3)


@pytest.fixture(scope="module")
def forest_of(gl):
    terrain = Taiga()
    lit = SimpleNamespace(settled=True, height_at=lambda x, y: 0.0)

    def made(**changes):
        quality = replace(Quality(shade_maps=0, map_texels=64), **changes)
        return Forest(gl, terrain, Sun(200.0, 35.0), quality=quality, defines={"SHADE_MAPS": 0}), lit

    return made


@pytest.mark.slow
@pytest.mark.gl
def test_a_forest_of_hundreds_of_thousands_keeps_to_its_budget(forest_of):
    forest, lit = forest_of(plants=10**9, thin=1e-3)
    forest.settle(CAMERA, SIZE, lit)
    assert forest.count > 100_000
    for most in (500, 20_000):
        thinned, _ = forest_of(plants=most, thin=1e-3)
        thinned._cells = forest._cells
        thinned.settle(CAMERA, SIZE, lit)
        assert 0.8 * most < thinned.count <= most
        _, place, _, _ = drawn(thinned)
        # The nearest and those of high levels stay.
        away = np.hypot(*(place - EYE[:2]).T)
        assert np.median(away) < 0.8 * np.median(np.hypot(*(drawn(forest)[1] - EYE[:2]).T))


@pytest.mark.gl
def test_a_step_of_the_eye_changes_few_plants(forest_of):
    forest, lit = forest_of(plants=20_000)
    forest.settle(CAMERA, SIZE, lit)
    before = drawn(forest)
    moved = replace(CAMERA, eye=(3000.6, 300.8, 160.0), target=(3000.6, 1700.8, -200.0))
    forest.update(moved, SIZE, lit, 0.05, Allowance(0.0))
    forest._choose(moved, SIZE)
    after = drawn(forest)
    both, a, b = np.intersect1d(before[0], after[0], return_indices=True)
    assert len(both) > 0.98 * len(before[0])
    assert np.abs(before[2][a] - after[2][b]).max() < 0.02
    assert np.abs(before[3][a] - after[3][b]).mean() < 0.01
    gone = np.setdiff1d(before[0], both)
    aside = np.abs(before[1][np.isin(before[0], gone)] - EYE[:2])
    away = np.hypot(*aside.T)
    edge = np.abs(aside[:, 0] / aside[:, 1] - np.tan(np.radians(30.0)) * SIZE[0] / SIZE[1]) < 0.1
    assert before[3][np.isin(before[0], gone)][~edge & (away > 100.0)].max(initial=0.0) < 0.1


@pytest.mark.gl
def test_plants_are_not_chosen_again_for_an_eye_at_rest(forest_of, monkeypatch):
    forest, lit = forest_of(plants=3000)
    forest.settle(CAMERA, SIZE, lit)
    chosen = []
    monkeypatch.setattr("sketchterrain.render.forest.joined", lambda *_: chosen.append(1))
    monkeypatch.setattr("sketchterrain.render.forest.in_view", lambda *_: chosen.append(1))
    for _ in range(3):
        forest.update(CAMERA, SIZE, lit, 0.05, Allowance(0.0))
        forest._choose(CAMERA, SIZE)
    assert not chosen
    assert forest.settled


@pytest.mark.slow
@pytest.mark.gl
def test_a_flight_that_comes_to_rest_shows_what_a_still_does(forest_of):
    still, lit = forest_of(plants=3000)
    still.settle(CAMERA, SIZE, lit)
    flown, _ = forest_of(plants=3000)
    away = replace(CAMERA, eye=(3000.0, 300.0, 400.0), target=(3000.0, 1700.0, 600.0))
    flown.settle(away, SIZE, lit)
    for _ in range(400):
        flown.update(CAMERA, SIZE, lit, 0.05, Allowance(1.0))
        flown._choose(CAMERA, SIZE)
        if flown.settled:
            break
    assert flown.settled
    (a, _, _, share), (b, _, _, other) = drawn(still), drawn(flown)
    assert (a == b).all()
    assert np.abs(share - other).max() < 1e-3
