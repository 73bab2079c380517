"""A small terrain with no symmetry: wider than high, one mountain in its north-east."""

import resource
from contextlib import contextmanager

import numpy as np
import pytest

import sketchterrain as st


@pytest.fixture(scope="session")
def terrain():
    mountain, river, forest = (np.zeros((48, 64), np.uint8) for _ in range(3))
    mountain[4:16, 48:60] = 1
    river[24:27, :40] = 1
    forest[34:46, 6:30] = 1
    layers = {"mountain": mountain, "river": river, "forest": forest}
    labels = {("mountain", 1): {"height": 500.0}}
    given = {"ground": {"relief": 5.0}, "density": {"hill": 4.0}, "layers": layers, "labels": labels}
    return st.build(st.Sketch(name="North-east", extent=1024.0, seed=5, **given))


@pytest.fixture(scope="session")
def raster(terrain):
    return terrain.raster(129)


@contextmanager
def limited_file_size(size):
    """Refuse larger files, as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="session")
def files_no_larger_than():
    return limited_file_size
