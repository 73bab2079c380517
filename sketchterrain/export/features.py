"""Placed features, rivers and lakes as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from skimage.measure import find_contours

from sketchterrain.features import FEATURE_TYPES
from sketchterrain.features.catalogue import conifer_share
from sketchterrain.whole_files import write_atomic

if TYPE_CHECKING:
    from sketchterrain.features import Lake, River, ShapeField
    from sketchterrain.terrain import TerrainFeatures


_OUTLINE_DECIMALS = 2  # centimetres
_TYPE_COLUMNS = {
    "mountain": ("peakiness", "erosion", "gullies"),
    "hill": ("erosion", "gullies"),
    "dune": ("wavelength", "wind"),
}


def write_features(folder: Path, features: TerrainFeatures) -> tuple[Path, ...]:
    """Write ``features.json``: point features by id, rivers as splines, lakes as outlines.

    Ids are 64-bit unsigned integers, lengths metres, angles degrees.
    """
    text = (
        '{"format": 1,\n"features": [\n'
        + _lines(_point_entry(point) for point in features.points)
        + '],\n"splines": [\n'
        + _lines(_river_entry(river) for river in features.rivers)
        + '],\n"lakes": [\n'
        + _lines(_lake_entry(lake) for lake in features.lakes)
        + "]}\n"
    )
    return (write_atomic(folder / "features.json", text.encode()),)


def _lines(entries: Iterable[dict[str, Any]]) -> str:
    """Return one entry a line, so that files can be read and compared."""
    text = ",\n".join(json.dumps(entry, allow_nan=False) for entry in entries)
    return text and f"{text}\n"


def _point_entry(point: np.void) -> dict[str, Any]:
    name = FEATURE_TYPES[int(point["type"])]
    entry = {
        "id": int(point["id"]),
        "type": name,
        "x": float(point["x"]),
        "y": float(point["y"]),
        "radius": _shortest(point["radius"]),
        "strength": _shortest(point["strength"]),
    }
    entry |= {key: _shortest(point[key]) for key in _TYPE_COLUMNS.get(name, ())}
    if name == "forest":
        entry["conifers"] = round(float(conifer_share(point["peakiness"])), 4)
    return entry | {"painted": bool(point["painted"])}


def _river_entry(river: River) -> dict[str, Any]:
    return {
        "id": river.id,
        "type": "river",
        "label": river.label,
        "points": river.points.tolist(),
        "width": [_shortest(width) for width in river.width],
        "depth": [_shortest(depth) for depth in river.depth],
        "centreline": river.centreline.tolist(),
        "centreline_width": [_shortest(width) for width in river.centreline_width],
        "centreline_depth": [_shortest(depth) for depth in river.centreline_depth],
    }


def _lake_entry(lake: Lake) -> dict[str, Any]:
    return {
        "id": lake.id,
        "type": "lake",
        "label": lake.label,
        "level": lake.level,
        "depth": lake.depth,
        "outline": [ring.tolist() for ring in lake_outline(lake.shape)],
    }


def lake_outline(shape: ShapeField) -> list[npt.NDArray[np.float64]]:
    """Return closed rings (n, 2) of x, y (m) along the shore, islands included."""
    rings = find_contours(shape.inside.astype(np.float64), 0.0, positive_orientation="high")
    corner = np.array([shape.west, shape.south])
    return [np.round(ring[:, ::-1] * shape.spacing + corner, _OUTLINE_DECIMALS) for ring in rings]


def _shortest(value: np.float32) -> float:
    """Return the number with the fewest digits that rounds to this float32: 0.6, not 0.6000000238418579."""
    return float(str(value))
