"""Draped layers in appearance tiles: exact coverage, borders, dashes, blending, against shapely and NumPy."""

import warnings
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pyogrio.raw
import pytest
import shapely

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.drape.drapes import Drapes, LayerStyle
from sketchterrain.export.sampled import SampleGrid, sample_appearance
from sketchterrain.features.items import AFTER, BEFORE, ENDS, FILL, POINT, STARTS, STROKE, Items
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.offscreen import canvas, read_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun
from sketchterrain.schema.colours import linear_from_hex
from sketchterrain.terrain.appearance import SIDE, TEXEL_PIXELS, WHITE, Appearance
from sketchterrain.terrain.orthophotos import Orthophoto
from sketchterrain.terrain.painted_land import PaintedLand
from tests import terrains
from tests.devices import DEVICES, needs_device

pytestmark = needs_device

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
    land = below or PaintedLand.bare(EXTENT, ComputeContext(DEVICES[0], real=real))
    return Appearance(land).with_drapes(FakeDrapes(layers, parts))


@lru_cache(maxsize=4)
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


KEY = (2, 1, 1)  # 190 texels of 2.5 m from (475, 475) on
BUFFER = {"butt": "flat", "round": "round", "square": "square"}


def wiggle(seed, count=30, step=60.0):
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.normal(0.0, 0.5, count)) + rng.uniform(0.0, 6.0)
    points = np.cumsum(np.stack([np.cos(angle), np.sin(angle)], axis=1) * step, axis=0)
    return points - points.mean(axis=0) + 712.0


def shares(paint, key=KEY):
    return paint.tiles([key])[0, ..., 3] / 255.0


def test_shares_of_areas_are_exact():
    """Of a star with a hole, at every level, in tiles inside, cut and touched, in floats and doubles."""
    shape = shapely.difference(star(1, (960.0, 940.0), 800.0), star(2, (960.0, 940.0), 90.0))
    items = items_of(*rings(1, shape))
    reals = ("float", "double")[: 1 + DEVICES[0].has_double]
    paints = [painted(items, fill="#ffffff", colour="", real=real) for real in reals]
    for key in ((0, 0, 0), (-1, 0, 0), (1, 0, 1), (4, 7, 8), (6, 33, 32)):
        true = exact(shape, key)
        for real, paint in zip(reals, paints, strict=True):
            assert np.abs(shares(paint, key) - true).max() < 1.2 / 255.0, (real, key)


def test_areas_of_a_layer_that_share_borders_leave_nothing_between_them():
    points = shapely.MultiPoint(np.random.default_rng(4).uniform(0.0, 1900.0, (300, 2)))
    square = shapely.box(0.0, 0.0, 1900.0, 1900.0)
    cells = shapely.get_parts(shapely.voronoi_polygons(points, extend_to=square))
    cells = shapely.intersection(cells, square)
    items = items_of(*(part for number, cell in enumerate(cells) for part in rings(number, cell)))
    for opacity in (1.0, 0.5):
        paint = painted(items, fill="#ffffff", colour="", fill_opacity=opacity)
        for key in (KEY, (0, 0, 0), (4, 7, 8)):
            inside = shares(paint, key)[2:-2, 2:-2]
            assert np.abs(inside - opacity).max() < 1.1 / 255.0


def test_shares_of_lines_are_those_of_their_buffers():
    """In all widths, caps and joins: ± 0.02 in 99 % of texels, more only inside of sharp corners."""
    for cap, join in (("butt", "bevel"), ("round", "round"), ("square", "mitre")):
        for seed, width in enumerate((0.5, 7.5, 60.0)):
            points = wiggle(seed)
            shape = shapely.LineString(points).buffer(
                0.5 * width, cap_style=BUFFER[cap], join_style=join, mitre_limit=4.0, quad_segs=32
            )
            paint = painted(items_of((STROKE, 1, points)), width=width, cap=cap, join=join)
            found, true = shares(paint), exact(shape, KEY)
            error = np.abs(found - true)[(found > 0) | (true > 0)]
            assert np.quantile(error, 0.99) < 0.02, (cap, join, width)
            assert error.max() < 0.25, (cap, join, width)
            assert found.sum() == pytest.approx(true.sum(), rel=0.005), (cap, join, width)


