"""Tables of draped files on disk, mapped into memory: in metres of the sketch, with levels of items."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt
import shapely
from rasterio import Env
from rasterio._err import CPLE_BaseError
from rasterio.crs import CRS
from rasterio.warp import transform

from sketchterrain.array_types import Float64Array
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.rasters import content_hash
from sketchterrain.errors import InputError, one_line
from sketchterrain.features.files import (
    FileTable,
    VectorFile,
    layer_crs,
    open_vector_file,
)
from sketchterrain.features.levels import (
    ITEM,
    Level,
    Shapes2D,
    common,
    morton,
    parts_of,
    places,
    split_shapes,
)
from sketchterrain.features.osm_relations import incomplete_areas
from sketchterrain.features.table import NO_INTEGER, FeatureTable, Rings, Shapes, Texts
from sketchterrain.io.crs import parse_crs
from sketchterrain.io.disk_cache import stored_folder
from sketchterrain.io.files import wrap_read_errors

FARTHEST: Final = 64.0
"""Extents of a sketch from it beyond which features are left out."""

_FORMAT: Final = 6  # of stores
_LEVELS: Final = 16
_SHRINK: Final = 0.7  # of the points of a finer level: a level with more is not stored
_CHUNK: Final = 1 << 22  # bytes of a file that are read at once
_READ_WHOLE: Final = ("GeoJSON", "OSM")  # by GDAL, each time: more at once
_MOST_PER_BYTE: Final = 1000  # features, of a file, which may be compressed
_BATCH: Final = 1 << 14  # items that are sorted into place at once
_FACTS: Final = "facts.json"
_COLUMNS: Final = {
    "vertices": np.float64,
    "rings": np.int64,
    "parts": np.int64,
    "begins": np.bool_,
    "kinds": np.uint8,
    "ids": np.int64,
}
_COLLECTION: Final = 7  # shapely's type id
_FAR: Final = np.array([80.0, 85.0])  # degrees from a sketch, of points that have no place in its frame


@contextmanager
def open_drape(layer: DrapedLayer) -> Iterator[tuple[VectorFile, FileTable, CRS | None]]:
    """Open the table of a layer with its CRS, None of metres in the sketch's frame; raise InputError."""
    place = f"draped layer {one_line(layer.path)}"
    with open_vector_file(Path(layer.path), place) as file:
        table = file.table(layer["table"], count=True)
        if table.features > _MOST_PER_BYTE * file.nbytes:  # memory for as many is allocated
            raise InputError(f"{place}: not a whole {file.driver} file ({table.features} features)")
        crs = layer_crs(table.crs, place)
        yield file, table, layer_crs(layer["crs"], place) if layer["crs"] and crs is None else crs


class FileProjection:
    """From coordinates of a file to metres from a sketch's south-west corner, and back."""

    def __init__(self, crs: CRS | None, frame: Mapping[str, Any], place: str) -> None:
        if crs is not None and not frame["crs"]:
            raise InputError(f"{place}: expected a sketch with a CRS, [frame] has none")
        self.place = place
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
    result, pending = np.full(points.shape, np.nan), [np.flatnonzero(np.isfinite(points).all(axis=1))]
    while pending:
        rows = pending.pop()
        try:
            with Env():
                result[rows] = np.transpose(transform(source, target, *points[rows].T))
        except CPLE_BaseError:
            pending += np.array_split(rows, 2) if len(rows) > 1 else []
    result[~np.isfinite(result).all(axis=1)] = np.nan
    return result


