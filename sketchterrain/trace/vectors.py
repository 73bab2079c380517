"""A sketch of what a GIS holds: rivers, lakes, forests and summits of GeoJSON or a GeoPackage."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.metric_crs import metric_crs
from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.sketch.document import LARGEST_SIDE
from sketchterrain.sketch.wording import did_you_mean, shown
from sketchterrain.trace.geojson import read_geojson
from sketchterrain.trace.geopackage_layers import MAGIC, read_geopackage
from sketchterrain.trace.mapped_shapes import placed_on_map
from sketchterrain.trace.painted_shapes import painted
from sketchterrain.trace.traced import Traced
from sketchterrain.trace.vector_kinds import READ

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.trace.vector_features import Source

    Box = tuple[float, float, float, float]

__all__ = ["is_vectors", "sketch_from_vectors"]

_SIZE = 512  # px
_BLANK = b"\xef\xbb\xbf \t\r\n"  # what may stand before JSON


def is_vectors(path: Path) -> bool:
    """Return whether a file begins as GeoJSON or a GeoPackage does."""
    try:
        with path.open("rb") as stream:
            start = stream.read(4096)
    except OSError:
        return False
    return start.startswith(MAGIC) or start.lstrip(_BLANK).startswith(b"{")


def sketch_from_vectors(
    path: Path,
    *,
    layer: str | None = None,
    width: float | None = None,
    bounds: Box | None = None,
    crs: str | None = None,
    size_px: int = _SIZE,
    name: str | None = None,
) -> Traced:
    """Make a sketch of the lines, areas and summits of a map.

    They are brought into metres, cut to a rectangle and painted on the layers that their properties ask for.

    Parameters
    ----------
    path
        GeoJSON or a GeoPackage, known by its first bytes.
    layer
        For features that say nothing of themselves.
    width
        m, of lines that say none.
    bounds
        West, south, east, north in the file's own coordinates; None: all that is taken.
    crs
        Coordinate reference system in metres to bring it into; None: the file's own if its metres are such
        on the ground, else the UTM zone of the middle.
    size_px
        Pixels along the sketch's longer side.
    name
        Of the sketch; None: that of the file.

    Raises
    ------
    InputError
        If an option is none, or the file is, or nothing of it belongs to a sketch.
    SketchterrainError
        If a library is not installed.
    """
    _check(layer, width, bounds, size_px)
    target = None if crs is None else metric_crs(crs)
    sources = _read(path)
    place = one_line(path)
    left_out: Counter[str] = sum((source.left_out for source in sources), Counter())
    try:
        found = placed_on_map(
            sources, layer=layer, width=width, bounds=bounds, target=target, size_px=size_px
        )
        picture = painted(found, width)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    sketch = Sketch(
        name=one_line(path.stem)[:200] if name is None else name,
        extent=found.area.extent,
        weather={} if found.latitude is None else {"latitude": round(found.latitude, 2)},
        layers=picture.layers,
        labels=picture.labels,
    )
    left = [f"{count} {why}" for why, count in sorted((left_out + found.left_out + picture.left_out).items())]
    size = f"{sketch.width_px}×{sketch.height_px} px, {sketch.pixel_size:.4g} m each"
    notes = (
        *picture.notes,
        *([f"left out: {', '.join(left)}"] if left else []),
        size,
        *found.notes,
    )
    return Traced(sketch, notes)


def _check(layer: str | None, width: float | None, bounds: Box | None, size_px: int) -> None:
    if layer is not None and layer not in LAYERS:
        near = did_you_mean(layer, LAYERS)
        raise InputError(f"unknown layer {shown(layer)}: expected {', '.join(LAYERS)}{near}")
    if width is not None and not (math.isfinite(width) and width >= 0.0):
        raise InputError(f"width: expected metres ≥ 0, got {width}")
    if bounds is not None:
        west, south, east, north = bounds
        if not (all(map(math.isfinite, bounds)) and west < east and south < north):
            raise InputError(f"bounds: expected west < east and south < north, got {shown(bounds)}")
    if not 1 <= size_px <= LARGEST_SIDE:
        raise InputError(f"size: expected 1 to {LARGEST_SIDE} px, got {size_px}")


def _read(path: Path) -> list[Source]:
    place = one_line(path)
    try:
        with path.open("rb") as stream:
            start = stream.read(4096)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({one_line(error.strerror or error)})") from None
    if start.startswith(MAGIC):
        sources = read_geopackage(path, READ)
    elif start.lstrip(_BLANK).startswith(b"{"):
        sources = [read_geojson(path)]
    else:
        raise InputError(f"{place}: expected GeoJSON or a GeoPackage, it begins with {shown(start[:20])}")
    if not any(source.features or source.left_out for source in sources):
        raise InputError(f"{place}: expected points, lines or areas, it has none")
    return sources
