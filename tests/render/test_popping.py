"""No holes and no popping while tiles stream: flights, random cameras, finite worlds."""

from itertools import count

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import build
from sketchterrain.geometry.camera import Camera, draw_distance
from sketchterrain.io.resources import preset_names
from sketchterrain.render.ground_stream import JUMP, TerrainStream, view_of
from sketchterrain.render.offscreen import render_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.scene import BoundedTerrain, visible_rectangle
from sketchterrain.render.sky import Sun, Weather
from sketchterrain.tiles.lod import ScreenError
from sketchterrain.world.viewed import StoredTerrain
from tests import terrains
from tests.devices import DEVICES, NO_DEVICE

from ..world.grown import InMemoryWorld
from .ground_model import (
    MAGENTA,
    QUADS,
    TILE_BYTES,
    HoleView,
    ShadedView,
    camera_towards,
    change,
    holes,
    must_be_covered,
    open_edges,
    rays,
    shaded,
)
from .test_ground import Streamed, view_from

SIZE = (192, 108)
RATE = 30.0
SMALL = Quality(quads=64, tile_memory=600 * TILE_BYTES)
REACH = 16_000.0
BOUND = 4.0
"""Largest change of 255 levels at 30 frames a second, beyond edges that move by a pixel."""


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.parametrize(("z", "pitch", "seconds"), [(95.0, -4.0, 2e-3), (180.0, -25.0, 4e-2)])
def test_tiles_morph_without_popping_before_a_camera_at_rest(gl, waves, z, pitch, seconds):
    ticks = count()  # a batch takes `seconds` of simulated time
    metric = ScreenError(tolerance=0.3, quad=10.0)
    stream = TerrainStream(gl, waves, SMALL, metric=metric, timer=lambda: seconds * next(ticks))
    shade = ShadedView(gl, stream, SIZE)
    stream.converge(
        camera_towards((300.0, 200.0, z + 400.0), 0.0, 200.0, -20.0, REACH), SIZE, draw_distance=REACH
    )
    camera = camera_towards((350.0, 260.0, z + 350.0), 0.0, 20.0, pitch, REACH)
    assert np.hypot(np.hypot(50.0, 60.0), 50.0) < JUMP * waves.extent
    biggest, drawn, first, before = [], set(), None, None
    for _ in range(90):
        stats = stream.update(camera, SIZE, elapsed=1 / RATE, budget=0.006, draw_distance=REACH)
        assert not stats.jumped
        picture = shade.draw(camera, REACH)
        if before is None:
            first = picture
        else:
            biggest.append(change(before, picture).max())
        before = picture
        drawn.add(stats.triangles)
    assert stats.converged
    assert len(drawn) >= 3
    assert max(biggest) < BOUND
    # The picture did change.
    assert np.abs(first - before).max() > 0.5
    assert max(biggest[-5:]) == 0.0


@pytest.mark.gl
@pytest.mark.slow
def test_in_flight_frames_differ_only_by_the_motion(gl, waves):
    """From one eye, the tiles of two successive frames look almost equal."""
    speed = 40.0
    metric = ScreenError(tolerance=0.3, quad=10.0)
    ticks = count()  # a batch takes 2 ms of simulated time
    stream = TerrainStream(gl, waves, SMALL, metric=metric, timer=lambda: 2e-3 * next(ticks))
    shade = ShadedView(gl, stream, SIZE)
    biggest, drawn = [], set()
    for frame in range(50):
        place = (300.0 + speed * frame / RATE, 200.0, 150.0 + 20.0 * np.sin(frame / 20.0))
        camera = camera_towards(place, 0.0, 90.0 + 0.3 * frame, -12.0, REACH)
        if frame:
            view = view_of(camera, SIZE, draw_distance=REACH)
            stream.tile_renderer.set_tiles(stream.tiles.draw_list(view), camera.eye)
            before = shade.draw(camera, REACH)
        stats = stream.update(camera, SIZE, elapsed=1 / RATE, budget=0.006, draw_distance=REACH)
        assert stats.jumped == (frame == 0)
        if frame > 15:  # the first picture has converged
            biggest.append(change(before, shade.draw(camera, REACH)).max())
            drawn.add(stats.triangles)
    assert len(drawn) > 10
    assert 0.0 < max(biggest) < BOUND


CAMERAS = 75
"""For each preset."""
RANDOM_SIZE = (128, 72)
RANDOM_REACH = 4.0
FRAMES = 3
QUICK = Quality(tolerance=2.0, quads=32, tile_memory=128 << 20)