class _Arrays:
    """Arrays in a folder, a file each: appended to, and then mapped into memory."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._streams = folder, dict[str, BinaryIO]()

    def add(self, name: str, array: npt.NDArray[Any]) -> None:
        """Append to an array."""
        if name not in self._streams:
            self._streams[name] = (self._folder / name).open("wb")
        self._streams[name].write(array.tobytes())

    def add_texts(self, name: str, texts: list[str]) -> None:
        """Append texts."""
        start = self._streams[name].tell() if name in self._streams else 0
        encoded = list(map(str.encode, texts))
        self.add(name, np.frombuffer(b"".join(encoded), np.uint8))
        self.add(f"{name}.ends", start + np.cumsum(list(map(len, encoded)), dtype=np.int64))

    def close(self) -> None:
        """Write what was appended."""
        for stream in self._streams.values():
            stream.close()

    def array(self, name: str, dtype: npt.DTypeLike, columns: int = 0) -> npt.NDArray[Any]:
        """Return an array of values, or of rows of some columns."""
        path = self._folder / name
        is_empty = not path.is_file() or path.stat().st_size == 0
        found = np.zeros(0, dtype) if is_empty else np.asarray(np.memmap(path, dtype, "r"))
        return found.reshape(-1, columns) if columns else found

    def texts(self, name: str) -> Texts:
        """Return texts."""
        return Texts(self.array(name, np.uint8), self.array(f"{name}.ends", np.int64))


def open_table(
    layer: DrapedLayer, frame: Mapping[str, Any], extent: float
) -> tuple[dict[str, Any], FeatureTable]:
    """Return facts about a layer's file, and its table, which is stored once; raise InputError."""
    with wrap_read_errors(Path(layer.path)):
        digest = content_hash(layer.file)
    place = [str(frame[name]) for name in ("crs", "east", "north")]
    key = "\n".join([str(_FORMAT), digest, layer["table"], layer["crs"], str(extent), *place])

    def build(folder: Path) -> None:
        with open_drape(layer) as (file, table, crs):
            projection = FileProjection(crs, frame, file.place)
            _build(file, table, projection, extent, folder)

    folder = stored_folder("drape", key, build)
    facts = json.loads((folder / _FACTS).read_text(encoding="utf-8"))
    stored = _Arrays(folder)
    levels = tuple(
        Level(
            tolerance,
            stored.array(f"items{number}", ITEM),
            stored.array(f"points{number}", np.float64, 2),
            stored.array(f"groups{number}", np.float32, 4),
        )
        for number, tolerance in enumerate(facts["levels"])
    )
    columns = {
        name: stored.texts(f"column{at}") if kind == "text" else stored.array(f"column{at}", kind)
        for at, (name, kind) in enumerate(facts["fields"].items())
    }
    arrays = {name: stored.array(name, dtype, 2 * (name == "vertices")) for name, dtype in _COLUMNS.items()}
    mixed = {int(name): bytes.fromhex(text) for name, text in facts["mixed"].items()}
    return facts, FeatureTable.mapped(arrays, columns, levels=levels, count=facts["features"], mixed=mixed)


def placed(wkb: Shapes, projection: FileProjection) -> Shapes:
    """Return shapes in metres of the sketch; None for missing ones, or where a point of it has no place."""
    with np.errstate(invalid="ignore"):
        shapes = np.asarray(shapely.from_wkb(wkb, on_invalid="fix"), object)
    points, at = shapely.get_coordinates(shapes, return_index=True)
    points = projection.to_sketch(points)
    lost = np.zeros(len(shapes), bool)
    lost[at[~np.isfinite(points).all(axis=1)]] = True
    shapes[lost] = None
    return np.asarray(shapely.set_coordinates(shapes, points[~lost[at]]))


