"""The content of ``report.json``."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sketchterrain.app.listings import device_entry, undescribed_labels
from sketchterrain.app.progress import Stages
from sketchterrain.export.files import stale_files
from sketchterrain.export.foliage_files import FoliageResult
from sketchterrain.io.system import peak_memory
from sketchterrain.placement.feature_types import FEATURE_TYPES
from sketchterrain.terrain.surfaces import Raster
from sketchterrain.terrain.terrain import Terrain

REPORT = "report.json"


def terrain_report(terrain: Terrain, raster: Raster, plants: FoliageResult) -> dict[str, Any]:
    """Return what is known of a terrain and its files."""
    rows, columns = raster.height.shape
    features = terrain.features
    kinds = Counter(FEATURE_TYPES[code] for code in features.points["type"].tolist())
    plant_count = sum(plants.counts.values())
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
            "plants": plant_count,
            "seconds": round(plants.seconds, 4),
            "plants_per_second": round(plant_count / plants.seconds),
        },
    }


def report_header(terrain: Terrain) -> dict[str, Any]:
    """Return the entries of every report of a terrain."""
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
    """Return times (s), those of the preview's `rendering` too, memory (bytes) and the written files."""
    return {
        "timings": rounded(stages.seconds | {"total": stages.elapsed}),
        "rendering": rounded(rendering),
        "peak_memory": peak_memory(),
        "files": [path.name for path in files] + [REPORT],
    }


def stale_report_files(folder: Path, report: dict[str, Any]) -> list[Path]:
    """Return files of the previous run, of the same format and target, that a new report does not list."""
    try:
        before = json.loads((folder / REPORT).read_bytes())
        if before["format"] != report["format"] or before.get("target") != report.get("target"):
            return []
        names = [str(name) for name in before["files"]]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return []  # there is no report, or not one of ours
    return stale_files(folder, names, report["files"])


def rounded(seconds: dict[str, float]) -> dict[str, float]:
    """Return times rounded to 0.1 ms."""
    return {name: round(value, 4) for name, value in seconds.items()}