def is_below_ground(view, stream, camera, ground, reach):
    """Return whether coarse tiles stand above the camera: until they are refined, it sees no ground."""
    picture = view.draw(stream, camera_towards(camera.eye, ground, 0.0, -89.0, reach))
    middle = picture[RANDOM_SIZE[1] // 2 - 2 :, RANDOM_SIZE[0] // 2 - 2 :][:4, :4, :3]
    return bool((middle == MAGENTA).all())


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=pytest.mark.soak if number % 4 else pytest.mark.slow)
        for number, name in enumerate(preset_names())
    ],
)
def terrain(request):
    if not DEVICES:
        pytest.skip(NO_DEVICE)
    return terrains.preset(request.param)


@pytest.mark.gl
def test_random_cameras_see_no_holes(gl, terrain):
    rng = np.random.default_rng(11)
    eye, stream = HoleView(gl, RANDOM_SIZE), TerrainStream(gl, terrain, QUICK)
    bad, covered = [], 0
    for number in range(CAMERAS):
        east, north = rng.uniform(-0.5, 1.5, 2) * terrain.extent
        height = 1.7 * (20_000.0 / 1.7) ** rng.uniform()
        bearing, pitch = rng.uniform(0.0, 360.0), np.degrees(np.arcsin(rng.uniform(-1.0, 0.3)))
        for frame in range(FRAMES):
            ground = float(terrain.heights(east, north))
            reach = draw_distance(height, extent=terrain.extent, extents=RANDOM_REACH)
            camera = camera_towards((east, north, ground + height), ground, bearing, pitch, reach)
            if frame < FRAMES - 1 or number % 3:
                stats = stream.update(camera, RANDOM_SIZE, elapsed=0.05, budget=0.008, draw_distance=reach)
                converged = stats.converged
            else:
                stream.converge(camera, RANDOM_SIZE, draw_distance=reach)
                converged = True
            lowest = float(stream.tiles.pool.bottom.min())
            found = holes(eye.draw(stream, camera), camera, reach, lowest)
            if found and not converged and is_below_ground(eye, stream, camera, ground, reach):
                found = 0
            covered += must_be_covered(camera, RANDOM_SIZE, reach, lowest).mean() / (CAMERAS * FRAMES)
            if found:
                bad.append((number, frame, found, round(height, 1), round(pitch), converged))
            east, north = east + rng.uniform(-0.1, 0.1) * height, north + rng.uniform(-0.1, 0.1) * height
            bearing += rng.uniform(-60.0, 60.0)
    assert not bad
    assert covered > 0.3


SLOTS = 500
END_REACH = 9000.0
CELL = 4.0


@pytest.fixture(scope="module")
def ending_terrain():
    mountain, forest = (np.zeros((64, 64), np.uint8) for _ in range(2))
    mountain[50:64, 16:48] = 1  # across the southern border
    forest[56:64, 50:64] = 1
    sketch = Sketch(extent=2048.0, layers={"mountain": mountain, "forest": forest})
    return build(sketch, device=terrains.context())


@pytest.fixture(scope="module")
def stored(ending_terrain):
    """South of the origin, so that viewing and terrain coordinates are equal."""
    return InMemoryWorld(ending_terrain, (0.0, -401 * CELL, 512 * CELL, 0.0), CELL)


@pytest.fixture(scope="module")
def world(stored, ending_terrain):
    return StoredTerrain(stored, ending_terrain.context, ending_terrain)


class Ending:
    """A terrain with resolution and bounds of a stored world."""

    def __init__(self, ending_terrain, world):
        self._terrain = ending_terrain
        self.bounds, self.finest_cell = world.bounds, world.finest_cell
        self.extent = world.extent

    def __getattr__(self, name):
        return getattr(self._terrain, name)


def streamed_of(world, **options):
    return Streamed(world, slots=SLOTS, finest_cell=world.finest_cell, bounds=world.bounds, **options)


def eyes(world):
    """Inside, at the border, high above, outside."""
    west, south, east, north = world.bounds
    x, y = (west + east) / 2, (south + north) / 2
    return [
        (x, y, 900.0),
        (east - 30.0, south + 30.0, 60.0),
        (x, y, 6000.0),
        (west - 800.0, south - 500.0, 700.0),
    ]


