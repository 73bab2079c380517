"""Coordinate reference systems (CRS), and paths that GDAL accepts."""

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rasterio import Env
from rasterio._err import CPLE_BaseError
from rasterio.crs import CRS
from rasterio.errors import CRSError
from rasterio.warp import transform

from sketchterrain.errors import InputError, one_line

# An authority's code, URN, WKT or PROJ string; GDAL would also open files and URLs.
_FORMS = re.compile(r"[A-Za-z]+:[0-9A-Za-z]+(\+[0-9]+)?|urn:ogc:def:crs:[\w:.]+|\+[^/]*|[A-Z_]+\s*\[.*", re.S)
_EPSG = re.compile(r"EPSG:[0-9]+", re.I)
_WESTWARD = re.compile(r'AXIS\["[^"]*",\s*WEST\b', re.I)
_MAX_LENGTH = 20_000  # characters; the longest WKT of EPSG has about 8000
_MAX_SHOWN = 60


def parse_crs(text: str) -> CRS:
    """Return the CRS of an authority's code (``EPSG:25832``), URN, WKT or PROJ string; raise InputError."""
    definition = text.strip()
    if len(definition) <= _MAX_LENGTH and _FORMS.fullmatch(definition):
        try:
            with Env():  # silences GDAL's own messages
                return CRS.from_user_input(definition)
        except CRSError:
            pass
    raise InputError(
        f"{_shorten(text)!r} is not a coordinate reference system: expected a code such as EPSG:25832, or WKT"
    )


def parse_metric_crs(text: str) -> CRS:
    """Return the projected CRS in metres, eastward and northward, of a text; raise InputError for others."""
    crs = parse_crs(text)
    if crs.is_projected:
        unit, metres = crs.linear_units_factor
        if metres != 1.0:
            problem = f"is in the unit {one_line(unit)}"
        elif is_westward(crs):
            problem = "has a westward axis"
        else:
            return crs
    elif crs.is_geographic:
        problem = "is in degrees"
    else:
        problem = "is not projected"
    raise InputError(
        f"the coordinate reference system {_shorten(text)!r} {problem}: expected one in metres eastward and "
        "northward, such as EPSG:25832 (UTM zone 32)"
    )


def parse_vertical_datum(text: str) -> CRS:
    """Return the vertical CRS of a text; raise InputError for others."""
    crs = parse_crs(text)
    if not crs.to_wkt().startswith("VERT_CS["):
        raise InputError(f"{_shorten(text)!r} is not a vertical datum: expected one, such as EPSG:5773")
    return crs


def compound_crs(text: str, vertical: str) -> str:
    """Return a CRS with a vertical datum, as codes or WKT; raise InputError if it is none."""
    horizontal, datum = parse_crs(text).to_wkt(), parse_vertical_datum(vertical).to_wkt()
    if horizontal.startswith("COMPD_CS["):
        raise InputError(f"{_shorten(text)!r} has a vertical datum: expected no other one, {vertical}")
    codes = _EPSG.fullmatch(text), _EPSG.fullmatch(vertical)
    if all(codes):
        return f"{text}+{vertical.partition(':')[2]}"
    name = " + ".join(wkt.split('"')[1] for wkt in (horizontal, datum))
    return f'COMPD_CS["{name}",{horizontal},{datum}]'


def crs_text(crs: CRS | None) -> str:
    """Return a CRS as an authority's code, else as WKT; an empty text without one."""
    if crs is None:
        return ""
    code = crs.to_authority()
    return ":".join(code) if code else str(crs.to_wkt())


def is_westward(crs: CRS) -> bool:
    """Return whether the x axis points west."""
    return _WESTWARD.search(crs.to_wkt()) is not None


def transform_points(source: Any, target: Any, x: Any, y: Any) -> npt.NDArray[np.float64]:
    """Return x and y, (2, …), in another CRS, inf outside of it."""
    try:
        with Env():
            found = transform(source, target, np.ravel(x), np.ravel(y))
    except CPLE_BaseError:
        found = np.full((2, np.size(x)), np.inf)
    return np.reshape(np.asarray(found, np.float64), (2, *np.shape(x)))


def _shorten(text: str) -> str:
    line = one_line(text.strip())
    return line if len(line) <= _MAX_SHOWN else f"{line[: _MAX_SHOWN - 1]}…"


@contextmanager
def plain_path(path: Path) -> Iterator[Path]:
    """Yield a path by which pyogrio reads or writes a file of any name: a symbolic link where needed.

    pyogrio takes ``!`` and a suffix ``.zip`` for an archive's (`pyogrio.util.vsi_path`), and only UTF-8.
    """
    absolute = path.absolute()
    if not {"!", "\ufffd"}.intersection(one_line(absolute)) and absolute.suffix != ".zip":
        yield absolute
        return
    with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
        link = Path(folder) / "map.gpkg"
        link.symlink_to(absolute)
        yield link
