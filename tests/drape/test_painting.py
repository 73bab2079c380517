"""Draped layers in appearance tiles: exact coverage, borders, dashes, blending, against shapely and NumPy."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import list_devices
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.drape.drapes import LayerStyle
from sketchterrain.drape.items import AFTER, BEFORE, ENDS, FILL, POINT, STARTS, STROKE, Items
from sketchterrain.drape.painting import TEXEL_PIXELS, WHITE, DrapedAppearance, linear_colour
from sketchterrain.terrain.appearance import SIDE

if not list_devices():
    pytest.skip("no OpenCL device", allow_module_level=True)

EXTENT = 1900.0  # m: texels of 10 m at level 0
SOLID = {"unit": "m", "colour": "#ffffff", "fill": "", "fill_opacity": 1.0, "cap": "butt"}


class FakeDrapes:
    """Layers of items in memory, one style each."""

    def __init__(self, layers, parts, rasters=None):
        self.layers, self.parts, self.raster_sources = tuple(layers), parts, rasters or {}
        self.sources, self.held = (1,) * len(self.layers), None
        self.is_empty = not layers
        self.asked = 0
        self.styles = tuple(
            LayerStyle(number, layer.style, layer["opacity"], layer["blend"])
            for number, layer in enumerate(self.layers)
        )

    def items(self, box, texel):
        self.asked += 1
        chosen = [
            part._replace(layer=np.full_like(part.layer, number), style=np.full_like(part.style, number))
            for number, part in self.parts.items()
            if self.layers[number]["visible"]
        ]
        return Items.joined(chosen)

    def rasters(self, texel):
        return [(n, source) for n, source in self.raster_sources.items() if self.layers[n]["visible"]]

    def occupied(self, boxes):
        return np.ones(len(boxes), bool)

    def changed_boxes(self, old):
        return np.array([[0.0, 0.0, 1.0, 1.0]])


def items_of(*parts):
    """Return items of (kind, feature, points[, along[, ends]])."""
    rows = [(*part, *(0.0, STARTS | ENDS)[len(part) - 3 :]) for part in parts]
    kinds, features, points, along, ends = zip(*rows, strict=True)
    points = [np.asarray(each, float).reshape(-1, 2) for each in points]
    zeros = np.zeros(len(rows), np.int32)
    return Items(
        np.array(features, np.int64),
        zeros,
        zeros,
        np.array(kinds, np.int8),
        np.cumsum([0, *map(len, points)]).astype(np.int64),
        np.concatenate(points),
        np.array(along, float),
        np.array(ends, np.uint8),
    )


def layer(number=0, values=None, **style):
    return DrapedLayer(f"layer{number}.gpkg", values or {}, SOLID | style)


def painted(parts, *, real="float", below=None, layers=None, **style):
    """Return the appearance of items in one layer, or of some by layer."""
    layers = [layer(**style)] if layers is None else layers
    parts = {0: parts} if isinstance(parts, Items) else parts
    context = ComputeContext(list_devices()[0], real=real)
    return DrapedAppearance(FakeDrapes(layers, parts), context, EXTENT, below)


def texel_boxes(level, column, row):
    width = EXTENT / 2.0**level
    side = width / (SIDE - 2)
    west = column * width + (np.arange(SIDE) - 1.0) * side
    north = (row + 1) * width - (np.arange(SIDE) - 1.0) * side
    return shapely.box(west, north[:, None] - side, west + side, north[:, None])


def exact(shape, key):
    """Return the shares of texels in a shape."""
    boxes = texel_boxes(*key)
    shapely.prepare(shape)
    result = np.where(shapely.contains_properly(shape, boxes), 1.0, 0.0)
    partly = shapely.intersects(shape, boxes) & (result == 0.0)
    result[partly] = shapely.area(shapely.intersection(shape, boxes[partly])) / shapely.area(boxes[0, 0])
    return result


def rings(feature, shape):
    """Return the fills of a polygon."""
    shape = shapely.geometry.polygon.orient(shape)
    return [(FILL, feature, each.coords) for each in (shape.exterior, *shape.interiors)]


def star(seed, middle, radius, count=40):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    away = radius * rng.uniform(0.3, 1.0, count)
    points = np.stack([np.cos(angle), np.sin(angle)], axis=1) * away[:, None] + middle
    return shapely.Polygon(points)


@pytest.mark.parametrize("real", ["float", "double"])
def test_shares_of_areas_are_exact(real):
    """Of a star with a hole, at every level, in tiles wholly inside, cut and touched."""
    if real == "double" and not list_devices()[0].has_double:
        pytest.skip("no 64-bit floats")
    shape = star(1, (960.0, 940.0), 800.0)
    hole = star(2, (960.0, 940.0), 90.0)
    shape = shapely.difference(shape, hole)
    assert shape.geom_type == "Polygon"
    paint = painted(items_of(*rings(1, shape)), fill="#ffffff", colour="", real=real)
    for key in ((0, 0, 0), (-1, 0, 0), (1, 0, 1), (1, 1, 0), (3, 4, 4), (4, 7, 8), (6, 33, 32)):
        found = paint.tiles([key])[0, ..., 3] / 255.0
        assert np.abs(found - exact(shape, key)).max() < 1.2 / 255.0, key
