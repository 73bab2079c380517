"""Worlds with bounds: no tile beyond them, no hole within, and the picture of their terrain."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.compute import ComputeContext
from sketchterrain.render import Camera, Quality, Sun, Weather, render_picture
from sketchterrain.render.ground_stream import GroundStream
from sketchterrain.render.scene import Bounded, rectangle_of
from sketchterrain.sketch import Sketch
from sketchterrain.terrain import build
from sketchterrain.tiles import ScreenError, TileStream
from sketchterrain.world.viewed import ViewedWorld

from ..world.grown import Grown
from .ground_model import QUADS, TILE_BYTES, open_edges, shaded
from .ground_pictures import MAGENTA, Eye, camera_towards

SLOTS = 500
SIZE = (192, 108)
REACH = 9000.0
CELL = 4.0


@pytest.fixture(scope="module")
def terrain():
    mountain, forest = (np.zeros((64, 64), np.uint8) for _ in range(2))
    mountain[50:64, 16:48] = 1  # at the southern border, and so beyond it
    forest[56:64, 50:64] = 1
    sketch = Sketch(extent=2048.0, layers={"mountain": mountain, "forest": forest})
    return build(sketch, device=ComputeContext())


@pytest.fixture(scope="module")
def stored(terrain):
    """South of the terrain's origin, so that its viewing coordinates are the terrain's own."""
    return Grown(terrain, (0.0, -401 * CELL, 512 * CELL, 0.0), CELL)


@pytest.fixture(scope="module")
def world(stored, terrain):
    return ViewedWorld(stored, terrain.context, terrain)


class Ending:
    """A terrain that is known no finer than a stored world, and ends where that does."""

    def __init__(self, terrain, world):
        self._terrain = terrain
        self.bounds, self.finest_cell = world.bounds, world.finest_cell
        self.extent = world.extent

    def __getattr__(self, name):
        return getattr(self._terrain, name)


def stream_of(world, **options):
    """A stream over a world, its vertices here."""
    stream = TileStream(
        world.extent,
        slots=SLOTS,
        quads=QUADS,
        finest_cell=world.finest_cell,
        bounds=world.bounds,
        **options,
    )
    return stream, world.vertex_store(SLOTS, quads=QUADS)


def eyes(world):
    """Within, at the rim, high above and outside, looking around and down."""
    west, south, east, north = world.bounds
    x, y = (west + east) / 2, (south + north) / 2
    return [
        (x, y, 900.0),
        (east - 30.0, south + 30.0, 60.0),
        (x, y, 6000.0),
        (west - 800.0, south - 500.0, 700.0),
    ]


def test_every_tile_that_is_drawn_has_ground_and_nothing_opens_between_them(world):
    from .test_cracks import view_from

    stream, store = stream_of(world, metric=ScreenError(1.5))
    rng = np.random.default_rng(2)
    west, south, east, north = world.bounds
    width, middle = np.array([east - west, north - south]), np.array([west + east, south + north]) / 2
    levels, lonely_ones, cases, moved = set(), 0, 0, 0
    for step, start in enumerate(eyes(world) * 3):
        eye = np.array([*np.add(start[:2], rng.uniform(-60, 60, 2)), start[2]])
        view = view_from(eye.tolist())
        batch = stream.plan(view, budget=0.05 if step else np.inf)
        while batch:
            facts = world.write_tiles(batch.keys, batch.slots, batch.parents, store)
            stream.arrived(batch, facts, seconds=0.001 * len(batch.keys))
            batch = stream.plan(view, budget=0.05) if step % 3 == 0 else None
        if step == 0:
            stream.jump(view)
        draws = stream.advance(view, elapsed=rng.uniform(0.05, 0.3))
        assert draws.keys
        low = draws.corners * world.extent / 2**24 - [0.0, 1.0] * (draws.steps * QUADS)[:, None] * (
            world.extent / 2**24
        )
        side = (draws.steps * QUADS * world.extent / 2**24)[:, None]
        assert (low < [east, north]).all()
        assert (low + side > [west, south]).all()
        vertices = store.download()
        places, *_ = shaded(draws, vertices, world.extent, eye)
        edges = open_edges(draws, places) + np.float32([*eye[:2], 0.0])
        # What no other triangle has the other way round lies on an end, or beyond one and is cut off.
        inner = np.abs(edges[..., :2] - middle) < 0.5 * width - 1e-3
        assert not inner.all(axis=(-1, -2)).any()
        lonely_ones += len(edges)
        levels |= {key.level for key in draws.keys}
        cases |= int(np.bitwise_or.reduce(draws.cases))
        moved += int(np.count_nonzero((draws.morph > 0) & (draws.morph < 1)))
    assert len(levels) >= 2
    assert lonely_ones > 0
    assert cases
    assert moved


def test_tiles_are_streamed_only_within_the_bounds_of_a_world(world, terrain):
    from .test_cracks import view_from

    assert isinstance(world, Bounded)
    assert not isinstance(terrain, Bounded)
    assert rectangle_of(terrain) == (0.0, 0.0, *terrain.size)
    assert rectangle_of(world) == (0.0, -401 * CELL, 512 * CELL, 0.0)
    stream, store = stream_of(world)
    for eye, reach in (((1e6, 1e6, 500.0), 3000.0), ((1000.0, -800.0, 500.0), REACH)):
        view = view_from(eye)
        draws = stream.settle(
            type(view)(view.eye, view.planes, view.pixels_per_radian, draw_distance=reach),
            lambda batch: world.write_tiles(batch.keys, batch.slots, batch.parents, store),
        )
        assert bool(draws.keys) == (reach == REACH)
        assert stream.settled


@pytest.mark.gl
def test_ground_is_seen_up_to_the_ends_and_nothing_beyond(gl, world, stored):
    eye = Eye(gl, SIZE)
    stream = GroundStream(gl, world, Quality(quads=64, tile_memory=SLOTS * TILE_BYTES))
    west, south, east, north = world.bounds
    high = float(stored.data["height", 0].max())
    lowest = float(stored.data["height", 0].min()) - 10.0
    checked = 0
    for place in eyes(world):
        x, y, z = place
        z = max(z, float(world.heights(x, y)) + 20.0)
        for bearing, pitch in ((0, -85), (140, -25), (250, -10)):
            camera = camera_towards([x, y, z], 0.0, bearing, pitch, REACH)
            stream.settle(camera, SIZE, draw_distance=REACH)
            picture = eye.see(stream, camera)
            seen = ~(picture[..., :3] == MAGENTA).all(axis=-1)
            # Each ray passes over what lies between the highest and the lowest ground: none is seen where
            # that is all outside, and none is missing where all of it is inside.
            ways = rays(camera)
            ends = [
                np.array([x, y]) + ways[..., :2] * ((z - height) / -ways[..., 2])[..., None]
                for height in (min(high, z), lowest)
            ]
            down = ways[..., 2] < -0.02
            boxes = np.minimum(*ends), np.maximum(*ends)
            outside = (boxes[1] < [west, south]).any(-1) | (boxes[0] > [east, north]).any(-1)
            inside = ((boxes[0] > [west, south]) & (boxes[1] < [east, north])).all(-1)
            near = np.linalg.norm(ends[1] - [x, y], axis=-1) < REACH
            assert not (seen & down & outside).any()
            assert seen[down & inside & near].all()
            checked += int((down & outside).sum()) + int((down & inside).sum())
    assert checked > 20_000


def rays(camera):
    """Where each pixel's middle looks, (height, width, 3), row 0 the lowest."""
    width, height = SIZE
    half = np.tan(np.radians(camera.fov) / 2.0)
    x = ((np.arange(width) + 0.5) / width * 2.0 - 1.0) * half * width / height
    y = ((np.arange(height) + 0.5) / height * 2.0 - 1.0)[:, None] * half
    axes = camera.view()[:3, :3]
    return x[..., None] * axes[0] + y[..., None] * axes[1] - axes[2]


@pytest.mark.gl
@pytest.mark.slow
def test_the_picture_of_a_stored_world_is_that_of_its_terrain(world, terrain):
    live = Ending(terrain, world)
    ground = float(world.heights(1000.0, -1300.0))
    camera = Camera((1000.0, -1300.0, ground + 90.0), (1000.0, -200.0, ground + 60.0), fov=55.0)
    options = {
        "size": (320, 180),
        "camera": camera,
        "sun": Sun(250.0, 32.0),
        "weather": Weather(clouds=0.0),
        "quality": Quality.of(0.4),
    }
    one, two = (render_picture(scene, **options).astype(int) for scene in (world, live))
    apart = np.abs(one - two).max(axis=-1)
    # Weights are rounded to sum to 255, plants stand on samples instead of between them, shadows beyond the
    # ends are of other ground: a pixel may differ at an edge, the picture does not.
    assert apart.mean() < 1.5
    assert np.mean(apart > 24) < 0.01
    assert one.std() > 20