def test_lines_thinner_than_a_texel_keep_their_share():
    rng = np.random.default_rng(6)
    for width in (0.05, 0.2, 1.0):  # of texels
        for angle in rng.uniform(0.0, np.pi, 6):
            away = 400.0 * np.array([np.cos(angle), np.sin(angle)])
            middle = rng.uniform(700.0, 720.0, 2)
            # Many lines beside each other, as a share of 0.05 texels is 13/255.
            paint = painted(items_of((STROKE, 1, [middle - away, middle + away])), width=2.5 * width)
            whole = shares(paint)[1:-1, 1:-1].sum()
            line = shapely.LineString([middle - away, middle + away])
            length = line.intersection(shapely.box(475.0, 475.0, 950.0, 950.0)).length / 2.5
            assert whole == pytest.approx(width * length, rel=0.05 if width > 0.1 else 0.1)


def test_floats_are_as_good_as_doubles():
    if not DEVICES[0].has_double:
        pytest.skip("no 64-bit floats")
    items = items_of(
        *rings(1, star(3, (700.0, 700.0), 250.0)),
        (STROKE, 2, wiggle(3)),
        (STROKE, 3, [(-4e6, 0), (4e6, 1400)]),
    )
    style = {"fill": "#40c057", "hatch": "cross", "hatch_spacing": 22.0, "width": 9.0, "dash": "30 12 5 12"}
    one, other = (
        painted(items, real=real, **style).tiles([KEY, (7, 47, 47)]) for real in ("float", "double")
    )
    assert other[..., 3].any(axis=(1, 2)).all()
    one, other = (each * (each[..., 3:] / 255.0) for each in (one, other))  # of no share any colour will do
    assert np.abs(one - other).max() <= 2.0


def test_neighbouring_tiles_share_texels():
    items = items_of(
        *rings(1, star(3, (950.0, 950.0), 700.0)),
        (STROKE, 2, wiggle(3) + 238.0),
        (POINT, 3, [(950.0, 930.0)]),
    )
    style = {"fill": "#40c057", "hatch": "lines", "hatch_spacing": 31.0, "width": 12.0, "dash": "30 12 5"}
    paint = painted(items, cap="round", **style)
    for level in (1, 3, 5):
        at = 2 ** (level - 1)
        here, east, north = paint.tiles([(level, at - 1, at - 1), (level, at, at - 1), (level, at - 1, at)])
        assert here[..., 3].any()
        for one, other in ((here[:, -2:], east[:, :2]), (here[:2], north[-2:])):
            assert np.abs(one.astype(int) - other).max() <= 1


def test_levels_agree_where_they_meet():
    """Widths in metres are those of the level below; widths in px are twice as wide, as texels are."""
    for unit, ratio in (("m", 1.0), ("px", 2.0)):
        paint = painted(items_of((STROKE, 1, wiggle(2))), width=20.0 if unit == "m" else 5.0, unit=unit)
        found = [shares(paint, key)[1:-1, 1:-1] for key in (KEY, (3, 2, 2), (3, 3, 2), (3, 2, 3), (3, 3, 3))]
        lower = np.concatenate([np.concatenate(found[3:], axis=1), np.concatenate(found[1:3], axis=1)])
        halved = lower.reshape(190, 2, 190, 2).mean(axis=(1, 3))
        if unit == "m":
            assert np.abs(halved - found[0]).max() < 0.12
        assert found[0].sum() == pytest.approx(ratio * halved.sum(), rel=0.03)
    texels = 5.0 / TEXEL_PIXELS
    straight = painted(items_of((STROKE, 1, [(0, 700), (1900, 700)])), width=5.0, unit="px")
    assert shares(straight)[:, 50].sum() == pytest.approx(texels, abs=0.02)


def test_a_thick_line_through_a_corner_is_whole_in_all_tiles():
    """Sun et al. and two-step draping, D2: 200 texels wide, its axis beside two of the four tiles."""
    points = [(475.0 - 600.0, 475.0 + 590.0), (475.0 + 600.0, 475.0 - 610.0)]
    paint = painted(items_of((STROKE, 1, points)), width=500.0)
    shape = shapely.LineString(points).buffer(250.0, cap_style="flat")
    for key in ((2, 0, 0), (2, 1, 0), (2, 0, 1), (2, 1, 1)):
        assert np.abs(shares(paint, key) - exact(shape, key)).max() < 0.01
        assert shares(paint, key).max() == 1.0


