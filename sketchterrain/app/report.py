"""What ``report.json`` says of a generated terrain."""

from __future__ import annotations

import json
from collections import Counter
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from sketchterrain.app.listings import device_entry, undescribed_labels
from sketchterrain.export.files import stale_files
from sketchterrain.io.system import peak_memory
from sketchterrain.placement.feature_types import FEATURE_TYPES

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sketchterrain.app.progress import Stages
    from sketchterrain.export.foliage_files import FoliageResult
    from sketchterrain.terrain.surfaces import Raster
    from sketchterrain.terrain.terrain import Terrain

REPORT = "report.json"
"""The file's name."""


def terrain_report(terrain: Terrain, raster: Raster, plants: FoliageResult) -> dict[str, Any]:
    """Return what a terrain is and what was counted in its files."""
    rows, columns = raster.height.shape
    features = terrain.features
    kinds = Counter(FEATURE_TYPES[code] for code in features.points["type"].tolist())
    return report_header(terrain) | {
        "extent": terrain.extent,
        "size": {"columns": columns, "rows": rows},
        "spacing": {"x": raster.spacing[0], "y": raster.spacing[1]},
        "heights": {"minimum": float(raster.height.min()), "maximum": float(raster.height.max())},
        "counts": {
            "features": {name: kinds[name] for name in FEATURE_TYPES},
            "rivers": len(features.rivers),
            "lakes": len(features.lakes),
            "plants": plants.counts,
        },
        "foliage": {
            "files": [path.name for path in plants.files],
            "plants": sum(plants.counts.values()),
            "seconds": round(plants.seconds, 4),
            "plants_per_second": round(sum(plants.counts.values()) / plants.seconds),
        },
    }


def report_header(terrain: Terrain) -> dict[str, Any]:
    """Return what every report says of a terrain, whatever its files are."""
    sketch, recipe, context = terrain.sketch, terrain.recipe, terrain.context
    return {
        "format": 1,
        "version": version("sketchterrain"),
        "sketch": sketch.name,
        "seed": sketch.seed,
        "device": device_entry(context.device),
        "fast": context.fast,
        "notes": undescribed_labels(sketch),
        "resolutions": [each.line for each in recipe.resolutions],
        "edits": {"count": len(sketch.edits), "orphans": list(recipe.orphans)},
    }


def run_statistics(stages: Stages, rendering: dict[str, float], files: Sequence[Path]) -> dict[str, Any]:
    """Return what every report says of the work."""
    return {
        "timings": rounded(stages.seconds | {"total": stages.elapsed}),
        "rendering": rounded(rendering),
        "peak_memory": peak_memory(),
        "files": [path.name for path in files] + [REPORT],
    }


def stale_report_files(folder: Path, told: dict[str, Any]) -> list[Path]:
    """Return the files of the last time in a folder that there is none of this time in place of."""
    try:
        before = json.loads((folder / REPORT).read_bytes())
        if before["format"] != told["format"] or before.get("target") != told.get("target"):
            return []
        names = [str(name) for name in before["files"]]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return []  # there is none, or none of ours
    return stale_files(folder, names, told["files"])


def rounded(seconds: dict[str, float]) -> dict[str, float]:
    """Return seconds to a tenth of a millisecond."""
    return {name: round(value, 4) for name, value in seconds.items()}
