"""Layers of vector files, read by GDAL into shapely geometries, and metric sketch areas."""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import pyogrio
import shapely
from rasterio.crs import CRS

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError, format_value, one_line
from sketchterrain.features.files import (
    FileTable,
    find_driver,
    layer_crs,
    open_vector_file,
    reproject,
    valid_areas,
)
from sketchterrain.features.osm_relations import incomplete_areas
from sketchterrain.features.table import Shapes, single_parts
from sketchterrain.importing.legend import BUILT_KEYS, OSM_KEYS, RELEVANT_TAGS
from sketchterrain.io.crs import is_westward, parse_crs
from sketchterrain.schema.parameters import SKETCH

Box = Sequence[float]  # west, south, east, north

_MAX_DISTORTION = 0.05  # relative, of a projection's metres
_MIN_ASPECT = 0.25  # shorter over longer side, unless given by the user
_UTM_NORTH, _UTM_SOUTH, _UPS_NORTH, _UPS_SOUTH = 32600, 32700, 5041, 5042  # EPSG, WGS 84
_UTM_MAX_NORTH, _UTM_MAX_SOUTH = 84.0, -80.0  # degrees
_WHOLE_METRES_FROM = 100.0  # m along the longer side
_RADIUS = 6_371_000.0  # m, of the Earth as a sphere


class SketchArea(NamedTuple):
    """The rectangle of a sketch."""

    west: float  # m
    south: float
    pixel: float  # m
    columns: int  # px
    rows: int

    @property
    def extent(self) -> float:
        """Metres along the longer side."""
        return self.pixel * max(self.columns, self.rows)

    def pixels(self, points: Float64Array) -> Float64Array:
        """Return fractional columns and rows, (n, 2), of x and y; row 0 starts at the north edge."""
        column, up = ((points - (self.west, self.south)) / self.pixel).T
        return np.stack([column, self.rows - up], axis=-1)


def sketch_area(box: Box, size_px: int, *, exact: bool) -> SketchArea:
    """Return a sketch's area around a rectangle (m): whole pixels, `size_px` along the longer side.

    Unless `exact`, a rectangle narrower than 1 : 4 is widened.
    """
    west, south, east, north = box
    longer = max(east - west, north - south)
    low, high = SKETCH["extent"].low, SKETCH["extent"].high
    if not exact:
        more = 0.5 * np.maximum(0.0, _MIN_ASPECT * longer - np.array([east - west, north - south]))
        west, south, east, north = west - more[0], south - more[1], east + more[0], north + more[1]
    if longer >= _WHOLE_METRES_FROM:
        west, south, east, north = math.floor(west), math.floor(south), math.ceil(east), math.ceil(north)
        longer = max(east - west, north - south)
    if not low <= longer <= high:
        raise InputError(
            f"the area is {longer:.4g} m long: expected {low:g} to {high:g} m, set bounds to clip it"
        )
    pixel = longer / size_px
    columns, rows = (max(1, math.ceil(side / pixel - 1e-6)) for side in (east - west, north - south))
    return SketchArea(west, south, pixel, columns, rows)


def mean_longitude(longitudes: npt.NDArray[np.float64]) -> float:
    """Return the circular mean of longitudes (degrees): of 179 and -179 it is 180."""
    angles = np.radians(longitudes)
    return math.degrees(math.atan2(np.sin(angles).sum(), np.cos(angles).sum()))


def to_longitude_latitude(crs: CRS, points: Float64Array) -> Float64Array:
    """Return longitude and latitude of (n, 2) points."""
    return reproject(points, crs, parse_crs("OGC:CRS84"))