def test_a_line_that_crosses_itself_is_blended_once():
    loop = [(500, 600), (900, 600), (900, 800), (700, 800), (700, 500)]
    runs = [
        (STROKE, 1, loop[:4], 0.0, STARTS | AFTER),
        (STROKE, 1, loop[1:], 400.0, ENDS | BEFORE),
    ]
    cut = painted(items_of(*runs), layers=[layer(0, {"opacity": 0.5}, width=30.0, join="mitre")])
    found = cut.tiles([KEY])[0, ..., 3]
    assert set(np.unique(found[found > 120])) <= {127, 128}
    whole = painted(items_of((STROKE, 1, loop)), layers=cut.layers.drapes.layers)
    assert np.array_equal(found, whole.tiles([KEY])[0, ..., 3])
    two = painted(items_of((STROKE, 1, loop), (STROKE, 2, loop)), layers=cut.layers.drapes.layers)
    assert two.tiles([KEY])[0, ..., 3].max() == 191


def test_dashes_have_their_places_in_all_runs_and_tiles():
    """Along a slanted line that is cut into runs: the places of dashes, exact to 1 mm."""
    start, way = np.array([300.0, 650.0]), np.array([0.8, 0.6])
    lengths = (13.0, 7.0, 4.0, 9.0)
    cuts = np.array([0.0, 151.0, 333.3, 500.0])
    runs = [
        (STROKE, 1, start + np.outer(cuts[:3], way), 0.0, STARTS | AFTER),
        (STROKE, 1, start + np.outer(cuts, way), cuts[1], BEFORE | AFTER),
        (STROKE, 1, start + np.outer(cuts[1:], way), cuts[2], ENDS | BEFORE),
    ]
    paint = painted(items_of(*runs), width=20.0, dash="13 7 4 9")
    edges = np.concatenate([[0.0], np.cumsum(np.tile(lengths, 16))])
    dashes = [
        shapely.LineString([start + a * way, start + min(b, 500.0) * way]).buffer(10.0, cap_style="flat")
        for a, b in zip(edges[::2], edges[1::2], strict=False)
        if a < 500.0
    ]
    shape = shapely.union_all(dashes)
    for key in ((3, 2, 3), (3, 1, 3), (4, 5, 7)):
        true, found = exact(shape, key), shares(paint, key)
        assert found.sum() == pytest.approx(true.sum(), rel=0.01)
        assert (
            np.abs(found - true).max() < 0.3
        )  # pulses are averaged over the width of a texel in any direction
        along = [
            (values * (np.arange(SIDE)[None, :] * 0.8 - np.arange(SIDE)[:, None] * 0.6)).sum() / values.sum()
            for values in (found, true)
        ]
        assert along[0] == pytest.approx(along[1], abs=0.05)
    odd, even = (painted(items_of(*runs), width=20.0, dash=dash) for dash in ("9 4 2", "9 4 2 9 4 2"))
    assert np.array_equal(odd.tiles([KEY]), even.tiles([KEY]))
    fine = painted(items_of(*runs), width=20.0, dash="0.06 0.04")
    assert shares(fine, (2, 1, 1)).max() == pytest.approx(0.6, abs=0.01)


def test_caps_of_dashes_and_discs_have_their_areas():
    line = [(500.0, 700.0), (870.0, 700.0)]
    for cap, area in (("butt", 40.0 * 20.0), ("square", 60.0 * 20.0), ("round", 40.0 * 20.0 + np.pi * 100.0)):
        paint = painted(items_of((STROKE, 1, line)), width=20.0, dash="40 60", cap=cap)
        assert 6.25 * shares(paint).sum() == pytest.approx(4.0 * area, rel=0.02), cap
    for width in (0.8, 2.0, 5.0, 40.0):
        paint = painted(items_of((POINT, 1, [(700.3, 701.1)])), width=width)
        assert 6.25 * shares(paint).sum() == pytest.approx(
            np.pi * width**2 / 4.0, rel=0.12 if width < 10 else 0.01
        )
    ringed = painted(items_of((POINT, 1, [(700.0, 700.0)])), width=80.0, colour="#ff0000", fill="#0000ff")
    texels = ringed.tiles([KEY])[0]
    assert texels[100, 91, 2] > 0
    assert texels[100, 91, 0] == 0
    assert (texels[texels[..., 3] > 250][:, [0, 2]] > 0).any(axis=1).all()


