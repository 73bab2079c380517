"""Files of features, read and written by GDAL: formats, tables, coordinate systems, and those of sketches."""

import gzip
import io
import math
import re
import sqlite3
import tempfile
import warnings
import zlib
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from glob import escape
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import pyogrio
import pyogrio.raw
import shapely
from rasterio.crs import CRS

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.errors import InputError, format_value, one_line, prefix_errors
from sketchterrain.features.table import AREA, KINDS, LINE, Column, FeatureTable, Shapes
from sketchterrain.io.crs import parse_crs, plain_path, transform_points
from sketchterrain.io.files import wrap_read_errors
from sketchterrain.io.gdal import OFFLINE

# Local coordinate systems, as in this program's own exports.
_LOCAL = re.compile(r"(LOCAL_CS|ENGCRS|ENGINEERINGCRS)\[.*UNIT\[\"met(re|er)\"", re.I | re.S)
_TABLES = {"gpkg_contents", "gpkg_geometry_columns", "gpkg_spatial_ref_sys"}
# First bytes of vector formats and GDAL's driver that reads them.
_VECTORS = {b"SQLite format 3\0": "GPKG", b"fgb\x03": "FlatGeobuf", b"\0\0\x27\x0a": "ESRI Shapefile"}
_BLANK = b"\xef\xbb\xbf \t\r\n"  # may precede JSON or XML
# Other elements than OSM's could make GDAL choose a driver that opens other files.
_ELEMENT = re.compile(rb"<[/?]?(\w+)\b")
_ELEMENTS = {b"gpx": "GPX", b"kml": "LIBKML"}
_DXF = re.compile(rb"(\s*999\s*\n[^\n]*\n)*\s*0\s*\n\s*SECTION\b")
_GZIP = b"\x1f\x8b"
_MAX_UNPACKED = 1 << 31  # bytes
# Parts of a Shapefile besides the one that users select.
_PARTS = (".dbf", ".shx", ".prj", ".cpg", ".sbn", ".sbx", ".qix")
_GPX_TABLES = ("tracks", "routes", "waypoints")  # others have their points
_DRIVERS = {"ESRI Shapefile", "GPKG", "FlatGeobuf", "GeoJSON", "OSM", "GPX", "LIBKML", "DXF"}
# GDAL tries all drivers for a file: no other ones, and no addresses, as of a CRS in GeoJSON.
_OPTIONS = {**OFFLINE, "OSM_MAX_TMPFILE_SIZE": "1"}  # MB of memory for nodes, which are on disk beyond
pyogrio.set_gdal_config_options(_OPTIONS | {"OGR_SKIP": ",".join(pyogrio.list_drivers().keys() - _DRIVERS)})
pyogrio.core._register_drivers()  # takes them out
_OSM_ELEMENTS = set(b"xml osm bounds bound note meta remark node way relation tag nd member center".split())


def vector_driver(start: bytes) -> str | None:
    """Return GDAL's driver for the first bytes of a vector file, also of a compressed .osm, or None."""
    if start.startswith(_GZIP):
        with suppress(zlib.error):
            unpacked = zlib.decompressobj(wbits=31).decompress(start, len(start))
            return "OSM" if vector_driver(unpacked) == "OSM" else None
    text = start.lstrip(_BLANK)
    if text.startswith(b"{"):
        return "GeoJSON"
    elements = set(_ELEMENT.findall(start[: start.rfind(b">") + 1])) if text.startswith(b"<") else set()
    if start[4:15] == b"\n\tOSMHeader" or b"osm" in elements <= _OSM_ELEMENTS:
        return "OSM"
    if elements & _ELEMENTS.keys():
        return _ELEMENTS[(elements & _ELEMENTS.keys()).pop()]
    if _DXF.match(text):
        return "DXF"
    return next((driver for magic, driver in _VECTORS.items() if start.startswith(magic)), None)


