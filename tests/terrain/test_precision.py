"""Errors of float32 against float64: within a millimetre on a kilometre's relief, anywhere within 16 km."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sketchterrain.features import River
from sketchterrain.terrain.evaluation import Evaluator
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.reference import reference_ground

from .conftest import feature, lake

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain import TerrainRecipe

HEIGHT_M = 1e-3
NORMAL_DEGREES = 0.1
EXTENT = 32768.0
FARTHEST = 16_000.0
CORNERS = [(-1, -1), (1, -1), (-1, 1), (1, 1), (0, 0)]
KINDS = ("ground", "mountains", "eroded", "hills", "dunes", "river", "lake")
SIDE = 35


def recipe_of(
    kind: str, corner: tuple[int, int], make_recipe: Callable[..., TerrainRecipe]
) -> tuple[TerrainRecipe, np.ndarray[Any, Any]]:
    """One kind of thing as high as a kilometre in a far corner, and its middle (m)."""
    x, y = middle = np.array(corner) * (FARTHEST - 1500)
    eroded = {"erosion": 0.8, "gullies": 0.5} if kind == "eroded" else {}
    ground = {"relief": 1000.0 if kind == "ground" else 60.0, "wavelength": 2400.0, "roughness": 0.48}
    changes: dict[str, Any] = {"extent": EXTENT, "ground": ground}
    features = {
        "mountains": [("mountain", 0, 0, 1400, 1000), ("mountain", 900, 500, 900, 700)],
        "eroded": [("mountain", 0, 0, 1400, 1000), ("mountain", 900, 500, 900, 700)],
        "hills": [("hill", 0, 0, 900, 250), ("hill", 500, -600, 600, 180)],
        "dunes": [("dune", 0, 0, 1500, 25)],
    }.get(kind, [])
    more = {"mountain": {"peakiness": 0.6} | eroded, "dune": {"wavelength": 150, "wind": 250}}
    placed = [feature(name, x + a, y + b, r, h, **more.get(name, {})) for name, a, b, r, h in features]
    if kind == "river":
        along = np.linspace(-1400, 1400, 300)
        line = np.column_stack([x + along, y + 150 * np.sin(along / 300), 12 - 0.004 * along])
        ones = np.ones(along.size, np.float32)
        points, few = line[::20], ones[::20]
        changes["rivers"] = (River(1, 1, points, 20 * few, 2 * few, line, 20 * ones, 2 * ones),)
    if kind == "lake":
        changes["lakes"] = (lake(x, y, 400, 3.0),)
    return make_recipe(*placed, **changes), middle


@pytest.mark.parametrize(
    "corners", [CORNERS[:1], pytest.param(CORNERS[1:], marks=pytest.mark.slow)], ids=["one", "others"]
)
@pytest.mark.parametrize("kind", KINDS)
def test_heights_are_within_a_millimetre_of_numpy(
    kind: str,
    corners: list[tuple[int, int]],
    make_recipe: Callable[..., TerrainRecipe],
    context: ComputeContext,
) -> None:
    for corner in corners:
        recipe, middle = recipe_of(kind, corner, make_recipe)
        unit = metres_per_unit(recipe.extent)
        places = middle + np.random.default_rng(2).uniform(-1400, 1400, (6000, 2))
        x, y = (np.rint(axis / unit).astype(np.int64) for axis in places.T)
        height, _ = Evaluator(recipe, context).points(x, y, cell_size=0.0)
        error = np.abs(height - reference_ground(recipe, x, y).height)
        assert np.ptp(height) > 20
        assert error.max() < HEIGHT_M, corner
        assert np.percentile(error, 99.9) < HEIGHT_M / 2, corner


@pytest.mark.parametrize(
    "cells", [[2.0], pytest.param([0.25, 16.0], marks=pytest.mark.slow)], ids=["one", "others"]
)
@pytest.mark.parametrize("kind", KINDS)
def test_normals_are_within_a_tenth_of_a_degree(
    kind: str,
    cells: list[float],
    make_recipe: Callable[..., TerrainRecipe],
    context: ComputeContext,
    double_context: ComputeContext,
) -> None:
    recipe, middle = recipe_of(kind, CORNERS[0], make_recipe)
    for cell_size in cells:
        step = 1 << round(np.log2(cell_size / metres_per_unit(recipe.extent)))
        places = middle + np.random.default_rng(2).uniform(-900, 900, (12, 2))
        first = np.floor(places / cell_size).astype(np.int64) * step
        offsets = np.arange(SIDE) * step
        x, y = first[:, :1] + offsets, first[:, 1:] - offsets
        found, expected = (
            Evaluator(recipe, opened).surface(x, y, cell_size=cell_size)
            for opened in (context, double_context)
        )
        assert np.abs(found.height - expected.height).max() < HEIGHT_M, cell_size
        chord = np.linalg.norm(found.normal.astype(np.float64) - expected.normal, axis=-1)
        assert np.degrees(2 * np.arcsin(chord.max() / 2)) < NORMAL_DEGREES, cell_size
