"""Draped layers saved as files with their edits."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from sketchterrain.document.drapes import DrapedLayer, class_value
from sketchterrain.document.store import reject_sketch_folder
from sketchterrain.drape.drapes import Drapes
from sketchterrain.drape.vector_source import VectorSource
from sketchterrain.drape.vector_store import FileProjection, open_drape
from sketchterrain.errors import InputError, SketchterrainError, format_value, one_line
from sketchterrain.features.files import FileTable, write_table
from sketchterrain.features.table import Feature
from sketchterrain.io.files import atomic_path, hash_file

DRIVERS: Final = {".gpkg": "GPKG", ".fgb": "FlatGeobuf", ".geojson": "GeoJSON", ".json": "GeoJSON"}
"""Formats that a layer can be saved in, by suffix."""

_BATCH: Final = 1 << 16  # features that are written to a GeoPackage at once


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
    of_table = table.geometry_type.partition(" ")[0]
    types = {edit.geometry.geom_type for edit in edits.values() if edit}
    one_type = types <= {of_table, of_table.removeprefix("Multi")}
    step = _BATCH if driver == "GPKG" else max(table.features, 1)
    for first in range(0, max(table.features, 1), step):
        wkb, values, _ = table.read(first, step, force_2d=False, datetime_as_string=False)
        ids = list(range(first, first + len(wkb)))
        if first + step >= table.features:  # new features follow the last one
            ids += sorted(number for number in edits if number >= table.features)
        edited = {at: edits[number] for at, number in enumerate(ids) if number in edits}
        wkb = np.append(wkb, np.full(len(ids) - len(wkb), None))
        for at, edit in edited.items():
            wkb[at] = edit and _in_file(edit.geometry, wkb[at], projection, of_table)
        left = np.array([edited.get(at, True) is not None for at in range(len(ids))], bool)
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


def _in_file(geometry: BaseGeometry, before: bytes | None, projection: FileProjection, kind: str) -> bytes:
    """Return a geometry in the file's coordinates, with the heights of the nearest vertices before.

    It has several parts if it had, or if those of the table's kind have.
    """
    shape = shapely.transform(geometry, projection.to_file)
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        raise InputError(f"{projection.place}: expected edited features with a place in the file's CRS")
    former, several = shapely.from_wkb(before), f"Multi{shape.geom_type}"
    if several == kind or (former is not None and former.geom_type == several):
        shape = getattr(shapely, several)([shape])
    old = shapely.get_coordinates(former, include_z=True)
    if len(old) and np.isfinite(old).all():
        heights = [old[np.argmin(np.hypot(*(old[:, :2] - at).T)), 2] for at in shapely.get_coordinates(shape)]
        shape = shapely.force_3d(shape)
        shape = shapely.transform(shape, lambda at: np.column_stack([at[:, :2], heights]), include_z=True)
    return bytes(shapely.to_wkb(shape))


def _new_kinds(fields: Mapping[str, str], edits: Iterable[Feature | None]) -> dict[str, str]:
    """Return the dtypes of properties that the file does not have."""
    ranks = dict[str, int]()
    for name, value in (pair for edit in edits if edit for pair in edit.properties.items()):
        if name not in fields:
            ranks[name] = max(ranks.get(name, 0), {int: 0, float: 1}.get(type(value), 2))
    return {name: ("int64", "float64", "object")[rank] for name, rank in ranks.items()}


def _column(
    values: npt.NDArray[Any] | None, name: str, kind: str, edited: Mapping[int, Feature | None], rows: int
) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """Return a property of features with edits, and where it has no value."""
    given = np.zeros(0, kind) if values is None else values
    missing = np.ones(rows, bool)
    missing[: len(given)] = [each is None or each != each for each in given.tolist()]
    column = np.full(rows, None) if kind == "object" else np.zeros(rows, kind)
    column[~missing] = given[~missing[: len(given)]]
    for at, edit in edited.items():
        value = None if edit is None else edit.properties.get(name)
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
