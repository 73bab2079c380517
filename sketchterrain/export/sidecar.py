"""What is written beside an export's files: what they are, and what to type in where they are imported."""

from __future__ import annotations

import json
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from sketchterrain.export.files import files_without_successor, write_json

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.export.grid import Grid
    from sketchterrain.export.target import Export, Written

__all__ = ["SIDECAR", "replaced_files", "sidecar", "write_sidecar"]

SIDECAR = "terrain.json"
"""The file's name."""

_ORIENTATION = {"row_0": "north", "column_0": "west", "samples": "vertices"}


def sidecar(export: Export, written: Written, target: str) -> dict[str, Any]:
    """Return what the sidecar says; a target's own facts stand in place of those that all have.

    Parameters
    ----------
    export, written
        What was written, and of what.
    target
        The target's name.
    """
    height, tiling = export.sampled.height, export.tiling
    facts = dict(written.facts)
    heights = {"minimum": float(height.min()), "maximum": float(height.max()), "units": "m"}
    told = {
        "format": 1,
        "target": target,
        "program": f"sketchterrain {version('sketchterrain')}",
        "sketch": export.terrain.sketch.name,
        "seed": export.terrain.sketch.seed,
        "grid": _grid(export.grid),
        "heights": heights | facts.pop("heights", {}),
        "byte_order": "as the files' formats have it",
        "orientation": _ORIENTATION,
    }
    if tiling.count > 1:
        told["tiling"] = {
            "columns": tiling.columns,
            "rows": tiling.rows,
            "overlap": tiling.overlap,
            "first": tiling.first,
            "y_counts_from": "south" if tiling.from_south else "north",
        }
    told["tiles"] = [
        {
            "name": tiling.name(export.name, piece),
            "x": piece.x,
            "y": piece.y,
            "left": piece.left,
            "top": piece.top,
            **_grid(export.grid.part(piece.left, piece.top, piece.columns, piece.rows)),
        }
        for piece in tiling.pieces(export.grid.columns, export.grid.rows)
    ]
    told |= facts
    files = [{"file": path.name, "what": what} for path, what in written.files.items()]
    return told | {"files": [*files, {"file": SIDECAR, "what": "this"}], "import": written.settings}


def write_sidecar(export: Export, written: Written, target: str) -> tuple[Path, dict[str, Any]]:
    """Write ``terrain.json`` into the export's folder, and return its path and what it says."""
    told = sidecar(export, written, target)
    return write_json(export.folder / SIDECAR, told), told


def replaced_files(folder: Path, told: dict[str, Any]) -> list[Path]:
    """Return the files of an earlier export in a folder that a newer one stands in place of, without its own.

    That is one of the same sketch to the same target, by its sidecar; any other's files are nobody's business
    here, nor is what its sidecar names outside of the folder.

    Parameters
    ----------
    folder
        As it is before the newer files come into it.
    told
        What the newer sidecar says.
    """
    try:
        before = json.loads((folder / SIDECAR).read_bytes())
        if any(before[key] != told[key] for key in ("format", "target", "sketch")):
            return []
        names = {str(each["file"]) for each in before["files"]}
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []  # there is none, or none of ours
    return files_without_successor(folder, names, (each["file"] for each in told["files"]))


def _grid(grid: Grid) -> dict[str, Any]:
    dx, dy = grid.spacing
    west, south, east, north = grid.area
    return {
        "columns": grid.columns,
        "rows": grid.rows,
        "spacing": {"x": dx, "y": dy},
        "bounds": {"west": west, "south": south, "east": east, "north": north},
    }
