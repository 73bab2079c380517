"""Fields of signed distance around painted shapes, and the covers made of them."""

from __future__ import annotations

import numpy as np

from sketchterrain.features.covers import lay_covers
from sketchterrain.features.shape_fields import shape_field
from sketchterrain.features.shapes import label_shapes
from sketchterrain.sketch import MATERIALS, Sketch, load_sketch

SIDE = 64


def painted(layer: str, image: np.ndarray, *, fidelity: float = 1.0, **label: object) -> Sketch:
    blank = load_sketch("valley_river")
    layers = {name: np.zeros((SIDE, SIDE), np.uint8) for name in blank.layers} | {layer: image}
    labels = {(layer, 1): label} if label else {}
    return blank.replace(layers=layers, extent=SIDE * 10.0, fidelity=fidelity, labels=labels)


def disc(row: float, column: float, radius: float) -> np.ndarray:
    rows, columns = np.indices((SIDE, SIDE))
    return (np.hypot(rows - row, columns - column) < radius).astype(np.uint8)


def field_of(image: np.ndarray, *, fidelity: float, margin: float = 50.0):
    sketch = painted("lake", image, fidelity=fidelity)
    (shape,) = label_shapes("lake", image)
    return shape_field(sketch, shape, margin=margin)


def test_a_discs_field_is_its_distance() -> None:
    field = field_of(disc(30, 20, 12.3), fidelity=1.0)
    rows, columns = field.inside.shape
    x = field.west + np.arange(columns) * field.spacing
    y = field.south + np.arange(rows)[:, None] * field.spacing
    expected = 123 - np.hypot(x - 205, y - (SIDE - 30.5) * 10)
    assert np.abs(field.inside - expected).max() < 7.5  # most of a pixel of 10 m: its steps


def test_a_field_keeps_its_area_and_its_margin() -> None:
    for fidelity in (0.0, 0.5, 0.8, 1.0):
        for radius in (0.5, 2.2, 9.0):
            image = disc(30, 30, radius)
            field = field_of(image, fidelity=fidelity)
            assert np.count_nonzero(field.inside > 0) == image.sum(), (fidelity, radius)
            rim = np.concatenate([field.inside[[0, -1]].ravel(), field.inside[:, [0, -1]].ravel()])
            assert rim.max() <= -50, (fidelity, radius)


def test_a_shape_at_the_edge_goes_on_beyond_it() -> None:
    image = np.zeros((SIDE, SIDE), np.uint8)
    image[20:40, :10] = 1
    field = field_of(image, fidelity=1.0)
    row = round((340 - field.south) / 10)
    column = round((-40 - field.west) / 10)
    assert field.inside[row, column] > 0


def test_every_painted_pixel_makes_a_cover() -> None:
    image = np.zeros((SIDE, SIDE), np.uint8)
    image[5, 5] = image[50:60, 20:40] = 1
    image[0, 0] = 2
    covers = lay_covers(painted("material", image, material="sand", strength=0.7))
    assert [(cover.label, cover.material, cover.strength) for cover in covers] == [
        (2, MATERIALS.index("rock"), 1.0),
        (1, MATERIALS.index("sand"), 0.7),
        (1, MATERIALS.index("sand"), 0.7),
    ]
    assert len({cover.id for cover in covers}) == 3
    assert lay_covers(painted("material", disc(9, 9, 4), strength=0.0)) == ()