def test_hatches_cover_their_share_and_stay_in_place():
    square = rings(1, shapely.box(0.0, 0.0, 1900.0, 1900.0))
    for hatch, share in (("lines", 0.25), ("cross", 1.0 - 0.75**2)):
        for spacing in (40.0, 3.0, 0.4):
            style = {"hatch": hatch, "hatch_spacing": spacing, "width": 0.25 * spacing, "hatch_angle": 30.0}
            paint = painted(items_of(*square), fill="#ffffff", colour="", **style)
            for key in (KEY, (3, 2, 2)):
                assert shares(paint, key).mean() == pytest.approx(share, abs=0.01)
    level = {"hatch": "lines", "hatch_spacing": 50.0, "width": 10.0, "hatch_angle": 0.0}
    found = shares(painted(items_of(*square), fill="#ffffff", colour="", **level))
    rows = 475.0 + (SIDE - 1 - np.arange(SIDE) - 0.5) * 2.5
    on_line = np.abs((rows + 25.0) % 50.0 - 25.0) < 3.0
    assert (found[on_line] == 1.0).all()
    assert not found[np.abs((rows + 25.0) % 50.0 - 25.0) > 7.0].any()


def test_many_translucent_areas_add_up():
    count, opacity = 10_000, 3e-4
    box = list(shapely.box(700.0, 700.0, 760.0, 760.0).exterior.coords)
    items = items_of(*((FILL, number, box) for number in range(count)))
    paint = painted(items, fill="#ffffff", colour="", fill_opacity=opacity)
    found = shares(paint)[exact(shapely.Polygon(box), KEY) == 1.0]
    assert found.size == 24**2
    assert np.abs(found - (1.0 - (1.0 - opacity) ** count)).max() <= 1.0 / 255.0


def ground():
    """Return land of one colour with a share of 100 / 255, and its texel."""
    land = PaintedLand.bare(EXTENT, ComputeContext(DEVICES[0]))
    photo = Orthophoto(np.full((1, 1, 4), (200, 120, 60, 100), np.uint8), (-4000.0, -4000.0, 6000.0, 6000.0))
    land = land.updated(replace(land.recipe, orthophotos=(photo,)), land.heights)
    return land, Appearance(land).tiles([KEY])[0, 90, 90]


class Picture:
    """A raster of one colour."""

    def __init__(self, *pixel):
        self.pixel = pixel

    def pixels(self, west, north, texel, columns, rows):
        return np.full((rows, columns, 4), self.pixel, np.uint8)


FORMULAS = {
    "normal": lambda x, c: 0 * x + c,
    "multiply": lambda x, c: x * c / WHITE,
    "screen": lambda x, c: WHITE * (1.0 - (1.0 - x / WHITE) * (1.0 - c / WHITE)),
    "add": lambda x, c: x + c,
}


def test_blend_modes_and_their_order():
    """Layers of all modes over ground that is painted in part, against NumPy, for any ground."""
    area = items_of(*rings(1, shapely.box(0.0, 0.0, 1900.0, 1900.0)))
    rng, (land, below) = np.random.default_rng(8), ground()
    assert below[3] == 100
    for trial in range(6):
        modes = rng.permutation(["normal", "multiply", "screen", "add"])[: 2 + trial % 3]
        if trial == 0:
            modes = ["normal", "normal"]
        colours = ["#" + rng.integers(0, 200, 3).astype(np.uint8).tobytes().hex() for _ in modes]
        opacities = rng.uniform(0.2, 0.7, len(modes))
        layers = [
            layer(number, {"blend": mode, "opacity": opacity}, fill=colour, colour="")
            for number, (mode, colour, opacity) in enumerate(zip(modes, colours, opacities, strict=True))
        ]
        paint = painted(dict.fromkeys(range(len(modes)), area), layers=layers, below=land)
        texel = paint.tiles([KEY])[0, 90, 90] / 255.0
        assert paint.filters == (trial != 0)
        assert len(texel) == 4 + 4 * paint.filters
        for bare in (0.05, 0.3):
            value = bare + ((below[:3] / 255.0) ** 2 - bare) * (100.0 / 255.0)
            for mode, colour, opacity in zip(modes, colours, opacities, strict=True):
                mixed = FORMULAS[mode](value, WHITE * linear_from_hex(colour))
                value = value + (mixed - value) * opacity
            through = texel[4:7] if paint.filters else 1.0 - texel[3]
            np.testing.assert_allclose(bare * through + texel[:3] ** 2 * texel[3], value, atol=0.006)


