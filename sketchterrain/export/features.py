"""Placed features and rivers as JSON."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from sketchterrain.features import FEATURE_TYPES
from sketchterrain.whole_files import write_whole

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    import numpy as np

    from sketchterrain.features import River
    from sketchterrain.terrain import TerrainFeatures

__all__ = ["write_features"]

# What only some types have; for the others the field says nothing.
_ONLY = {"mountain": ("peakiness",), "dune": ("wavelength", "wind")}


def write_features(folder: Path, features: TerrainFeatures) -> tuple[Path, ...]:
    """Write ``features.json``: point features sorted by id, and rivers as splines.

    Ids are 64-bit unsigned integers. Lengths are metres, angles degrees.
    """
    text = (
        '{"format": 1,\n"features": [\n'
        + _lines(_feature(point) for point in features.points)
        + '],\n"splines": [\n'
        + _lines(_spline(river) for river in features.rivers)
        + "]}\n"
    )
    return (write_whole(folder / "features.json", text.encode()),)


def _lines(entries: Iterable[dict[str, Any]]) -> str:
    """One entry a line: a person can read it, and a difference between two files shows what moved."""
    return "".join(f"{line}\n" for line in _separated([json.dumps(e, allow_nan=False) for e in entries]))


def _separated(lines: list[str]) -> list[str]:
    return [*(f"{line}," for line in lines[:-1]), *lines[-1:]]


def _feature(point: np.void) -> dict[str, Any]:
    name = FEATURE_TYPES[int(point["type"])]
    entry = {
        "id": int(point["id"]),
        "type": name,
        "x": float(point["x"]),
        "y": float(point["y"]),
        "radius": _shortest(point["radius"]),
        "strength": _shortest(point["strength"]),
    }
    entry |= {key: _shortest(point[key]) for key in _ONLY.get(name, ())}
    return entry | {"painted": bool(point["painted"])}


def _spline(river: River) -> dict[str, Any]:
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


def _shortest(value: np.float32) -> float:
    """Return the number with the fewest digits that is this float32: 0.6, not 0.6000000238418579."""
    return float(str(value))
