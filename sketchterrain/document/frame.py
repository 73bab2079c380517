"""The frame of a sketch: coordinate reference system, place of the south-west corner, vertical datum."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

_ANY_CRS = "EPSG:3857"


class Georeference(NamedTuple):
    """The CRS of outputs, None for local metres, and the sketch's south-west corner in it (m)."""

    crs: str | None
    origin: tuple[float, float]


def check_frame(frame: Mapping[str, Any]) -> None:
    """Raise InputError unless the CRS is in metres and the vertical datum is one."""
    if frame["crs"] or frame["vertical"]:
        _check_systems(frame["crs"], frame["vertical"])


@lru_cache(maxsize=16)
def _check_systems(crs: str, vertical: str) -> None:
    from sketchterrain.io.crs import compound_crs, parse_metric_crs  # GDAL, which most sketches do without

    if crs:
        parse_metric_crs(crs)
    if vertical:
        compound_crs(crs or _ANY_CRS, vertical)


def georeference(
    frame: Mapping[str, Any], crs: str | None = None, origin: tuple[float, float] | None = None
) -> Georeference:
    """Return the georeference of a frame's outputs; a given CRS or origin is used instead of the frame's.

    Another CRS than the frame's has its own origin, by default 0, 0.
    """
    own = crs is None or crs == (frame["crs"] or None)
    if origin is None:
        origin = (frame["east"], frame["north"]) if own else (0.0, 0.0)
    if not own:
        return Georeference(crs, origin)
    if not (frame["crs"] and frame["vertical"]):
        return Georeference(frame["crs"] or None, origin)
    from sketchterrain.io.crs import compound_crs

    return Georeference(compound_crs(frame["crs"], frame["vertical"]), origin)
