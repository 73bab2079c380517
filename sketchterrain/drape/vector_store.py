"""Vector files as stores on disk: geometries in metres of the sketch, properties, and levels of items."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import pyogrio
import pyogrio.raw
import shapely
from rasterio import Env
from rasterio._err import CPLE_BaseError
from rasterio.crs import CRS
from rasterio.warp import transform

from sketchterrain.array_types import Bounds, Float64Array
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.rasters import content_hash
from sketchterrain.document.vector_formats import Shapes, layer_crs, vector_driver
from sketchterrain.drape.levels import (
    LevelWriter,
    Outlines,
    mapped,
    parts_of,
    split_shapes,
    stored_level,
)
from sketchterrain.errors import InputError, format_value, one_line
from sketchterrain.io.crs import parse_crs, plain_path
from sketchterrain.io.disk_cache import stored_folder
from sketchterrain.io.files import wrap_read_errors

FARTHEST: Final = 64.0
"""Extents of a sketch from it beyond which features are left out."""

_FORMAT: Final = 1  # of stores
_LEVELS: Final = 16
_SHRINK: Final = 0.7  # of the points of a finer level: a level with more is not stored
_CHUNK: Final = 1 << 23  # bytes of a file that are read at once
_NULL: Final = b"\xff"  # in texts, which are UTF-8
_NO_INTEGER: Final = np.iinfo(np.int64).min
_FAR: Final = np.array([80.0, 85.0])  # degrees from a sketch, of points that have no place in its frame


class VectorFile(NamedTuple):
    """A table of an open vector file."""

    dataset: str  # as GDAL opens it
    driver: str
    table: str
    crs: CRS | None
    crs_text: str | None
    geometry_type: str
    features: int
    fields: dict[str, str]  # dtypes by name
    place: str  # for errors

    def read(
        self, skip: int, most: int, *, exact: bool = False
    ) -> tuple[Shapes, dict[str, npt.NDArray[Any]]]:
        """Return the WKB of features in the file's CRS, and their properties by name.

        Without heights, and with dates as texts, unless `exact`.
        """
        meta, _, wkb, fields = pyogrio.raw.read(
            self.dataset,
            layer=self.table,
            skip_features=skip,
            max_features=most,
            force_2d=not exact,
            datetime_as_string=not exact,
        )
        return wkb, dict(zip(map(str, meta["fields"]), fields, strict=True))


@contextmanager
def open_vector_file(path: Path, table: str = "") -> Iterator[VectorFile]:
    """Open a table of a vector file, by default its first; raise InputError if it cannot be read."""
    place = f"draped layer {one_line(path)}"
    with wrap_read_errors(path), path.open("rb") as stream:
        start = stream.read(4096)
    driver = vector_driver(start)
    if driver is None:
        raise InputError(f"{place}: expected a vector file, it begins with {format_value(start[:20])}")
    try:
        with plain_path(path) as file, warnings.catch_warnings(), np.errstate(invalid="ignore"):
            warnings.simplefilter("ignore")  # GDAL has many harmless ones
            # The prefix excludes other drivers for JSON, such as pipelines that open other files.
            dataset = f"GeoJSON:{file}" if driver == "GeoJSON" else str(file)
            names = [str(name) for name, kind in pyogrio.list_layers(dataset) if kind is not None]
            if table not in ("", *names) or not names:
                expected = ", ".join(map(format_value, names[:20])) or "a table with geometries"
                raise InputError(f"{place}: table {format_value(table)}: expected {expected}")
            info = pyogrio.read_info(dataset, layer=table or names[0], force_feature_count=True)
            if info["driver"] != driver:
                raise InputError(f"{place}: expected {driver}, GDAL detects {info['driver']}")
            fields = dict(zip(map(str, info["fields"]), map(str, info["dtypes"]), strict=True))
            crs = layer_crs(info["crs"], place)
            known = crs, info["crs"], info["geometry_type"], info["features"]
            yield VectorFile(dataset, driver, table or names[0], *known, fields, place)
    except (RuntimeError, ValueError, OSError, shapely.errors.GEOSException) as error:
        raise InputError(f"{place}: cannot be read as {driver} ({one_line(error)[:160]})") from None


def file_crs(file: VectorFile, layer: DrapedLayer) -> CRS | None:
    """Return the CRS of a layer's coordinates; None if they are metres of the sketch's frame."""
    return layer_crs(layer.crs, file.place) if layer.crs and file.crs is None else file.crs


class Projection:
    """From coordinates of a file to metres from a sketch's south-west corner, and back."""

    def __init__(self, crs: CRS | None, frame: Mapping[str, Any], place: str) -> None:
        if crs is not None and not frame["crs"]:
            raise InputError(f"{place}: expected a sketch with a CRS, [frame] has none")
        self._corner = np.array([frame["east"], frame["north"]], np.float64)
        own = parse_crs(frame["crs"]) if frame["crs"] else None
        self._pair = (crs, own) if crs is not None and crs != own else None
        self._middle = None
        if self._pair is not None and crs is not None and crs.is_geographic:
            self._middle = _transformed(self._corner[None], own, crs)[0]

    def to_sketch(self, points: Float64Array) -> Float64Array:
        """Return points (n, 2) in metres; NaN where they have no place."""
        if self._pair is None:
            return points - self._corner
        if self._middle is not None:  # degrees across the antimeridian
            points = np.where(np.abs(points[:, 1:]) > 90.0, np.nan, points)
            turns = np.rint((points[:, 0] - self._middle[0]) / 360.0)
            points = points - turns[:, None] * np.array([360.0, 0.0])
        found = _transformed(points, *self._pair)
        lost = ~np.isfinite(found).all(axis=1)
        if lost.any() and self._middle is not None:  # far away in the same direction
            middle = self._middle * [1.0, 0.0]
            near = np.clip(points[lost], middle - _FAR, middle + _FAR)
            found[lost] = _transformed(near, *self._pair)
        return found - self._corner

    def to_file(self, points: Float64Array) -> Float64Array:
        """Return points (n, 2) of the sketch in the file's coordinates."""
        found = points + self._corner
        if self._pair is None:
            return found
        found = _transformed(found, *self._pair[::-1])
        if self._middle is not None:
            found[:, 0] -= 360.0 * np.rint(found[:, 0] / 360.0)
        return found


