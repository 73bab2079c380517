"""What two recipes have in common, so that it need not be made again."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sketchterrain.terrain.recipe import TerrainRecipe


def global_key(recipe: TerrainRecipe) -> tuple[object, ...]:
    """Return what is on the device once for all the world."""
    settings = (dict(recipe.ground), dict(recipe.climate), recipe.material_rules)
    noises = (recipe.stacks, recipe.warp, recipe.ridge_depth)
    return recipe.extent, recipe.seed, recipe.fidelity, settings, noises, recipe.dune_styles


def bit_equal(one: object, other: object) -> bool:
    """Tell whether two values of data classes and arrays are the bit_equal to the bit."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(bit_equal, one, other))
    if is_dataclass(one) and type(one) is type(other):
        return all(bit_equal(getattr(one, each.name), getattr(other, each.name)) for each in fields(one))
    return bool(one == other)
