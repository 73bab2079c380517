"""Deterministic DEMs."""

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame

MakeGrid = Callable[..., ElevationGrid]
FRAME = SketchFrame("EPSG:32632", 500_000.0, 5_200_000.0)
PLACE = Affine(30.0, 0.0, 500_100.0, 0.0, -30.0, 5_201_000.0)
HEIGHTS = (300.0 + np.add.outer(3.0 * np.arange(20), 7.0 * np.arange(25))).astype(np.float32)


def write(path: Path, heights: Any = HEIGHTS, *, tags: dict[str, str] | None = None, **profile: Any) -> Path:
    """Write a GeoTIFF of heights 30 m apart within the frame, unless a profile says otherwise."""
    rows, columns = heights.shape
    profile = {"crs": "EPSG:32632", "transform": PLACE, "width": columns, "height": rows, **profile}
    with rasterio.open(path, "w", driver="GTiff", count=1, dtype=heights.dtype, **profile) as file:
        file.update_tags(**(tags or {}))
        file.write(heights, 1)
    return path


def ground(x: Float64Array, y: Float64Array) -> Float64Array:
    """Hills of waves from 300 m to 10 km long."""
    rng = np.random.default_rng(7)
    height = np.full(np.shape(x), 800.0)
    for _ in range(40):
        length = 300.0 * 33.0 ** rng.random()
        angle, phase = 2.0 * np.pi * rng.random(2)
        height += 0.02 * length * np.sin(2 * np.pi / length * (x * np.cos(angle) + y * np.sin(angle)) + phase)
    return height


@pytest.fixture(scope="session")
def make_grid() -> MakeGrid:
    """Return a function that samples the hills by a grid with a given middle, step, size and rotation."""

    @cache
    def make(
        step: float = 30.0,
        rows: int = 100,
        columns: int = 120,
        *,
        middle: tuple[float, float] = (5000.0, 5000.0),
        degrees: float = 0.0,
        accuracy: float = 0.0,
        offset: float = 0.0,
    ) -> ElevationGrid:
        a, d = step * math.cos(math.radians(degrees)), step * math.sin(math.radians(degrees))
        right, down = 0.5 * (columns - 1), 0.5 * (rows - 1)
        x, y = middle
        place = (a, d, x - a * right - d * down, d, -a, y - d * right + a * down)
        row, column = np.indices((rows, columns)).astype(np.float64)
        x_at, y_at = (
            place[0] * column + place[1] * row + place[2],
            place[3] * column + place[4] * row + place[5],
        )
        samples = (ground(x_at, y_at) + offset).astype(np.float32)
        return ElevationGrid(samples, place, accuracy)

    return make
