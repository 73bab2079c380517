"""The sidecar of an export: what its files are, and what to type in where they are imported, also as rows."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from sketchterrain.export.files import files_without_successor, write_json
from sketchterrain.export.images import ORIENTATION
from sketchterrain.export.sampled import Grid
from sketchterrain.export.target import Export, Written

SIDECAR = "terrain.json"
"""The file's name."""

_MOST = 4  # entries of a list; the sidecar has all
_DIGITS = 10  # of a number that is shown


def sidecar(export: Export, written: Written, target: str) -> dict[str, Any]:
    """Return what the sidecar says; a target's own facts stand in place of those that all have."""
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
        "orientation": ORIENTATION,
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


class Row(NamedTuple):
    """One thing to type in, or a heading over others."""

    depth: int  # 0, or under so many headings
    name: str
    value: str  # empty for a heading


def typed_rows(settings: Mapping[str, Any]) -> list[Row]:
    """Return a target's settings (``import`` in the sidecar) as rows.

    >>> typed_rows({"Terrain Size": {"X": 3072.0, "Y": 450.55}, "Flip": False})
    [Row(depth=0, name='Terrain Size', value='X 3072  Y 450.55'), Row(depth=0, name='Flip', value='no')]
    """
    return list(_rows(settings, 0))


def _rows(settings: Mapping[str, Any], depth: int) -> Iterator[Row]:
    for name, value in settings.items():
        if isinstance(value, dict) and not all(isinstance(each, (int, float)) for each in value.values()):
            yield Row(depth, name, "")
            yield from _rows(value, depth + 1)
        elif isinstance(value, list) and any(isinstance(each, (dict, list)) for each in value):
            for number, entry in enumerate(value[:_MOST], start=1):
                yield Row(depth, name.removesuffix("s") + (f" {number}" if len(value) > 1 else ""), "")
                yield from _rows(entry, depth + 1)
            if len(value) > _MOST:
                yield Row(depth, name, f"{len(value) - _MOST} more in {SIDECAR}")
        else:
            yield Row(depth, name, _shown(value))


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return "  ".join(f"{name} {_shown(each)}" for name, each in value.items())
    if isinstance(value, list):
        return ", ".join(_shown(each) for each in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    return "none" if value is None else str(value)
