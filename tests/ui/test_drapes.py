"""Draped layers in the window: list, style, classes, pictures, choice and edits of features, files."""

import json

import numpy as np
import pytest
import rasterio
from affine import Affine
from PyQt6.QtCore import QPointF, Qt
from PyQt6.QtGui import QColor
from PyQt6.QtWidgets import QFileDialog

from sketchterrain.document.drapes import draped_layer
from sketchterrain.document.sketch import Sketch
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.models import drapes as model
from sketchterrain.ui.models.workspace import Selection

FRAME = {"crs": "EPSG:25832", "east": 600000.0, "north": 5269000.0}
SIDE = 1000.0  # m


def geojson(path, *features):
    """Write features of kind, coordinates (m of the sketch) and properties."""

    def shifted(places):
        if isinstance(places[0], float):
            return [places[0] + FRAME["east"], places[1] + FRAME["north"]]
        return [shifted(each) for each in places]

    table = {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}},
        "features": [
            {
                "type": "Feature",
                "geometry": {"type": kind, "coordinates": shifted(places)},
                "properties": properties,
            }
            for kind, places, properties in features
        ],
    }
    path.write_text(json.dumps(table))
    return path


def square(west, south, side):
    east, north = west + side, south + side
    return [[[west, south], [east, south], [east, north], [west, north], [west, south]]]


@pytest.fixture
def fields(tmp_path):
    """Two squares that overlap, 300 m and 200 m, and a line, in a file."""
    return geojson(
        tmp_path / "fields.geojson",
        ("Polygon", square(100.0, 100.0, 300.0), {"use": "meadow", "rank": 1}),
        ("Polygon", square(300.0, 300.0, 200.0), {"use": "wood", "rank": 2}),
        ("LineString", [[600.0, 600.0], [900.0, 600.0]], {"use": "path", "rank": 3}),
    )


@pytest.fixture
def blank(document):
    document.open(Sketch(frame=FRAME, extent=SIDE, layers={"hill": np.zeros((50, 50), np.uint8)}))
    return document


def settle(qtbot, canvas):
    sources = canvas._context.document.drapes
    qtbot.waitUntil(lambda: not (sources.is_busy or canvas.drapes.is_busy))


@pytest.fixture
def draped(blank, fields, open_canvas, qtbot):
    """The canvas of a sketch with the fields."""
    blank.do(
        "Add",
        blank.sketch.replace(drapes=(draped_layer(fields, fill="#00ff00", colour="#ff0000", width=6.0),)),
    )
    canvas = open_canvas(blank)
    settle(qtbot, canvas)
    return canvas


def colour_at(canvas, x, y):
    image, place = canvas.grab().toImage(), canvas._context.screen_from_world(x, y)
    return image.pixelColor(place.toPoint())


def test_layers_are_drawn_beneath_and_above_the_paint_by_their_order(draped, blank, tmp_path, qtbot):
    paper, green = colour_at(draped, 800.0, 300.0), colour_at(draped, 200.0, 200.0)
    assert green.green() > green.red() + 50
    assert colour_at(draped, 750.0, 600.0) == QColor("#ff0000")
    pixels = np.zeros((3, 10, 10), np.uint8)
    pixels[2] = 255
    at = Affine(SIDE / 10, 0.0, FRAME["east"], 0.0, -SIDE / 10, FRAME["north"] + SIDE)
    profile = {"count": 3, "height": 10, "width": 10, "dtype": "uint8", "photometric": "RGB"}
    with rasterio.open(tmp_path / "blue.tif", "w", crs=FRAME["crs"], transform=at, **profile) as file:
        file.write(pixels)
    raster, layers = draped_layer(tmp_path / "blue.tif"), blank.sketch.drapes
    for order, seen in (((raster, *layers), True), ((*layers, raster), False)):
        blank.do("Order", blank.sketch.replace(drapes=order))
        settle(qtbot, draped)
        assert colour_at(draped, 800.0, 300.0) == QColor("#0000ff")
        assert (colour_at(draped, 750.0, 600.0) == QColor("#ff0000")) == seen
    model.change_drape(blank, 1, "Hide", visible=0)
    settle(qtbot, draped)
    assert colour_at(draped, 750.0, 600.0) == QColor("#ff0000")
    assert paper not in (green, QColor("#0000ff"))
