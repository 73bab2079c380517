"""Where a sketch of vectors lies: which coordinates in metres, which rectangle, how large its pixels are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from rasterio import Env
from rasterio._err import CPLE_BaseError
from rasterio.crs import CRS
from rasterio.warp import transform

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError
from sketchterrain.metric_crs import is_westward, parse_crs
from sketchterrain.sketch import SKETCH

Box = Sequence[float]  # west, south, east, north

_STRETCHED = 0.05  # how far metres of a projection may be from metres on the ground
_SLIMMEST = 0.25  # of the longer side, where nothing says how wide the area is
_UTM_NORTH, _UTM_SOUTH, _UPS_NORTH, _UPS_SOUTH = 32600, 32700, 5041, 5042  # EPSG, WGS 84
_FARTHEST_NORTH, _FARTHEST_SOUTH = 84.0, -80.0  # that UTM goes
_WHOLE_METRES_FROM = 100.0  # m along the longer side
_RADIUS = 6_371_000.0  # m, of the Earth as a sphere


class Area(NamedTuple):
    """The rectangle of a sketch: its south-west corner and the side of a pixel (m), and its size (px)."""

    west: float
    south: float
    pixel: float
    columns: int
    rows: int

    @property
    def extent(self) -> float:
        """Metres along the longer side."""
        return self.pixel * max(self.columns, self.rows)

    def pixels(self, places: Float64Array) -> Float64Array:
        """Return column and row, as real numbers, of (n, 2) x and y; row 0 begins at the north edge."""
        column, up = ((places - (self.west, self.south)) / self.pixel).T
        return np.stack([column, self.rows - up], axis=-1)


def area_of(box: Box, size_px: int, *, chosen: bool) -> Area:
    """Return a sketch's area around a rectangle (m): whole pixels, `size_px` along the longer side.

    A rectangle that no user chose and that is slimmer than 1 : 4 is widened.
    """
    west, south, east, north = box
    longer = max(east - west, north - south)
    low, high = SKETCH["extent"].low, SKETCH["extent"].high
    if not chosen:
        more = 0.5 * np.maximum(0.0, _SLIMMEST * longer - np.array([east - west, north - south]))
        west, south, east, north = west - more[0], south - more[1], east + more[0], north + more[1]
    if longer >= _WHOLE_METRES_FROM:
        west, south, east, north = math.floor(west), math.floor(south), math.ceil(east), math.ceil(north)
        longer = max(east - west, north - south)
    if not low <= longer <= high:
        raise InputError(
            f"the area is {longer:.4g} m long: expected {low:g} to {high:g} m, give bounds to cut it to"
        )
    pixel = longer / size_px
    columns, rows = (max(1, math.ceil(side / pixel - 1e-6)) for side in (east - west, north - south))
    return Area(west, south, pixel, columns, rows)


def middle_longitude(longitudes: npt.NDArray[np.float64]) -> float:
    """Return the middle of longitudes on the circle, degrees: of 179 and -179 it is 180."""
    angles = np.radians(longitudes)
    return math.degrees(math.atan2(np.sin(angles).sum(), np.cos(angles).sum()))


def to_degrees(crs: CRS, places: Float64Array) -> Float64Array:
    """Return longitude and latitude of (n, 2) places."""
    return reprojected(places, crs, parse_crs("OGC:CRS84"))


def metric(crs: CRS, middle: tuple[float, float]) -> CRS:
    """Return a CRS of metres around a place: the same, if its metres are true there, else the UTM zone."""
    if crs.is_projected and crs.linear_units_factor[1] == 1.0 and not is_westward(crs) and _true(crs, middle):
        return crs
    longitude, north = to_degrees(crs, np.array([middle]))[0]
    if north > _FARTHEST_NORTH or north < _FARTHEST_SOUTH:
        return parse_crs(f"EPSG:{_UPS_NORTH if north > 0 else _UPS_SOUTH}")
    zone = int((longitude + 180.0) // 6.0) % 60 + 1
    return parse_crs(f"EPSG:{(_UTM_NORTH if north >= 0 else _UTM_SOUTH) + zone}")


def _true(crs: CRS, middle: tuple[float, float]) -> bool:
    """Return whether a metre is a metre on the ground: in Web Mercator it is not."""
    steps = np.array([middle, (middle[0] + 100.0, middle[1]), (middle[0], middle[1] + 100.0)])
    (lon, lat), *others = to_degrees(crs, steps)
    lengths = [
        _RADIUS * math.hypot(math.radians(y - lat), math.radians(x - lon) * math.cos(math.radians(lat)))
        for x, y in others
    ]
    return all(abs(length / 100.0 - 1.0) < _STRETCHED for length in lengths)


def reprojected(places: Float64Array, source: CRS, target: CRS) -> Float64Array:
    """Return (n, 2) x and y in another CRS; raise `InputError` if one of them has no place there."""
    if source == target:
        return places
    try:
        with Env():
            x, y = transform(source, target, places[:, 0], places[:, 1])
    except CPLE_BaseError:
        x = y = [math.nan]
    found = np.stack([np.asarray(x, np.float64), np.asarray(y, np.float64)], axis=-1)
    if not np.isfinite(found).all():
        raise InputError(
            f"coordinates have no place in {target.to_string()[:60]}: give smaller bounds, or another crs"
        )
    return found
