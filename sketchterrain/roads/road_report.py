"""Facts about roads for reports: lengths, bridges, tunnels, steepest grades, findings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.roads.road_types import BRIDGE, TUNNEL, Road, RoadNetwork, grades
from sketchterrain.schema.layers import WAY_LAYERS, vector_of

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


def road_facts(network: RoadNetwork, sketch: Sketch) -> dict[str, Any]:
    """Return a report's entries of a network: lengths in m, grades as rise over run."""
    own = {name: [road for road in network.roads if road.layer == name] for name in WAY_LAYERS}
    own = {name: roads for name, roads in own.items() if roads}
    return {
        "lengths": {name: round(sum(_length(road) for road in roads), 1) for name, roads in own.items()},
        "bridges": _connected(network, BRIDGE),
        "tunnels": _connected(network, TUNNEL),
        **{name: len(built) for name, built in network.lists.items() if name != "roads"},
        "steepest": {name: _steepest(roads, sketch) for name, roads in own.items()},
        "findings": list(network.findings),
    }


def _length(road: Road) -> float:
    return float(road.along[-1] - road.along[0])


def _connected(network: RoadNetwork, structure: int) -> int:
    """Return how many connected groups of parts have a structure: they form no loops."""
    axes = [road.axis for road in network.roads if road.structure == structure]
    return len({axis[end].tobytes() for axis in axes for end in (0, -1)}) - len(axes)


def _steepest(roads: list[Road], sketch: Sketch) -> dict[str, Any]:
    """Return the grade that is the largest share of its limit, and where it is."""
    layer = roads[0].layer
    limits = dict(zip(sketch.vectors[layer].ids.tolist(), sketch.vector_values(layer, "grade"), strict=True))
    slopes = [np.abs(grades(road)) for road in roads]
    shares = [slope.max() / limits[vector_of(road.id)] for road, slope in zip(roads, slopes, strict=True)]
    worst = int(np.argmax(shares))
    road, at = roads[worst], int(slopes[worst].argmax()) % len(roads[worst].axis)
    return {
        "grade": round(float(slopes[worst].max()), 4),
        "limit": round(float(limits[vector_of(road.id)]), 4),
        "vector": vector_of(road.id),
        "position": np.round(road.axis[at, :2], 1).tolist(),
    }
