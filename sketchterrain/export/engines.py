"""Engine coordinate systems, file names of tiles, and plants and water as JSON in engine coordinates."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import FloatArray
from sketchterrain.export.files import format_rows, write_json, write_json_list
from sketchterrain.export.foliage_files import plant_chunks, plant_pieces
from sketchterrain.export.sampled import TerrainSamples, interpolate_heights
from sketchterrain.export.target import Export, ExportOptions, TileWindow
from sketchterrain.export.vectors import lake_outline
from sketchterrain.landforms.placement.feature_types import Lake, River
from sketchterrain.terrain.surfaces import TerrainFeatures

Direction = Literal["east", "north", "up", "south"]
PLANT_FIELDS: Final = (
    *("species", "x", "y", "z", "rotation", "scale", "tint"),
    *("normal_x", "normal_y", "normal_z"),
)
"""Columns of a plant's row."""

_PLANT_ROW: Final = "[%d,%.3f,%.3f,%.3f,%.4f,%.3f,%.3f,%.4f,%.4f,%.4f],\n"
_WORLD: Final = {"east": (1, 0, 0), "north": (0, 1, 0), "up": (0, 0, 1), "south": (0, -1, 0)}
_PLANTS: Final = {"woody": "trees and shrubs", "grass": "grass, flowers and ferns"}
_DECIMALS: Final = 3


@dataclass(frozen=True)
class EngineAxes:
    """A program's coordinate system."""

    x: Direction  # where each axis points
    y: Direction
    z: Direction
    unit: str = "m"  # or "cm"
    per_metre: float = 1.0  # units
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the program: east, north, up in the sketch (m)

    @property
    def rotation_sign(self) -> int:
        """1 where angles about the vertical axis are counter-clockwise seen from above, else −1."""
        return round(float(np.linalg.det(self._matrix)))

    @property
    def metadata(self) -> dict[str, Any]:
        """Its entry in files and sidecars."""
        return {
            "x": self.x,
            "y": self.y,
            "z": self.z,
            "unit": self.unit,
            "handed": "right" if self.rotation_sign > 0 else "left",
            "origin": dict(zip(("east", "north", "up"), self.origin, strict=True)),
        }

    @property
    def title(self) -> str:
        """Unit and directions in words."""
        return f"{self.unit}: x {self.x}, y {self.y}, z {self.z}"

    def points(self, east: FloatArray, north: FloatArray, up: FloatArray) -> FloatArray:
        """Return points of the world (m) in the program's coordinates and unit, (n, 3)."""
        world = np.stack([east, north, up], axis=-1).astype(np.float64) - self.origin
        return world @ self._matrix.T * self.per_metre

    def vectors(self, vectors: FloatArray) -> FloatArray:
        """Return vectors east, north, up, (n, 3), along the program's axes; lengths are unchanged."""
        return vectors.astype(np.float64) @ self._matrix.T

    @property
    def _matrix(self) -> npt.NDArray[np.float64]:
        return np.array([_WORLD[axis] for axis in (self.x, self.y, self.z)], np.float64)


def tile_path(export: Export, kind: str, tile: TileWindow, suffix: str) -> Path:
    """Return the path of a tile's file of one kind: ``valley_grass_x0_y0.png``."""
    tiling = export.tiling
    name = tiling.tile_name("_".join(part for part in (export.name, kind) if part), tile)
    if kind and tiling.count > 1 and "{name}" not in tiling.pattern:
        name = f"{kind}_{name}"  # else all kinds would have one name
    return export.folder / f"{name}{suffix}"


def tile_samples(export: Export) -> Iterator[tuple[TileWindow, TerrainSamples]]:
    """Return the tiles and their samples, from the north-west, row by row."""
    for tile in export.tiling.tiles(export.grid.columns, export.grid.rows):
        yield tile, export.samples.window(tile.left, tile.top, tile.columns, tile.rows)


def write_tiles(
    export: Export, stage: str, title: str, write: Callable[[TileWindow, TerrainSamples], dict[Path, str]]
) -> dict[Path, str]:
    """Write the files of each tile as a stage of work, and return them with their descriptions."""
    files: dict[Path, str] = {}
    with export.stages.stage(stage, title) as progress:
        for done, (tile, samples) in enumerate(tile_samples(export), start=1):
            files |= write(tile, samples)
            progress(done / export.tiling.count)
    return files


