"""Topographic maps against their terrain."""

import io
import itertools
from contextlib import contextmanager
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely
from PIL import Image

import sketchterrain as st
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.errors import InputError
from sketchterrain.export.map import relief
from sketchterrain.export.map.drawing import LabelSpace, MapSheet, MapText, Polygons, Polylines, sheet_png
from sketchterrain.export.map.features import (
    BANK,
    INDEX,
    PENS,
    WATER,
    WIDTHS,
    choose_interval,
    contour_rings,
    prominences,
    trace_contours,
)
from sketchterrain.export.map.relief import (
    SCALES,
    MapFrame,
    MapSamples,
    fit_frame,
    nearest_round,
    sample_map,
    shaded_relief,
)
from sketchterrain.export.map.sheet import map_sheet, with_rasters, write_map, write_sheet
from sketchterrain.measure.adherence_rivers import standing_water
from sketchterrain.schema.materials import BUILT_IN

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def terrain():
    """A mountain, a river from the west, a lake and a wood, on a sketch wider than high."""
    mountain, river, forest, lake = (np.zeros((48, 64), np.uint8) for _ in range(4))
    mountain[4:18, 44:60] = 1
    river[24:27, :34] = 1
    forest[34:46, 6:26] = 1
    lake[33:42, 40:52] = 1
    layers = {"mountain": mountain, "river": river, "forest": forest, "lake": lake}
    labels = {("mountain", 1): {"height": 250.0}, ("river", 1): {"width": 15.0}}
    given = {"ground": {"relief": 10.0}, "density": {"hill": 1.2}, "layers": layers, "labels": labels}
    return st.build(st.Sketch(name="A & <B>", extent=2048.0, seed=5, **given))