def find_driver(path: Path, location: str, *, required: bool = False) -> str | None:
    """Return GDAL's driver for a file by its first bytes, None unless it is a vector file.

    Raise InputError for a part of a Shapefile, and without a driver if one is `required`.
    """
    with wrap_read_errors(path), path.open("rb") as stream:
        if path.suffix.lower() in _PARTS:
            raise InputError(f"{location} is a part of a Shapefile: expected {path.with_suffix('.shp').name}")
        start = stream.read(4096)
    driver = vector_driver(start)
    if required and driver is None:
        raise InputError(f"{location}: expected a vector file, it begins with {format_value(start[:20])}")
    return driver


class FileTable(NamedTuple):
    """A table of an open vector file."""

    dataset: str | bytes  # as GDAL opens it
    name: str
    driver: str
    crs: str | None  # as GDAL names it
    geometry_type: str
    features: int  # -1: unknown
    fields: dict[str, str]  # dtypes by name

    def read(
        self, skip: int = 0, most: int | None = None, *, failures: int = 256, **options: Any
    ) -> tuple[Shapes, dict[str, npt.NDArray[Any]], int]:
        """Return the WKB and properties of features, and how many of them are damaged: they have neither.

        Without heights and with dates as texts, unless the `options` of pyogrio say otherwise. Raise
        RuntimeError, ValueError or LookupError if all are damaged, or after so many failures.
        """
        options = {"force_2d": True, "datetime_as_string": True, **options}
        if self.features < 0:
            meta, _, wkb, fields = pyogrio.raw.read(self.dataset, self.name, **options)
            return wkb, dict(zip(map(str, meta["fields"]), fields, strict=True)), 0
        count = self.features - skip if most is None else min(most, self.features - skip)
        parts, pending, errors = dict[int, Any](), [(0, count)], list[Exception]()
        while pending and len(errors) < failures:
            first, number = pending.pop()
            place = {"skip_features": skip + first, "max_features": number}
            try:
                parts[first] = pyogrio.raw.read(self.dataset, self.name, **place, **options)
            except (RuntimeError, ValueError, LookupError) as error:
                errors.append(error)
                half = number // 2
                pending += [(first + half, number - half), (first, half)] if half else []
        if not parts:
            raise errors[0]
        meta, _, wkb, fields = next(iter(parts.values()))
        columns, known = [wkb, *fields], np.ones(count, bool)
        if len(wkb) < count:
            kinds = [float if each.dtype.kind in "biuf" else object for each in columns]
            columns = [np.full(count, math.nan if kind is float else None, kind) for kind in kinds]
            known[:] = False
            for first, (_, _, wkb, fields) in parts.items():
                known[first : first + len(wkb)] = True
                for column, values in zip(columns, (wkb, *fields), strict=True):
                    column[first : first + len(wkb)] = values
        wkb, *fields = columns
        return wkb, dict(zip(map(str, meta["fields"]), fields, strict=True)), int((~known).sum())


class VectorFile(NamedTuple):
    """A vector file that is open for reading."""

    dataset: str  # as GDAL opens it
    driver: str
    tables: list[str]  # those with geometries
    views: list[str]  # of a GeoPackage: their queries may never end
    place: str  # for errors
    nbytes: int

    def table(self, name: str = "", *, count: bool = False) -> FileTable:
        """Return a table, by default the first one, whose features are counted if need be."""
        if name not in ("", *self.tables) or not self.tables:
            expected = ", ".join(map(format_value, self.tables[:20])) or "a table with geometries"
            raise InputError(f"{self.place}: table {format_value(name)}: expected {expected}")
        found = _table(self.dataset, name or self.tables[0], count=count)
        if found.driver != self.driver:
            raise InputError(f"{self.place}: expected {self.driver}, GDAL detects {found.driver}")
        return found


def _table(dataset: str | bytes, name: str | int, *, count: bool) -> FileTable:
    info = pyogrio.read_info(dataset, layer=name, force_feature_count=count)
    fields = dict(zip(map(str, info["fields"]), map(str, info["dtypes"]), strict=True))
    known = info["driver"], info["crs"], info["geometry_type"], info["features"], fields
    return FileTable(dataset, info["layer_name"], *known)


