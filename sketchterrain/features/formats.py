"""Vector files: their formats by the first bytes, coordinate systems, and shapes in them."""

import gzip
import math
import re
import sqlite3
import tempfile
import warnings
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyogrio
import pyogrio.raw
import shapely
from rasterio.crs import CRS

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError, format_value, one_line, prefix_errors
from sketchterrain.io.crs import parse_crs, plain_path, transform_points
from sketchterrain.io.files import wrap_read_errors
from sketchterrain.io.gdal import OFFLINE

Shapes = npt.NDArray[np.object_]

_MAX_FAILURES = 256  # of reading parts of a damaged file, before the rest is given up
_NESTED = (-1, 4, 5, 6, 7)  # none, multi geometries and collections
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


def find_driver(path: Path, location: str) -> str | None:
    """Return GDAL's driver for a file by its first bytes; raise InputError for a part of a Shapefile."""
    return vector_driver(_first_bytes(path, location))


def file_driver(path: Path, location: str) -> str:
    """Return GDAL's driver for a vector file by its first bytes; raise InputError for other files."""
    start = _first_bytes(path, location)
    if driver := vector_driver(start):
        return driver
    raise InputError(f"{location}: expected a vector file, it begins with {format_value(start[:20])}")


def _first_bytes(path: Path, location: str) -> bytes:
    with wrap_read_errors(path), path.open("rb") as stream:
        if path.suffix.lower() in _PARTS:
            raise InputError(f"{location} is a part of a Shapefile: expected {path.with_suffix('.shp').name}")
        return stream.read(4096)


@contextmanager
def open_layers(path: Path, driver: str, location: str) -> Iterator[tuple[str, list[str]]]:
    """Yield a vector file's name for GDAL and its layers; raise InputError if what is read is unreadable."""
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
                tables = pyogrio.list_layers(dataset)
            except RuntimeError:
                if driver != "ESRI Shapefile":
                    raise
                dataset = str(_reindexed(file, Path(folder)))  # its index is damaged or missing
                tables = pyogrio.list_layers(dataset)
            names = [str(name) for name, kind in tables if kind is not None]
            yield dataset, [name for name in _GPX_TABLES if name in names] if driver == "GPX" else names
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


def read_features(
    dataset: str, table: str, skip: int, count: int, **options: Any
) -> tuple[dict[str, Any], Shapes, dict[str, npt.NDArray[Any]], int]:
    """Return facts of a table, WKB and properties of features, and how many of them are damaged.

    Those have neither. Raise RuntimeError, ValueError or LookupError if all are damaged.
    """
    parts, pending, failures = dict[int, Any](), [(0, count)], list[Exception]()
    while pending and len(failures) < _MAX_FAILURES:
        first, number = pending.pop()
        place = {"skip_features": skip + first, "max_features": number}
        try:
            parts[first] = pyogrio.raw.read(dataset, table, **place, **options)
        except (RuntimeError, ValueError, LookupError) as error:
            failures.append(error)
            half = number // 2
            pending += [(first + half, number - half), (first, half)] if half else []
    if not parts:
        raise failures[0]
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
    return meta, wkb, dict(zip(map(str, meta["fields"]), fields, strict=True)), int((~known).sum())


def geopackage_tables(path: Path, location: str) -> set[str]:
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


def single_parts(shapes: Shapes, of: npt.NDArray[np.intp]) -> tuple[Shapes, npt.NDArray[np.intp]]:
    """Return the parts of multi geometries and collections, with the index of each one's feature."""
    while np.isin(shapely.get_type_id(shapes), _NESTED).any():
        shapes, part = shapely.get_parts(shapes, return_index=True)
        of = of[part]
    return shapes, of
