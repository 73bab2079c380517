"""What ``report.json`` says of a generated terrain."""

from __future__ import annotations

import resource
import sys
from collections import Counter
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sketchterrain.features import FEATURE_TYPES
from sketchterrain.listings import device_entry, undescribed_labels

if TYPE_CHECKING:
    from sketchterrain.export import WrittenFoliage
    from sketchterrain.terrain import Raster, Terrain

__all__ = ["peak_memory", "report_of", "rounded"]


def report_of(terrain: Terrain, raster: Raster, plants: WrittenFoliage) -> dict[str, Any]:
    """Return what a terrain is and what was counted in its files."""
    rows, columns = raster.height.shape
    features = terrain.features
    kinds = Counter(FEATURE_TYPES[code] for code in features.points["type"].tolist())
    return {
        "format": 1,
        "version": version("sketchterrain"),
        "sketch": terrain.sketch.name,
        "seed": terrain.sketch.seed,
        "extent": terrain.extent,
        "size": {"columns": columns, "rows": rows},
        "spacing": {"x": raster.spacing[0], "y": raster.spacing[1]},
        "heights": {"minimum": float(raster.height.min()), "maximum": float(raster.height.max())},
        "device": device_entry(terrain.context.device),
        "fast": terrain.context.fast,
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
        "notes": undescribed_labels(terrain.sketch),
        "resolutions": [each.line for each in terrain.recipe.resolutions],
        "edits": {"count": len(terrain.sketch.edits), "orphans": list(terrain.recipe.orphans)},
    }


def rounded(seconds: dict[str, float]) -> dict[str, float]:
    """Return seconds to a tenth of a millisecond."""
    return {name: round(value, 4) for name, value in seconds.items()}


def peak_memory() -> int:
    """Return the most memory this process has had at once, bytes."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage also counts what the parent had before it started this program
        for line in status.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