@contextmanager
def open_vector_file(path: Path, location: str) -> Iterator[VectorFile]:
    """Open a vector file; raise InputError if it is none, or if what is read of it is unreadable."""
    driver = str(find_driver(path, location, required=True))
    known = _geopackage_tables(path, location) if driver == "GPKG" else None
    try:
        with (
            plain_path(path) as file,
            tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder,
            warnings.catch_warnings(),
            np.errstate(invalid="ignore"),
        ):
            warnings.simplefilter("ignore")  # GDAL has many harmless ones
            # The prefix excludes other drivers for JSON, such as pipelines that open other files.
            dataset = f"GeoJSON:{file}" if driver == "GeoJSON" else str(file)
            if driver == "OSM":  # many nodes are on disk, by default in the working directory
                pyogrio.set_gdal_config_options({"CPL_TMPDIR": tempfile.gettempdir()})
                dataset = str(_unpacked(file, Path(folder), location))
            try:
                listed = pyogrio.list_layers(dataset)
            except RuntimeError:
                if driver != "ESRI Shapefile":
                    raise
                dataset = str(_reindexed(file, Path(folder)))  # its index is damaged or missing
                listed = pyogrio.list_layers(dataset)
            names = [str(name) for name, kind in listed if kind is not None]
            if driver == "GPX":
                names = [name for name in _GPX_TABLES if name in names]
            views = [name for name in names if known is not None and name.lower() not in known]
            tables = [name for name in names if name not in views]
            yield VectorFile(dataset, driver, tables, views, location, path.stat().st_size)
    except (RuntimeError, ValueError, LookupError, OSError, shapely.errors.GEOSException) as error:
        raise InputError(f"{location}: cannot be read as {driver} ({one_line(error)[:160]})") from None


def _unpacked(file: Path, folder: Path, location: str) -> Path:
    """Return a file that is not compressed; raise InputError if it is too large."""
    with file.open("rb") as stream:
        if stream.read(2) != _GZIP:
            return file
    with gzip.open(file) as packed, (folder / "map.osm").open("wb") as unpacked:
        try:
            while part := packed.read(1 << 20):
                unpacked.write(part)
                if unpacked.tell() > _MAX_UNPACKED:
                    raise InputError(f"{location}: expected at most {_MAX_UNPACKED >> 20} MiB, unpacked")
        except (EOFError, zlib.error) as error:
            raise ValueError(one_line(error)) from None
    return folder / "map.osm"


