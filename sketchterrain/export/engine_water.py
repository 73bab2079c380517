"""Rivers and lakes along a program's axes, as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.export.features import lake_outline
from sketchterrain.export.files import write_json

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from sketchterrain.export.engine_axes import EngineAxes
    from sketchterrain.features import Lake, River
    from sketchterrain.terrain import TerrainFeatures

__all__ = ["water_in", "write_water"]

_DECIMALS = 3


def write_water(path: Path, features: TerrainFeatures, axes: EngineAxes) -> Path:
    """Write :func:`water_in` as JSON."""
    return write_json(path, water_in(features, axes))


def water_in(features: TerrainFeatures, axes: EngineAxes) -> dict[str, Any]:
    """Return all rivers and lakes: places and lengths in the program's unit.

    A river's points are those of its centreline, springs first, on the water; a lake's outline is rings on
    its level, each closed, islands included.
    """
    return {
        "format": 1,
        "axes": axes.facts,
        "rivers": [_river(river, axes) for river in features.rivers],
        "lakes": [_lake(lake, axes) for lake in features.lakes],
    }


def _river(river: River, axes: EngineAxes) -> dict[str, Any]:
    return {
        "id": river.id,
        "label": river.label,
        "points": _rounded(axes.places(*river.centreline.T)),
        "width": _rounded(river.centreline_width * axes.per_metre),
        "depth": _rounded(river.centreline_depth * axes.per_metre),
    }


def _lake(lake: Lake, axes: EngineAxes) -> dict[str, Any]:
    level = np.float64(lake.level)
    rings = [
        axes.places(ring[:, 0], ring[:, 1], np.full(len(ring), level)) for ring in lake_outline(lake.shape)
    ]
    return {
        "id": lake.id,
        "label": lake.label,
        "level": round(float((level - axes.origin[2]) * axes.per_metre), _DECIMALS),
        "depth": round(float(lake.depth * axes.per_metre), _DECIMALS),
        "outline": [_rounded(ring) for ring in rings],
    }


def _rounded(values: npt.NDArray[np.floating]) -> Any:
    # Adding zero makes 0.0 of −0.0.
    return (np.round(values.astype(np.float64), _DECIMALS) + 0.0).tolist()
