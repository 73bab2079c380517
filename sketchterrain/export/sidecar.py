"""The sidecar of an export, ``terrain.json``, with import settings as rows."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from sketchterrain.errors import InputError, one_line
from sketchterrain.export.files import write_json
from sketchterrain.export.rasters import ORIENTATION
from sketchterrain.export.sampled import SampleGrid
from sketchterrain.export.target import Export, ExportOutput

SIDECAR = "terrain.json"

_MAX_ENTRIES = 4  # of a list in rows; the sidecar has all
_DIGITS = 10  # of a number in rows


def sidecar(export: Export, output: ExportOutput, target: str) -> dict[str, Any]:
    """Return the content of the sidecar; a target's own facts replace the common ones."""
    height, tiling = export.samples.height, export.tiling
    facts = dict(output.facts)
    heights = {"minimum": float(height.min()), "maximum": float(height.max()), "units": "m"}
    content = {
        "format": 1,
        "target": target,
        "program": f"sketchterrain {version('sketchterrain')}",
        "sketch": export.terrain.sketch.name,
        "seed": export.terrain.sketch.seed,
        "grid": _grid_entry(export.grid),
        "heights": heights | facts.pop("heights", {}),
        "byte_order": "as the files' formats have it",
        "orientation": ORIENTATION,
    }
    if tiling.count > 1:
        content["tiling"] = {
            "columns": tiling.columns,
            "rows": tiling.rows,
            "overlap": tiling.overlap,
            "first": tiling.first,
            "y_counts_from": "south" if tiling.from_south else "north",
        }
    content["tiles"] = [
        {
            "name": tiling.tile_name(export.name, tile),
            "x": tile.x,
            "y": tile.y,
            "left": tile.left,
            "top": tile.top,
            **_grid_entry(export.grid.window(tile.left, tile.top, tile.columns, tile.rows)),
        }
        for tile in tiling.tiles(export.grid.columns, export.grid.rows)
    ]
    content |= facts
    files = [{"file": path.name, "what": what} for path, what in output.files.items()]
    return content | {"files": [*files, {"file": SIDECAR, "what": "this"}], "import": output.settings}


def write_sidecar(export: Export, output: ExportOutput, target: str) -> tuple[Path, dict[str, Any]]:
    """Write ``terrain.json`` into the export's folder, and return its path and content."""
    content = sidecar(export, output, target)
    return write_json(export.folder / SIDECAR, content), content


def check_sidecar(folder: Path, sketch: str, target: str) -> None:
    """Raise InputError if a folder has the sidecar of another sketch or target, whose facts would be lost."""
    with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):  # missing, or not ours
        before = json.loads((folder / SIDECAR).read_bytes())
        if (before["sketch"], before["target"]) != (sketch, target):
            holds = one_line(f"{folder}: holds {before['sketch']!r} for {before['target']}, in {SIDECAR}")
            raise InputError(f"{holds}: expected another folder for each sketch and target")


def _grid_entry(grid: SampleGrid) -> dict[str, Any]:
    dx, dy = grid.spacing
    return {
        "columns": grid.columns,
        "rows": grid.rows,
        "spacing": {"x": dx, "y": dy},
        "bounds": {"west": grid.west, "south": grid.south, "east": grid.east, "north": grid.north},
    }


class SettingRow(NamedTuple):
    """One import setting, or a heading (with an empty value) of those below it."""

    depth: int  # number of headings above
    name: str
    value: str


def setting_rows(settings: Mapping[str, Any]) -> list[SettingRow]:
    """Return a target's import settings as rows.

    >>> setting_rows({"Flip": False})
    [SettingRow(depth=0, name='Flip', value='no')]
    """
    return list(_rows(settings, 0))


def _rows(settings: Mapping[str, Any], depth: int) -> Iterator[SettingRow]:
    for name, value in settings.items():
        if isinstance(value, dict) and not all(isinstance(item, (int, float)) for item in value.values()):
            yield SettingRow(depth, name, "")
            yield from _rows(value, depth + 1)
        elif isinstance(value, list) and any(isinstance(item, (dict, list)) for item in value):
            for number, entry in enumerate(value[:_MAX_ENTRIES], start=1):
                title = name.removesuffix("s") + (f" {number}" if len(value) > 1 else "")
                yield SettingRow(depth, title, "")
                yield from _rows(entry, depth + 1)
            if len(value) > _MAX_ENTRIES:
                yield SettingRow(depth, name, f"{len(value) - _MAX_ENTRIES} more in {SIDECAR}")
        else:
            yield SettingRow(depth, name, _text(value))


def _text(value: object) -> str:
    if isinstance(value, dict):
        return "  ".join(f"{name} {_text(item)}" for name, item in value.items())
    if isinstance(value, list):
        return ", ".join(_text(item) for item in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    return "none" if value is None else str(value)
