"""Material weights in plain NumPy float64, as ``kernels/materials.clh`` gives them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.document.parameters import MATERIALS
from sketchterrain.terrain.host_heights import field_distance
from sketchterrain.terrain.noise import fbm
from sketchterrain.terrain.packing import pack_covers, pack_fields, pack_world

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sketchterrain.array_types import Float64Array, LatticeArray
    from sketchterrain.document.material_rules import Factor, MaterialRule
    from sketchterrain.terrain.host_heights import HostSamples
    from sketchterrain.terrain.recipe import TerrainRecipe


_MOTTLE_CONTRAST = 2.2


@dataclass(frozen=True, eq=False)
class Site:
    """What rules are told of points, arrays of one shape; see `INPUTS` for their meaning.

    Attributes
    ----------
    height
        Metres.
    steepness
        Rise over run.
    hollow
        Change of slope over a cell, positive where the ground is concave.
    mottle
        About -1 to 1.
    mountain, dune, forest, water
        0 … 1.
    """

    height: Float64Array
    steepness: Float64Array
    hollow: Float64Array
    mottle: Float64Array
    mountain: Float64Array
    dune: Float64Array
    forest: Float64Array
    water: Float64Array


def rule_weights(rules: Sequence[MaterialRule], climate: Mapping[str, float], site: Site) -> Float64Array:
    """Return the weights that rules give points of any shape, with one more axis of ``len(MATERIALS)``.

    Each rule covers what those before it left: w ← w (1 − a), w_k ← w_k + a; all is grass at first.
    """
    inputs = {
        **{name: np.asarray(getattr(site, name), np.float64) for name in Site.__dataclass_fields__},
        "above_snow_line": site.height - climate["snow_line"],
        "above_tree_line": site.height - climate["tree_line"],
        "aridity": np.full(np.shape(site.height), climate["aridity"]),
        "wetness": np.maximum(np.asarray(site.water) - 0.2, 0) / 0.8,
    }
    weights = np.zeros((*np.shape(site.height), len(MATERIALS)))
    weights[..., MATERIALS.index("grass")] = 1
    for rule in rules:
        cover = np.full(weights.shape[:-1], rule.cover)
        for factor in rule.factors:
            cover = cover * _ramp(factor, inputs)
        weights *= 1 - cover[..., None]
        weights[..., MATERIALS.index(rule.material)] += cover
    return weights


def patch_weights(
    recipe: TerrainRecipe, ground: HostSamples, x: LatticeArray, y: LatticeArray, *, cell_size: float
) -> Float64Array:
    """Return the weights at the vertices of a patch inside its border.

    Parameters
    ----------
    recipe
    ground
        At the vertices, row 0 northernmost, arrays of shape (rows · columns,) or (rows, columns).
    x, y
        LatticeArray coordinates of the vertices, shape (rows, columns).
    cell_size
        Metres between neighbours.

    Returns
    -------
    (rows − 2, columns − 2, len(MATERIALS)) float64
        They sum to 1.
    """
    inner = (slice(1, -1), slice(1, -1))
    z = ground.height.reshape(x.shape)
    east = (z[1:-1, 2:] - z[1:-1, :-2]) / (2 * cell_size)
    north = (z[:-2, 1:-1] - z[2:, 1:-1]) / (2 * cell_size)
    around = z[1:-1, 2:] + z[1:-1, :-2] + z[:-2, 1:-1] + z[2:, 1:-1]
    octaves = pack_world(recipe, cell_size, real=np.float64).octaves
    at_x, at_y = x[inner].ravel(), y[inner].ravel()
    mottle = _MOTTLE_CONTRAST * fbm(octaves, "mottle", at_x, at_y)
    masks = {
        name: getattr(ground, name).reshape(x.shape)[inner]
        for name in ("mountain", "dune", "forest", "water")
    }
    site = Site(
        height=z[inner],
        steepness=np.hypot(east, north),
        hollow=(around - 4 * z[inner]) / (4 * cell_size),
        mottle=mottle.reshape(z[inner].shape),
        **masks,
    )
    weights = rule_weights(recipe.material_rules, recipe.climate, site)
    flat = weights.reshape(-1, len(MATERIALS))
    return _with_covers(recipe, flat, at_x, at_y, mottle).reshape(weights.shape)


def _with_covers(
    recipe: TerrainRecipe, weights: Float64Array, x: LatticeArray, y: LatticeArray, mottle: Float64Array
) -> Float64Array:
    """Lay the painted materials over weights at lattice positions of shape (n,)."""
    fields = pack_fields(recipe, [cover.shape for cover in recipe.covers])
    packed = pack_covers(recipe, fields)
    ragged = 0.5 * np.clip(mottle, -1, 1)
    for i, (_, inverse_width, strength, _) in enumerate(packed.shape):
        t = np.clip(field_distance(fields, i, x, y) * inverse_width + ragged + 0.5, 0, 1)
        cover = strength * t * t * (3 - 2 * t)
        weights = weights * (1 - cover[:, None])
        weights[:, packed.form[i, 3]] += cover
    return weights


def _ramp(factor: Factor, inputs: Mapping[str, Float64Array]) -> Float64Array:
    total = sum(weight * inputs[name] for name, weight in factor.weights.items())
    t = np.clip((total - factor.start) / (factor.full - factor.start), 0, 1)
    return np.asarray(t if factor.shape == "straight" else t * t * (3 - 2 * t))
