"""Draped vector layers as shapes of a map, with their entries in its legend."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.document.parameters import Properties
from sketchterrain.export.drapes import DrapedShapes
from sketchterrain.export.map.drawing import Points, Polygons, Polylines, Shape, rectangle
from sketchterrain.export.map.relief import MapFrame

_PIXEL: Final = 0.2  # mm of a map, for widths in px


def draw_drapes(layers: Iterable[DrapedShapes], frame: MapFrame) -> list[Shape]:
    """Return the features of layers, the lowest first; patterns of areas are filled."""
    from sketchterrain.document.vector_formats import single_parts  # loads GDAL

    shapes: list[Shape] = []
    for layer in layers:
        for _, style, geometry in layer.by_style():
            parts, _ = single_parts(geometry, np.arange(len(geometry)))
            shapes += _drawn(shapely.force_2d(parts), style, float(layer.layer["opacity"]), frame)
    return shapes


def drape_legend(
    layers: Iterable[DrapedShapes], frame: MapFrame, width: float, height: float
) -> list[tuple[str, list[Shape]]]:
    """Return title and symbol, of a width and height (mm), of all styles of layers in use."""
    own = MapFrame(0.0, 0.0, width / frame.mm_per_metre, 0.0, frame.scale)
    entries = []
    for layer in layers:
        for name, style, geometry in layer.by_style():
            corners = rectangle(0.0, -height / 2, width, height)
            kind = int(shapely.get_dimensions(geometry).max())
            middle = shapely.Point(0.5 * width, 0.0), shapely.LineString([(0.0, 0.0), (width, 0.0)])
            shape = (*middle, shapely.Polygon(corners))[kind]
            sample = shapely.transform(np.array([shape]), lambda at: at / frame.mm_per_metre * [1.0, -1.0])
            entries.append((name, _drawn(sample, style, float(layer.layer["opacity"]), own)))
    return entries


def _drawn(parts: npt.NDArray[np.object_], style: Properties, opacity: float, frame: MapFrame) -> list[Shape]:
    unit = frame.mm_per_metre if style["unit"] == "m" else _PIXEL
    width, kind = float(style["width"]) * unit, shapely.get_dimensions(parts)
    dots = frame.to_sheet(shapely.get_coordinates(parts[kind == 0]))
    circle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    discs = [at + 0.5 * width * np.stack([np.cos(circle), np.sin(circle)], axis=-1) for at in dots]
    rings = _paths(shapely.get_rings(parts[kind == 2]), frame)
    lines, shapes = [*_paths(parts[kind == 1], frame), *rings], list[Shape]()
    if style["fill"] and rings:
        shapes.append(Polygons(rings, _rgb(style["fill"]), opacity * float(style["fill_opacity"])))
    if style["colour"] and width > 0.0:
        dashes = tuple(unit * float(each) for each in str(style["dash"]).split())
        shapes += [Polylines(lines, _rgb(style["colour"]), width, opacity, dashes)] if lines else []
        shapes += [Polygons(discs, _rgb(style["colour"]), opacity)] if discs else []
    return shapes


def _paths(lines: Iterable[shapely.LineString], frame: MapFrame) -> list[Points]:
    return [frame.to_sheet(line.coords) for line in lines]


def _rgb(code: object) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(str(code)[1:])
    return red, green, blue
