"""Metric coordinate reference systems, and paths that GDAL understands."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line

if TYPE_CHECKING:
    from rasterio.crs import CRS


# A code of an authority, WKT or a PROJ string: GDAL would open files and addresses too.
_FORMS = re.compile(r"[A-Za-z]+:[0-9A-Za-z]+(\+[0-9]+)?|urn:ogc:def:crs:[\w:.]+|\+[^/]*|[A-Z_]+\s*\[.*", re.S)
_WESTWARD = re.compile(r'AXIS\["[^"]*",\s*WEST\b', re.I)
_LONGEST = 20_000  # characters: the longest WKT of EPSG's has about 8000
_SHOWN = 60


def parse_crs(text: str) -> CRS:
    """Return the coordinate reference system that a text names."""
    from rasterio import Env
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    wanted = text.strip()
    if len(wanted) <= _LONGEST and _FORMS.fullmatch(wanted):
        try:
            with Env():  # takes GDAL's own messages off the terminal
                return CRS.from_user_input(wanted)
        except CRSError:
            pass
    raise InputError(
        f"{_shown(text)!r} is no coordinate reference system: expected a code such as EPSG:25832, or WKT"
    )


def parse_metric_crs(text: str) -> CRS:
    """Return the projected coordinate reference system in metres that a text names."""
    crs = parse_crs(text)
    if crs.is_projected:
        unit, metres = crs.linear_units_factor
        if metres != 1.0:
            problem = f"is in the unit {one_line(unit)}"
        elif is_westward(crs):
            problem = "counts westward"
        else:
            return crs
    elif crs.is_geographic:
        problem = "is in degrees"
    else:
        problem = "is no map's"
    raise InputError(
        f"the coordinate reference system {_shown(text)!r} {problem}: expected one in metres eastward and "
        "northward, such as EPSG:25832 (UTM zone 32)"
    )


def is_westward(crs: CRS) -> bool:
    """Return whether x counts to the west: what lies in it as if it did not is turned round."""
    return _WESTWARD.search(crs.to_wkt()) is not None


def _shown(text: str) -> str:
    line = one_line(text.strip())
    return line if len(line) <= _SHOWN else f"{line[: _SHOWN - 1]}…"


@contextmanager
def plain_path(path: Path) -> Iterator[Path]:
    """Yield a path by which pyogrio finds a file, or makes one, whatever its name is.

    pyogrio takes a ``!`` for the end of an archive's name, and an ending ``.zip`` for an archive
    (`pyogrio.util.vsi_path`): it would read or write another file. Such a file is reached by a link.
    """
    whole = path.absolute()
    if "!" not in str(whole) and whole.suffix != ".zip":
        yield whole
        return
    with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
        link = Path(folder) / "map.gpkg"
        link.symlink_to(whole)
        yield link
