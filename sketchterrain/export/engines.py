"""Plants and waters along the axes of an engine, as JSON, and the names of an engine's files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
import numpy.typing as npt

from sketchterrain.export.features import lake_outline
from sketchterrain.export.files import text_rows, write_json, write_listing
from sketchterrain.export.foliage_files import Area, Planted
from sketchterrain.export.sampled import Sampled, ground_at
from sketchterrain.export.target import Export, ExportOptions
from sketchterrain.export.tiling import Piece

if TYPE_CHECKING:  # load SciPy and OpenCL
    from sketchterrain.features import Lake, River
    from sketchterrain.terrain import TerrainFeatures

Direction = Literal["east", "north", "up", "south"]
Reals = npt.NDArray[np.floating]
PLANT_FIELDS: Final = (
    "species",
    "x",
    "y",
    "z",
    "rotation",
    "scale",
    "tint",
    "normal_x",
    "normal_y",
    "normal_z",
)
"""Of a row of plants."""

_PLANT_ROW: Final = "[%d,%.3f,%.3f,%.3f,%.4f,%.3f,%.3f,%.4f,%.4f,%.4f],\n"
_AT_ONCE: Final = 1 << 12  # plants
_WORLD: Final = {"east": (1, 0, 0), "north": (0, 1, 0), "up": (0, 0, 1), "south": (0, -1, 0)}
_PLANTS: Final = {"woody": "trees and shrubs", "grass": "grass, flowers and ferns"}
_DECIMALS: Final = 3


@dataclass(frozen=True)
class EngineAxes:
    """A program's coordinate system.

    Attributes
    ----------
    x, y, z : {'east', 'north', 'up', 'south'}
        Where each axis points.
    unit : str
        Its name, "m" or "cm".
    per_metre : float
        Units a metre has.
    origin : (float, float, float)
        The program's own origin: east, north and up of the sketch's south-west corner, m.
    """

    x: Direction
    y: Direction
    z: Direction
    unit: str = "m"
    per_metre: float = 1.0
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def turn(self) -> int:
        """1 where angles about the vertical axis grow counter-clockwise seen from above, else −1."""
        return round(float(np.linalg.det(self._matrix)))

    @property
    def facts(self) -> dict[str, Any]:
        """What a file says of them."""
        return {
            "x": self.x,
            "y": self.y,
            "z": self.z,
            "unit": self.unit,
            "handed": "right" if self.turn > 0 else "left",
            "origin": dict(zip(("east", "north", "up"), self.origin, strict=True)),
        }

    def places(self, east: Reals, north: Reals, up: Reals) -> Reals:
        """Return places of the world (m each) as the program has them."""
        world = np.stack([east, north, up], axis=-1).astype(np.float64) - self.origin
        return world @ self._matrix.T * self.per_metre

    def directions(self, vectors: Reals) -> Reals:
        """Return vectors east, north, up, shape (n, 3), along the program's axes; lengths stay."""
        return vectors.astype(np.float64) @ self._matrix.T

    @property
    def _matrix(self) -> npt.NDArray[np.float64]:
        return np.array([_WORLD[axis] for axis in (self.x, self.y, self.z)], np.float64)


def path_of(export: Export, what: str, piece: Piece, ending: str) -> Path:
    """Return the path of a tile's file of one kind: ``valley_grass_x0_y0.png``."""
    tiling = export.tiling
    name = tiling.name("_".join(each for each in (export.name, what) if each), piece)
    if what and tiling.count > 1 and "{name}" not in tiling.pattern:
        name = f"{what}_{name}"  # else all kinds would have one name
    return export.folder / f"{name}{ending}"


def tiles_of(export: Export) -> Iterator[tuple[Piece, Sampled]]:
    """Return the tiles and what is known at their vertices, from the north-west, row by row."""
    for piece in export.tiling.pieces(export.grid.columns, export.grid.rows):
        yield piece, export.sampled.part(piece.left, piece.top, piece.columns, piece.rows)


def storeys_of(options: ExportOptions) -> dict[str, str]:
    """Return the storeys of plants that are wanted, and what each is called in files' names."""
    named = {"woody": ("plants", options.plants), "grass": ("grass", options.grass)}
    return {storey: name for storey, (name, wanted) in named.items() if wanted}


def plants_within(terrain: Planted, area: Area, storey: str) -> Iterator[npt.NDArray[np.void]]:
    """Return the plants of a rectangle in small pieces, none of them empty."""
    for plants in terrain.foliage_pieces(*area, storey=storey):
        for first in range(0, len(plants), _AT_ONCE):
            yield plants[first : first + _AT_ONCE]


def write_all_plants(export: Export, axes: EngineAxes, *, degrees: bool = False) -> dict[Path, str]:
    """Write the storeys of plants that are wanted, a JSON file each; return the files and what they are."""
    sampled, files = export.sampled, dict[Path, str]()
    head: dict[str, Any] = {
        "format": 1,
        "axes": axes.facts,
        "rotation": f"{'degrees' if degrees else 'radians'} about the vertical axis",
        "species": list(export.terrain.species_names),
        "fields": list(PLANT_FIELDS),
    }
    _, south, _, north = sampled.grid.area
    for storey, kind in storeys_of(export.options).items():
        path = export.folder / f"{export.name}_{kind}.json"
        with export.stages.stage(kind, kind.capitalize()) as tell:

            def rows(storey: str = storey, tell: Callable[[float], None] = tell) -> Iterator[bytes]:
                for plants in plants_within(export.terrain, sampled.grid.area, storey):
                    yield plant_rows(plants, sampled, axes, degrees=degrees)
                    tell(min(1.0, max(0.0, (float(plants["y"].max()) - south) / (north - south))))

            write_listing(path, head, "plants", rows())
        files[path] = f"{_PLANTS[storey]}, {_along(axes)}"
    return files


def plant_rows(plants: npt.NDArray[np.void], sampled: Sampled, axes: EngineAxes, *, degrees: bool) -> bytes:
    """Return a row of :data:`PLANT_FIELDS` for each plant, which stands on the grid's ground.

    Rotations are about the vertical axis, positive as the program turns.
    """
    place = axes.places(plants["x"], plants["y"], ground_at(sampled, plants["x"], plants["y"]))
    normal = axes.directions(plants["normal"])
    whole = 360.0 if degrees else 2.0 * np.pi
    turn = np.mod(axes.turn * plants["rotation"].astype(np.float64) * (whole / (2.0 * np.pi)), whole)
    columns = plants["species"], *place.T, turn, plants["scale"], plants["tint"], *normal.T
    return text_rows(_PLANT_ROW, *columns).removesuffix(b",\n")


def write_all_water(export: Export, axes: EngineAxes) -> dict[Path, str]:
    """Write rivers and lakes; return the file and what it is."""
    path = export.folder / f"{export.name}_water.json"
    return {write_json(path, water_in(export.terrain.features, axes)): f"rivers and lakes, {_along(axes)}"}


def _along(axes: EngineAxes) -> str:
    return f"{axes.unit}: x {axes.x}, y {axes.y}, z {axes.z}"


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
