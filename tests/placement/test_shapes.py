"""Painted shapes: depth, signed distance, covers, user features, placed features."""

import itertools

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.landforms.placement.covers import create_covers, shape_field
from sketchterrain.landforms.placement.placement import place
from sketchterrain.landforms.placement.shapes import EDGE_OVERHANG, find_regions, label_shapes
from sketchterrain.landforms.placement.user_features import mean_size, user_features
from sketchterrain.schema.materials import MATERIALS


def image(*rows):
    return np.array([[int(c) for c in row.replace(".", "0")] for row in rows], dtype=np.uint8)


def test_shapes_are_8_connected_and_separate_labels():
    shapes = label_shapes("hill", image("1..2", ".1.2", "..13", "1..."))
    found = [(shape.label, shape.area, shape.id) for shape in shapes]
    assert found == [(1, 3, 0), (2, 2, 3), (3, 1, 11), (1, 1, 12)]
    picture = np.zeros((32, 40), np.uint8)
    picture[20, 30] = 5
    (shape,) = label_shapes("hill", picture)
    assert shape.depth.tolist() == [[0.5]]  # a lone pixel is half a pixel deep
    assert shape.centre == (20.0, 30.0)
    assert (shape.label, shape.id, shape.image_width) == (5, 20 * 40 + 30, 40)


def test_depth_is_measured_to_all_borders_except_the_sketch_edge():
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


def test_regions_equal_connected_components():
    for share, size in itertools.product((0.0, 0.1, 0.4, 0.7, 1.0), ((1, 1), (1, 23), (23, 1), (17, 24))):
        rng = np.random.default_rng(7)
        for _ in range(10):
            image = (rng.integers(1, 4, size) * (rng.random(size) < share)).astype(np.uint8)
            expected = []
            for value in (1, 2, 3):
                numbers, count = ndimage.label(image == value, structure=np.ones((3, 3)))
                masks = [numbers == k for k in range(1, count + 1)]
                expected += [(int(np.argmax(mask)), value, mask) for mask in masks]
            expected.sort(key=lambda each: each[0])
            for region, (_, label, mask) in zip(find_regions(image), expected, strict=True):
                whole = np.zeros(image.shape, np.bool_)
                whole[region.rows, region.columns] = region.mask
                assert region.label == label
                np.testing.assert_array_equal(whole, mask)
                assert region.mask.any(axis=1)[[0, -1]].all()
                assert region.mask.any(axis=0)[[0, -1]].all()
    assert label_shapes("hill", np.zeros((8, 8), np.uint8)) == ()


SIDE = 64


def painted(layer, image, *, fidelity=1.0, **label):
    blank = load_sketch("valley_river")
    layers = {name: np.zeros((SIDE, SIDE), np.uint8) for name in blank.layers} | {layer: image}
    labels = {(layer, 1): label} if label else {}
    return blank.replace(layers=layers, extent=SIDE * 10.0, fidelity=fidelity, labels=labels)


def disc(row, column, radius, side=SIDE):
    rows, columns = np.indices((side, side))
    return (np.hypot(rows - row, columns - column) < radius).astype(np.uint8)


def field_of(image, *, fidelity):
    (shape,) = label_shapes("lake", image)
    return shape_field(painted("lake", image, fidelity=fidelity), shape, margin=50.0)


def test_shape_fields_are_distances_that_preserve_area_and_extend_beyond_the_edge():
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


def test_shapes_continue_beyond_the_edge_to_an_uneven_end():
    field = field_of(np.ones((SIDE, SIDE), np.uint8), fidelity=1.0)
    rows, columns = np.nonzero(field.inside > 0)
    overhang = EDGE_OVERHANG * SIDE * 10.0
    for across, along, first in (
        (columns, rows, (field.west, field.south)),
        (rows, columns, (field.south, field.west)),
    ):
        at = first[1] + along * field.spacing
        beside = (at > 0.0) & (at < SIDE * 10.0)
        low = [-(first[0] + across[beside & (along == k)].min() * 10.0) for k in np.unique(along[beside])]
        assert 0.6 * overhang - 15.0 < min(low) < 0.85 * overhang < 1.1 * overhang < max(low)
        assert max(low) < 1.4 * overhang
        assert np.abs(np.diff(low)).max() <= 20.0


def test_covers_have_the_material_and_strength_of_their_label():
    image = np.zeros((SIDE, SIDE), np.uint8)
    image[5, 5] = image[50:60, 20:40] = 1
    image[0, 0] = 2
    covers = create_covers(painted("material", image, material="sand", strength=0.7))
    assert [(cover.label, cover.material, cover.strength) for cover in covers] == [
        (2, MATERIALS.index("rock"), 1.0),
        (1, MATERIALS.index("sand"), 0.7),
        (1, MATERIALS.index("sand"), 0.7),
    ]
    assert len({cover.id for cover in covers}) == 3
    assert create_covers(painted("material", disc(9, 9, 4), strength=0.0)) == ()


ROW, COLUMN = np.mgrid[:160, :240]


def blob():
    angle = np.arctan2(ROW - 80, COLUMN - 110)
    return (np.hypot(ROW - 80, COLUMN - 110) < 45 + 8 * np.sin(3 * angle)).astype(np.uint8)


def stroke():
    middle = 80 + 30 * np.sin(COLUMN / 40)
    return ((np.abs(ROW - middle) < 9) & (COLUMN > 10) & (COLUMN < 230)).astype(np.uint8)