def test_bounded_worlds_have_no_cracks(world):
    streamed = streamed_of(world, metric=ScreenError(1.5))
    rng = np.random.default_rng(2)
    west, south, east, north = world.bounds
    width, middle = np.array([east - west, north - south]), np.array([west + east, south + north]) / 2
    levels, unpaired, cases, moved = set(), 0, 0, 0
    for step, start in enumerate(eyes(world) * 3):
        eye = np.array([*np.add(start[:2], rng.uniform(-60, 60, 2)), start[2]])
        view = view_from(eye.tolist())
        options = {"budget": 0.05 if step else np.inf, "jump": not step, "drain": step % 3 == 0}
        draws = streamed.frame(view, elapsed=rng.uniform(0.05, 0.3), **options)
        assert draws.keys
        unit = world.extent / 2**24
        side = (draws.steps * QUADS * unit)[:, None]
        low = draws.corners * unit - [0.0, 1.0] * side
        assert (low < [east, north]).all()
        assert (low + side > [west, south]).all()
        vertices = streamed.store.download()
        places, *_ = shaded(draws, vertices, world.extent, eye)
        edges = open_edges(draws, places) + np.float32([*eye[:2], 0.0])
        # Edges without a neighbour are on or beyond the bounds, where they are clipped.
        inner = np.abs(edges[..., :2] - middle) < 0.5 * width - 1e-3
        assert not inner.all(axis=(-1, -2)).any()
        unpaired += len(edges)
        levels |= {key.level for key in draws.keys}
        cases |= int(np.bitwise_or.reduce(draws.cases))
        moved += int(np.count_nonzero((draws.morph > 0) & (draws.morph < 1)))
    assert len(levels) >= 2
    assert unpaired > 0
    assert cases
    assert moved


def test_tiles_are_streamed_only_within_the_bounds(world, ending_terrain):
    assert isinstance(world, BoundedTerrain)
    assert not isinstance(ending_terrain, BoundedTerrain)
    assert visible_rectangle(ending_terrain) == (0.0, 0.0, *ending_terrain.size)
    assert visible_rectangle(world) == (0.0, -401 * CELL, 512 * CELL, 0.0)
    streamed = streamed_of(world)
    for eye, reach in (((1e6, 1e6, 500.0), 3000.0), ((1000.0, -800.0, 500.0), END_REACH)):
        view = view_from(eye)
        draws = streamed.stream.generate_all(
            type(view)(view.eye, view.planes, view.pixels_per_radian, draw_distance=reach), streamed.write
        )
        assert bool(draws.keys) == (reach == END_REACH)
        assert streamed.stream.converged


@pytest.mark.gl
def test_terrain_is_visible_up_to_the_bounds_and_not_beyond(gl, world, stored):
    eye = HoleView(gl, SIZE)
    stream = TerrainStream(gl, world, Quality(quads=64, tile_memory=SLOTS * TILE_BYTES))
    west, south, east, north = world.bounds
    high = float(stored.data["height", 0].max())
    lowest = float(stored.data["height", 0].min()) - 10.0
    checked = 0
    for place in eyes(world):
        x, y, z = place
        z = max(z, float(world.heights(x, y)) + 20.0)
        for bearing, pitch in ((0, -85), (140, -25), (250, -10)):
            camera = camera_towards([x, y, z], 0.0, bearing, pitch, END_REACH)
            stream.converge(camera, SIZE, draw_distance=END_REACH)
            picture = eye.draw(stream, camera)
            visible = ~(picture[..., :3] == MAGENTA).all(axis=-1)
            # A ray between the highest and lowest terrain sees it if all of it is inside the bounds, and not
            # if all of it is outside.
            directions = rays(camera, SIZE)
            ends = [
                np.array([x, y]) + directions[..., :2] * ((z - height) / -directions[..., 2])[..., None]
                for height in (min(high, z), lowest)
            ]
            down = directions[..., 2] < -0.02
            boxes = np.minimum(*ends), np.maximum(*ends)
            outside = (boxes[1] < [west, south]).any(-1) | (boxes[0] > [east, north]).any(-1)
            inside = ((boxes[0] > [west, south]) & (boxes[1] < [east, north])).all(-1)
            near = np.linalg.norm(ends[1] - [x, y], axis=-1) < END_REACH
            assert not (visible & down & outside).any()
            assert visible[down & inside & near].all()
            checked += int((down & outside).sum()) + int((down & inside).sum())
    assert checked > 20_000


@pytest.mark.gl
@pytest.mark.slow
def test_a_stored_world_looks_like_its_terrain(world, ending_terrain):
    live = Ending(ending_terrain, world)
    ground = float(world.heights(1000.0, -1300.0))
    camera = Camera((1000.0, -1300.0, ground + 90.0), (1000.0, -200.0, ground + 60.0), fov=55.0)
    options = {
        "size": (320, 180),
        "camera": camera,
        "sun": Sun(250.0, 32.0),
        "weather": Weather(clouds=0.0),
        "quality": Quality.from_level(0.4),
    }
    one, two = (render_picture(scene, **options).astype(int) for scene in (world, live))
    apart = np.abs(one - two).max(axis=-1)
    # Rounded weights, plants on interpolated samples and shadows from beyond the bounds may differ.
    assert apart.mean() < 1.5
    assert np.mean(apart > 24) < 0.01
    assert one.std() > 20