def test_rasters_lie_between_layers_of_vectors():
    area = items_of(*rings(1, shapely.box(0.0, 0.0, 1900.0, 1900.0)))
    layers = [layer(0, fill="#ff0000"), DrapedLayer("a.tif", {"opacity": 0.5}), layer(2, fill="#0000ff")]
    context = ComputeContext(DEVICES[0])
    for order, expected in (((0, 1), [0.4 + 0.275, 0.275, 0.275]), ((1, 2), [0.0, 0.0, 0.8])):
        chosen = [layers[number] for number in order]
        vectors = {place: area for place, number in enumerate(order) if number != 1}
        drapes = FakeDrapes(chosen, vectors, {order.index(1): Picture(255, 255, 255, 255)})
        paint = Appearance(PaintedLand.bare(EXTENT, context)).with_drapes(drapes)
        texel = paint.tiles([KEY])[0, 90, 90] / 255.0
        np.testing.assert_allclose(texel[:3] ** 2 * texel[3], expected, atol=0.005)
    clear, bare = FakeDrapes(layers[1:2], {}, {0: Picture(9, 9, 9, 0)}), Appearance(ground()[0])
    assert np.array_equal(bare.with_drapes(clear).tiles([KEY]), bare.tiles([KEY]))


def test_a_new_style_asks_for_no_feature():
    """Of colours, opacities, order, blending and visibility: what is listed is kept."""
    below, _ = ground()
    parts = {0: items_of((STROKE, 1, wiggle(1))), 1: items_of((STROKE, 1, wiggle(2)))}
    layers = [layer(0, width=9.0), layer(1, width=12.0, colour="#00ff00")]
    paint = painted(parts, layers=layers, below=below)
    before = paint.tiles([KEY])
    turned = {0: parts[1], 1: parts[0]}
    hidden = replace(layers[0], values={**layers[0].values, "visible": 0})
    for other, own in (
        ([layers[0].replace(colour="#123456", dash="9 9"), layers[1].replace(opacity=0.4)], parts),
        (layers[::-1], turned),
        ([hidden, layers[1].replace(blend="multiply")], parts),
    ):
        drapes = FakeDrapes(other, own)
        found = paint.with_drapes(drapes, paint).tiles([KEY])
        assert drapes.asked == 0
        fresh = painted(own, layers=other, below=below).tiles([KEY])
        assert np.array_equal(found, fresh)
        assert found.shape != before.shape or not np.array_equal(found, before)
    wider = FakeDrapes([layers[0].replace(width=30.0), layers[1]], parts)
    assert paint.with_drapes(wider, paint).tiles([KEY]).any()
    assert wider.asked == 1


def test_windows_are_tiles_with_a_pixel_a_texel():
    items = items_of(*rings(1, star(3, (700.0, 700.0), 250.0)), (STROKE, 2, wiggle(3)))
    paint = painted(items, fill="#40c057", width=7.0, below=ground()[0])
    tiles = paint.tiles([KEY, (2, 2, 1)])[:, 1:-1, 1:-1]
    size = {"cell": (2.5, 2.5), "columns": 300, "rows": 100}
    found = paint.window(476.25, 948.75, **size)
    assert found.shape == (100, 300, 4)
    assert np.abs(found.astype(int) - np.concatenate(tiles, axis=1)[:100, :300]).max() <= 1
    layers = [layer(0, {"blend": "multiply"}, fill="#ff0000")]
    filtered = painted(items_of(*rings(1, shapely.box(0, 0, 1900, 1900))), layers=layers)
    texel = filtered.window(476.25, 948.75, **size)[50, 50] / 255.0
    np.testing.assert_allclose(texel[:3] ** 2 * texel[3], [0.2, 0.0, 0.0], atol=0.01)


