"""Pseudo-random numbers and the mesh variant of a plant from its position alone, for pictures and files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.look.tree_levels import VARIANTS

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array


def plant_chances(plants: npt.NDArray[np.void]) -> tuple[Float64Array, Float64Array]:
    """Return two numbers in 0..1 for each plant (`PLANT`) from its position alone."""
    x, y = ((plants[axis] * 8.0).astype(np.int64) for axis in ("x", "y"))
    seed = x * 73_856_093 ^ y * 19_349_663
    bits = (seed.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(24)
    first = ((bits >> np.uint64(16)) & np.uint64(0xFFFF)).astype(np.float64) / 0xFFFF
    second = ((bits >> np.uint64(32)) & np.uint64(0xFF)).astype(np.float64) / 0xFF
    return first, second


def plant_variants(chance: Float64Array) -> npt.NDArray[Any]:
    """Return 0 … `VARIANTS` - 1 for each second chance, as whole numbers in float64."""
    return np.floor(np.minimum(chance * VARIANTS, VARIANTS - 1))
