"""Where a sketch of vectors lies: which coordinates in metres, which rectangle, how large its pixels are."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.metric_crs import is_westward, named_crs
from sketchterrain.sketch import SKETCH

if TYPE_CHECKING:
    import numpy.typing as npt
    from rasterio.crs import CRS

    Box = tuple[float, float, float, float]
    Places = npt.NDArray[np.float64]

__all__ = [
    "Area",
    "area_of",
    "box_around",
    "latitude",
    "metric",
    "reprojected",
    "reprojected_box",
    "unrolled",
]

_STRETCHED = 0.05  # how far metres of a projection may be from metres on the ground
_SLIMMEST = 0.25  # of the longer side, where nothing says how wide the area is
_UTM_NORTH, _UTM_SOUTH, _UPS_NORTH, _UPS_SOUTH = 32600, 32700, 5041, 5042  # EPSG, WGS 84
_FARTHEST_NORTH, _FARTHEST_SOUTH = 84.0, -80.0  # that UTM goes
_WHOLE_METRES_FROM = 100.0  # m along the longer side


class Area(NamedTuple):
    """The rectangle of a sketch, and its pixels.

    Attributes
    ----------
    west, south : float
        m.
    pixel : float
        m along a side.
    columns, rows : int
    """

    west: float
    south: float
    pixel: float
    columns: int
    rows: int

    @property
    def extent(self) -> float:
        """Metres along the longer side."""
        return self.pixel * max(self.columns, self.rows)

    def pixels(self, places: Places) -> Places:
        """Return column and row, as real numbers, of x and y; row 0 begins at the north edge."""
        east, north = places[..., 0] - self.west, places[..., 1] - self.south
        return np.stack([east / self.pixel, self.rows - north / self.pixel], axis=-1)


def area_of(box: Box, size_px: int, *, chosen: bool) -> Area:
    """Return a sketch's area around a rectangle: whole pixels, of which none is cut.

    Parameters
    ----------
    box
        West, south, east, north, m.
    size_px
        Pixels along the longer side.
    chosen
        Whether a person chose this rectangle; else one slimmer than 1 : 4 is made wider.

    Raises
    ------
    InputError
        If it is too small or too large for a sketch.
    """
    west, south, east, north = box
    longer = max(east - west, north - south)
    low, high = SKETCH["extent"].low, SKETCH["extent"].high
    if not chosen:
        least = _SLIMMEST * longer
        west, east = _at_least(west, east, least)
        south, north = _at_least(south, north, least)
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


def _at_least(low: float, high: float, length: float) -> tuple[float, float]:
    more = max(0.0, length - (high - low)) / 2.0
    return low - more, high + more


def box_around(places: Places) -> Box:
    """Return west, south, east and north of places."""
    low, high = places.min(axis=0), places.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def unrolled(places: Places) -> Places:
    """Return degrees without a jump where the features lie on both sides of the antimeridian."""
    x = places[:, 0]
    if x.size == 0 or x.max() - x.min() <= 180.0:
        return places
    east = np.where(x < 0, x + 360.0, x)
    if east.max() - east.min() >= x.max() - x.min():
        return places
    return np.stack([east, places[:, 1]], axis=-1)


def latitude(crs: CRS, middle: tuple[float, float]) -> float:
    """Return how far north a place lies, degrees."""
    return float(reprojected(np.array([middle]), crs, _degrees())[0, 1])


def metric(crs: CRS, middle: tuple[float, float]) -> CRS:
    """Return a system of metres around a place: the same, if its metres are some, else the UTM zone.

    Parameters
    ----------
    crs
        That the place is in.
    middle
        x and y of the place.

    Raises
    ------
    InputError
        If there is no such place on Earth.
    """
    if crs.is_projected and crs.linear_units_factor[1] == 1.0 and not is_westward(crs) and _true(crs, middle):
        return crs
    longitude, north = reprojected(np.array([middle]), crs, _degrees())[0]
    if north > _FARTHEST_NORTH or north < _FARTHEST_SOUTH:
        return named_crs(f"EPSG:{_UPS_NORTH if north > 0 else _UPS_SOUTH}")
    zone = int((longitude + 180.0) // 6.0) % 60 + 1
    return named_crs(f"EPSG:{(_UTM_NORTH if north >= 0 else _UTM_SOUTH) + zone}")


def _true(crs: CRS, middle: tuple[float, float]) -> bool:
    """Whether a metre northward and one eastward are such on the ground: in Web Mercator they are not."""
    steps = np.array([middle, (middle[0] + 100.0, middle[1]), (middle[0], middle[1] + 100.0)])
    (lon, lat), *others = reprojected(steps, crs, _degrees())
    radius = 6_371_000.0  # a sphere will do for a few per cent
    lengths = [
        radius * math.hypot(math.radians(y - lat), math.radians(x - lon) * math.cos(math.radians(lat)))
        for x, y in others
    ]
    return all(abs(length / 100.0 - 1.0) < _STRETCHED for length in lengths)


def _degrees() -> CRS:
    return named_crs("OGC:CRS84")


def reprojected(places: Places, source: CRS, target: CRS) -> Places:
    """Return x and y in another coordinate reference system, by PROJ.

    Raises
    ------
    InputError
        If one of them has no place there.
    """
    from rasterio import Env
    from rasterio._err import CPLE_BaseError
    from rasterio.warp import transform

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


def reprojected_box(box: Box, source: CRS, target: CRS) -> Box:
    """Return the rectangle around a rectangle in another coordinate reference system."""
    west, south, east, north = box
    share = np.linspace(0.0, 1.0, 22)[:, None]
    corners = np.array([(west, south), (east, south), (east, north), (west, north), (west, south)])
    sides = [a + share * (b - a) for a, b in pairwise(corners)]
    return box_around(reprojected(np.concatenate(sides), source, target))