def _build(
    file: VectorFile, table: FileTable, projection: FileProjection, extent: float, folder: Path
) -> None:
    """Write a store in one pass over the file."""
    with TemporaryDirectory(dir=folder, ignore_cleanup_errors=True) as scratch:
        arrays, unsorted = _Arrays(folder), _Arrays(Path(scratch))
        at_once = _CHUNK << (6 if file.driver in _READ_WHOLE else 0)
        step = max(1, table.features * at_once // max(file.nbytes, 1))
        fields = {name: _stored_kind(dtype) for name, dtype in table.fields.items()}
        tolerances, left_out, empty, boxes = list[float](), 0, 0, [np.full((1, 4), np.nan)]
        mixed, ends = dict[int, str](), np.zeros(2, np.int64)
        for name in ("rings", "parts"):
            arrays.add(name, ends[:1])
        for first in range(0, max(table.features, 1), step):
            wkb, values, _ = table.read(first, step)
            shapes = placed(wkb, projection)
            rings = Rings.of_shapes(shapes)
            rows = np.flatnonzero(rings.kinds >= 0)
            counts = np.bincount(rings.ring, minlength=len(rings.feature)), np.bincount(rings.feature)[rows]
            for name, end, count in zip(("rings", "parts"), ends, counts, strict=True):
                arrays.add(name, end + np.cumsum(count, dtype=np.int64))
            ends += [len(rings.ring), len(rings.feature)]
            own = {"vertices": rings.vertices, "begins": rings.begins, "ids": first + rows}
            for name, array in {**own, "kinds": rings.kinds[rows].astype(np.uint8)}.items():
                arrays.add(name, array)
            for at, (name, kind) in enumerate(fields.items()):
                _add_column(arrays, f"column{at}", kind, values[name][rows])
            several = np.flatnonzero(shapely.get_type_id(shapes) == _COLLECTION)
            mixed |= dict(
                zip((first + several).tolist(), shapely.to_wkb(shapes[several], hex=True), strict=True)
            )
            bounds, limit = shapely.bounds(shapes), FARTHEST * extent
            near = (bounds[:, :2] <= limit).all(axis=1) & (bounds[:, 2:] >= -limit).all(axis=1)
            lost = [each is not None and shape is None for each, shape in zip(wkb, shapes, strict=True)]
            left_out += int((~near & np.isfinite(bounds).all(axis=1)).sum()) + sum(lost)
            empty += sum(each is None for each in wkb)
            boxes.append(bounds[near])
            split = split_shapes(shapes[near], first + np.flatnonzero(near))
            tolerances = tolerances or _tolerances(split, extent)
            for number, tolerance in enumerate(tolerances):
                items, points = parts_of(split, tolerance)
                unsorted.add(f"items{number}", items)
                unsorted.add(f"points{number}", points)
        unsorted.close()
        _sort_levels(unsorted, arrays, len(tolerances))
    arrays.close()
    whole = np.concatenate(boxes)
    box = [*np.fmin.reduce(whole[:, :2]).tolist(), *np.fmax.reduce(whole[:, 2:]).tolist()]
    facts = {"features": table.features, "left_out": left_out, "empty": empty, "tables": file.tables}
    is_relations = file.driver == "OSM" and table.name == "multipolygons"
    incomplete = sorted(incomplete_areas(Path(file.dataset), (), None).ids) if is_relations else []
    facts |= {"fields": fields, "box": box, "incomplete": incomplete, "mixed": mixed}
    (folder / _FACTS).write_text(json.dumps(facts | {"levels": tolerances}), encoding="utf-8")


def _tolerances(shapes: Shapes2D, extent: float) -> list[float]:
    """Return those of levels, of which each has far fewer points of some features than the finer one."""
    steps = np.diff(shapes.outlines.along)
    if not (steps > 0.0).any():
        return [0.0, *(extent / 2.0**number for number in range(16, 3, -2))]
    finest = 2.0 ** np.floor(np.log2(0.5 * np.median(steps[steps > 0.0])))  # half the usual step of a line
    kept, most = [0.0], len(parts_of(shapes, 0.0).points)
    for tolerance in (finest * 2.0 ** np.arange(_LEVELS)).tolist():
        if tolerance <= extent / 8.0 and (count := len(parts_of(shapes, tolerance).points)) <= _SHRINK * most:
            kept.append(tolerance)
            most = count
    return kept


def _sort_levels(unsorted: _Arrays, arrays: _Arrays, count: int) -> None:
    """Write the items of each level sorted by place."""
    for number in range(count):
        items = unsorted.array(f"items{number}", ITEM)
        points = unsorted.array(f"points{number}", np.float64, 2)
        # In each part of the file they begin with its first point.
        first = np.cumsum(items["count"], dtype=np.int64) - items["count"]
        order, end = np.argsort(morton(items["box"]), kind="stable"), 0
        for at in range(0, max(len(order), 1), _BATCH):
            batch = items[order[at : at + _BATCH]]
            batch["first"] = first[order[at : at + _BATCH]]
            arrays.add(f"points{number}", points[places(batch)])
            batch["first"] = end + np.cumsum(batch["count"]) - batch["count"]
            end += int(batch["count"].sum())
            arrays.add(f"items{number}", batch)
            arrays.add(f"groups{number}", common(batch["box"]))


def _stored_kind(dtype: str) -> str:
    """Return how values of a dtype are stored: numbers in 8 bytes each, others as text."""
    if dtype.startswith(("int", "uint", "bool")):
        return "int64"
    return "float64" if dtype.startswith("float") else "text"


def _add_column(arrays: _Arrays, name: str, kind: str, values: npt.NDArray[Any]) -> None:
    if kind == "text":
        texts = ["" if each is None else str(each) for each in values.tolist()]
        return arrays.add_texts(name, texts)
    if kind == "int64" and values.dtype.kind == "f":  # NaN: missing
        values = np.where(np.isnan(values), NO_INTEGER, np.nan_to_num(values).astype(np.int64))
    return arrays.add(name, values.astype(kind))
