"""The kernels against plain NumPy float64, and against their own REAL=double build."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features.crests import crests
from sketchterrain.terrain.evaluation import MASKS, Evaluator
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.reference import reference_ground

from .conftest import feature

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain import TerrainRecipe
    from sketchterrain.terrain.reference import ReferenceGround

# float32 carries 7 digits; the steepest profile multiplies a distance's error by height / radius.
HEIGHT_TOLERANCE_M = 3e-3
MASK_TOLERANCE = 2e-5
CELLS = (0.0, 8.0, 64.0)
_EXPECTED: dict[tuple[str, float], ReferenceGround] = {}
WET = {"river": "water", "lake": "water", "eroded": "mountain", "crest": "mountain"}


def places(count: int = 4000, *, far: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.integers(0, 1 << 24, count) + far, rng.integers(0, 1 << 24, count) - far


def expected_ground(case: tuple[str, TerrainRecipe], cell_size: float) -> ReferenceGround:
    """The reference at `places()`, evaluated once a case and cell size."""
    name, recipe = case
    if (name, cell_size) not in _EXPECTED:
        _EXPECTED[name, cell_size] = reference_ground(recipe, *places(), cell_size=cell_size)
    return _EXPECTED[name, cell_size]


def test_float_kernel_agrees_with_numpy_float64(
    case: tuple[str, TerrainRecipe], context: ComputeContext
) -> None:
    name, recipe = case
    for cell_size in CELLS:
        height, masks = Evaluator(recipe, context).points(*places(), cell_size=cell_size)
        expected = expected_ground(case, cell_size)
        np.testing.assert_allclose(height, expected.height, atol=HEIGHT_TOLERANCE_M, rtol=0)
        for number, mask in enumerate(MASKS):
            np.testing.assert_allclose(masks[:, number], getattr(expected, mask), atol=MASK_TOLERANCE, rtol=0)
    # Each case reaches its branch.
    _, masks = Evaluator(recipe, context).points(*places(), cell_size=4.0)
    reached = dict(zip(MASKS, (masks > 0.5).sum(axis=0) > 20, strict=True))
    assert reached == {mask: mask == WET.get(name, name) for mask in MASKS}


def test_double_kernel_is_the_numpy_reference(
    case: tuple[str, TerrainRecipe], double_context: ComputeContext
) -> None:
    """Two independent writings of the same formulas agree, up to the fixed-point fraction's 24 bits."""
    _, recipe = case
    for cell_size in CELLS:
        height, masks = Evaluator(recipe, double_context).points(*places(), cell_size=cell_size)
        expected = expected_ground(case, cell_size)
        np.testing.assert_allclose(height, expected.height, atol=2e-4, rtol=0)
        for number, mask in enumerate(MASKS):
            np.testing.assert_allclose(masks[:, number], getattr(expected, mask), atol=2e-6, rtol=0)


def test_far_from_the_origin_it_is_as_exact_as_near(
    case: tuple[str, TerrainRecipe], context: ComputeContext
) -> None:
    """A thousand million units away noise comes from the same integers; only features stay behind."""
    name, recipe = case
    x, y = places(far=10**9 << 10)
    height, masks = Evaluator(recipe, context).points(x, y, cell_size=0.0)
    expected = reference_ground(recipe, x, y)
    np.testing.assert_allclose(height, expected.height, atol=1e-4, rtol=0)
    assert not masks.any(), name
    assert height.std() > 1


def test_noise_is_continuous_across_cells(make_recipe, context: ComputeContext) -> None:
    """Along a line in steps of one lattice unit the height never jumps."""
    recipe = make_recipe()
    start = 7_340_032  # a corner of many octaves' cells, less a few thousand units
    x = np.arange(start - 4000, start + 4000)
    height, _ = Evaluator(recipe, context).points(x, np.full(x.size, start), cell_size=0.0)
    # A slope of 2 over one unit of 0.244 mm, and a float32 step at some 20 m.
    assert np.abs(np.diff(height)).max() < 2 * 4096 / 2**24 + 4e-6


def test_seed_changes_the_ground(make_recipe, context: ComputeContext) -> None:
    x, y = places(500)
    one, _ = Evaluator(make_recipe(seed=1), context).points(x, y, cell_size=4.0)
    two, _ = Evaluator(make_recipe(seed=2), context).points(x, y, cell_size=4.0)
    assert abs(np.corrcoef(one, two)[0, 1]) < 0.3


def test_a_mountain_with_a_crest_is_longer_than_wide_and_sags_to_its_ends(
    make_recipe: Callable[..., TerrainRecipe], double_context: ComputeContext
) -> None:
    recipe = make_recipe(feature("mountain", 2000, 2000, 1200, 900, painted=False), fidelity=1.0)
    direction = crests(recipe.painted)[0]
    length = float(np.hypot(*direction))
    unit, along = metres_per_unit(recipe.extent), np.arange(-1150, 1150, 2.0)

    def heights(east: float, north: float) -> np.ndarray:
        line = [np.rint((2000 + along * part / length) / unit).astype(np.int64) for part in (east, north)]
        return Evaluator(recipe, double_context).points(*line, cell_size=0.0)[0]

    lengthwise, across = heights(*direction), heights(-direction[1], direction[0])
    assert (lengthwise > 300).sum() > 1.2 * (across > 300).sum()
    ends = [np.argmin(np.abs(along - side * length * 1200)) for side in (-1, 1)]
    assert all(0.4 * lengthwise.max() < lengthwise[end] < 0.95 * lengthwise.max() for end in ends)