def ring():
    distance = np.hypot(ROW - 80, COLUMN - 110)
    return ((distance > 45) & (distance < 60)).astype(np.uint8)


def broken_up(picture, layer="hill", **settings):
    settings = {"multitude": 1, "fidelity": 1.0, "seed": 7} | settings
    (shape,) = label_shapes(layer, picture)
    return user_features(shape, **settings)


def covered(features, picture):
    union = np.zeros(picture.shape, bool)
    for feature in features:
        distance = np.hypot(ROW - feature["row"], COLUMN - feature["column"])
        union |= distance < feature["disc"] + 0.5
    return float(union[picture > 0].mean())


def test_discs_cover_the_shape_by_fidelity_and_stay_inside():
    for picture in (blob(), stroke(), ring()):
        for multitude in (1, 6):
            features = broken_up(picture, multitude=multitude)
            assert covered(features, picture) > 0.99
            assert len(features) < 130

    loose, near, exact = (broken_up(stroke(), fidelity=fidelity) for fidelity in (0.0, 0.8, 1.0))
    assert len(loose) < len(near) < len(exact)
    assert 0.6 <= covered(loose, stroke()) < covered(exact, stroke())
    assert covered(near, stroke()) > 0.85

    (shape,) = label_shapes("hill", blob())
    features = user_features(shape, multitude=4, fidelity=1.0, seed=1)
    depth = np.zeros(blob().shape)
    depth[shape.rows, shape.columns] = shape.depth
    assert np.all(features["disc"] <= np.maximum(depth[features["row"], features["column"]], 1.0))


def test_multitude_is_the_number_of_summits_and_one_summit_makes_a_ridge():
    for multitude in (1, 2, 5, 12):
        assert broken_up(blob(), multitude=multitude)["summit"].sum() == multitude
    features = broken_up(blob(), multitude=8)
    summits = features[features["summit"]]
    row, column = summits["row"].astype(float), summits["column"].astype(float)
    distance = np.hypot(row[:, None] - row, column[:, None] - column) + 1e9 * np.eye(len(summits))
    assert distance.min() >= 0.9 * mean_size(int(blob().sum()), 8)

    features = broken_up(stroke(), "mountain", multitude=1)
    support = features[~features["summit"]]
    assert features["summit"].sum() == 1
    assert features["share"][features["summit"]] == 1.0
    assert support["share"].max() <= 0.85
    assert support["column"].min() < 30
    assert support["column"].max() > 210


def test_features_depend_on_the_seed_and_a_dab_keeps_most_summits():
    first = broken_up(blob(), multitude=5)
    np.testing.assert_array_equal(first, broken_up(blob(), multitude=5))
    assert not np.array_equal(first["id"][:5], broken_up(blob(), multitude=5, seed=8)["id"][:5])

    picture = blob()
    dabbed = picture | (np.hypot(ROW - 80, COLUMN - 158) < 4).astype(np.uint8)
    before, after = (broken_up(each, multitude=8) for each in (picture, dabbed))
    unchanged = np.isin(before["id"][before["summit"]], after["id"][after["summit"]])
    assert unchanged.mean() >= 0.5


def spot(row, column, radius):
    return disc(row, column, radius, side=128)


def sketch(fidelity=0.8, **layers):
    return Sketch(extent=1280.0, fidelity=fidelity, layers=layers or {"hill": np.zeros((128, 128), np.uint8)})


def test_features_have_the_strength_and_properties_of_their_labels():
    painted = sketch(0.8, mountain=spot(60, 60, 30))
    high = painted.replace(labels={("mountain", 1): {"height": 250.0}})
    assert place(high, seed=1)["strength"].max() == 250.0

    labels = {
        ("dune", 2): {"height": 9.0, "wavelength": 77.0, "wind": 30.0},
        ("mountain", 1): {"peakiness": 0.9},
    }
    layers = {"dune": 2 * spot(30, 30, 20), "mountain": spot(90, 90, 20), "forest": spot(20, 100, 10)}
    placed = place(sketch(0.8, **layers).replace(labels=labels), seed=1)
    dunes, mountains, forests = (placed[placed["type"] == code] for code in (2, 0, 3))
    assert set(dunes["wavelength"]) == {77.0}
    assert set(dunes["wind"]) == {30.0}
    np.testing.assert_array_equal(mountains["peakiness"], np.float32(0.9))
    assert np.all((forests["strength"] > 0.5) & (forests["strength"] <= 1.0))


def test_distant_paint_changes_nothing_and_mountains_avoid_rivers():
    before = place(sketch(0.5, hill=spot(30, 30, 15)), seed=1)
    painted = spot(30, 30, 15) | 2 * spot(100, 100, 20)
    after = place(sketch(0.5, hill=painted, mountain=spot(100, 60, 12)), seed=1)
    np.testing.assert_array_equal(after[np.isin(after["id"], before["id"])], before)

    river = np.tile((np.abs(np.arange(128) - 60) < 2).astype(np.uint8), (128, 1))
    mountain = spot(64, 64, 30)
    alone = place(sketch(0.0, mountain=mountain), seed=1)
    shy = place(sketch(0.0, mountain=mountain, river=river), seed=1)
    assert np.abs(shy["x"] - 605).mean() > np.abs(alone["x"] - 605).mean()