def _transformed(points: Float64Array, source: CRS, target: CRS) -> Float64Array:
    """Return points (n, 2) in another CRS; NaN where that fails, which GDAL reports for all at once."""
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        result = np.full(points.shape, np.nan)
        result[finite] = _transformed(points[finite], source, target)
        return result
    try:
        with Env():
            found = np.array(transform(source, target, points[:, 0], points[:, 1]), np.float64).T
        found[~np.isfinite(found).all(axis=1)] = np.nan
        return found
    except CPLE_BaseError:
        if len(points) == 1:
            return np.full((1, 2), np.nan)
        halves = np.array_split(points, 2)
        return np.concatenate([_transformed(half, source, target) for half in halves])


class VectorStore:
    """Features of a table of a vector file, by number in the order of the file."""

    def __init__(self, folder: Path) -> None:
        facts = json.loads((folder / "facts.json").read_text(encoding="utf-8"))
        self.count: int = facts["features"]
        self.fields: dict[str, str] = facts["fields"]
        self.left_out: int = facts["left_out"]
        self.box: Bounds = tuple(facts["box"])
        self.levels = tuple(stored_level(folder, number, tolerance) for number, tolerance in facts["levels"])
        self._geometry = _Texts(folder / "geometry")
        self._columns: dict[str, Any] = {
            name: _Texts(folder / f"column{number}")
            if kind == "text"
            else mapped(folder / f"column{number}.bin", np.dtype(kind))
            for number, (name, kind) in enumerate(self.fields.items())
        }

    def geometries(self, ids: Iterable[int]) -> Shapes:
        """Return geometries in metres of the sketch; None of features without one, or without a place."""
        content = [self._geometry[each] for each in ids]
        return np.asarray(shapely.from_wkb(np.array([each or None for each in content], object)))

    def values(self, name: str, ids: Iterable[int]) -> list[int | float | str | None]:
        """Return a property of features; all None if there is no such property."""
        column = self._columns.get(name)
        if column is None:
            return [None for _ in ids]
        if isinstance(column, _Texts):
            return [None if (text := column[each]) == _NULL else text.decode() for each in ids]
        found = column[np.fromiter(ids, np.int64)]
        missing = np.isnan(found) if found.dtype.kind == "f" else found == _NO_INTEGER
        return [None if none else value for value, none in zip(found.tolist(), missing.tolist(), strict=True)]

    def properties(self, number: int) -> dict[str, int | float | str | None]:
        """Return all properties of a feature."""
        return {name: self.values(name, [number])[0] for name in self.fields}


class _Texts:
    """Byte strings in a file."""

    def __init__(self, path: Path) -> None:
        self._ends = mapped(path.with_suffix(".ends"), np.int64)
        self._content = mapped(path.with_suffix(".bin"), np.uint8)

    def __getitem__(self, number: int) -> bytes:
        start = self._ends[number - 1] if number else 0
        return self._content[start : self._ends[number]].tobytes()


class _TextWriter:
    """Writes what `_Texts` reads."""

    def __init__(self, path: Path) -> None:
        self._files = path.with_suffix(".bin").open("wb"), path.with_suffix(".ends").open("wb")
        self._size = 0

    def add(self, texts: list[bytes]) -> None:
        ends = self._size + np.cumsum([len(text) for text in texts], dtype=np.int64)
        self._files[0].write(b"".join(texts))
        self._files[1].write(ends.tobytes())
        self._size = int(ends[-1]) if len(ends) else self._size

    def close(self) -> None:
        for file in self._files:
            file.close()


def open_store(layer: DrapedLayer, frame: Mapping[str, Any], extent: float) -> VectorStore:
    """Return the store of a layer's file, which is built once; raise InputError if it cannot be read."""
    path = Path(layer.path)
    with wrap_read_errors(path):
        digest = content_hash(layer.file)
    place = [str(frame[name]) for name in ("crs", "east", "north")]
    key = "\n".join([str(_FORMAT), digest, layer["table"], layer.crs, str(extent), *place])

    def build(folder: Path) -> None:
        with open_vector_file(path, layer["table"]) as file:
            _build(file, layer, frame, extent, folder)

    return VectorStore(stored_folder("drape", key, build))


