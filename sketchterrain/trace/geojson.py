"""GeoJSON (RFC 7946, and the member ``crs`` of its predecessor of 2008), read without trust."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from sketchterrain.errors import InputError, one_line
from sketchterrain.metric_crs import named_crs
from sketchterrain.sketch.wording import shown
from sketchterrain.trace.vector_features import MOST_VERTICES, Source, VectorFeature, too_many

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy.typing as npt
    from rasterio.crs import CRS

__all__ = ["read_geojson"]

_LARGEST = 512 << 20  # bytes
_LONGITUDE_AND_LATITUDE = "OGC:CRS84"  # what RFC 7946 allows alone
# How deep the coordinates of each lie, and what each part is.
_SHAPES = {
    "Point": ("point", 0),
    "MultiPoint": ("point", 1),
    "LineString": ("line", 1),
    "MultiLineString": ("line", 2),
    "Polygon": ("area", 2),
    "MultiPolygon": ("area", 3),
}
_COLLECTION = "GeometryCollection"


def read_geojson(path: Path) -> Source:
    """Return the features of a GeoJSON file.

    Raises
    ------
    InputError
        If it is too large, no JSON or no GeoJSON, or its coordinate reference system is none.
    """
    place = one_line(path)
    try:
        return _features(_parsed(_checked_bytes(path, place), place), path.stem, place)
    except RecursionError:
        raise InputError(f"{place}: expected GeoJSON, this is nested too deeply") from None


def _features(document: Any, called: str, place: str) -> Source:
    kind = document.get("type") if isinstance(document, dict) else document
    if kind == "FeatureCollection":
        entries = document.get("features")
        if not isinstance(entries, list):
            raise InputError(f"{place}: features: expected a list, got {shown(entries)}")
    elif kind == "Feature":
        entries = [document]
    elif isinstance(kind, str) and (kind in _SHAPES or kind == _COLLECTION):
        entries = [{"type": "Feature", "properties": None, "geometry": document}]
    else:
        expected = "expected GeoJSON: a FeatureCollection, a Feature or a geometry"
        raise InputError(f"{place}: {expected}, got the type {shown(kind)}")
    name = document.get("name")
    source = Source(name if isinstance(name, str) else called, _crs(document, place), [])
    for index, entry in enumerate(entries):
        where = f"{place}: features[{index}]"
        if not isinstance(entry, dict) or entry.get("type") != "Feature":
            raise InputError(f"{where}: expected a Feature, got {shown(entry)}")
        properties = entry.get("properties")
        if properties is not None and not isinstance(properties, dict):
            raise InputError(f"{where}: expected properties as an object, got {shown(properties)}")
        _add(source, entry.get("geometry"), properties or {}, where)
    return source


def _checked_bytes(path: Path, place: str) -> bytes:
    try:
        size = path.stat().st_size
        if size > _LARGEST:
            raise InputError(f"{place}: {size / (1 << 20):.0f} MiB: expected at most {_LARGEST >> 20} MiB")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({one_line(error.strerror or error)})") from None
    # JSON takes many times its bytes of memory: what it would take is found out before it is parsed.
    containers, values = content.count(b"[") + content.count(b"{"), content.count(b",")
    if containers > 2 * MOST_VERTICES or values > 8 * MOST_VERTICES:
        raise InputError(too_many(place, max(containers, values / 3)))
    return content


def _parsed(content: bytes, place: str) -> Any:
    try:
        return json.loads(content.decode("utf-8-sig"), parse_constant=_no_constant)
    except UnicodeDecodeError as error:
        raise InputError(f"{place}: expected UTF-8, byte {error.start} is none") from None
    except json.JSONDecodeError as error:
        at = f"line {error.lineno}, column {error.colno}"
        raise InputError(f"{place}: expected JSON ({one_line(error.msg)} in {at})") from None
    except ValueError as error:  # NaN, or a number of thousands of digits
        raise InputError(f"{place}: expected JSON ({one_line(error)})") from None


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _crs(document: dict[str, Any], place: str) -> CRS:
    given = document.get("crs")
    if given is None:
        return named_crs(_LONGITUDE_AND_LATITUDE)
    properties = given.get("properties") if isinstance(given, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise InputError(f"{place}: crs: expected a name, got {shown(given)}")
    try:
        return named_crs(name)
    except InputError as error:
        raise InputError(f"{place}: crs: {error}") from None


def _add(source: Source, geometry: object, properties: dict[str, Any], where: str) -> None:
    """Add the shapes of a geometry; collections in collections are laid out flat, without recursion."""
    if geometry is None:
        source.left_out["without a shape"] += 1
    waiting = [geometry] if geometry is not None else []
    while waiting:
        given = waiting.pop()
        each: dict[str, Any] = given if isinstance(given, dict) else {}
        kind = each.get("type")
        if kind == _COLLECTION:
            parts = each.get("geometries")
            if not isinstance(parts, list):
                raise InputError(f"{where}: geometries: expected a list, got {shown(parts)}")
            waiting.extend(reversed(parts))
        elif isinstance(kind, str) and kind in _SHAPES:
            shapes = list(_shapes(each.get("coordinates"), *_SHAPES[kind], properties, where))
            source.features.extend(shapes)
            if not shapes:
                source.left_out["without a shape"] += 1
        else:
            raise InputError(f"{where}: expected a geometry, got {shown(given)}")


def _shapes(
    coordinates: object, kind: Any, depth: int, properties: dict[str, Any], where: str
) -> Iterator[VectorFeature]:
    if not isinstance(coordinates, list):
        raise InputError(f"{where}: coordinates: expected a list, got {shown(coordinates)}")
    if not coordinates:  # RFC 7946, 3.1: to be taken as no geometry
        return
    if kind == "area":
        for rings in coordinates if depth == 3 else [coordinates]:
            yield VectorFeature(kind, [_closed(ring) for ring in _places(rings, where)], properties)
    elif kind == "line":
        lines = coordinates if depth == 2 else [coordinates]
        yield VectorFeature(kind, _places(lines, where), properties)
    else:
        points = coordinates if depth == 1 else [coordinates]
        yield VectorFeature(kind, list(_line(points, where)[:, None]), properties)


def _places(lines: object, where: str) -> list[npt.NDArray[np.float64]]:
    if not isinstance(lines, list):
        raise InputError(f"{where}: coordinates: expected a list, got {shown(lines)}")
    return [_line(line, where) for line in lines]


def _line(line: object, where: str) -> npt.NDArray[np.float64]:
    """Return positions as x and y; heights and what else a position has are left away."""
    expected = f"{where}: expected a list of positions [x, y], got"
    if not isinstance(line, list) or not line:
        raise InputError(f"{expected} {shown(line)}")
    try:
        found: npt.NDArray[Any] = np.asarray(line)
    except ValueError:  # positions of several lengths
        try:
            found = np.asarray([position[:2] for position in line])
        except (TypeError, KeyError, ValueError):
            raise InputError(f"{expected} {shown(line)}") from None
    if found.ndim != 2 or found.shape[1] < 2 or found.dtype.kind not in "iuf":
        raise InputError(f"{expected} {shown(line)}")
    places = found[:, :2].astype(np.float64)
    if not np.isfinite(places).all():
        raise InputError(f"{where}: expected finite coordinates, got {shown(line)}")
    return places


def _closed(ring: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return ring if np.array_equal(ring[0], ring[-1]) else np.concatenate([ring, ring[:1]])
