"""Differences of two recipes: changed items, and the areas outside which terrains are bit-equal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sketchterrain.array_types import Bounds
from sketchterrain.geometry.differences import merge_boxes
from sketchterrain.stages.digests import digest_of
from sketchterrain.terrain.layers.layer import LayerChange, no_boxes
from sketchterrain.terrain.recipe import TerrainRecipe

EVERYWHERE: Bounds = (-math.inf, -math.inf, math.inf, math.inf)
"""The whole world."""


@dataclass(frozen=True, eq=False)
class RecipeChange:
    """What differs between two recipes of the same extent."""

    recipe: TerrainRecipe  # the new one, whose unchanged layers are the old one's
    layers: dict[str, LayerChange]  # changes by layer, without unchanged ones
    areas: list[Bounds]  # m, outside which heights, normals and materials are bit-equal


def difference(old: TerrainRecipe, new: TerrainRecipe) -> RecipeChange | None:
    """Return what differs between two recipes; None if it may be everything everywhere."""
    if old is new:
        return RecipeChange(new, {}, [])
    if old.key() != new.key():
        return None
    changes: dict[str, LayerChange] = {}
    layers = []
    for before, now in zip(old.layers, new.layers, strict=True):
        same = before is now or digest_of(before) == digest_of(now)
        change = None if same else now.change(before, new.world)
        if not same and change is None:
            return None
        if change:
            changes[now.name] = change
        layers.append(now if change else before)
    areas = np.concatenate([no_boxes(), *(change.boxes for change in changes.values())]) * new.world.unit
    return RecipeChange(
        new.with_layers(layers), changes, merge_boxes((w, s, e, n) for w, s, e, n in areas.tolist())
    )


def changed_areas(old: TerrainRecipe, new: TerrainRecipe) -> list[Bounds]:
    """Return rectangles (west, south, east, north, m) outside which two terrains are bit-equal.

    Empty if nothing changed; `EVERYWHERE` if anything global did (a layer's key, the climate, material rules,
    seed, extent). A tile's normals read one vertex beyond its border: widen the areas by the cell size to
    select tiles.
    """
    change = difference(old, new)
    return [EVERYWHERE] if change is None else change.areas


def touches(areas: Sequence[Bounds], bounds: Bounds, *, margin: float = 0.0) -> bool:
    """Return whether a rectangle (west, south, east, north, m), widened by a margin, overlaps any area.

    A tile is unchanged unless its bounds, widened by its cell size, do.
    """
    west, south, east, north = bounds
    return any(
        w <= east + margin and e >= west - margin and s <= north + margin and n >= south - margin
        for w, s, e, n in areas
    )