def placed(wkb: Shapes, projection: Projection) -> Shapes:
    """Return shapes in metres of the sketch; None where there is none, or no place for a point of it."""
    with np.errstate(invalid="ignore"):
        shapes = np.asarray(shapely.from_wkb(wkb, on_invalid="fix"), object)
    points, at = shapely.get_coordinates(shapes, return_index=True)
    points = projection.to_sketch(points)
    lost = np.zeros(len(shapes), bool)
    lost[at[~np.isfinite(points).all(axis=1)]] = True
    shapes[lost] = None
    return np.asarray(shapely.set_coordinates(shapes, points[~lost[at]]))


def _build(
    file: VectorFile, layer: DrapedLayer, frame: Mapping[str, Any], extent: float, folder: Path
) -> None:
    """Write a store in one pass over the file."""
    projection = Projection(file_crs(file, layer), frame, file.place)
    step = max(1, file.features * _CHUNK // max(Path(layer.path).stat().st_size, 1))
    geometry = _TextWriter(folder / "geometry")
    columns = [
        _ColumnWriter(folder / f"column{number}", kind) for number, kind in enumerate(file.fields.values())
    ]
    levels: list[LevelWriter] = []
    count, left_out, boxes = 0, 0, [np.zeros((0, 4))]
    while count < file.features or not count:
        wkb, values = file.read(count, step)
        shapes = placed(wkb, projection)
        geometry.add([text or b"" for text in shapely.to_wkb(shapes).tolist()])
        for column, name in zip(columns, file.fields, strict=True):
            column.add(values[name])
        bounds, limit = shapely.bounds(shapes), FARTHEST * extent
        near = (bounds[:, :2] <= limit).all(axis=1) & (bounds[:, 2:] >= -limit).all(axis=1)
        lost = [each is not None and shape is None for each, shape in zip(wkb, shapes, strict=True)]
        left_out += int((~near & np.isfinite(bounds).all(axis=1)).sum()) + sum(lost)
        boxes.append(bounds[near])
        split = split_shapes(shapes[near], count + np.flatnonzero(near))
        levels = levels or _level_writers(split.outlines, extent, folder)
        for level in levels:
            level.add(parts_of(split, level.tolerance))
        count += len(wkb)
        if not len(wkb):
            break
    geometry.close()
    for column in columns:
        column.close()
    kept, points = list[tuple[int, float]](), np.inf
    for level in levels:
        if keep := level.points <= _SHRINK * points:
            kept.append((level.number, level.tolerance))
            points = level.points
        level.finish(keep=keep)
    everything = np.concatenate(boxes)
    low, high = everything[:, :2].min(axis=0, initial=np.inf), everything[:, 2:].max(axis=0, initial=-np.inf)
    facts = {
        "features": count,
        "left_out": left_out,
        "fields": {name: column.kind for name, column in zip(file.fields, columns, strict=True)},
        "box": [*low.tolist(), *high.tolist()] if len(everything) else [np.nan] * 4,
        "levels": kept,
    }
    (folder / "facts.json").write_text(json.dumps(facts), encoding="utf-8")


def _level_writers(outlines: Outlines, extent: float, folder: Path) -> list[LevelWriter]:
    """Return the writers of all levels, each twice as coarse: from half the usual step of a line on."""
    steps = np.diff(outlines.along)
    steps = steps[steps > 0.0]
    finest = 2.0 ** np.floor(np.log2(0.5 * np.median(steps))) if len(steps) else extent
    tolerances = [0.0] + [each for number in range(_LEVELS) if (each := finest * 2.0**number) <= extent / 8.0]
    return [LevelWriter(folder, number, tolerance) for number, tolerance in enumerate(tolerances)]


class _ColumnWriter:
    """Writes a property of all features, whole and other numbers in 8 bytes each."""

    def __init__(self, path: Path, dtype: str) -> None:
        numeric = dtype.startswith(("int", "uint", "bool"))
        self.kind = "int64" if numeric else "float64" if dtype.startswith("float") else "text"
        self._texts = _TextWriter(path) if self.kind == "text" else None
        self._numbers = None if self._texts else path.with_suffix(".bin").open("wb")

    def add(self, values: npt.NDArray[Any]) -> None:
        """Write the values of features."""
        if self._texts is not None:
            self._texts.add([_NULL if each is None else str(each).encode() for each in values.tolist()])
        elif self._numbers is not None:
            if self.kind == "int64" and values.dtype.kind == "f":  # NaN where there is none
                values = np.where(np.isnan(values), _NO_INTEGER, np.nan_to_num(values).astype(np.int64))
            self._numbers.write(values.astype(self.kind).tobytes())

    def close(self) -> None:
        """Close the files."""
        for file in (self._texts, self._numbers):
            if file is not None:
                file.close()
