"""Edits of features as new layers, and layers saved as files with their edits."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import shapely
from shapely.affinity import rotate, scale, translate
from shapely.geometry.base import BaseGeometry

from sketchterrain.array_types import Float64Array
from sketchterrain.document.drapes import DrapedLayer, FeatureEdit, class_value
from sketchterrain.document.store import reject_sketch_folder
from sketchterrain.drape.drapes import Drapes
from sketchterrain.drape.vector_source import Feature, VectorSource
from sketchterrain.drape.vector_store import FileProjection, open_drape
from sketchterrain.errors import InputError, SketchterrainError, format_value, one_line
from sketchterrain.features.files import FileTable, write_table
from sketchterrain.io.files import atomic_path, hash_file

DRIVERS: Final = {".gpkg": "GPKG", ".fgb": "FlatGeobuf", ".geojson": "GeoJSON", ".json": "GeoJSON"}
"""Formats that a layer can be saved in, by suffix."""

_BATCH: Final = 1 << 16  # features that are written to a GeoPackage at once

_Value = int | float | str | None


def move_feature(layer: DrapedLayer, feature: Feature, east: float, north: float) -> DrapedLayer:
    """Return the layer with a feature moved by metres."""
    return with_geometry(layer, feature, translate(feature.geometry, east, north))


def rotate_feature(
    layer: DrapedLayer, feature: Feature, degrees: float, about: tuple[float, float]
) -> DrapedLayer:
    """Return the layer with a feature rotated counterclockwise about a point (m)."""
    return with_geometry(layer, feature, rotate(feature.geometry, degrees, about))


def scale_feature(
    layer: DrapedLayer, feature: Feature, factors: tuple[float, float], about: tuple[float, float]
) -> DrapedLayer:
    """Return the layer with a feature scaled eastward and northward about a point (m)."""
    if not all(factors):
        raise InputError(f"feature {feature.id}: scale {format_value(factors)}: expected no zero")
    return with_geometry(layer, feature, scale(feature.geometry, *factors, origin=about))


def move_vertex(layer: DrapedLayer, feature: Feature, vertex: int, x: float, y: float) -> DrapedLayer:
    """Return the layer with a vertex of a feature, as `shapely.get_coordinates` numbers it, at a point."""

    def moved(line: Float64Array, at: int) -> Float64Array:
        return np.where(np.arange(len(line))[:, None] == at, (x, y), line)

    return _with_line(layer, feature, vertex, moved)


def insert_vertex(layer: DrapedLayer, feature: Feature, vertex: int, x: float, y: float) -> DrapedLayer:
    """Return the layer with another vertex (m) of a feature, after one that is not the last of its line."""
    return _with_line(layer, feature, vertex, lambda line, at: np.insert(line, at + 1, (x, y), axis=0))


def delete_vertex(layer: DrapedLayer, feature: Feature, vertex: int) -> DrapedLayer:
    """Return the layer without a vertex of a feature; the last point of a part takes the part with it."""
    return _with_line(layer, feature, vertex, lambda line, at: np.delete(line, at, axis=0))


def _with_line(
    layer: DrapedLayer, feature: Feature, vertex: int, change: Callable[[Float64Array, int], Float64Array]
) -> DrapedLayer:
    """Return the layer with one point, line or ring of a feature changed, given the vertex's place in it."""
    shape, first = feature.geometry, 0
    kind = shape.geom_type.removeprefix("Multi")
    count = shapely.get_num_coordinates(shape) if kind in _MAKERS else 0  # not in collections
    if not 0 <= vertex < count:
        raise InputError(f"feature {feature.id}: vertex {vertex}: expected 0 to {count - 1}")
    (least, make), is_area = _MAKERS[kind], int(kind == "Polygon")
    parts = [_lines(part) for part in shapely.get_parts(shape)]
    for part in parts:
        for number, line in enumerate(part):
            if 0 <= (at := vertex - first) < len(line):
                count = len(line) - is_area
                changed = change(line[:count], at % count)
                part[number] = np.concatenate([changed, changed[:is_area]])
            if not np.isfinite(part[number]).all():
                raise InputError(f"feature {feature.id}: expected finite coordinates")
            if kind == "Point" and len(part[number]) > 1:
                raise InputError(f"feature {feature.id}: expected a line or an area to insert a vertex in")
            first += len(line)
    shapes = [
        make([part[0], *(hole for hole in part[1:] if len(hole) >= least)])
        for part in parts
        if len(part[0]) >= least
    ]
    if not shapes:
        return delete_feature(layer, feature)
    return with_geometry(layer, feature, shapes[0] if shape.geom_type == kind else type(shape)(shapes))


