"""Where water stands: on rivers and on lakes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import BoolArray, Float64Array
    from sketchterrain.features.catalogue import Lake
    from sketchterrain.terrain.recipe import TerrainRecipe


def standing_water(
    recipe: TerrainRecipe, layer: str, x: Float64Array, y: Float64Array, ground: npt.NDArray[np.float32]
) -> BoolArray:
    """Return where the ground lies under the water of a layer, ``'river'`` or ``'lake'``.

    Parameters
    ----------
    recipe : TerrainRecipe
    layer : str
    x, y : float64, any shape
        Metres.
    ground : float32, the same shape
        Heights of the terrain there (m).
    """
    if layer == "river":
        return _rivers(recipe, x, y, ground)
    wet = np.zeros(x.shape, dtype=np.bool_)
    for lake in recipe.lakes:
        wet |= _within(lake, x, y) & (ground < lake.level)
    return wet


def _rivers(
    recipe: TerrainRecipe, x: Float64Array, y: Float64Array, ground: npt.NDArray[np.float32]
) -> BoolArray:
    rivers = recipe.rivers
    if not rivers:
        return np.zeros(x.shape, dtype=np.bool_)
    line = np.concatenate([river.centreline for river in rivers])
    half = np.concatenate([river.centreline_width for river in rivers]) / 2.0
    # Centrelines come in steps shorter than the water is wide, so that the nearest vertex will do.
    places = np.stack([x.ravel(), y.ravel()], axis=-1)
    bound = 1.5 * float(half.max()) + 1.0
    found = cKDTree(line[:, :2]).query(places, distance_upper_bound=bound)
    distance, nearest = np.asarray(found[0]), np.asarray(found[1])
    near = np.isfinite(distance)
    wet = np.zeros(x.size, dtype=np.bool_)
    index = nearest[near]
    wet[near] = (ground.ravel()[near] < line[index, 2]) & (distance[near] <= 1.5 * half[index])
    return wet.reshape(x.shape)


def _within(lake: Lake, x: Float64Array, y: Float64Array) -> BoolArray:
    """Whether places lie nearer to a lake's painted shape than two of its samples."""
    field = lake.shape
    rows, columns = field.inside.shape
    column = np.rint((x - field.west) / field.spacing).astype(np.int64)
    row = np.rint((y - field.south) / field.spacing).astype(np.int64)
    there = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    result = np.zeros(x.shape, dtype=np.bool_)
    result[there] = field.inside[row[there], column[there]] > -2.0 * field.spacing
    return result