@contextmanager
def half_size():
    """Let maps be at most 137.5 mm wide."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(relief, "MAX_SIDE", 0.5 * relief.MAX_SIDE)
        yield


@pytest.fixture(scope="module")
def ground(terrain):
    with half_size():
        return sample_map(terrain, fit_frame(terrain.size))


@pytest.fixture(scope="module")
def sheet(terrain):
    with half_size():
        return map_sheet(terrain)


def labels(sheet, *layers):
    names = layers or tuple(sheet.layers)
    return [shape for name in names for shape in sheet.layers[name] if isinstance(shape, MapText)]


def paths(sheet, layer, kind):
    return [shape for shape in sheet.layers[layer] if isinstance(shape, kind)]


def metres(frame, path):
    x = (path[:, 0] - frame.left) / frame.mm_per_metre
    return np.stack([x, frame.north - (path[:, 1] - frame.top) / frame.mm_per_metre], axis=-1)


def strays(terrain, ground, points, level, radius):
    """Return the points (m) without ground at their level (m) within a distance (mm of the sheet)."""
    for count in (8, 64):  # directions
        angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        circle = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(angle), np.sin(angle)], axis=-1)])
        near = np.clip(points[:, None] + radius / ground.frame.mm_per_metre * circle, 0.0, terrain.size)
        heights = terrain.heights(near[..., 0], near[..., 1], cell_size=ground.cell_size)
        off = (heights.min(axis=1) > level) | (heights.max(axis=1) < level)
        points, level = points[off], level[off]
    return points


def level_ground(height, scale=5000.0):
    """Return dry grassland of some heights (m) over a square of 1000 m."""
    height = np.asarray(height, np.float32)
    spacing = 1000.0 / (len(height) - 1)
    cover = np.eye(1, len(BUILT_IN), dtype=np.float32) * np.ones((*height.shape, 1), np.float32)
    frame = MapFrame(10.0, 20.0, 1000.0, 1000.0, scale)
    dry = np.full(height.shape, -1.0, np.float32)
    return MapSamples(frame, (spacing, spacing), height, height, spacing, dry, dry, cover, BUILT_IN)


def places(side=201):
    x = np.linspace(0.0, 1000.0, side)
    return x[None, :], x[::-1, None]


def test_map_frame_has_a_round_scale_and_north_up():
    for size in ((6144.0, 6144.0), (16384.0, 8192.0), (1.0, 1.0), (200.0, 1e6), (1e6, 17.0)):
        fitted = fit_frame(size)
        assert 180.0 < max(fitted.box[2:]) <= 275.0 + 1e-6
        assert 2.0 * fitted.left + fitted.box[2] >= 160.0
        assert fitted.scale / 10 ** np.floor(np.log10(fitted.scale)) in SCALES
    frame = fit_frame((4096.0, 3072.0))
    left, top, width, height = frame.box
    corners = frame.to_sheet([[0.0, 0.0], [4096.0, 0.0], [0.0, 3072.0]])
    expected = [[left, top + height], [left + width, top + height], [left, top]]
    assert corners == pytest.approx(np.array(expected))
    assert width * frame.scale == pytest.approx(4096.0 * 1000.0)
    for number, nearest, above in [(1.0, 1, 1), (1.3, 1, 2), (3.3, 5, 5), (0.07, 0.05, 0.1)]:
        assert nearest_round(number) == pytest.approx(nearest), number
        assert nearest_round(number, up=True) == pytest.approx(above), number


def test_contours_follow_their_height(terrain, ground):
    interval = choose_interval(ground)
    contours = trace_contours(ground, interval)
    levels = np.unique([contour.height for contour in contours])
    assert interval == 5.0
    assert (levels % interval == 0.0).all()
    assert ground.smooth.min() < levels[0] <= ground.smooth.min() + interval
    assert ground.smooth.max() - 2.0 * interval <= levels[-1] < ground.smooth.max()  # small ones are left out
    for contour in contours:
        assert contour.index == (round(contour.height / interval) % INDEX == 0)
        # Closed, or from border to border.
        ends = contour.points[[0, -1]]
        on_border = np.isclose(ends, 0.0) | np.isclose(ends, terrain.size)
        assert (ends[0] == ends[1]).all() or on_border.any(axis=1).all()
    points = np.concatenate([contour.points for contour in contours])
    level = np.concatenate([np.full(len(contour.points), contour.height) for contour in contours])
    # No more than a tenth of a millimetre off on the sheet, but for notches; in the median nearly not at all.
    far = strays(terrain, ground, points, level, 0.1)
    assert len(far) <= 2e-5 * len(points)
    assert not len(strays(terrain, ground, points, level, 0.15))
    height = terrain.heights(*points.T, cell_size=ground.cell_size)
    assert np.median(np.abs(height - level)) < 0.01 * interval

    x, y = places()
    for contour in trace_contours(level_ground(200.0 - 0.4 * np.hypot(x - 500.0, y - 500.0)), 20.0):
        radius = np.hypot(*(contour.points - 500.0).T)
        assert radius == pytest.approx((200.0 - contour.height) / 0.4, abs=1.0)
    for slope, scale, expected in ((0.9, 25e3, 20.0), (0.1, 25e3, 2.0), (0.9, 100e3, 50.0), (0.0, 5e3, 0.1)):
        # 20 m is what Alpine maps of 1 : 25 000 have.
        assert choose_interval(level_ground(slope * x + 0.0 * y, scale)) == expected


def test_drawn_contours_follow_their_height_and_avoid_lakes_and_labels(terrain, ground, sheet):
    interval = choose_interval(ground)
    lines = paths(sheet, "contours", Polylines)
    assert {line.colour for line in lines} <= set(PENS.values())
    assert {line.width for line in lines} == set(WIDTHS.values())
    visible = [path for line in lines for path in line.paths]
    text = shapely.union_all(
        [label.outline(margin=0.0) for label in labels(sheet, "labels") if not label.halo]
    )
    assert not shapely.intersects(text, shapely.MultiLineString(visible))
    courses = [metres(ground.frame, path) for path in visible]
    points, ends = np.concatenate(courses), np.cumsum([len(path) for path in courses])[:-1]
    height = terrain.heights(*points.T, cell_size=ground.cell_size)
    own = np.array([float(np.median(part)) for part in np.split(height, ends)])
    level = np.repeat(interval * np.rint(own / interval), [len(path) for path in courses])
    assert not len(strays(terrain, ground, points, level, 0.15))
    middle = np.array([len(path) // 2 for path in courses]) + np.concatenate([[0], ends])
    assert not standing_water(terrain.recipe, "lake", *points[middle].T, height[middle]).any()


def test_rivers_and_lakes_are_drawn_at_their_positions(terrain, ground, sheet):
    rivers = [line for line in paths(sheet, "rivers", Polylines) if line.colour in (BANK, WATER)]
    along = np.linspace(0.0, 1.0, 400)[:, None]
    pieces = [pair for line in rivers for path in line.paths for pair in itertools.pairwise(path)]
    points = np.concatenate([start + along * (end - start) for start, end in pieces])
    river = max(terrain.features.rivers, key=lambda each: len(each.centreline))
    inside = ((river.centreline[:, :2] > 0.0) & (river.centreline[:, :2] < terrain.size)).all(axis=1)
    x, y = river.centreline[inside, :2].T
    dry = ~standing_water(terrain.recipe, "lake", x, y, terrain.heights(x, y))
    for place in ground.frame.to_sheet(river.centreline[inside][dry])[::7]:
        assert np.hypot(*(points - place).T).min() < 0.15  # mm
    widest = max(float(each.centreline_width.max()) for each in terrain.features.rivers)
    widest *= ground.frame.mm_per_metre
    assert max(line.width for line in rivers) == pytest.approx(widest, abs=0.6)

    shore = paths(sheet, "lakes", Polygons)[0].paths
    lake = terrain.features.lakes[0]
    for ring in shore:
        assert (ring[0] == ring[-1]).all()
        height = terrain.heights(*metres(ground.frame, ring).T)
        assert np.median(np.abs(height - lake.level)) < 1.5
    assert f"{lake.level:.0f}" in [label.text for label in labels(sheet, "labels")]


def test_labels_neither_overlap_nor_are_clipped(terrain, ground, sheet):
    left, top, width, height = ground.frame.box
    on_map = [label.outline(margin=0.0) for label in labels(sheet, "labels")]
    everywhere = [label.outline(margin=0.0) for label in labels(sheet)]
    assert len(on_map) > 10
    for page, outlines in (
        (shapely.box(left, top, left + width, top + height), on_map),
        (shapely.box(0.0, 0.0, sheet.width, sheet.height), everywhere),
    ):
        assert all(page.contains(outline) for outline in outlines)
        assert not any(a.intersects(b) for a, b in itertools.combinations(outlines, 2))

    peaks = [int(label.text) for label in labels(sheet, "labels") if label.halo]
    x, y = np.linspace(0.0, terrain.size[0], 700), np.linspace(0.0, terrain.size[1], 500)
    assert max(peaks) == pytest.approx(float(terrain.heights(x[None], y[:, None]).max()), abs=6.0)


def test_map_files_have_the_requested_size_vectors_and_text(sheet, tmp_path):
    (svg,) = write_sheet(tmp_path / "a.svg", sheet)
    root = ET.fromstring(svg.read_text())  # noqa: S314 - written here
    assert svg.stat().st_size < 4_000_000
    assert root.get("width") == f"{sheet.width:.2f}mm"
    assert len(list(root.iter(f"{SVG}image"))) == 1
    assert [each.text for each in root.iter(f"{SVG}text")] == [label.text for label in labels(sheet)]
    assert [each.get("id") for each in root.findall(f"{SVG}g")] == list(sheet.layers)

    (png,) = write_sheet(tmp_path / "a.png", sheet, size=(500, 5000))
    picture = np.asarray(Image.open(png).convert("RGB")).astype(int)
    assert picture.shape[1] == 500
    assert picture.shape[0] == pytest.approx(500 * sheet.height / sheet.width, abs=1)
    lake = paths(sheet, "lakes", Polygons)[0].paths[0]
    column, row = (lake.mean(axis=0) * 500 / sheet.width + [4, 4]).astype(int)
    assert picture[row, column, 2] > picture[row, column, 0] + 20  # blue


@pytest.mark.slow
def test_maps_are_deterministic(terrain, sheet, tmp_path):
    for suffix in ("png", "svg"):
        (first,) = write_sheet(tmp_path / f"a.{suffix}", sheet, size=(500, 5000))
        with half_size():
            (second,) = write_map(tmp_path / f"b.{suffix}", terrain, size=(500, 5000))
        assert first.read_bytes() == second.read_bytes()
    with pytest.raises(InputError, match=r"a \.png or \.svg file for a map, got 'a\.pdf'"):
        write_map(tmp_path / "a.pdf", terrain)


def test_relief_covers_the_frame(ground, sheet):
    (relief,) = sheet.layers["relief"]
    left, _, width, _ = relief.box
    columns = relief.pixels.shape[1]
    # The first and the last sample lie on the map's borders: half a pixel within.
    assert left + 0.5 * width / columns == pytest.approx(ground.frame.left)
    assert width * (columns - 1) / columns == pytest.approx(ground.frame.box[2])


def test_prominence_is_the_descent_towards_a_higher_summit():
    found = prominences(np.array([[0.0, 5.0, 2.0, 9.0, 4.0, 7.0, 1.0]]))
    assert [(p, c) for p, _, c in found] == [(9.0, 3), (3.0, 1), (3.0, 5)]


def test_label_space_is_reserved_once_and_only_on_the_map():
    space = LabelSpace((0.0, 0.0, 100.0, 50.0))
    text = MapText("123", 50.0, 25.0, 2.0, (0, 0, 0), "middle", 30.0)
    outline = text.outline(margin=0.0)
    assert outline.centroid.coords[0] == pytest.approx((50.0, 25.0))
    assert outline.length == pytest.approx(2 * (text.width + 0.72 * text.size))
    assert (outline.bounds[3] - outline.bounds[1]) > 0.5 * text.width  # it is turned
    for dx, free in ((0.0, True), (0.0, False), (10.0, True), (49.0, False)):
        assert space.reserve(shapely.affinity.translate(outline, dx)) == free
    assert MapText("123123", 0, 0, 2.0, (0, 0, 0)).width == pytest.approx(2.0 * text.width, rel=0.1)


def test_contour_rings_close_at_the_border():
    x, y = places()
    depth = (100.0 - np.hypot(x, y - 500.0)).astype(np.float32)  # half a disc at the western border
    ((ring,),) = contour_rings(depth, [0.0], level_ground(0.0 * depth))
    assert shapely.Polygon(ring).area == pytest.approx(0.5 * np.pi * 20.0**2, rel=0.05)


def test_north_western_slopes_are_lighter_and_flat_terrain_is_even():
    x, y = places(101)
    flat = shaded_relief(level_ground(0.0 * x + 0.0 * y)).astype(int)
    assert np.ptp(flat.reshape(-1, 3), axis=0).max() == 0
    cone = shaded_relief(level_ground(200.0 - 0.4 * np.hypot(x - 500.0, y - 500.0))).astype(int).sum(axis=-1)
    assert cone[25, 25] > cone[75, 75] + 60


def test_shapes_are_rendered_at_their_positions():
    ring = np.array([[2.0, 2.0], [8.0, 2.0], [8.0, 8.0], [2.0, 8.0]])
    hole = 0.5 * (ring - 5.0) + 5.0
    layers = {
        "areas": [
            Polygons([ring, hole], (200, 0, 0)),
            Polygons([ring + np.array([10.0, 0.0])], (0, 0, 0), 0.5),
        ],
        "lines": [Polylines([np.array([[0.0, 15.0], [10.0, 15.0]])], (0, 0, 0), 2.0)],
        "text": [MapText("III", 15.0, 13.0, 4.0, (0, 0, 0), "start", 90.0, halo=(0, 0, 255))],
    }
    png = io.BytesIO(sheet_png(MapSheet("x", 20.0, 20.0, layers), width=200))
    picture = np.asarray(Image.open(png).convert("RGB")).astype(int)
    paper = picture[0, 0].tolist()
    assert picture.shape == (200, 200, 3)
    assert picture[30, 30].tolist() == [200, 0, 0]
    assert picture[50, 50].tolist() == paper  # the hole
    assert picture[50, 150] == pytest.approx([126, 126, 124], abs=2)
    assert picture[150, 50].tolist() == [0, 0, 0]
    assert (picture[:, 50, 0] < 128).sum() == pytest.approx(20, abs=1)  # 2 mm
    # Text that is turned by 90° goes down from its anchor, in a halo.
    text = picture[110:, 120:]
    rows, columns = np.nonzero(text.sum(axis=-1) < 100)
    assert 20 <= rows.mean() < 70
    assert abs(columns.mean() - 30) < 4
    halo = (text[..., 2] > 200) & (text[..., 0] < 60)
    assert halo.sum() > 100


class Gradient:
    """A raster whose red grows eastward and green northward, by the metre, at half opacity."""

    layers = (DrapedLayer("a.tif", {"opacity": 0.5}),)

    def rasters(self, _):
        return [(0, self)]

    def pixels(self, west, north, texel, columns, rows):
        x, y = west + (np.arange(columns) + 0.5) * texel, north - (np.arange(rows) + 0.5) * texel
        red, green = np.meshgrid(0.05 * x, 0.05 * y)
        pixels = np.stack([red, green, 0.0 * red, 255.0 + 0.0 * red], axis=-1)
        return np.rint(np.clip(pixels, 0.0, 255.0)).astype(np.uint8)


def test_rasters_are_at_their_place_on_the_relief(ground):
    rows, columns = ground.height.shape
    bare = np.full((rows, columns, 3), 100, np.uint8)
    found = with_rasters(bare, Gradient(), ground).astype(float)
    x, y = np.arange(columns) * ground.spacing[0], np.arange(rows)[::-1] * ground.spacing[1]
    red, green = np.meshgrid(np.minimum(0.05 * x, 255.0), np.minimum(0.05 * y, 255.0))
    assert np.abs(found[..., 0] - 50.0 - 0.5 * red).max() < 0.05 * max(ground.spacing) + 1.0
    assert np.abs(found[..., 1] - 50.0 - 0.5 * green).max() < 0.05 * max(ground.spacing) + 1.0
    assert (found[..., 2] == 50.0).all()
    assert np.array_equal(with_rasters(bare, None, ground), bare)
