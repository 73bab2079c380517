"""Vertical datums: heights above the ellipsoid, EGM96 and EGM2008, converted by geoid grids at hand."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.raster_reader import ELLIPSOID, Affine6, read_header, read_window
from sketchterrain.errors import one_line

_GEOIDS: Final = {
    "EPSG:5773": ("us_nga_egm96_15.tif", "egm96_15.gtx"),
    "EPSG:3855": ("us_nga_egm08_25.tif", "egm08_25.gtx"),
}  # files of PROJ-data: heights of the datum above the ellipsoid
_ELLIPSOIDS = (ELLIPSOID, "EPSG:4979")
_GEOID_RANGE, _GEOID_DIFFERENCES = 107.0, 10.0  # m: above the ellipsoid; from one model to another
_NODE, _MOST_STEPS = 500.0, 64  # m between points at which geoids are evaluated; samples
_AT_ONCE = 1 << 20  # of them


def convert_heights(grid: ElevationGrid, vertical: str, declared: str = "") -> ElevationGrid:
    """Return a grid with heights above the datum `vertical` of the sketch; findings tell what was done.

    `declared` is the datum of the grid's heights, by default that of its file. Datums are codes (EPSG:5773,
    EPSG:3855), WKT or `ELLIPSOID`; an empty one is unknown. Raise InputError if one is no vertical datum.
    """
    source, told = declared or grid.vertical, ""
    if grid.vertical and _name(source) != _name(grid.vertical):
        told = f"heights above {_name(source)} as declared, not {_name(grid.vertical)} as in its file"
    shift, finding = height_shift(source, vertical, grid.crs, grid.place, grid.shape)
    findings = (*grid.findings, *filter(None, (told, finding)))
    if shift is None:
        return replace(grid, findings=findings)
    return grid.raised(shift.rows, vertical=vertical, findings=findings)


class HeightShift(NamedTuple):
    """Metres from one vertical datum to another at the samples of a grid, bilinear between nodes."""

    nodes: Float64Array
    step: int  # samples between nodes
    columns: int

    def rows(self, first: int, last: int) -> Float64Array:
        """Return what to add to heights of some rows, m."""
        found = self.nodes
        for axis, span in enumerate((np.arange(first, last), np.arange(self.columns))):
            index, rest = np.divmod(span, self.step)
            t = np.expand_dims(rest / self.step, 1 - axis)
            found = found.take(index, axis) * (1.0 - t) + found.take(index + 1, axis) * t
        return found


def height_shift(
    source: str, target: str, crs: str, place: Affine6, shape: tuple[int, int]
) -> tuple[HeightShift | None, str]:
    """Return what to add to the heights of a grid, None for nothing, and what was found, in words."""
    names = [_name(each) if each else "" for each in (source, target)]
    if names[0] == names[1]:
        return None, ""
    if not source:
        return None, f"no vertical datum declared, taken for that of the sketch ({names[1]})"
    if not target:
        return None, f"heights above {names[0]}, not converted: the sketch has no vertical datum"
    from sketchterrain.io.crs import transform_points

    reason = "its samples have no place on Earth"
    a, b, c, d, e, f = place
    length = np.hypot(a, d) * (111_320.0 if abs(a) + abs(d) < 0.05 else 1.0)
    step = int(np.clip(_NODE / length, 1, _MOST_STEPS))
    count, across = ((n - 1) // step + 2 for n in shape)
    columns, groups, parts = step * np.arange(float(across)), -(-count * across // _AT_ONCE), []
    for rows in np.array_split(step * np.arange(float(count)), groups) if crs else ():
        row, column = np.meshgrid(rows, columns, indexing="ij")
        points = a * column + b * row + c, d * column + e * row + f
        longitude, latitude = transform_points(crs, "EPSG:4326", *points)
        if not (np.isfinite(longitude).all() and np.isfinite(latitude).all()):
            break
        above = [_above_ellipsoid(each, longitude, latitude) for each in (source, target)]
        parts.append(above[0] - above[1])
    else:
        if parts and np.isfinite(nodes := np.concatenate(parts)).all():
            told = f"heights above {names[0]} converted to {names[1]}, by {np.median(nodes):+.2f} m"
            return HeightShift(nodes, step, shape[1]), told
        if parts:
            missing = [
                _GEOIDS[each][0] for each in (source, target) if each in _GEOIDS and not _geoid_file(each)
            ]
            reason = f"PROJ has no {' nor '.join(missing)}" if missing else "no geoid grid covers it"
    most = _GEOID_RANGE if {source, target} & set(_ELLIPSOIDS) else _GEOID_DIFFERENCES
    return None, f"heights above {names[0]} not converted to {names[1]} ({reason}): off by up to {most:g} m"


def geoid_files() -> list[str]:
    """Return the geoid grids at hand, on which conversions depend."""
    return [str(path) for datum in _GEOIDS if (path := _geoid_file(datum))]


def _name(datum: str) -> str:
    """Return the name of a datum; raise InputError if it is none."""
    from sketchterrain.io.crs import parse_vertical_datum

    if datum in _ELLIPSOIDS:
        return "the ellipsoid"
    return one_line(parse_vertical_datum(datum).to_wkt().split('"')[1])


def _above_ellipsoid(datum: str, longitude: Float64Array, latitude: Float64Array) -> Float64Array:
    """Return the heights of a datum above the ellipsoid (m), bilinear in its grid; NaN where unknown."""
    unknown, path = np.full(longitude.shape, np.nan), _geoid_file(datum)
    if datum in _ELLIPSOIDS or path is None:
        return np.zeros(longitude.shape) if datum in _ELLIPSOIDS else unknown
    header = read_header(path)
    east, _, west, _, south, north = header.place or (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    column, row = ((longitude - west + 0.5 * east) % 360.0) / east - 0.5, (latitude - north) / south
    rows, columns = header.shape
    inside = (column > -1) & (column < columns) & (row > -1) & (row < rows)
    if not inside.any():
        return unknown
    left, top = (max(int(each[inside].min()), 0) for each in (column, row))
    right, bottom = (int(each[inside].max()) + 2 for each in (column, row))
    found, known = read_window(header, (top, left, min(bottom, rows) - top, min(right, columns) - left))
    part = np.where(known, found.astype(np.float64), np.nan)
    values = ndimage.map_coordinates(part, [row - top, column - left], order=1, mode="nearest")
    return np.asarray(np.where(inside, values, np.nan))


def _geoid_file(datum: str) -> Path | None:
    files = (folder / name for folder in _proj_folders() for name in _GEOIDS.get(datum, ()))
    return next((path for path in files if path.is_file()), None)


def _proj_folders() -> Iterator[Path]:
    """Yield the folders in which PROJ looks for grids."""
    for name in ("PROJ_USER_WRITABLE_DIRECTORY", "PROJ_DATA", "PROJ_LIB"):
        yield from (Path(each) for each in os.environ.get(name, "").split(os.pathsep) if each)
    yield Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share") / "proj"
    yield from (Path("/usr/share/proj"), Path("/usr/local/share/proj"))
