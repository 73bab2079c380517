"""A small terrain whose every direction is another: wider than high, one mountain in its north-east."""

import resource
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.terrain import Raster
from sketchterrain.terrain.plant import PLANT, SPECIES

SIDE = 129


@pytest.fixture(scope="session")
def terrain() -> st.Terrain:
    mountain, river, forest = (np.zeros((48, 64), np.uint8) for _ in range(3))
    mountain[4:16, 48:60] = 1
    river[24:27, :40] = 1
    forest[34:46, 6:30] = 1
    return st.build(
        st.Sketch(
            name="North-east",
            extent=1024.0,
            seed=5,
            ground={"relief": 5.0},
            density={"hill": 4.0},
            layers={"mountain": mountain, "river": river, "forest": forest},
            labels={("mountain", 1): {"height": 500.0}},
        )
    )


@pytest.fixture(scope="session")
def raster(terrain: st.Terrain) -> Raster:
    return terrain.raster(SIDE)


@pytest.fixture
def ground() -> Callable[[object], Raster]:
    """A raster of given heights, 2 m apart eastward and 3 m northward, all of one material."""

    def make(height: object) -> Raster:
        heights = np.asarray(height, np.float32)
        up = np.broadcast_to(np.float32([0, 0, 1]), (*heights.shape, 3))
        grass = np.broadcast_to(np.float32([1, 0, 0, 0]), (*heights.shape, 4))
        return Raster((2.0, 3.0), heights, up, grass)

    return make


@pytest.fixture(scope="session")
def plants() -> Callable[[int], np.ndarray]:
    """So many plants of all species on rough ground, from south to north, the same every time."""

    def make(count: int) -> np.ndarray:
        random = np.random.default_rng(count)
        some = np.zeros(count, PLANT)
        some["x"], some["y"] = 4096.0 * random.random(count), np.sort(4096.0 * random.random(count))
        some["z"] = random.normal(100.0, 300.0, count)
        upward = np.stack([*random.normal(0.0, 0.3, (2, count)), np.ones(count)], axis=-1)
        some["normal"] = upward / np.linalg.norm(upward, axis=-1, keepdims=True)
        some["species"], some["level"] = random.integers(0, [[len(SPECIES)], [6]], (2, count))
        some["scale"] = random.uniform(0.2, 1.3, count)
        some["rotation"] = random.uniform(0.0, 2 * np.pi, count)
        some["tint"] = random.random(count)
        return some

    return make


@pytest.fixture(scope="session")
def files_no_larger_than() -> Callable[[int], AbstractContextManager[None]]:
    """Within, the system refuses larger files, as a full disk does."""

    @contextmanager
    def limited(size: int) -> Iterator[None]:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limited