_MAKERS: Final[dict[str, tuple[int, Callable[[list[Float64Array]], BaseGeometry]]]] = {
    "Point": (1, lambda lines: shapely.Point(lines[0][0])),
    "LineString": (2, lambda lines: shapely.LineString(lines[0])),
    "Polygon": (4, lambda rings: shapely.Polygon(rings[0], rings[1:])),
}
"""By kind of part: the fewest coordinates of a line or ring, and how a part is made of them."""


def _lines(part: BaseGeometry) -> list[Float64Array]:
    """Return the coordinates of a point or line, or of the rings of an area."""
    rings = shapely.get_rings(part) if part.geom_type == "Polygon" else [part]
    return [shapely.get_coordinates(ring) for ring in rings]


def with_geometry(layer: DrapedLayer, feature: Feature, geometry: BaseGeometry) -> DrapedLayer:
    """Return the layer with another geometry (m) of a feature; raise InputError if it becomes invalid."""
    if shapely.is_valid(feature.geometry):
        _check(geometry, f"feature {feature.id}")
    return _with_edit(layer, feature.id, shapely.to_wkb(geometry), feature.properties)


def _check(geometry: BaseGeometry, what: str) -> None:
    if not shapely.is_valid(geometry):
        reason = one_line(shapely.is_valid_reason(geometry))[:80]
        raise InputError(f"{what}: expected a valid geometry ({reason})")


def _with_edit(layer: DrapedLayer, number: int, wkb: bytes, properties: Mapping[str, _Value]) -> DrapedLayer:
    edit = FeatureEdit(number, wkb, tuple(properties.items()))
    return layer.replace(edits={**layer.edits, number: edit})


def set_properties(layer: DrapedLayer, feature: Feature, values: Mapping[str, _Value]) -> DrapedLayer:
    """Return the layer with other values of some properties of a feature; None is no value."""
    return _with_edit(layer, feature.id, shapely.to_wkb(feature.geometry), {**feature.properties, **values})


def create_feature(
    layer: DrapedLayer, source: VectorSource, geometry: BaseGeometry, properties: Mapping[str, _Value]
) -> tuple[DrapedLayer, int]:
    """Return the layer with another feature, and its id; raise InputError if its geometry (m) is invalid."""
    number = source.updated(layer).next_id
    _check(geometry, "new feature")
    return _with_edit(layer, number, shapely.to_wkb(geometry), properties), number


def delete_feature(layer: DrapedLayer, feature: Feature) -> DrapedLayer:
    """Return the layer without a feature."""
    return _with_edit(layer, feature.id, b"", {})


def save_layer(drapes: Drapes, number: int, path: Path) -> DrapedLayer:
    """Write a layer with its edits as a file, whole or not at all, and return the layer of that file.

    The suffix of the path is the format. Coordinates are in the CRS of the layer's file, in GeoJSON in
    degrees. Other tables of a GeoPackage are kept if it is the layer's own file. Raise InputError if the
    file has changed, if a property does not fit it, or if it cannot be written.
    """
    layer, source = drapes.layers[number], drapes.sources[number]
    driver = DRIVERS.get(path.suffix.lower())
    if driver is None or not isinstance(source, VectorSource):
        what = f"{one_line(path)}: expected a name with {', '.join(DRIVERS)}"
        raise InputError(what if driver is None else f"layer {layer.title}: expected features")
    if problem := source.problem(layer):
        raise InputError(problem)
    if driver == "FlatGeobuf":
        reject_sketch_folder(path.parent)
    own = Path(layer.path)
    with (
        atomic_path(path) as temporary,
        TemporaryDirectory(prefix=".sketchterrain-", dir=path.parent) as folder,
        open_drape(layer) as (file, stored, crs),
    ):
        if driver == "GeoJSON" and crs is None:
            what = "expected a CRS for GeoJSON: save it as GeoPackage or FlatGeobuf"
            raise InputError(f"{file.place}: {what}")
        written = Path(folder) / f"layer{path.suffix.lower()}"
        if driver == "GPKG" and path.exists() and path.samefile(own):
            shutil.copyfile(own, written)
        _write(stored, layer, FileProjection(crs, drapes.frame, file.place), written, driver)
        written.replace(temporary)
        table = stored.name if driver == "GPKG" else ""
    return layer.replace(path=str(path.absolute()), sha256=hash_file(path)[1], table=table, edits={})


