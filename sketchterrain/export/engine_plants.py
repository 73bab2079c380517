"""Plants as an engine's own program or script reads them: places on its ground, along its axes, as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from sketchterrain.export.decimals import decimals
from sketchterrain.export.grid_ground import ground_at
from sketchterrain.export.json_rows import json_rows, small_numbers, write_listing

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import numpy.typing as npt

    from sketchterrain.export.engine_axes import EngineAxes
    from sketchterrain.export.foliage_files import Area, Planted
    from sketchterrain.export.sampled import Sampled

__all__ = ["PLANT_FIELDS", "plant_rows", "plants_within", "storeys_of", "write_plants"]

PLANT_FIELDS = ("species", "x", "y", "z", "rotation", "scale", "tint", "normal_x", "normal_y", "normal_z")
"""What stands in a row of :func:`write_plants`."""

_AT_ONCE = 1 << 15  # rows: what they need as text stays in the processor's cache


class _Wanted(Protocol):
    """What is asked of `ExportOptions`."""

    @property
    def plants(self) -> bool: ...
    @property
    def grass(self) -> bool: ...


def storeys_of(options: _Wanted) -> dict[str, str]:
    """Return the storeys of plants that are wanted, and what each is called in files' names."""
    named = {"woody": ("plants", options.plants), "grass": ("grass", options.grass)}
    return {storey: name for storey, (name, wanted) in named.items() if wanted}


def plants_within(terrain: Planted, area: Area, storey: str) -> Iterator[npt.NDArray[np.void]]:
    """Return the plants of a rectangle in small pieces, none of them empty."""
    for plants in terrain.foliage_pieces(*area, storey=storey):
        for first in range(0, len(plants), _AT_ONCE):
            yield plants[first : first + _AT_ONCE]


def plant_rows(plants: npt.NDArray[np.void], sampled: Sampled, axes: EngineAxes, *, degrees: bool) -> bytes:
    """Return a row of :data:`PLANT_FIELDS` for each plant, which stands on the grid's ground.

    Rotations are about the vertical axis, positive as the program turns.
    """
    place = axes.places(plants["x"], plants["y"], ground_at(sampled, plants["x"], plants["y"]))
    normal = axes.directions(plants["normal"])
    whole = 360.0 if degrees else 2.0 * np.pi
    turn = np.mod(axes.turn * plants["rotation"].astype(np.float64) * (whole / (2.0 * np.pi)), whole)
    columns = [
        small_numbers(plants["species"]),
        *(decimals(place[:, axis], 3) for axis in range(3)),
        decimals(turn, 4),
        decimals(plants["scale"], 3),
        decimals(plants["tint"], 3),
        *(decimals(normal[:, axis], 4) for axis in range(3)),
    ]
    parts = [part for column in columns for part in (b",", column)]
    return json_rows([b"[", *parts[1:], b"]"])


def write_plants(
    path: Path,
    terrain: Planted,
    storey: str,
    sampled: Sampled,
    axes: EngineAxes,
    *,
    degrees: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Path:
    """Write the plants of a grid's rectangle: an object with their axes, species, fields, and rows.

    Parameters
    ----------
    path
    terrain
    storey
        ``'woody'`` or ``'grass'``.
    sampled
        The ground that they stand on.
    axes
        The program's.
    degrees
        Whether it turns by degrees, not radians.
    progress
        Called with the share that is done, 0 … 1.

    Raises
    ------
    SketchterrainError
        If the system cannot write the file.
    """
    head: dict[str, Any] = {
        "format": 1,
        "axes": axes.facts,
        "rotation": f"{'degrees' if degrees else 'radians'} about the vertical axis",
        "species": list(terrain.species_names),
        "fields": list(PLANT_FIELDS),
    }
    _, south, _, north = sampled.grid.area

    def rows() -> Iterator[bytes]:
        for plants in plants_within(terrain, sampled.grid.area, storey):
            yield plant_rows(plants, sampled, axes, degrees=degrees)
            if progress is not None:
                progress(min(1.0, max(0.0, (float(plants["y"].max()) - south) / (north - south))))

    return write_listing(path, head, "plants", rows())
