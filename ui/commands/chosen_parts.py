"""What is chosen, found in what was placed: a point feature, a river, a lake; and what a person calls it."""

from __future__ import annotations

import numpy as np

from sketchterrain.features import Lake, River
from sketchterrain.features.catalogue import FEATURE_TYPES
from sketchterrain.ui.engine.protocol import Placed
from sketchterrain.ui.models.workspace import Chosen


def point_of(placed: Placed, chosen: Chosen) -> np.void | None:
    """Return the point feature that is chosen, a row of FEATURE; None if it is none, or gone."""
    if chosen.kind != "feature":
        return None
    at = int(np.searchsorted(placed.points["id"], np.uint64(chosen.id)))
    found = at < len(placed.points) and int(placed.points["id"][at]) == chosen.id
    return placed.points[at] if found else None


def river_of(placed: Placed, chosen: Chosen) -> River | None:
    """Return the river that is chosen; None if it is none, or gone."""
    if chosen.kind != "river":
        return None
    return next((river for river in placed.rivers if river.id == chosen.id), None)


def lake_of(placed: Placed, chosen: Chosen) -> Lake | None:
    """Return the lake that is chosen; None if it is none, or gone."""
    if chosen.kind != "lake":
        return None
    return next((lake for lake in placed.lakes if lake.id == chosen.id), None)


def is_there(placed: Placed, chosen: Chosen) -> bool:
    """Whether what is chosen was placed."""
    return any(find(placed, chosen) is not None for find in (point_of, river_of, lake_of))


def parent_of(placed: Placed, river: River) -> River | None:
    """Return the river that another one joins; None if it runs on its own."""
    end = river.centreline[-1]
    others = (each for each in placed.rivers if each.id != river.id)
    return next((each for each in others if (each.centreline == end).all(axis=1).any()), None)


def name_of(placed: Placed, chosen: Chosen) -> str:
    """Return what a person calls what is chosen: ``mountain``, ``river 2``, as contradictions count them."""
    point = point_of(placed, chosen)
    if point is not None:
        return FEATURE_TYPES[int(point["type"])]
    ids = [each.id for each in (placed.rivers if chosen.kind == "river" else placed.lakes)]
    return f"{chosen.kind} {ids.index(chosen.id) + 1}" if chosen.id in ids else chosen.kind
