"""Painted shapes, their depth, fields of signed distance around them, and the covers made of them."""

import itertools

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.features.covers import lay_covers
from sketchterrain.features.shape_fields import shape_field
from sketchterrain.features.shapes import EDGE_OVERHANG, label_shapes, regions_of
from sketchterrain.sketch import MATERIALS, Sketch, load_sketch


def image(*rows: str) -> np.ndarray:
    return np.array([[int(c) for c in row.replace(".", "0")] for row in rows], dtype=np.uint8)


def test_diagonal_neighbours_are_one_shape_and_other_labels_are_others() -> None:
    shapes = label_shapes("hill", image("1..2", ".1.2", "..13", "1..."))
    assert [(shape.label, shape.area, shape.id) for shape in shapes] == [
        (1, 3, 0),
        (2, 2, 3),
        (3, 1, 11),
        (1, 1, 12),
    ]
    picture = np.zeros((32, 40), np.uint8)
    picture[20, 30] = 5
    (shape,) = label_shapes("hill", picture)
    assert shape.depth.tolist() == [[0.5]]  # a lone pixel is half a pixel deep
    assert shape.centre == (20.0, 30.0)
    assert (shape.label, shape.id, shape.image_width) == (5, 20 * 40 + 30, 40)


def test_a_shapes_depth_is_measured_to_all_borders_but_the_sketchs_edge() -> None:
    row, column = np.mgrid[:101, :101] - 50
    distance = np.hypot(row, column)
    (shape,) = label_shapes("hill", ((distance > 20) & (distance < 40)).astype(np.uint8))
    assert shape.depth.max() == pytest.approx(10.0, abs=0.6)
    assert shape.depth[~shape.mask].max() == 0.0
    assert shape.centre == pytest.approx((50.0, 50.0), abs=0.1)

    rng = np.random.default_rng(4)
    picture = (rng.random((30, 40)) < 0.9).astype(np.uint8)
    picture[[0, -1]] = picture[:, [0, -1]] = 0
    empty = np.argwhere(picture == 0)
    for shape in label_shapes("hill", picture):
        rows, columns = shape.pixels(shape.mask)
        nearest = np.sqrt(((np.stack([rows, columns], -1)[:, None] - empty) ** 2).sum(-1)).min(1)
        np.testing.assert_allclose(shape.depth[shape.mask], nearest - 0.5)

    row, column = np.mgrid[:200, :200]
    inside = (np.hypot(row - 100, column - 100) < 20).astype(np.uint8)
    cut = (np.hypot(row - 100, column) < 20).astype(np.uint8)
    (whole,), (half,) = label_shapes("hill", inside), label_shapes("hill", cut)
    np.testing.assert_array_equal(half.depth[:, 0], whole.depth[:, 19])

    (shape,) = label_shapes("hill", np.ones((60, 80), np.uint8))
    assert shape.depth.max() == 29.5 + 80 * EDGE_OVERHANG
    assert shape.centre == pytest.approx((29.5, 39.5))


def test_regions_are_those_of_connected_labels() -> None:
    for share, size in itertools.product((0.0, 0.1, 0.4, 0.7, 1.0), ((1, 1), (1, 23), (23, 1), (17, 24))):
        rng = np.random.default_rng(7)
        for _ in range(10):
            image = (rng.integers(1, 4, size) * (rng.random(size) < share)).astype(np.uint8)
            check_regions(image)
    assert label_shapes("hill", np.zeros((8, 8), np.uint8)) == ()


def check_regions(image: np.ndarray) -> None:
    expected = []
    for value in (1, 2, 3):
        numbers, count = ndimage.label(image == value, structure=np.ones((3, 3)))
        expected += [(int(np.argmax(numbers == k)), value, numbers == k) for k in range(1, count + 1)]
    regions = regions_of(image)
    assert len(regions) == len(expected)
    for region, (_, label, mask) in zip(regions, sorted(expected, key=lambda each: each[0]), strict=True):
        whole = np.zeros(image.shape, np.bool_)
        whole[region.rows, region.columns] = region.mask
        assert region.label == label
        np.testing.assert_array_equal(whole, mask)
        assert region.mask.any(axis=1)[[0, -1]].all()
        assert region.mask.any(axis=0)[[0, -1]].all()


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


def test_a_field_is_the_distance_keeps_its_area_and_margin_and_goes_on_beyond_the_edge() -> None:
    field = field_of(disc(30, 20, 12.3), fidelity=1.0)
    rows, columns = field.inside.shape
    x = field.west + np.arange(columns) * field.spacing
    y = field.south + np.arange(rows)[:, None] * field.spacing
    expected = 123 - np.hypot(x - 205, y - (SIDE - 30.5) * 10)
    assert np.abs(field.inside - expected).max() < 7.5  # most of a pixel of 10 m: its steps

    for fidelity in (0.0, 0.5, 0.8, 1.0):
        for radius in (0.5, 2.2, 9.0):
            image = disc(30, 30, radius)
            field = field_of(image, fidelity=fidelity)
            assert np.count_nonzero(field.inside > 0) == image.sum(), (fidelity, radius)
            rim = np.concatenate([field.inside[[0, -1]].ravel(), field.inside[:, [0, -1]].ravel()])
            assert rim.max() <= -50, (fidelity, radius)

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