def test_changes_are_those_of_layers_and_of_the_ground():
    below, _ = ground()
    paint = painted(items_of((STROKE, 1, wiggle(1))), width=10.0, unit="px", below=below)
    bare = Appearance(PaintedLand.bare(EXTENT, below.context))
    assert paint.reach(bare) == pytest.approx(1.0 + 10.0 / TEXEL_PIXELS)
    new = Appearance(bare.land).with_drapes(paint.layers.drapes, paint)
    photo = below.recipe.orthophotos[0].box
    assert new.changed_areas(paint).tolist() == [list(photo), [0.0, 0.0, 1.0, 1.0]]
    assert np.isinf(new.changed_areas(bare)).all()
    assert not paint.is_empty
    assert paint.occupied([KEY]).all()


def test_degenerate_features_are_painted_without_a_trace_of_them():
    """Repeated points, lines of no length, bow-ties, far ends, rings of no area."""
    bow = [(500, 500), (900, 900), (900, 500), (500, 900), (500, 500)]
    items = items_of(
        (STROKE, 1, [(500, 500), (500, 500)]),
        (STROKE, 2, [(600, 600), (600, 600), (700, 600), (700, 600)], 0.0, STARTS | ENDS | BEFORE | AFTER),
        (STROKE, 3, [(-1e9, 700), (1e9, 700)]),
        (FILL, 4, bow),
        (FILL, 5, [(500, 500), (900, 900), (500, 500)]),
    )
    found = painted(items, fill="#ffffff", width=4.0, join="mitre").tiles([KEY, (9, 140, 140)])
    assert (found[0, ..., 3] > 0).any()
    assert shares(painted(items, fill="#ffffff", width=4.0))[100, 40] == 1.0


def write_areas(folder, *shapes):
    """Return layers of one white area each."""
    layers = []
    for number, shape in enumerate(shapes):
        path = folder / f"{number}.gpkg"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a file without a CRS
            columns = [np.zeros(1, np.int64)], ["number"]
            pyogrio.raw.write(path, shapely.to_wkb([shape]), *columns, geometry_type="Polygon", crs=None)
        layers.append(DrapedLayer(str(path), {}, SOLID | {"width": 0.0, "fill": "#ffffff"}))
    return tuple(layers)


def test_the_exported_picture_has_the_draped_layers_of_the_sketch(tmp_path):
    shape = star(1, (512.0, 512.0), 400.0)
    terrain = terrains.plain()
    grid = SampleGrid(112.0, 112.0, 912.0, 912.0, 161, 161)
    assert sample_appearance(terrain, grid) is None
    layers = write_areas(tmp_path, shape)
    terrain = Terrain(terrain.sketch.replace(drapes=layers), terrain.recipe, terrain.context)
    found = sample_appearance(terrain, grid)[..., 3] / 255.0
    x, y = np.meshgrid(np.linspace(112.0, 912.0, 161), np.linspace(912.0, 112.0, 161))
    texels = shapely.box(x - 2.5, y - 2.5, x + 2.5, y + 2.5)
    assert np.abs(found - shapely.area(shapely.intersection(texels, shape)) / 25.0).max() < 0.01


