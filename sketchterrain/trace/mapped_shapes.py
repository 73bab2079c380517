"""Features of a map that belong to a sketch, in metres, and the sketch's rectangle among them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS
from sketchterrain.trace.vector_clip import ring_in, segments_in, segments_of
from sketchterrain.trace.vector_kinds import number_in, tags_of, wanted_by
from sketchterrain.trace.vector_place import (
    Area,
    area_of,
    box_around,
    latitude,
    metric,
    reprojected,
    reprojected_box,
    unrolled,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    import numpy.typing as npt
    from rasterio.crs import CRS

    from sketchterrain.trace.vector_features import Kind, Source, VectorFeature
    from sketchterrain.trace.vector_kinds import Wanted

    Box = tuple[float, float, float, float]
    Places = npt.NDArray[np.float64]

__all__ = ["WIDE", "MappedShape", "MappedShapes", "placed_on_map"]

_AROUND = 0.5  # of its size, that is kept around a chosen rectangle: wide lines there reach in
_DISCS = ("mountain", "hill", "dune", "forest")  # what a point can stand for
_AREAS = ("dune", "forest", "lake", "material")  # what lines are only the border of
_WIDEST = 1e6  # m
WIDE: Final = 0.04
"""Of the longer side: a line or disc on a layer of areas that says nothing of its width."""


class MappedShape(NamedTuple):
    """A shape in metres.

    Attributes
    ----------
    kind : {'point', 'line', 'area'}
    parts : sequence of float64
        Segments (n, 2, 2) of a line; of points such of no length; closed rings (n, 2) of an area.
    wanted : Wanted
    width : float or None
        m that its line, or its disc, is wide.
    """

    kind: Kind
    parts: Sequence[Places]
    wanted: Wanted
    width: float | None


@dataclass(frozen=True, eq=False)
class MappedShapes:
    """What of a map belongs to a sketch.

    Attributes
    ----------
    shapes : list of MappedShape
    area : Area
    latitude : float or None
        Of its middle, degrees.
    left_out : Counter
        How many features do not belong to it, by why.
    notes : tuple of str
    """

    shapes: list[MappedShape]
    area: Area
    latitude: float | None
    left_out: Counter[str]
    notes: tuple[str, ...]


def placed_on_map(
    sources: Sequence[Source],
    *,
    layer: str | None,
    width: float | None,
    bounds: Box | None,
    target: CRS | None,
    size_px: int,
) -> MappedShapes:
    """Choose what belongs to a sketch, bring it into metres and find the rectangle around it.

    Parameters
    ----------
    sources
    layer
        For features that say nothing of themselves.
    width
        m, of lines that say none.
    bounds
        West, south, east, north in the first source's coordinates; None: around all.
    target
        Coordinate reference system in metres, or None: what suits.
    size_px
        Pixels along the longer side.

    Raises
    ------
    InputError
        If nothing belongs to a sketch, coordinates are no such, or the area is too small or too large.
    """
    left_out: Counter[str] = Counter()
    home, shapes = _together(sources, layer, width, left_out)
    if home is not None and home.is_geographic:
        shapes = _in_degrees(shapes, bounds)
    if bounds is not None:
        shapes = _cut(shapes, bounds, left_out)
    box = bounds or box_around(_vertices(shapes))
    north: float | None = None
    if home is not None:
        middle = (0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]))
        north = latitude(home, middle)
        target = target or metric(home, middle)
        shapes = _with_vertices(shapes, reprojected(_vertices(shapes), home, target))
        box = reprojected_box(box, home, target)
    elif target is not None:
        raise InputError("its metres lie nowhere on Earth: expected no crs to bring it into")
    area = area_of(_around(shapes) if bounds is None else box, size_px, chosen=bounds is not None)
    return MappedShapes(shapes, area, north, left_out, _told(area, target))


def _together(
    sources: Sequence[Source], layer: str | None, width: float | None, left_out: Counter[str]
) -> tuple[CRS | None, list[MappedShape]]:
    """Return what belongs to a sketch, all in the coordinate reference system of the first source."""
    chosen = [(source.crs, _wanted(source, layer, width, left_out)) for source in sources]
    chosen = [(crs, shapes) for crs, shapes in chosen if shapes]
    if not chosen:
        raise InputError(
            f"nothing in it says what it is: expected a property layer ({', '.join(LAYERS)}), "
            "tags such as waterway=river or natural=water, or one layer for all"
        )
    home, together = chosen[0]
    for crs, shapes in chosen[1:]:
        if crs is None or home is None:
            if crs is not home:
                raise InputError("some of its layers lie on Earth and some do not: expected one or the other")
            together += shapes
        else:
            together += _with_vertices(shapes, reprojected(_vertices(shapes), crs, home))
    return home, together


def _wanted(
    source: Source, layer: str | None, width: float | None, left_out: Counter[str]
) -> list[MappedShape]:
    shapes = []
    for feature in source.features:
        tags = tags_of(feature.properties)
        wanted = wanted_by(tags, source.name, layer)
        if wanted is None:
            left_out["that say nothing a sketch knows"] += 1
            continue
        shape = _shape(feature, wanted, tags, width)
        if isinstance(shape, str):
            left_out[shape] += 1
        else:
            shapes.append(shape)
    return shapes


def _shape(
    feature: VectorFeature, wanted: Wanted, tags: Mapping[str, Any], width: float | None
) -> MappedShape | str:
    """Return a feature's shape, or why it has none on its layer."""
    kind, parts = feature.kind, list(feature.parts)
    if kind == "line" and wanted.layer in _AREAS and all(_is_closed(part) for part in parts):
        kind = "area"
    if kind == "area":
        rings = [part for part in parts if len(part) >= 4]
        return MappedShape(kind, rings, wanted, None) if rings else "with areas of less than three corners"
    if kind == "point":
        radius = number_in(tags.get("radius"))
        if wanted.layer not in _DISCS:
            return "that are points, where no area is known"
        wide = None if radius is None else 2.0 * radius
    else:
        wide = number_in(tags.get("width"))
        if wanted.layer in _AREAS and wide is None and width is None:
            return "that are lines around nothing"
    wide = None if wide is None else min(max(wide, 0.0), _WIDEST)
    return MappedShape(kind, [segments_of(part) for part in parts], wanted, wide)


