"""The frame of a sketch: coordinate reference system, place of the south-west corner, vertical datum."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any


def check_frame(frame: Mapping[str, Any]) -> None:
    """Raise InputError unless the CRS is in metres and the vertical datum is one."""
    if frame["crs"] or frame["vertical"]:
        _check_systems(frame["crs"], frame["vertical"])


@lru_cache(maxsize=16)
def _check_systems(crs: str, vertical: str) -> None:
    # Imports GDAL, which most sketches do without.
    from sketchterrain.io.crs import compound_crs, parse_metric_crs, parse_vertical_datum

    if crs:
        parse_metric_crs(crs)
    if crs and vertical:
        compound_crs(crs, vertical)
    elif vertical:
        parse_vertical_datum(vertical)


def georeference(
    frame: Mapping[str, Any], crs: str | None = None, origin: tuple[float, float] | None = None
) -> tuple[str | None, tuple[float, float]]:
    """Return the CRS of outputs, None for local metres, and the sketch's south-west corner in it (m).

    They are the frame's unless given; another CRS than the frame's has its own origin, by default 0, 0.
    """
    corner = 0.0, 0.0
    if crs is None or crs == (frame["crs"] or None):
        crs, corner = frame["crs"] or None, (frame["east"], frame["north"])
        if crs and frame["vertical"]:
            from sketchterrain.io.crs import compound_crs

            crs = compound_crs(crs, frame["vertical"])
    return crs, corner if origin is None else origin