@pytest.mark.slow
@pytest.mark.gl
def test_pictures_show_changed_layers_whatever_way_they_came(tmp_path):
    """Of a filtering layer over another: shown, hidden, restyled; old tiles stay until new ones are drawn."""
    quality = Quality.from_level(
        0.0, without=("clouds", "haze", "grass", "rocks", "detail", "shadows", "trees")
    )
    quality = replace(quality, quads=64, map_texels=128, material_texels=128)
    size = (200, 140)
    camera = Camera((450.0, 100.0, 250.0), (500.0, 450.0, 0.0), near=1.0, far=30_000.0)
    shapes = star(1, (450.0, 450.0), 250.0), shapely.box(475.0, 250.0, 750.0, 650.0)
    layers = write_areas(tmp_path, *shapes)
    layers = [layers[0].replace(fill="#3355ff"), layers[1].replace(fill="#ff8080", blend="multiply")]
    terrain = terrains.plain()
    sketch = terrain.sketch
    drapes = Drapes.open(layers, sketch.frame, sketch.size, sketch.extent)
    assert not drapes.problems

    with canvas(size) as (context, texture, framebuffer):
        renderer = Renderer(context, terrain, sun=Sun(200.0, 60.0), quality=quality)

        def draw(shown, *, whole=True):
            renderer.set_drapes(shown)
            if whole:
                renderer.prepare(camera, size)
            renderer.draw(camera, framebuffer)
            return read_picture(texture).astype(int)

        bare, both = draw(None), draw(drapes)
        appearance = renderer.scenery.appearance
        assert appearance.defines["APPEARANCE_FILTER"] == 1
        assert appearance.nbytes <= (384 * 192**2 * 4 + 2**20) + 2**24
        changed = np.abs(both - bare).max(axis=-1) > 5
        assert 0.05 < changed.mean() < 0.9
        change = both - bare  # where the ground is seen through the filter its red stays, about
        assert ((np.abs(change[..., 0]) < 25) & (change[..., 1] < -10) & (both[..., 2] < 60)).sum() > 200
        recoloured = drapes.updated([layers[0].replace(fill="#ffff00"), layers[1]])
        assert np.array_equal(draw(recoloured, whole=False), both)
        other = draw(recoloured)
        assert np.abs(other - both).max() > 20
        drawn = appearance.drawn
        draw(recoloured)
        assert appearance.drawn == drawn
        one = draw(drapes.updated([layers[0], layers[1].replace(visible=0)]))
        assert appearance.defines["APPEARANCE_FILTER"] == 0
        assert np.abs(one - both).max() > 20
        assert np.array_equal(draw(None), bare)
        assert np.array_equal(draw(recoloured), other)


COLOURS = "#d03030", "#3355ff", "#ffd43b", "#2b8a3e", "#101010", "#f8f8f8", "#ff0000", "#00e5ff"


def lab(colours):
    """Return CIE L*a*b* of sRGB colours (…, 3), 0 … 255, under D65."""
    linear = np.asarray(colours, float) / 255.0
    linear = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
    xyz = linear @ np.array([[0.4124, 0.2126, 0.0193], [0.3576, 0.7152, 0.1192], [0.1805, 0.0722, 0.9505]])
    f = xyz / [0.9505, 1.0, 1.089]
    f = np.where(f > 216 / 24389, np.cbrt(f), (24389 / 27 * f + 16) / 116)
    x, y, z = np.moveaxis(f, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


@pytest.mark.parametrize("sun", [Sun(200.0, 60.0), Sun(250.0, 6.0)])
def test_unlit_colours_are_those_of_the_legend(tmp_path, sun) -> None:
    quality = Quality.from_level(0.0, without=("clouds", "grass", "rocks", "detail", "shadows", "trees"))
    quality = replace(quality, quads=64, map_texels=128, material_texels=128)
    size, terrain = (160, 80), terrains.plain()
    sketch = terrain.sketch
    side = sketch.size[0] / len(COLOURS)
    strips = [shapely.box(k * side, 0.0, (k + 1) * side, sketch.size[1]) for k in range(len(COLOURS))]
    layers = [
        each.replace(fill=fill, unlit=1)
        for each, fill in zip(write_areas(tmp_path, *strips), COLOURS, strict=True)
    ]
    middle = 0.5 * sketch.size[0]
    camera = Camera((middle, -1500.0, 2200.0), (middle, middle, 0.0), near=1.0, far=30_000.0)
    drapes = Drapes.open(layers, sketch.frame, sketch.size, sketch.extent)
    with canvas(size) as (context, texture, framebuffer):
        renderer = Renderer(context, terrain, sun=sun, quality=quality)
        renderer.set_drapes(drapes)
        renderer.prepare(camera, size)
        renderer.draw(camera, framebuffer)
        picture = read_picture(texture)
    legend = lab([[int(each[at : at + 2], 16) for at in (1, 3, 5)] for each in COLOURS])
    distances = np.linalg.norm(lab(picture)[:, :, None] - legend, axis=-1)
    assert ((distances < 5.0).sum(axis=(0, 1)) > 90).all()
