"""Appearance tiles: what a view needs against what pixels read, the cache against its budget."""

import numpy as np
import pytest

from sketchterrain.tiles.appearance import PAGES, PIXELS, TEXELS, AppearanceTiles
from sketchterrain.tiles.lod import CameraView
from sketchterrain.tiles.quadtree import code_of, contains, decode, keys_of, parent_of
from sketchterrain.tiles.tile_pool import TilePool

EXTENT = 4096.0
ROOM = 100_000


def everywhere(keys):
    return np.ones(len(keys), bool)


def flat_pool(height=0.0):
    """Return a pool with the root tiles about the origin, level at a height (m)."""
    pool = TilePool(64)
    codes = np.array([code_of(-4, x, y) for x in (-1, 0) for y in (-1, 0)], np.int64)
    properties = np.zeros(4, [("low", "f8"), ("high", "f8"), ("error", "f8")])
    properties["low"] = properties["high"] = height
    pool.set_properties(pool.acquire(np.sort(codes)), properties)
    return pool


def level_pool(count=3):
    """Return a pool of all tiles of some levels about the origin, level at 0 m."""
    pool = TilePool(4096)
    codes = np.array(
        [code_of(n, x, y) for n in range(count) for x in range(-8, 9) for y in range(-8, 9)], np.int64
    )
    pool.set_properties(
        pool.acquire(np.sort(codes)), np.zeros(len(codes), [("low", "f8"), ("high", "f8"), ("error", "f8")])
    )
    return pool


def camera_view(eye, forward, *, fov=50.0, size=(480, 270), **given):
    """Return the view of a camera, and the unit directions of its pixels (n, 3)."""
    forward = np.asarray(forward, float) / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right)
    up = np.cross(right, forward)
    half = np.tan(np.radians(fov) / 2.0)
    wide = half * size[0] / size[1]
    normals = np.array(
        [forward * s + axis for axis, s in ((right, wide), (-right, wide), (up, half), (-up, half))]
        + [forward]
    )
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    planes = np.column_stack([normals, -normals @ np.asarray(eye, float)])
    view = CameraView(tuple(eye), planes, size[1] / (2.0 * half), **given)
    x, y = np.meshgrid(*((np.arange(n) + 0.5) / n * 2.0 - 1.0 for n in size))
    rays = forward + x.reshape(-1, 1) * wide * right + y.reshape(-1, 1) * half * up
    return view, rays / np.linalg.norm(rays, axis=1)[:, None]


