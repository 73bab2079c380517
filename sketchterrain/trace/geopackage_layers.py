"""The layers of a GeoPackage: an SQLite database, looked at before GDAL reads its tables."""

from __future__ import annotations

import re
import sqlite3
import warnings
from contextlib import closing
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sketchterrain.errors import InputError, one_line
from sketchterrain.gdal_paths import plain_path
from sketchterrain.metric_crs import named_crs
from sketchterrain.sketch.wording import shown
from sketchterrain.trace.vector_features import MOST_VERTICES, Source, VectorFeature, too_many

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt
    from rasterio.crs import CRS

    from sketchterrain.trace.vector_features import Kind

__all__ = ["MAGIC", "read_geopackage"]

MAGIC: Final = b"SQLite format 3\0"
"""How every SQLite database begins."""

_DRIVER = "GPKG"
_MOST_LAYERS = 100
_LONGEST = 120  # characters of a reason
_UNDEFINED = 99999  # what GDAL notes for coordinates of which nothing is known
_BYTES_A_VERTEX = 16  # at least
_TABLES = {"gpkg_contents", "gpkg_geometry_columns"}
# Coordinate reference systems of no place on Earth, as this program's own exports have them.
_LOCAL = re.compile(r"(LOCAL_CS|ENGCRS|ENGINEERINGCRS)\[.*UNIT\[\"met(re|er)\"", re.I | re.S)


class _Table(NamedTuple):
    name: str
    srs: object


def read_geopackage(path: Path, wanted: Collection[str]) -> list[Source]:
    """Return the layers of a GeoPackage that hold shapes.

    GDAL reads them (its driver GPKG, by pyogrio), after a look at the database itself: only tables are read,
    no views, whose queries may never end. Tables without features are left out.

    Parameters
    ----------
    path
    wanted
        Names of the properties to read, in lower case.

    Raises
    ------
    InputError
        If it is no GeoPackage, damaged, too large, or a layer is a view or has a coordinate reference system
        that is none.
    """
    place = one_line(path)
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError

    tables = _tables(path, place)
    try:
        sources = []
        with plain_path(path) as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # GDAL remarks on much that does no harm
            for table in tables:
                info = pyogrio.read_info(file, layer=table.name)
                if info["driver"] != _DRIVER:
                    raise InputError(f"{place}: expected a GeoPackage, GDAL takes it for {info['driver']}")
                sources.append(_source(file, table, info, place, wanted))
    except (DataLayerError, DataSourceError, ValueError) as error:
        reason = one_line(error)
        if len(reason) > _LONGEST:  # it may begin with a page of SQL
            reason = f"…{reason[-_LONGEST:]}"
        raise InputError(f"{place}: cannot be read as a GeoPackage ({reason})") from None
    return [source for source in sources if source.features or source.left_out]


def _tables(path: Path, place: str) -> list[_Table]:
    """Return the tables with shapes, checked: what they are, and how much is in them."""
    try:
        with closing(
            sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
        ) as database:
            database.text_factory = lambda text: text.decode(errors="replace")
            database.execute("PRAGMA trusted_schema = OFF")
            return list(_checked(database, place))
    except (sqlite3.Error, UnicodeDecodeError) as error:  # the latter from names of columns
        raise InputError(f"{place}: expected a whole GeoPackage ({one_line(error)})") from None


def _checked(database: sqlite3.Connection, place: str) -> Iterator[_Table]:
    made = dict(database.execute("SELECT lower(name), sql FROM sqlite_master WHERE type = 'table'"))
    if not made.keys() >= _TABLES:
        raise InputError(f"{place}: expected a GeoPackage, this is another SQLite database")
    rows = database.execute(
        "SELECT table_name, column_name, srs_id FROM gpkg_geometry_columns ORDER BY rowid LIMIT ?",
        (_MOST_LAYERS + 1,),
    ).fetchall()
    if not rows:
        raise InputError(f"{place}: expected layers of points, lines or areas, it has none")
    if len(rows) > _MOST_LAYERS:
        raise InputError(f"{place}: expected at most {_MOST_LAYERS} layers")
    vertices = 0.0
    for name, column, srs in rows:
        made_by = made.get(str(name).lower())
        if made_by is None or "VIRTUAL" in made_by[:40].upper():
            raise InputError(f"{place}: layer {shown(name)}: expected a table, not a view or nothing")
        table, shape = (f'"{str(each).replace(chr(34), chr(34) * 2)}"' for each in (name, column))
        (size,) = database.execute(f"SELECT total(length({shape})) FROM {table}").fetchone()  # noqa: S608 # quoted
        vertices += size / _BYTES_A_VERTEX
        if vertices > 2 * MOST_VERTICES:  # with heights, and some bytes around them
            raise InputError(too_many(place, vertices))
        yield _Table(str(name), srs)


def _source(file: Path, table: _Table, info: dict[str, Any], place: str, wanted: Collection[str]) -> Source:
    import pyogrio.raw

    columns = [str(each) for each in info["fields"] if str(each).lower() in wanted]
    meta, _, geometry, fields = pyogrio.raw.read(
        file, layer=table.name, columns=columns, force_2d=True, datetime_as_string=True
    )
    where = f"{place}: layer {shown(table.name)}"
    if meta["crs"] is None and table.srs != _UNDEFINED:
        raise InputError(f"{where}: its coordinate reference system {shown(table.srs)} is not in the file")
    source = Source(table.name, _crs(meta["crs"], where), [])
    keys = [str(each).lower() for each in meta["fields"]]
    values = [field.tolist() for field in fields]
    for index, shape in enumerate(_shapes(geometry)):
        properties = {key: column[index] for key, column in zip(keys, values, strict=True)}
        _add(source, shape, properties)
    return source


def _crs(text: str | None, where: str) -> CRS | None:
    if text is None or _LOCAL.match(text):
        return None
    try:
        return named_crs(text)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _shapes(geometry: npt.NDArray[np.object_]) -> npt.NDArray[np.object_]:
    import shapely

    # Curves and what is broken become None.
    shapes: npt.NDArray[np.object_] = shapely.from_wkb(geometry, on_invalid="ignore")
    return shapes


def _add(source: Source, shape: Any, properties: dict[str, Any]) -> None:
    import numpy as np
    import shapely

    if shape is None or shape.is_empty:
        source.left_out["without a shape that can be read"] += 1
        return
    waiting = [shape]
    while waiting:
        each = waiting.pop()
        if each.geom_type.startswith("Multi") or each.geom_type == "GeometryCollection":
            waiting.extend(reversed(each.geoms))
        elif each.is_empty:
            continue
        elif not np.isfinite(shapely.get_coordinates(each)).all():
            source.left_out["with coordinates that are not finite"] += 1
        elif each.geom_type == "Polygon":
            rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(each)]
            source.features.append(VectorFeature("area", rings, properties))
        else:
            kind: Kind = "point" if each.geom_type == "Point" else "line"
            source.features.append(VectorFeature(kind, [shapely.get_coordinates(each)], properties))
