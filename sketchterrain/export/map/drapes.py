"""Draped layers on a map: vectors as shapes with entries in its legend, and rasters on its relief."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.array_types import UInt8Array
from sketchterrain.document.own_materials import rgb_from_hex
from sketchterrain.document.parameters import Properties
from sketchterrain.export.drapes import DrapedShapes
from sketchterrain.export.map.drawing import Polygons, Polylines, Shape
from sketchterrain.export.map.relief import MapFrame, MapSamples

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes

_PIXEL: Final = 0.2  # mm of a map, for widths in px


def draw_drapes(
    layers: Iterable[DrapedShapes], frame: MapFrame, width: float, height: float
) -> tuple[list[Shape], list[tuple[str, list[Shape]]]]:
    """Return the features of layers, the lowest first, and titles with symbols of a width and height (mm).

    Patterns of areas are filled.
    """
    shapes, entries = list[Shape](), list[tuple[str, list[Shape]]]()
    sample = replace(frame, left=0.0, top=0.0, north=0.0, scale=1000.0)  # mm
    patch = shapely.box(0.0, -height / 2, width, height / 2)
    samples = patch.centroid, shapely.LineString([(0.0, 0.0), (width, 0.0)]), patch
    for layer in layers:
        for name, style, geometry in layer.by_style():
            look = {**style, "opacity": layer.layer["opacity"]}
            if style["unit"] == "m":
                look |= {"unit": frame.mm_per_metre}
            shapes += _drawn(geometry, look, frame)
            kind = int(shapely.get_dimensions(geometry).max())
            entries.append((name, _drawn(np.array([samples[kind]]), look, sample)))
    return shapes, entries


def with_rasters(image: UInt8Array, drapes: Drapes | None, samples: MapSamples) -> UInt8Array:
    """Return the image of a map's samples under the visible rasters, the lowest first."""
    if drapes is None:
        return image
    rows, columns, _ = image.shape
    across, up = samples.spacing
    result = image.astype(np.float64)
    for number, source in drapes.rasters(across):
        west, north = -0.5 * across, samples.frame.north + 0.5 * up
        pixels = source.pixels(west, north, across, columns, int(rows * up / across) + 1)
        pixels = pixels[((np.arange(rows) + 0.5) * up / across).astype(int)]
        share = float(drapes.layers[number]["opacity"]) / 255.0 * pixels[..., 3:]
        result += share * (pixels[..., :3] - result)
    return np.rint(result).astype(np.uint8)


def _drawn(geometry: npt.NDArray[np.object_], look: Properties, frame: MapFrame) -> list[Shape]:
    from sketchterrain.document.vector_formats import single_parts  # loads GDAL

    parts, _ = single_parts(shapely.force_2d(geometry), np.arange(len(geometry)))
    unit = _PIXEL if look["unit"] == "px" else float(look["unit"])
    width, opacity, kind = float(look["width"]) * unit, float(look["opacity"]), shapely.get_dimensions(parts)
    rings = [frame.to_sheet(each.coords) for each in shapely.get_rings(parts[kind == 2])]
    lines = [frame.to_sheet(each.coords) for each in parts[kind == 1]]
    circle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    disc = 0.5 * width * np.stack([np.cos(circle), np.sin(circle)], axis=-1)
    dots = [at + disc for at in frame.to_sheet(shapely.get_coordinates(parts[kind == 0]))]
    colour, fill = str(look["colour"]), str(look["fill"])
    dashes = tuple(unit * float(each) for each in str(look["dash"]).split())
    shapes: list[Shape] = []
    if fill and rings:
        shapes.append(Polygons(rings, rgb_from_hex(fill), opacity * float(look["fill_opacity"])))
    outlines = [*lines, *rings]
    if colour and width > 0.0 and outlines:
        shapes.append(Polylines(outlines, rgb_from_hex(colour), width, opacity, dashes))
    if colour and width > 0.0 and dots:
        shapes.append(Polygons(dots, rgb_from_hex(colour), opacity))
    return shapes