def read_tiles(view, position, sine, taps, finest):
    """Return the tiles that pixels read at positions (m from the eye), as kernels/render/appearance.glsl."""
    least = np.linalg.norm(position, axis=1) / view.pixels_per_radian
    texel = PIXELS * least * np.maximum(1.0 / sine / taps, 1.0)
    level = np.ceil(np.log2(EXTENT / ((TEXELS - 2) * texel)))
    farthest = np.abs(position[:, :2]).max(axis=1)
    level = np.minimum(level, np.floor(np.log2((3 * PAGES // 8 - 1) * EXTENT / farthest)))
    level = np.clip(level, 0, finest).astype(np.int64)
    place = (np.array(view.eye[:2]) + position[:, :2]) / (EXTENT * 2.0**-level)[:, None]
    return code_of(level, *np.floor(place).astype(np.int64).T)


CAMERAS = [
    ((300.0, -200.0, 1.7), (1.0, 0.3, -0.05), 50.0),
    ((-900.0, 700.0, 60.0), (-0.4, 1.0, -0.3), 60.0),
    ((10.0, 20.0, 900.0), (0.1, 0.0, -1.0), 40.0),
    ((500.0, 500.0, 5000.0), (1.0, 1.0, -0.4), 80.0),
    ((500.0, 500.0, 3.0), (0.2, -1.0, -0.9), 25.0),
]


@pytest.mark.parametrize(("eye", "forward", "fov"), CAMERAS)
def test_all_that_pixels_read_is_needed(eye, forward, fov):
    tiles = AppearanceTiles(EXTENT, slots=ROOM)
    view, rays = camera_view(eye, forward, fov=fov, draw_distance=20_000.0)
    codes = tiles.needed(view, level_pool(), everywhere).codes
    down = rays[:, 2] < -1e-3
    position = rays[down] * (-eye[2] / rays[down, 2])[:, None]
    position = position[np.hypot(*position[:, :2].T) < 20_000.0]
    sine = np.maximum(-position[:, 2] / np.linalg.norm(position, axis=1), 0.02)
    for taps in (1, 2, 8):
        read = read_tiles(view, position, sine, taps, tiles.finest)
        assert contains(np.sort(codes), read).all()
        assert len(np.unique(read)) >= 4
    # Parents come before their children; and much of it is read.
    order = {code: number for number, code in enumerate(codes.tolist())}
    above = parent_of(codes[decode(codes)[0] > 0]).tolist()
    below = codes[decode(codes)[0] > 0].tolist()
    assert all(order[parent] < order[child] for parent, child in zip(above, below, strict=True))
    assert len(codes) < 482


class Painter:
    """Stands for the textures: remembers which tile each slot has."""

    def __init__(self, tiles, is_uniform=lambda codes: np.zeros(len(codes), bool)):
        self.tiles, self.is_uniform = tiles, is_uniform
        self.content = np.full(tiles.slots, -1, np.int64)
        self.drawn = []

    def draw(self, codes):
        slots = self.tiles.store(codes, self.is_uniform(codes), codes.astype(np.uint32))
        self.content[slots[slots >= 0]] = codes[slots >= 0]
        self.drawn += codes.tolist()

    def converge(self, view, pool, occupied=everywhere):
        self.tiles.select(view, pool, occupied)
        while (codes := self.tiles.pending()).size:
            self.draw(codes[:16])
            self.tiles.select(view, pool, occupied)


def test_the_budget_holds_and_pages_show_the_finest_tile_that_is_there():
    rng = np.random.default_rng(3)
    tiles = AppearanceTiles(EXTENT, slots=40)
    painter, pool = Painter(tiles, lambda codes: codes % 5 == 0), level_pool()
    for step in range(60):
        eye = (rng.uniform(-2000, 2000), rng.uniform(-2000, 2000), 10.0 ** rng.uniform(0.2, 3.5))
        view, _ = camera_view(eye, (*rng.normal(size=2), -0.4), velocity=(30.0, 0.0, 0.0))
        tiles.select(view, pool, lambda keys: keys[:, 1] % 7 != 3)
        painter.draw(tiles.pending()[: int(rng.integers(1, 60))])
        painter.draw(tiles.pending(tiles.needed(view.extrapolated(1.0), pool, everywhere))[:3])
        if step % 10 == 9:
            painter.converge(view, pool)
            assert tiles.converged
        records = tiles._records
        slots = records["slot"][records["slot"] >= 0]
        assert len(np.unique(slots)) == len(slots) <= 40
        np.testing.assert_array_equal(painter.content[slots], records["code"][records["slot"] >= 0])
        assert len(records) <= 8 * 40
        needed = tiles._needed
        table, centre = tiles.page_table(eye)
        at, place = tiles.tiles_at(eye)
        np.testing.assert_array_equal(at, centre)
        width = EXTENT * 0.5 ** np.arange(tiles.finest + 1)[:, None]
        np.testing.assert_allclose((at + place) * width, np.tile(eye[:2], (len(at), 1)))
        assert tiles.shows(centre, eye)
        assert not tiles.shows(centre, (eye[0] + 9.0 * EXTENT, eye[1]))
        known = set(needed.codes.tolist()) & set(records["code"].tolist())
        empty = set(needed.empty.tolist())
        for level in rng.integers(0, tiles.finest + 1, 12).tolist():
            column, row = (centre[level] + rng.integers(-31, 32, 2)).tolist()
            page = table[level, row % PAGES, column % PAGES]
            code = int(code_of(level, column, row))
            while code not in known and code not in empty and decode(np.array(code))[0] > 0:
                code = int(parent_of(np.array(code)))
            if page[0]:
                assert painter.content[(page[0] & 0xFFFF) - 1] == code
                assert page[0] >> 16 == decode(np.array(code))[0]
            else:
                assert page[1] == (np.uint32(code & 0xFFFFFFFF) if code in known else 0)


def test_tiles_of_one_colour_and_empty_ones_take_no_slot():
    tiles = AppearanceTiles(EXTENT, slots=4)
    painter = Painter(tiles, lambda codes: np.ones(len(codes), bool))
    view, _ = camera_view((0.0, 0.0, 50.0), (1.0, 0.0, -1.0))
    painter.converge(view, flat_pool())
    assert len(painter.drawn) > 20
    assert tiles.finest > 5
    assert not tiles.page_table(view.eye)[0][..., 0].any()
    bare = AppearanceTiles(EXTENT, slots=4)
    bare.select(view, flat_pool(), lambda keys: np.zeros(len(keys), bool))
    assert bare.converged
    assert not bare.page_table(view.eye)[0].any()


def test_a_changed_area_redraws_the_tiles_that_it_touches_and_no_others():
    tiles = AppearanceTiles(EXTENT, slots=1000)
    painter, pool = Painter(tiles), level_pool()
    view, _ = camera_view((0.0, 0.0, 80.0), (1.0, 0.2, -0.8))
    painter.converge(view, pool)
    before, table = len(painter.drawn), tiles.page_table(view.eye)[0]
    area = (60.0, -10.0, 70.0, 10.0)
    tiles.invalidate([area])
    assert not tiles.converged
    np.testing.assert_array_equal(tiles.page_table(view.eye)[0], table)  # nothing vanishes meanwhile
    painter.converge(view, pool)
    redrawn = painter.drawn[before:]
    assert 0 < len(redrawn) < 0.6 * before
    for code in painter.drawn[:before]:
        ((level, column, row),) = keys_of(np.array([code]))
        width = EXTENT * 2.0**-level
        west, south, texel = column * width, row * width, width / (TEXELS - 2)
        touched = west - texel <= 70.0 and west + width + texel >= 60.0
        touched &= south - texel <= 10.0 and south + width + texel >= -10.0
        assert (code in redrawn) == touched
    tiles.invalidate([])
    assert tiles.converged
