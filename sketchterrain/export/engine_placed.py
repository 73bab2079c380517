"""Plants, rivers and lakes as files beside the ground of an engine, all of them along its axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.export.engine_plants import storeys_of, write_plants
from sketchterrain.export.engine_water import write_water

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.export.engine_axes import EngineAxes
    from sketchterrain.export.target import Export

__all__ = ["write_all_plants", "write_all_water"]

_PLANTS = {"woody": "trees and shrubs", "grass": "grass, flowers and ferns"}


def write_all_plants(export: Export, axes: EngineAxes, *, degrees: bool = False) -> dict[Path, str]:
    """Write the storeys of plants that are wanted, a file each.

    Parameters
    ----------
    export
    axes
        The engine's.
    degrees
        Whether it turns by degrees, not radians.

    Returns
    -------
    dict of Path to str
        Each file and what it is, as `Written` has them.
    """
    files: dict[Path, str] = {}
    for storey, kind in storeys_of(export.options).items():
        path = export.folder / f"{export.name}_{kind}.json"
        with export.stages.stage(kind, kind.capitalize()) as tell:
            write_plants(path, export.terrain, storey, export.sampled, axes, degrees=degrees, progress=tell)
        files[path] = f"{_PLANTS[storey]}, {_along(axes)}"
    return files


def write_all_water(export: Export, axes: EngineAxes) -> dict[Path, str]:
    """Write rivers and lakes; return the file and what it is."""
    path = export.folder / f"{export.name}_water.json"
    return {write_water(path, export.terrain.features, axes): f"rivers and lakes, {_along(axes)}"}


def _along(axes: EngineAxes) -> str:
    return f"{axes.unit}: x {axes.x}, y {axes.y}, z {axes.z}"
