"""What vectors paint, in pictures: against the pattern itself, whatever way the camera came, and edits."""

from dataclasses import replace
from functools import partial
from itertools import count

import numpy as np
import pytest

from sketchterrain.geometry.camera import Camera
from sketchterrain.render.offscreen import read_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Sun
from sketchterrain.tiles.appearance import TEXELS

from .conftest import Waves

SUN = Sun(200.0, 60.0)
SIZE = (240, 160)
BARE = ("clouds", "haze", "grass", "rocks", "detail", "shadows", "trees")
SMALL = {"quads": 64, "map_texels": 64, "material_texels": 64, "tile_memory": 64 << 20}
QUALITY = replace(Quality.from_level(0.0, without=BARE), tolerance=1.0, finest_quad=1.0, **SMALL)
ALBEDO = 0.3


class Pattern:
    """Paint of 1 × 1 texel means: `share(x, y, texel)` and `root(x, y, texel)` are the share and √albedo."""

    extent = 1000.0
    is_empty = filters = False
    layers, nbytes = None, 0

    def __init__(self, share, root=lambda x, y, texel: np.full(x.shape, np.sqrt(ALBEDO)), box=None):
        self.share, self.root, self.box, self.asked = share, root, box, []

    def occupied(self, keys):
        if self.box is None:
            return np.ones(len(keys), bool)
        width = self.extent * 2.0 ** -keys[:, :1].astype(float)
        low = keys[:, 1:] * width - width / (TEXELS - 2)
        high = low + width * TEXELS / (TEXELS - 2)
        west, south, east, north = self.box
        return (low <= [east, north]).all(axis=1) & (high >= [west, south]).all(axis=1)

    def changed_areas(self, old):
        return np.zeros((0, 4))

    def reach(self, old):
        return 1.0

    def tiles(self, keys):
        self.asked += [tuple(key) for key in keys.tolist()]
        result = np.zeros((len(keys), TEXELS, TEXELS, 4))
        for tile, (level, column, row) in zip(result, keys.tolist(), strict=True):
            width = self.extent * 2.0**-level
            texel = width / (TEXELS - 2)
            away = (np.arange(TEXELS) - 0.5) * texel
            x, y = np.meshgrid(column * width + away, (row + 1) * width - away)
            tile[..., :3] = self.root(x, y, texel)[..., None]
            tile[..., 3] = self.share(x, y, texel)
        return np.rint(255.0 * result).astype(np.uint8)


def strip(middle, half_width):
    """Return the share of texels that a strip along x covers about y = `middle` (m)."""

    def share(x, y, texel):
        low = np.maximum(y - 0.5 * texel, middle - half_width)
        high = np.minimum(y + 0.5 * texel, middle + half_width)
        return np.maximum(high - low, 0.0) / texel

    return Pattern(share, box=(-np.inf, middle - half_width, np.inf, middle + half_width))


def whole(x, y, texel):
    return np.ones(x.shape)


class Plain(Waves):
    """Level ground at 0 m, painted."""

    def __init__(self, appearance):
        super().__init__(rivers=False, plants=False)
        self.appearance = appearance

    def heights(self, x, y, *, cell_size=0.0):
        return np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)), np.float32)


EVERYWHERE = [(-1e5, -1e5, 1e5, 1e5)]


class Studio:
    """A renderer with its picture."""

    def __init__(self, gl, open_renderer, *, quality=QUALITY, first=None, **options):
        self.texture = gl.texture(SIZE, 4)
        self.framebuffer = gl.framebuffer([self.texture])
        self.appearance = first
        self.renderer = open_renderer(Plain(first), sun=SUN, quality=quality, **options)

    def picture(self, camera):
        self.renderer.draw(camera, self.framebuffer)
        return read_picture(self.texture).astype(int)

    def draw(self, appearance, camera):
        """Return the picture of a pattern, or none."""
        if appearance is not self.appearance:
            self.renderer.set_terrain(Plain(appearance), EVERYWHERE)
            self.appearance = appearance
        self.renderer.prepare(camera, SIZE)
        return self.picture(camera)


@pytest.fixture
def studio(gl, open_renderer):
    return partial(Studio, gl, open_renderer)


