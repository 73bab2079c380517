"""A small terrain whose every direction is another: wider than high, one mountain in its north-east."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.terrain import Raster

if TYPE_CHECKING:
    from collections.abc import Callable

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