def _is_closed(line: Places) -> bool:
    return len(line) >= 4 and bool(np.array_equal(line[0], line[-1]))


def _in_degrees(shapes: list[MappedShape], bounds: Box | None) -> list[MappedShape]:
    """Return the same on one side of the antimeridian, around the bounds if there are any."""
    places = _vertices(shapes)
    longest, highest = np.abs(places).max(axis=0)
    if highest > 90.0 or longest > 360.0:
        where = places[np.argmax(np.maximum(np.abs(places[:, 0]) / 360.0, np.abs(places[:, 1]) / 90.0))]
        raise InputError(
            f"{where[0]:g}, {where[1]:g} is no longitude and latitude: expected degrees, or a member crs "
            "that says what it is"
        )
    if bounds is None:
        return _with_vertices(shapes, unrolled(places))
    middle = 0.5 * (bounds[0] + bounds[2])
    return [shape._replace(parts=[_turned(part, middle) for part in shape.parts]) for shape in shapes]


def _turned(part: Places, middle: float) -> Places:
    """Return degrees near a longitude: segments each by itself, the short way round, a ring as a whole."""
    x, y = part[..., 0], part[..., 1]
    if part.ndim == 3:
        x = np.unwrap(x, axis=1, period=360.0)
        centre = x.mean(axis=1, keepdims=True)
    else:
        centre = np.full(1, 0.5 * (x.min() + x.max()))
    return np.stack([x + 360.0 * np.rint((middle - centre) / 360.0), y], axis=-1)


def _cut(shapes: list[MappedShape], bounds: Box, left_out: Counter[str]) -> list[MappedShape]:
    """Return what lies in a rectangle and around it: far away, places may have no other coordinates."""
    west, south, east, north = bounds
    more = (_AROUND * (east - west), _AROUND * (north - south))
    box = (west - more[0], south - more[1], east + more[0], north + more[1])
    kept = []
    for shape in shapes:
        cut = ring_in if shape.kind == "area" else segments_in
        parts = [part for part in (cut(each, box) for each in shape.parts) if len(part)]
        if parts:
            kept.append(shape._replace(parts=parts))
        else:
            left_out["outside"] += 1
    if not kept:
        raise InputError("nothing that belongs to a sketch lies in these bounds")
    return kept


def _around(shapes: Sequence[MappedShape]) -> Box:
    """Return the rectangle around shapes, with discs as wide as they will be."""
    west, south, east, north = box_around(_vertices(shapes))
    usual = WIDE * max(east - west, north - south)
    boxes = [(west, south, east, north)]
    for shape in shapes:
        if shape.kind == "point":
            half = 0.5 * (usual if shape.width is None else shape.width)
            low, high = _vertices([shape]).min(axis=0) - half, _vertices([shape]).max(axis=0) + half
            boxes.append((*low.tolist(), *high.tolist()))
    low, high = np.array(boxes)[:, :2].min(axis=0), np.array(boxes)[:, 2:].max(axis=0)
    return box_around(np.stack([low, high]))


def _vertices(shapes: Sequence[MappedShape]) -> Places:
    return np.concatenate([part.reshape(-1, 2) for shape in shapes for part in shape.parts])


def _with_vertices(shapes: Sequence[MappedShape], places: Places) -> list[MappedShape]:
    """Return the same shapes of other vertices, in the order of `_vertices`."""
    result, at = [], 0
    for shape in shapes:
        parts = []
        for part in shape.parts:
            count = part.size // 2
            parts.append(places[at : at + count].reshape(part.shape))
            at += count
        result.append(shape._replace(parts=parts))
    return result


def _told(area: Area, crs: CRS | None) -> tuple[str, ...]:
    corner = f"{area.west:.10g},{area.south:.10g}"
    if crs is None:
        return (f"south-west corner: {corner} in its own metres; export with --origin {corner} puts it back",)
    code = crs.to_authority()
    name = ":".join(code) if code else "its own coordinate reference system"
    back = f"--crs {name} --origin {corner}" if code else f"--origin {corner}"
    return (f"south-west corner: {corner} in {name}; export with {back} puts it back",)