def ground_at(camera, size=SIZE):
    """Return x and y (m) of the ground at pixels, (height, width) each."""
    x, y = np.meshgrid(*((np.arange(n) + 0.5) / n * 2.0 - 1.0 for n in size))
    ends = np.stack([x, -y, np.full(x.shape, 0.5), np.ones(x.shape)], axis=-1)
    away = ends @ np.linalg.inv(camera.to_clip(size[0] / size[1])).T
    ray = away[..., :3] / away[..., 3:]
    along = -camera.eye[2] / ray[..., 2]
    return camera.eye[0] + along * ray[..., 0], camera.eye[1] + along * ray[..., 1]


def above(height, fov=30.0):
    return Camera((500.4, 499.7, height), (500.4, 500.7, 0.0), fov=fov, near=0.3 * height, far=30_000.0)


@pytest.mark.gl
def test_no_border_of_a_tile_or_level_shows_at_any_height(studio):
    """What a pixel shows of a smooth pattern is a function of it, to which borders would add steps."""
    for level, heights in ((0.1, (230.0,)), (1.0, (1400.0, 7.0))):
        draw = studio(quality=replace(Quality.from_level(level, without=BARE), **SMALL)).draw
        for height in heights:
            turns = 2.0 * np.pi / (0.4 * height)
            pattern = Pattern(whole, lambda x, y, texel, k=turns: 0.5 + 0.2 * np.sin(k * x) * np.cos(k * y))
            shown = draw(pattern, above(height))[..., 1]
            places = ground_at(above(height))
            value = pattern.root(*places, 0.0)
            off = shown - np.polyval(np.polyfit(value.ravel(), shown.ravel(), 5), value)
            width = 1000.0 * 2.0 ** -max(key[0] for key in pattern.asked)
            assert len(set(pattern.asked)) > 4
            assert np.ptp(shown) > 60
            for axis, place in ((1, places[0][0]), (0, places[1][:, 0])):
                step = np.abs(np.diff(off, axis=axis))  # texels and pixels are rounded to 1/255 each
                assert step.max() <= 4.0
                lines = step.mean(axis=1 - axis)
                is_border = np.diff(np.floor(place / width)) != 0
                assert is_border.any()
                assert lines[is_border].mean() <= lines.mean() + 0.25, height
            assert np.abs(off).max() <= 4.5, height


@pytest.mark.gl
def test_edges_are_where_they_belong_within_half_a_pixel(studio):
    half_covered = Pattern(lambda x, y, texel: np.full(x.shape, 0.5))
    draw = studio().draw
    for height, half_width in ((800.0, 40.0), (8.0, 0.5)):
        camera = above(height)
        half = draw(half_covered, camera)[..., 1]
        _, y = ground_at(camera)
        for middle in (497.3, 500.0):
            middle = 500.0 + (middle - 500.0) * height / 60.0
            shown = draw(strip(middle, half_width), camera)[..., 1]
            for column in (20, 119, 200):
                sign = shown[:, column] - half[:, column] > 0
                (rows,) = np.nonzero(sign[1:] != sign[:-1])
                assert len(rows) == 2
                over = (shown - half)[:, column]
                share = over[rows] / (over[rows] - over[rows + 1])
                edges = y[rows, column] + share * (y[rows + 1, column] - y[rows, column])
                pixel = abs(y[1, column] - y[0, column])
                np.testing.assert_allclose(
                    sorted(edges), [middle - half_width, middle + half_width], atol=0.5 * pixel
                )


@pytest.mark.gl
def test_levels_change_without_a_step(studio):
    """Stripes of about four pixels lose contrast little by little while the eye rises through two levels."""

    def integral(y, period=0.9):
        return period * (np.floor(y / period) * 0.5 + np.minimum(y / period % 1.0, 0.5))

    stripes = Pattern(lambda x, y, texel: (integral(y + 0.5 * texel) - integral(y - 0.5 * texel)) / texel)
    draw = studio(quality=replace(QUALITY, appearance_taps=4)).draw
    pictures = [draw(stripes, above(height, fov=10.0)) for height in 150.0 * 1.035 ** np.arange(22)]
    contrast = np.array([each[..., 1].std() for each in pictures])
    assert contrast.max() > 1.4 * contrast.min()
    assert np.abs(np.diff(np.log(contrast))).max() < 0.12


