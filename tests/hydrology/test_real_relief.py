"""Painted rivers on real relief: they run down it, and never rise."""

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import make_recipe
from tests.terrain.conftest import tiers

SIDE, STROKES = 256, 24  # px; strokes of a sketch


def random_rivers(sketch: Sketch, seed: int) -> Sketch:
    """Return a sketch with winding strokes from anywhere to anywhere, whatever the relief."""
    rng, image = np.random.default_rng(seed), np.zeros((SIDE, SIDE), np.uint8)
    for _ in range(STROKES):
        at, heading = rng.uniform(0, SIDE, 2), rng.uniform(0, 2 * np.pi)
        for _ in range(int(rng.integers(20, 150))):
            heading += rng.normal(0, 0.2)
            at += np.array([np.sin(heading), np.cos(heading)])
            row, column = np.floor(at).astype(int)
            if 0 <= row < SIDE - 1 and 0 <= column < SIDE - 1:
                image[row : row + 2, column : column + 2] = 1
    return sketch.replace(
        layers={"river": image}, labels={("river", 1): {"width": float(rng.uniform(5, 40))}}
    )


@pytest.fixture(scope="module")
def bare() -> Sketch:
    """Return Andorra's relief without anything on it."""
    given = load_sketch("andorra")
    return Sketch(
        extent=given.extent,
        seed=1,
        frame=dict(given.frame),
        rasters=given.elevation_rasters,
        layers={"river": np.zeros((SIDE, SIDE), np.uint8)},
    )


@tiers("seed", [0], range(1, 6), range(6, 64))
def test_rivers_never_rise(bare, seed) -> None:
    recipe = make_recipe(random_rivers(bare, seed))
    rivers = [river for river in recipe.rivers if river.label]
    assert len(rivers) >= 8
    for river in rivers:
        assert (np.diff(river.centreline[:, 2]) <= 0.0).all()