def _reindexed(file: Path, folder: Path) -> Path:
    """Return a Shapefile in another folder with a new index of its records."""
    content, at, places = file.read_bytes(), 100, list[bytes]()
    while at + 8 < len(content) and (size := int.from_bytes(content[at + 4 : at + 8], "big")) < 1 << 30:
        places.append((at // 2).to_bytes(4, "big") + content[at + 4 : at + 8])  # in words of 2 bytes
        at += 8 + 2 * size
    for each in file.parent.glob(f"{escape(file.stem)}.*"):
        if each.suffix.lower() != ".shx":
            (folder / f"map{each.suffix.lower()}").symlink_to(each)
    length = (50 + 4 * len(places)).to_bytes(4, "big")
    (folder / "map.shx").write_bytes(content[:24] + length + content[28:100] + b"".join(places))
    return folder / "map.shp"


def _geopackage_tables(path: Path, location: str) -> set[str]:
    """Return the tables of a GeoPackage, in lower case, without views, whose queries may never end."""
    try:
        uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(uri, uri=True)) as database:
            database.text_factory = lambda text: text.decode(errors="replace")
            query = "SELECT lower(name) FROM sqlite_master WHERE sql LIKE 'CREATE TABLE%'"
            tables = {name for (name,) in database.execute(query)}
            if not tables >= _TABLES:
                raise InputError(f"{location}: expected a GeoPackage, this is another SQLite database")
            layers = "SELECT table_name, srs_id FROM gpkg_geometry_columns"
            known = "SELECT srs_id FROM gpkg_spatial_ref_sys"
            for name, code in database.execute(f"{layers} WHERE srs_id NOT IN ({known})"):
                raise InputError(
                    f"{location}: layer {format_value(name)}: its CRS {format_value(code)} is not in the file"
                )
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise InputError(f"{location}: expected a whole GeoPackage ({one_line(error)})") from None
    return tables


def reproject(points: Float64Array, source: CRS, target: CRS) -> Float64Array:
    """Transform (n, 2) x and y to another CRS; raise `InputError` for points outside of it."""
    if source == target:
        return points
    found = np.ascontiguousarray(transform_points(source, target, points[:, 0], points[:, 1]).T)
    if not np.isfinite(found).all():
        raise InputError(
            f"coordinates are outside of {target.to_string()[:60]}: set smaller bounds, or another crs"
        )
    return found


def layer_crs(text: str | None, where: str) -> CRS | None:
    """Return the CRS of a layer of a vector file, None if it has local metres; raise InputError."""
    if text is None or _LOCAL.match(text):
        return None
    with prefix_errors(where):
        return parse_crs(text)


def valid_areas(shapes: Shapes) -> Shapes:
    """Return shapes with valid areas: self-crossing ones are filled, collapsed ones are empty."""
    broken = ~shapely.is_valid(shapes) & (shapely.get_dimensions(shapes) == 2)
    shapes = shapes.copy()
    shapes[broken] = shapely.make_valid(shapes[broken], method="structure", keep_collapsed=False)
    return shapes


_LAYER_OPTIONS: Final[Mapping[str, Mapping[str, str]]] = {
    "GPKG": {},
    "FlatGeobuf": {"SPATIAL_INDEX": "NO"},  # keeps the order
    "GeoJSON": {"RFC7946": "YES", "COORDINATE_PRECISION": "10"},
}


def write_table(
    target: Path | io.BytesIO,
    name: str,
    wkb: Shapes,
    columns: Mapping[str, Any],
    *,
    driver: str,
    geometry_type: str = "Unknown",
    crs: str | None = None,
    missing: Mapping[str, BoolArray] | None = None,
    append: bool = False,
    **options: Any,
) -> None:
    """Write geometries, None for those without, and columns as a table of a file, or append to it.

    `missing` are rows without a value. Other tables of a GeoPackage stay. Raise RuntimeError or ValueError if
    it cannot be written.
    """
    values = [np.array(each, object) if isinstance(each, tuple) else each for each in columns.values()]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a table without a CRS
        pyogrio.raw.write(
            target,
            wkb,
            values,
            list(columns),
            field_mask=None if missing is None else [missing[each] for each in columns],
            layer=name,
            driver=driver,
            geometry_type=geometry_type,
            crs=crs or None,
            append=append,
            layer_options=_LAYER_OPTIONS[driver],
            **options,
        )


_FLATGEOBUF = b"fgb"
_MULTI = {4: "points", 5: "lines", 6: "areas", 7: "shapes"}  # shapely's type ids
_LEAST_BYTES = 16  # of a feature
_ERRORS = (RuntimeError, ValueError, LookupError, OSError, MemoryError)  # of damaged files
_MAX_MESSAGE = 160  # characters of GDAL's


def encode_vectors(layer: FeatureTable, frame: Mapping[str, Any]) -> bytes:
    """Return a layer as a FlatGeobuf file with coordinates in the frame; equal layers give equal bytes."""
    corner = np.array([frame["east"], frame["north"]])
    columns = {"id": layer.ids, "label": layer.labels.astype(np.int32), **layer.columns}
    shapes = shapely.transform(layer.shapes(), lambda points: points + corner)
    return encode_table(layer.layer, shapes, columns, geometry_type=geometry_type(layer), crs=frame["crs"])


def encode_table(name: str, shapes: Shapes, columns: Mapping[str, Any], **options: Any) -> bytes:
    """Return features in their order as a FlatGeobuf file, with options of `write_table`."""
    stream = io.BytesIO()
    write_table(stream, name, shapely.to_wkb(shapes), columns, driver="FlatGeobuf", **options)
    return stream.getvalue()


def geometry_type(layer: FeatureTable) -> str:
    """Return OGR's name of the type of all features."""
    kinds = set(layer.kinds.tolist())
    return {frozenset({LINE}): "LineString", frozenset({AREA}): "Polygon"}.get(frozenset(kinds), "Unknown")


def decode_vectors(data: bytes, name: str, frame: Mapping[str, Any]) -> FeatureTable:
    """Return the layer of a FlatGeobuf file; raise InputError if it is damaged, or not in the frame's CRS.

    The properties id and label may be missing; unknown ones are kept.
    """
    crs, shapes, columns = decode_table(data)
    _check_crs(crs, frame)
    kinds = shapely.get_type_id(shapes)
    if np.isin(kinds, list(_MULTI)).any():
        what = _MULTI[int(kinds[np.isin(kinds, list(_MULTI))][0])]
        raise InputError(f"expected single {' or '.join(KINDS)} features, not features of several {what}")
    ids, labels = (_whole(columns.pop(key, None), key) for key in ("id", "label"))
    corner = frame["east"], frame["north"]
    with np.errstate(over="ignore"):  # checked by the layer
        return FeatureTable.from_shapes(name, shapes, ids=ids, labels=labels, columns=columns, corner=corner)


def decode_table(data: bytes) -> tuple[str | None, Shapes, dict[str, Column]]:
    """Return CRS, geometries and columns of a FlatGeobuf file; raise InputError if it is damaged."""
    if not data.startswith(_FLATGEOBUF):
        raise InputError("expected a FlatGeobuf file")
    try:
        with warnings.catch_warnings(), np.errstate(invalid="ignore"):
            warnings.simplefilter("ignore")
            table = _table(data, 0, count=False)
            if table.features > len(data) // _LEAST_BYTES:  # memory for as many is allocated
                raise InputError(
                    f"not a whole FlatGeobuf file ({table.features} features in {len(data)} bytes)"
                )
            wkb, fields, damaged = table.read(failures=1)
            if damaged:
                raise InputError(f"not a whole FlatGeobuf file ({damaged} of {table.features} are missing)")
            shapes = np.asarray(shapely.from_wkb(wkb), dtype=object)
    except (*_ERRORS, shapely.errors.GEOSException) as error:
        raise InputError(f"not a whole FlatGeobuf file ({one_line(error)[:_MAX_MESSAGE]})") from None
    return table.crs, shapes, {name: _column(values) for name, values in fields.items()}


def _check_crs(found: str | None, frame: Mapping[str, Any]) -> None:
    if found is None or found == frame["crs"]:
        return
    if not frame["crs"] or parse_crs(found) != parse_crs(frame["crs"]):
        own = frame["crs"] or "no CRS"
        raise InputError(
            f"its CRS is {one_line(found)[:60]}: expected that of the sketch, {one_line(own)[:60]}"
        )


def _column(values: npt.NDArray[Any]) -> Column:
    if values.dtype.kind == "f":
        return values.astype(np.float64)
    if values.dtype.kind in "iub":
        return values.astype(np.int64)
    return tuple("" if value is None else str(value) for value in values.tolist())


def _whole(column: Column | None, name: str) -> npt.NDArray[Any] | None:
    if column is None:
        return None
    values = np.asarray(column)
    if values.dtype.kind not in "if" or (values != np.rint(values)).any() or (np.abs(values) > 2**31).any():
        raise InputError(f"property {name}: expected whole numbers")
    if name == "label" and ((values < 1) | (values > 255)).any():
        raise InputError("property label: expected whole numbers from 1 to 255")
    return values.astype(np.int64 if name == "id" else np.uint8)