def _write(table: FileTable, layer: DrapedLayer, projection: FileProjection, path: Path, driver: str) -> None:
    """Write the features of a file, those of a GeoPackage in batches."""
    edits = layer.edits
    kinds = {**table.fields, **_new_kinds(table.fields, edits.values())}
    same = {shapely.from_wkb(edit.geometry).geom_type for edit in edits.values() if edit.geometry}
    one_type = same <= {table.geometry_type.partition(" ")[0]}
    step = _BATCH if driver == "GPKG" else max(table.features, 1)
    for first in range(0, max(table.features, 1), step):
        wkb, values, _ = table.read(first, step, force_2d=False, datetime_as_string=False)
        ids = list(range(first, first + len(wkb)))
        if first + step >= table.features:  # new features follow the last one
            ids += sorted(number for number in edits if number >= table.features)
        edited = {at: edits[number] for at, number in enumerate(ids) if number in edits}
        wkb = np.append(wkb, np.full(len(ids) - len(wkb), None))
        for at, edit in edited.items():
            wkb[at] = edit.geometry and _in_file(edit.geometry, wkb[at], projection)
        left = np.array([at not in edited or bool(edited[at].geometry) for at in range(len(ids))], bool)
        columns = {
            name: _column(values.get(name), name, kind, edited, len(ids)) for name, kind in kinds.items()
        }
        try:
            write_table(
                path,
                table.name,
                wkb[left],
                {name: column[left] for name, (column, _) in columns.items()},
                missing={name: missing[left] for name, (_, missing) in columns.items()},
                driver=driver,
                geometry_type=table.geometry_type if one_type else "Unknown",
                crs=table.crs or (layer["crs"] if driver == "GeoJSON" else None),
                append=first > 0,
            )
        except (RuntimeError, ValueError) as error:
            reason = one_line(error)[:160]
            raise SketchterrainError(f"{path.suffix[1:]}: cannot be written ({reason})") from None


def _in_file(wkb: bytes, before: bytes | None, projection: FileProjection) -> bytes:
    """Return a geometry in the file's coordinates, with the heights of the nearest vertices before."""
    shape = shapely.transform(shapely.from_wkb(wkb), projection.to_file)
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        raise InputError(f"{projection.place}: expected edited features with a place in the file's CRS")
    old = shapely.get_coordinates(shapely.from_wkb(before), include_z=True) if before else np.zeros((0, 3))
    if len(old) and np.isfinite(old).all():
        heights = [old[np.argmin(np.hypot(*(old[:, :2] - at).T)), 2] for at in shapely.get_coordinates(shape)]
        shape = shapely.force_3d(shape)
        shape = shapely.transform(shape, lambda at: np.column_stack([at[:, :2], heights]), include_z=True)
    return bytes(shapely.to_wkb(shape))


def _new_kinds(fields: Mapping[str, str], edits: Iterable[FeatureEdit]) -> dict[str, str]:
    """Return the dtypes of properties that the file does not have."""
    ranks = dict[str, int]()
    for name, value in (pair for edit in edits for pair in edit.properties if pair[0] not in fields):
        ranks[name] = max(ranks.get(name, 0), {int: 0, float: 1}.get(type(value), 2))
    return {name: ("int64", "float64", "object")[rank] for name, rank in ranks.items()}


def _column(
    values: npt.NDArray[Any] | None, name: str, kind: str, edited: Mapping[int, FeatureEdit], rows: int
) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """Return a property of features with edits, and where it has no value."""
    given = np.zeros(0, kind) if values is None else values
    missing = np.ones(rows, bool)
    missing[: len(given)] = [each is None or each != each for each in given.tolist()]
    column = np.full(rows, None) if kind == "object" else np.zeros(rows, kind)
    column[~missing] = given[~missing[: len(given)]]
    for at, edit in edited.items():
        value = dict(edit.properties).get(name)
        missing[at] = value is None
        if value is not None:
            column[at] = _converted(value, name, kind)
    return column, missing


def _converted(value: int | float | str, name: str, kind: str) -> Any:
    """Return a value as one of a column; raise InputError if it is another kind of value."""
    if kind == "object":
        return class_value(value)
    with suppress(ValueError, OverflowError):
        found = np.array(value).astype(kind)[()]
        if found == value or (isinstance(value, str) and kind.startswith("datetime")):
            return found
    raise InputError(f"property {one_line(name)} = {format_value(value)}: expected {kind}, as in the file")
