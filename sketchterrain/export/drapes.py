"""Draped vector layers on the ground, and as tables of a GeoPackage with heights."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.array_types import Bounds
from sketchterrain.document.drapes import DrapedLayer, class_value
from sketchterrain.document.frame import georeference
from sketchterrain.export.rasters import local_metres
from sketchterrain.export.vectors import ExportLayer, Origin, distinct_name, geopackage
from sketchterrain.io.crs import parse_crs
from sketchterrain.schema.parameters import Properties

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.generation.terrain import Terrain

_POINTS_AT_ONCE: Final = 1 << 20


class DrapedShapes(NamedTuple):
    """Features of a layer on the ground, inside a rectangle."""

    layer: DrapedLayer
    ids: list[int]
    geometry: npt.NDArray[np.object_]  # (n,) shapely geometries, m from the sketch's south-west corner
    properties: list[dict[str, Any]]

    def by_style(self) -> Iterator[tuple[str, Properties, npt.NDArray[np.object_]]]:
        """Yield the name of each style in use, its values and the geometries that have it."""
        by, numbers = self.layer["by"], self.layer.class_numbers
        own = np.array([numbers.get(class_value(row.get(by)), -1) for row in self.properties], int)
        for number in np.unique(own).tolist():
            value = f" {self.layer.classes[number].value}" if number >= 0 else ""
            name = f"{self.layer.title}{value}"
            yield name, self.layer.style_of(number), self.geometry[own == number]


def draped_shapes(drapes: Drapes | None, terrain: Terrain, bounds: Bounds, cell: float) -> list[DrapedShapes]:
    """Return features of visible vector layers in a rectangle (m), with vertices at most `cell` m apart."""
    if drapes is None:
        return []
    from sketchterrain.drape.vector_source import VectorSource
    from sketchterrain.features.files import valid_areas

    found = []
    for layer, source in zip(drapes.layers, drapes.sources, strict=True):
        if layer["visible"] and isinstance(source, VectorSource):
            table = source.table
            ids = table.touching(bounds).tolist()
            shapes = valid_areas(np.fromiter(map(table.geometry, ids), object, len(ids)))
            shapes = shapely.clip_by_rect(shapes, *bounds)
            kept = np.flatnonzero(~shapely.is_empty(shapes)).tolist()
            ids = [ids[each] for each in kept]
            ground = _on_ground(shapes[kept], terrain, cell)
            values = [{**dict.fromkeys(table.columns), **table.feature(each).properties} for each in ids]
            found.append(DrapedShapes(layer, ids, ground, values))
    return found


def _on_ground(shapes: npt.NDArray[np.object_], terrain: Terrain, cell: float) -> npt.NDArray[np.object_]:
    """Return shapes with more vertices, and heights."""
    raised = shapely.force_3d(shapely.segmentize(shapes, cell))
    points = shapely.get_coordinates(raised, include_z=True)
    for part in np.array_split(points, -(-len(points) // _POINTS_AT_ONCE) or 1):
        part[:, 2] = terrain.heights(part[:, 0], part[:, 1], cell_size=cell)
    return np.asarray(shapely.set_coordinates(raised, points))


def write_drapes(
    path: Path, layers: Sequence[DrapedShapes], terrain: Terrain, crs: str | None = None, origin: Any = None
) -> tuple[Path, ...]:
    """Write a GeoPackage with a table for each layer, if there are any; by default in the sketch's frame."""
    if not layers:
        return ()
    if crs is None:
        crs, origin = georeference(terrain.sketch.frame, None, None)
    with geopackage(path, (local_metres() if crs is None else parse_crs(crs)).to_wkt()) as file:
        for name, each in zip(table_names(layers), layers, strict=True):
            file.add(_table(name, each, Origin(*origin or (0.0, 0.0))))
    return (path,)


def table_names(layers: Sequence[DrapedShapes]) -> list[str]:
    """Return the names of the layers' tables in their GeoPackage."""
    taken = set[str]()
    names = (re.sub(r"[^\w -]", "_", each.layer.title).strip() or "layer" for each in layers)
    return [distinct_name(name, taken) for name in names]


def _table(name: str, shapes: DrapedShapes, origin: Origin) -> ExportLayer:
    """Return a layer of a GeoPackage."""
    fields: dict[str, npt.NDArray[Any]] = {"id": np.array(shapes.ids, np.int64)}
    used = {"fid", "geom", *fields}
    for key in dict.fromkeys(key for row in shapes.properties for key in row):
        fields[distinct_name(key, used)] = _column([row.get(key) for row in shapes.properties])
    moved = shapely.transform(shapes.geometry, lambda at: np.add(at, (*origin, 0.0)), include_z=True)
    return ExportLayer(name, "Unknown", moved, fields)


def _column(values: list[Any]) -> npt.NDArray[Any]:
    """Return whole numbers, numbers with NaN for those without, or texts."""
    if all(isinstance(value, int) for value in values):
        return np.array(values, np.int64)
    if all(value is None or isinstance(value, int | float) for value in values):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    return np.array([None if value is None else str(value) for value in values], object)
