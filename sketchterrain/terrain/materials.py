"""Material rules packed for the terrain kernels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import or_

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.document.material_rules import Factor
from sketchterrain.io.resources import Defines
from sketchterrain.schema.materials import MaterialTable
from sketchterrain.terrain.layers.layer import MASKS
from sketchterrain.terrain.recipe import TerrainRecipe

_KERNEL_INPUTS = ("height", "steepness", "hollow", "mottle", "northness", "bedding", *MASKS)
_ROUNDING = 1e-3
# Ranges of a factor's inputs; the mottle's actual range is less than half of this.
_RANGES = {"steepness": (0.0, np.inf), "mottle": (-4.0, 4.0)}
_RANGES |= dict.fromkeys(("northness", "bedding"), (-1.0, 1.0)) | dict.fromkeys(MASKS, (0.0, 1.0))


def material_defines(table: MaterialTable) -> Defines:
    """Return the macros of kernels that evaluate materials: their number, and those of masks."""
    masks = ((f"MASK_{name.upper()}", number) for number, name in enumerate(MASKS))
    return ("MATERIALS", len(table)), ("MASKS", len(MASKS)), *masks


@dataclass(frozen=True)
class PackedRules:
    """``Rules`` of ``kernels/materials.clh``; at least one row of each, so that buffers are not empty."""

    count: int
    form: npt.NDArray[np.int32]  # (rules, 4)
    cover: Float64Array  # (rules,)
    ramp: Float64Array  # (factors, 9 + masks)


def pack_rules(recipe: TerrainRecipe) -> PackedRules:
    """Return the rules of a recipe, with its climate and sea level added to the starts of their ramps."""
    rules, climate = recipe.material_rules, dict(recipe.climate)
    if recipe.sea_level is None:
        rules = tuple(rule for rule in rules if not any(factor.above_sea for factor in rule.factors))
    else:
        climate["sea"] = recipe.sea_level
    factors = [_pack_factor(factor, climate) for rule in rules for factor in rule.factors]
    form = np.zeros((max(len(rules), 1), 4), np.int32)
    ends = np.cumsum([len(rule.factors) for rule in rules], dtype=np.int64)
    form[: len(rules), 0] = [recipe.materials.names.index(rule.material) for rule in rules]
    form[1 : len(rules), 1] = ends[:-1]
    form[: len(rules), 2] = ends
    for row in form[: len(rules)]:
        row[3] = reduce(or_, (_required_masks(factor) for factor in factors[row[1] : row[2]]), 0)
    cover = np.zeros(len(form))
    cover[: len(rules)] = [rule.cover for rule in rules]
    ramp = np.array(factors, np.float64).reshape(-1, len(_KERNEL_INPUTS) + 3)
    return PackedRules(len(rules), form, cover, ramp)


def _pack_factor(factor: Factor, climate: Mapping[str, float]) -> list[float]:
    """Return the weights of a factor's inputs, its start, 1 / (full - start), and 1 for a linear ramp."""
    weights = factor.weights
    # The climate is constant over the terrain: subtract its part from the ramp's start.
    start = factor.start - weights.pop("aridity", 0.0) * climate["aridity"]
    for line in ("snow_line", "tree_line", "sea"):
        weight = weights.pop(f"above_{line}", 0.0)
        start += weight * climate.get(line, 0.0)
        weights["height"] = weights.get("height", 0.0) + weight
    ramp = [start, 1 / (factor.full - factor.start), float(factor.shape == "straight")]
    return [*(weights.get(name, 0.0) for name in _KERNEL_INPUTS), *ramp]


def _required_masks(factor: list[float]) -> int:
    """Return the bits of the masks without which a packed factor is 0, whatever its other inputs."""
    *weights, start, inverse, _ = factor
    sign = np.sign(inverse)
    bits = 0
    for number, mask in enumerate(MASKS):
        others = {name: w for name, w in zip(_KERNEL_INPUTS, weights, strict=True) if w and name != mask}
        ends = {name: _RANGES.get(name, (-np.inf, np.inf)) for name in others}
        most = sum(max(sign * w * end for end in ends[name]) for name, w in others.items()) - sign * start
        # A sum of several may be rounded up.
        bits |= bool(most < -_ROUNDING if others else most <= 0) << number
    return bits
