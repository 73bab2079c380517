"""Materials' rules as the arrays that ``kernels/materials.clh`` reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.sketch import MOST_INPUTS
from sketchterrain.terrain.materials import MATERIALS

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from sketchterrain.sketch import Factor
    from sketchterrain.terrain.recipe import TerrainRecipe

__all__ = ["PackedRules", "pack_rules"]

_KERNEL_INPUTS = ("height", "steepness", "hollow", "mottle", "mountain", "dune", "forest", "water", "wetness")


@dataclass(frozen=True)
class PackedRules:
    """``Rules`` of ``kernels/materials.clh``; at least one row of each, so that there is a buffer.

    Attributes
    ----------
    count : int
        How many rules there are.
    form : ndarray of int32, shape (rules, 4)
    cover : ndarray of float64, shape (rules,)
    input : ndarray of int32, shape (factors, 4)
    ramp : ndarray of float64, shape (factors, 2, 4)
    """

    count: int
    form: npt.NDArray[np.int32]
    cover: npt.NDArray[np.float64]
    input: npt.NDArray[np.int32]
    ramp: npt.NDArray[np.float64]


def pack_rules(recipe: TerrainRecipe) -> PackedRules:
    """Return the rules of a recipe, with its climate put into the starts of their ramps."""
    rules = recipe.material_rules
    factors = [_pack_factor(factor, recipe.climate) for rule in rules for factor in rule.factors]
    form = np.zeros((max(len(rules), 1), 4), np.int32)
    ends = np.cumsum([len(rule.factors) for rule in rules], dtype=np.int64)
    form[: len(rules), 0] = [MATERIALS.index(rule.material) for rule in rules]
    form[1 : len(rules), 1] = ends[:-1]
    form[: len(rules), 2] = ends
    cover = np.zeros(len(form))
    cover[: len(rules)] = [rule.cover for rule in rules]
    return PackedRules(
        len(rules),
        form,
        cover,
        np.array([inputs for inputs, _ in factors], np.int32).reshape(-1, MOST_INPUTS),
        np.array([ramp for _, ramp in factors], np.float64).reshape(-1, 2, MOST_INPUTS),
    )


def _pack_factor(factor: Factor, climate: Mapping[str, float]) -> tuple[list[int], list[list[float]]]:
    """Return which inputs a factor weighs, and its weights and ramp."""
    weights = factor.weights
    # The climate is one for the whole terrain: what it adds is taken from the ramp's start.
    start = factor.start - weights.pop("aridity", 0.0) * climate["aridity"]
    height = weights.pop("height", 0.0)
    for line in ("snow_line", "tree_line"):
        weight = weights.pop(f"above_{line}", 0.0)
        start += weight * climate[line]
        height += weight
    # Height comes first: less its line it keeps its digits.
    known = {"height": height} | weights if height or not weights else weights
    none = MOST_INPUTS - len(known)
    inputs = [*(_KERNEL_INPUTS.index(name) for name in known), *([-1] * none)]
    ramp = [start, 1 / (factor.full - factor.start), float(factor.shape == "straight"), 0.0]
    return inputs, [[*known.values(), *([0.0] * none)], ramp]
