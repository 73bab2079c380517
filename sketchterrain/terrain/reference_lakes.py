"""Lakes in plain NumPy float64, as ``kernels/lakes.clh`` and ``kernels/fields.clh`` lay them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.field_packing import pack_fields, pack_lakes

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array, LatticeArray
    from sketchterrain.terrain.field_packing import PackedFields
    from sketchterrain.terrain.recipe import TerrainRecipe


_RIM = 0.15
_SOFTNESS = 0.5


def field_distance(fields: PackedFields, i: int, x: LatticeArray, y: LatticeArray) -> Float64Array:
    """Return the distance inside the shape of field ``i`` at lattice positions (m)."""
    first, columns, rows, _ = fields.form[i]
    samples = fields.samples[first : first + columns * rows].reshape(rows, columns)
    u = np.clip((x - fields.at[i, 0]) * fields.scale[i], 1, columns - 2)
    v = np.clip((y - fields.at[i, 1]) * fields.scale[i], 1, rows - 2)
    column, row = np.floor(u + 0.5).astype(np.int64), np.floor(v + 0.5).astype(np.int64)
    total = np.zeros(x.shape)
    for dv, weight_v in zip((-1, 0, 1), _weights(v - row), strict=True):
        for du, weight_u in zip((-1, 0, 1), _weights(u - column), strict=True):
            total += weight_v * weight_u * samples[row + dv, column + du]
    return total


def _weights(f: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    return 0.5 * (0.5 - f) ** 2, 0.75 - f**2, 0.5 * (0.5 + f) ** 2


def apply_lakes(
    recipe: TerrainRecipe, height: Float64Array, x: LatticeArray, y: LatticeArray, *, cell: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return the ground with lakes laid in, and the masks ``water`` and ``lake``, at lattice positions."""
    fields = pack_fields(recipe, [lake.shape for lake in recipe.lakes])
    packed = pack_lakes(recipe, fields, cell)
    weights, own, top, shown, deepest = np.zeros((5, *height.shape))
    nearest = np.ones(height.shape)
    for i in np.flatnonzero(packed.visible):
        _, inverse_margin, level, fade = packed.shape[i]
        depth, inverse_shelf, slope, rise = packed.profile[i]
        d = field_distance(fields, int(i), x, y)
        s = np.clip(-d * inverse_margin, 0, 1)
        t = np.clip(d * inverse_shelf, 0, 1)
        bed = level - depth * t**2 * (3 - 2 * t) - slope * t * (1 - t) ** 2
        weight = fade * (1 - s) ** 2 / (s**2 + 1 / 1024) ** 2
        weights += weight
        own += weight * (bed + rise * (1 - np.maximum(1 - 2 * s, 0) ** 2))
        top += weight * (level + rise)
        shown += weight * fade
        nearest, deepest = np.minimum(nearest, s), np.maximum(deepest, t)
    near = weights > 0
    own, top, shown = (part[near] / weights[near] for part in (own, top, shown))
    s, t, ground = nearest[near], deepest[near], height[near]
    laid, (water, lake) = height.copy(), np.zeros((2, *height.shape))
    terrain = ground + shown * _soft_positive(top - ground) * (1 - s**4) * (1 - s**2)
    laid[near] = terrain + (own - terrain) * shown * _cubic(np.maximum(s - _RIM, 0) / (1 - _RIM))
    water[near] = shown * (0.75 * np.maximum(1 - 3 * s, 0) + 0.25 * t)
    lake[near] = shown * _cubic(s / _RIM)
    return laid, water, lake


def _soft_positive(x: Float64Array) -> Float64Array:
    near = np.clip(x, -_SOFTNESS, _SOFTNESS) + _SOFTNESS
    return np.asarray(near**2 / (4 * _SOFTNESS) + np.maximum(x - _SOFTNESS, 0))


def _cubic(t: Float64Array) -> Float64Array:
    s = np.minimum(t, 1)
    return np.asarray(2 * s**3 - 3 * s**2 + 1)