def requested_storeys(options: ExportOptions) -> dict[str, str]:
    """Return the storeys of plants to write, and the word for each in file names."""
    names = {"woody": ("plants", options.plants), "grass": ("grass", options.grass)}
    return {storey: name for storey, (name, requested) in names.items() if requested}


def write_plants_json(export: Export, axes: EngineAxes, *, degrees: bool = False) -> dict[Path, str]:
    """Write the requested storeys of plants, a JSON file each; return the files with their descriptions."""
    samples, files = export.samples, dict[Path, str]()
    head: dict[str, Any] = {
        "format": 1,
        "axes": axes.metadata,
        "rotation": f"{'degrees' if degrees else 'radians'} about the vertical axis",
        "species": list(export.terrain.species_names),
        "fields": list(PLANT_FIELDS),
    }
    for storey, kind in requested_storeys(export.options).items():
        path = export.folder / f"{export.name}_{kind}.json"
        with export.stages.stage(kind, kind.capitalize()) as progress:
            chunks = plant_chunks(plant_pieces(export.terrain, samples.grid.bounds, storey, progress))
            rows = (_plant_rows(plants, samples, axes, degrees=degrees) for plants in chunks)
            write_json_list(path, head, "plants", rows)
        files[path] = f"{_PLANTS[storey]}, {axes.title}"
    return files


def _plant_rows(
    plants: npt.NDArray[np.void], samples: TerrainSamples, axes: EngineAxes, *, degrees: bool
) -> bytes:
    """Return a row of `PLANT_FIELDS` for each plant, on the interpolated terrain of the grid."""
    height = interpolate_heights(samples, plants["x"], plants["y"])
    position = axes.points(plants["x"], plants["y"], height)
    normal = axes.vectors(plants["normal"])
    full = 360.0 if degrees else 2.0 * np.pi
    turn = np.mod(axes.rotation_sign * plants["rotation"].astype(np.float64) * (full / (2.0 * np.pi)), full)
    columns = plants["species"], *position.T, turn, plants["scale"], plants["tint"], *normal.T
    return format_rows(_PLANT_ROW, *columns).removesuffix(b",\n")


def write_water_json(export: Export, axes: EngineAxes) -> dict[Path, str]:
    """Write the waters; return the file with its description."""
    path = export.folder / f"{export.name}_water.json"
    write_json(path, water_content(export.terrain.features, axes))
    return {path: f"rivers, lakes and the sea, {axes.title}"}


def water_content(features: TerrainFeatures, axes: EngineAxes) -> dict[str, Any]:
    """Return all waters in the program's coordinates and unit.

    A river is its centreline on the water, from the spring; a lake's outline is closed rings at its level,
    islands included; the sea, if there is one, is a level.
    """

    def height(level: float) -> float:
        return round(float((np.float64(level) - axes.origin[2]) * axes.per_metre), _DECIMALS)

    def river_entry(river: River) -> dict[str, Any]:
        return {
            "id": river.id,
            "label": river.label,
            "points": rounded_list(axes.points(*river.centreline.T)),
            "width": rounded_list(river.centreline_width * axes.per_metre),
            "depth": rounded_list(river.centreline_depth * axes.per_metre),
        }

    def lake_entry(lake: Lake) -> dict[str, Any]:
        outline = [np.insert(ring, 2, lake.level, axis=1) for ring in lake_outline(lake.shape)]
        return {
            "id": lake.id,
            "label": lake.label,
            "level": height(lake.level),
            "depth": round(float(lake.depth * axes.per_metre), _DECIMALS),
            "outline": [rounded_list(axes.points(*ring.T)) for ring in outline],
        }

    return {
        "format": 1,
        "axes": axes.metadata,
        "rivers": [river_entry(river) for river in features.rivers],
        "lakes": [lake_entry(lake) for lake in features.lakes],
        **({} if features.sea_level is None else {"sea": {"level": height(features.sea_level)}}),
    }


def rounded_list(values: npt.NDArray[np.floating]) -> Any:
    """Return numbers as nested lists, rounded for files."""
    # Adding zero makes 0.0 of −0.0.
    return (np.round(values.astype(np.float64), _DECIMALS) + 0.0).tolist()