@pytest.mark.gl
def test_nothing_changes_without_paint_or_behind_a_hill(draw):
    class Hidden(Plain):
        def heights(self, x, y, *, cell_size=0.0):
            x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
            return (60.0 * np.exp(-(((y - 500.0) / 30.0) ** 2))).astype(np.float32)

    camera = Camera((500.0, 100.0, 40.0), (500.0, 300.0, 0.0), near=1.0, far=30_000.0)
    empty = strip(0.0, 0.0)
    empty.is_empty = True
    pictures = [
        draw(Hidden(each), camera, size=SIZE, sun=SUN, quality=QUALITY)
        for each in (None, empty, strip(620.0, 3.0), strip(250.0, 3.0))
    ]
    assert np.array_equal(pictures[0], pictures[1])
    assert np.abs(pictures[2] - pictures[0]).max() <= 1  # another program
    assert np.abs(pictures[3] - pictures[0]).max() > 20


@pytest.mark.gl
@pytest.mark.slow
def test_every_way_to_a_view_gives_the_same_pixels(studio):
    camera = Camera((480.0, 420.0, 25.0), (520.0, 520.0, 0.0), near=1.0, far=30_000.0)
    pictures = []
    for way in ("prepare", "refined", "flight", "little memory"):
        pattern = strip(505.0, 3.0)
        slots = 60 if way == "little memory" else QUALITY.appearance_tiles
        quality = replace(QUALITY, appearance_tiles=slots, moving_scale=1.0)
        ticks = count()
        each = studio(quality=quality, first=pattern, timer=lambda ticks=ticks: 1e-3 * next(ticks))
        renderer = each.renderer
        if way == "refined":
            for _ in renderer.refined(camera, each.framebuffer):
                pass
        if way in ("flight", "little memory"):
            for step in range(6):
                eye = (camera.eye[0] - 300.0 + 50.0 * step, camera.eye[1], camera.eye[2] * (13 - 2 * step))
                renderer.frame(replace(camera, eye=eye), each.framebuffer, elapsed=0.05, budget=0.01)
            while not renderer.scenery.appearance.converged:
                renderer.frame(camera, each.framebuffer, elapsed=0.1, budget=0.05)
        if way != "refined":
            renderer.prepare(camera, SIZE)
            renderer.draw(camera, each.framebuffer)
        assert pattern.asked
        pictures.append(read_picture(each.texture))
    for other in pictures[1:]:
        assert np.array_equal(pictures[0], other)


@pytest.mark.gl
def test_a_moved_road_redraws_the_tiles_that_it_touches(studio):
    camera = Camera((500.0, 440.0, 60.0), (500.0, 520.0, 0.0), near=1.0, far=30_000.0)
    first = studio(first=strip(500.0, 3.0))
    renderer = first.renderer
    renderer.prepare(camera, SIZE)
    moved = strip(504.0, 3.0)
    renderer.set_terrain(Plain(moved), [(-1e4, 497.0, 1e4, 507.0)])
    meanwhile = first.picture(camera)
    renderer.prepare(camera, SIZE)
    after = first.picture(camera)
    for level, _, row in moved.asked:
        width = 1000.0 * 2.0**-level
        texel = width / (TEXELS - 2)
        assert row * width - texel <= 507.0
        assert (row + 1) * width + texel >= 497.0
    assert np.abs(meanwhile - after).max() > 20
    # Paint that is removed, and painted again.
    renderer.set_terrain(Plain(None), [])
    plain = first.picture(camera)
    assert not renderer.scenery.appearance
    renderer.set_terrain(Plain(moved), [])
    renderer.prepare(camera, SIZE)
    assert np.array_equal(first.picture(camera), after)
    assert np.array_equal(studio().draw(None, camera), plain)
    other = studio(first=moved)
    assert np.array_equal(other.draw(moved, camera), after)
    # Until they are redrawn, tiles show what was.
    assert np.array_equal(other.draw(strip(500.0, 3.0), camera), meanwhile)


@pytest.mark.gl
def test_narrow_roads_fade_by_the_share_of_a_pixel(studio):
    camera = Camera((500.0, 100.0, 300.0), (500.0, 400.0, 0.0), near=1.0, far=30_000.0)
    draw = studio().draw
    bare, *shown = (draw(strip(250.0, half), camera) for half in (0.0, 0.3, 0.6, 1.2))
    change = np.array([np.abs(each - bare).sum() for each in shown])
    assert change[0] > 0
    np.testing.assert_allclose(change / change[0], [1.0, 2.0, 4.0], rtol=0.35)