def metric_crs_at(crs: CRS, middle: tuple[float, float]) -> CRS:
    """Return a metric CRS for a point: the given one if it has little distortion there, else the UTM zone."""
    if (
        crs.is_projected
        and crs.linear_units_factor[1] == 1.0
        and not is_westward(crs)
        and _is_undistorted(crs, middle)
    ):
        return crs
    longitude, north = to_longitude_latitude(crs, np.array([middle]))[0]
    if north > _UTM_MAX_NORTH or north < _UTM_MAX_SOUTH:
        return parse_crs(f"EPSG:{_UPS_NORTH if north > 0 else _UPS_SOUTH}")
    zone = int((longitude + 180.0) // 6.0) % 60 + 1
    return parse_crs(f"EPSG:{(_UTM_NORTH if north >= 0 else _UTM_SOUTH) + zone}")


def _is_undistorted(crs: CRS, middle: tuple[float, float]) -> bool:
    """Return whether a projection's metres are nearly true: those of Web Mercator are not."""
    steps = np.array([middle, (middle[0] + 100.0, middle[1]), (middle[0], middle[1] + 100.0)])
    (lon, lat), *others = to_longitude_latitude(crs, steps)
    lengths = [
        _RADIUS * math.hypot(math.radians(y - lat), math.radians(x - lon) * math.cos(math.radians(lat)))
        for x, y in others
    ]
    return all(abs(length / 100.0 - 1.0) < _MAX_DISTORTION for length in lengths)


MAX_VERTICES: Final = 4_000_000
_MAX_BYTES = 1 << 29  # of a file
_BYTES_PER_VERTEX = 16  # of WKB
_NAMED_CRS = re.compile(
    rb'"crs"\s*:\s*{\s*"type"\s*:\s*"name"\s*,\s*"properties"\s*:\s*{\s*"name"\s*:\s*"([^"]*)"'
)
# Of OpenStreetMap; relations of rivers in others consist of ways that are in `lines` too.
_OSM_LAYERS = ("points", "lines", "multipolygons")
_POINT, _LINE, _POLYGON = 0, 1, 3  # shapely's type ids


@dataclass(frozen=True, eq=False)
class SourceLayer:
    """A layer of a file."""

    name: str
    crs: CRS | None  # None: local metres
    shapes: Shapes  # points, lines and valid polygons
    properties: list[dict[str, Any]]  # of each shape
    skipped: Counter[str]  # features by reason
    repaired: int  # areas that crossed themselves
    notes: tuple[str, ...] = ()


def read_vector_layers(
    path: Path, *, untagged: bool = True, degrees: tuple[float, float, float, float] | None = None
) -> list[SourceLayer]:
    """Read the layers of a vector file, known by its first bytes; raise `InputError` if it cannot be read.

    Of OpenStreetMap only features with a tag that may assign them to a layer, unless `untagged`, and that
    touch a rectangle in `degrees` (west, south, east, north).
    """
    location = one_line(path)
    driver = find_driver(path, location, required=True)
    if (size := path.stat().st_size) > _MAX_BYTES:
        raise InputError(f"{location}: {size / (1 << 20):.0f} MiB: expected at most {_MAX_BYTES >> 20} MiB")
    if driver == "GeoJSON":  # parsed JSON needs many times its size in memory
        content = path.read_bytes()
        _check_count(0.5 * max(content.count(b"["), content.count(b",") / 4.0), MAX_VERTICES, location)
        named = _NAMED_CRS.search(content)
        if named and not named[1].startswith(b"http"):  # GDAL takes an unknown one for degrees
            layer_crs(named[1].decode(errors="replace"), location)
        del content
    layers, is_osm = [], driver == "OSM"
    tagged, inside = is_osm and not untagged, degrees if is_osm else None
    with open_vector_file(path, location) as file:
        if file.views:
            raise InputError(f"{location}: layer {format_value(file.views[0])}: expected a table, not a view")
        remaining = MAX_VERTICES
        for name in _OSM_LAYERS if is_osm else file.tables:
            where = f"{location}: layer {format_value(name)}"
            layers.append(_read_layer(file.table(name), where, remaining, tagged=tagged, inside=inside))
            if is_osm and name == "multipolygons":
                layers[-1] = _with_incomplete(layers[-1], Path(file.dataset), tagged=tagged, inside=inside)
            remaining -= int(shapely.get_num_coordinates(layers[-1].shapes).sum())
    layers = [layer for layer in layers if len(layer.shapes) or any(layer.skipped.values()) or layer.notes]
    if not layers:
        raise InputError(f"{location}: expected points, lines or areas, found none")
    return layers


def osm_bounds(path: Path) -> tuple[float, float, float, float] | None:
    """Return the rectangle of an OpenStreetMap file's roads and paths, in degrees; None for another file.

    Raise `InputError` if it cannot be read.
    """
    if find_driver(path, one_line(path)) != "OSM":
        return None
    with open_vector_file(path, one_line(path)) as file:
        _, boxes = pyogrio.read_bounds(file.dataset, layer="lines", where="highway IS NOT NULL")
    if not boxes.shape[1]:
        return None
    west, south = boxes[:2].min(axis=1).tolist()
    east, north = boxes[2:].max(axis=1).tolist()
    return west, south, east, north


def _read_layer(
    table: FileTable, where: str, max_vertices: int, *, tagged: bool, inside: Box | None
) -> SourceLayer:
    _check_count(table.features, max_vertices, where)  # memory for as many is allocated
    columns = [name for name in table.fields if name.lower() in RELEVANT_TAGS]
    options: dict[str, Any] = {"columns": columns}
    if table.features < 0:  # unknown
        condition = _with_tags(table.name, columns) if tagged else None
        options |= {"where": condition, "bbox": inside, "max_features": max_vertices + 1}  # bounds the memory
    wkb, fields, lost = table.read(**options)
    size = sum(len(geometry) for geometry in wkb if geometry is not None)
    _check_count(size / _BYTES_PER_VERTEX, max_vertices, where)
    skipped = Counter({"damaged in the file": lost, "without a valid shape": -lost})
    shapes, of, repaired = _usable(wkb, skipped)
    texts = {key: column.tolist() for key, column in fields.items()}
    properties = [{key: column[index] for key, column in texts.items()} for index in of]
    return SourceLayer(table.name, layer_crs(table.crs, where), shapes, properties, skipped, repaired)


def _with_incomplete(layer: SourceLayer, path: Path, *, tagged: bool, inside: Box | None) -> SourceLayer:
    """Return OpenStreetMap's areas with what closes of incomplete ones, of which GDAL makes others."""
    found = incomplete_areas(path, OSM_KEYS if tagged else (), inside)
    shapes = valid_areas(np.array(found.shapes, object))
    parts, of = single_parts(shapes, np.arange(len(shapes)))
    areas = (shapely.get_type_id(parts) == _POLYGON) & ~shapely.is_empty(parts)
    ids = set(map(str, found.ids))
    whole = np.array([each.get("osm_id") not in ids for each in layer.properties], bool)
    properties = [*compress(layer.properties, whole), *(found.tags[each] for each in of[areas])]
    shapes = np.concatenate([layer.shapes[whole], parts[areas]])
    return replace(layer, shapes=shapes, properties=properties, notes=tuple(found.notes))


def _with_tags(layer: str, columns: Sequence[str]) -> str:
    """Return the SQL condition that a feature of OpenStreetMap has a tag that may assign it to a layer."""
    return " OR ".join(
        f'"{key}" IS NOT NULL' if key in columns else f"other_tags LIKE '%\"{key}\"=>%'"
        for key in OSM_KEYS
        if layer != "points" or key not in BUILT_KEYS
    )


def _check_count(vertices: float, limit: float, where: str) -> None:
    if vertices > limit:
        raise InputError(
            f"{where}: about {vertices:.2g} vertices: expected at most {MAX_VERTICES / 1e6:g} million "
            "in a file: simplify or clip it first"
        )


def _usable(wkb: Shapes, skipped: Counter[str]) -> tuple[Shapes, npt.NDArray[np.intp], int]:
    """Return points, lines and valid polygons, the index of each one's feature, and the number of repairs."""
    with np.errstate(invalid="ignore"):
        shapes = shapely.from_wkb(wkb, on_invalid="fix")  # closes rings; None if invalid
    shapes, of = single_parts(shapes, np.arange(len(shapes)))
    plain = np.isin(shapely.get_type_id(shapes), (_POINT, _LINE, _POLYGON)) & ~shapely.is_empty(shapes)
    shapes, of = shapes[plain], of[plain]
    skipped["without a valid shape"] += len(wkb) - len(np.unique(of))
    coordinates, at = shapely.get_coordinates(shapes, return_index=True)
    finite = np.ones(len(shapes), dtype=bool)
    finite[at[~np.isfinite(coordinates).all(axis=1)]] = False
    skipped["with coordinates that are not finite"] = int((~finite).sum())
    shapes, of = shapes[finite], of[finite]
    crossing = ~shapely.is_valid(shapes) & (shapely.get_type_id(shapes) == _POLYGON)
    shapes = valid_areas(shapes)
    hollow = shapely.is_empty(shapes)
    skipped["with areas of less than three corners"] = int(hollow.sum())
    return *single_parts(shapes[~hollow], of[~hollow]), int((crossing & ~hollow).sum())
