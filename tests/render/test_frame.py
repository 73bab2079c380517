"""Moving pictures: streamed and updated frames converge to fresh ones; time budgets."""

import ctypes
from dataclasses import replace
from functools import partial
from itertools import count
from types import SimpleNamespace

import moderngl
import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.generation.building import build, rebuild
from sketchterrain.geometry.camera import FARTHEST, Camera
from sketchterrain.render.offscreen import read_picture
from sketchterrain.render.overlays import HeightCache, Overlay, feature_lines
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun, Weather
from sketchterrain.render.targets import NOISE_PERIOD, wrap_to_noise_period
from sketchterrain.render.vertex_memory import gl_function
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.terrain.recipe import EVERYWHERE
from sketchterrain.terrain.surfaces import vertex_dtype
from sketchterrain.tiles.quadtree import code_of, decode, keys_of, parent_of
from sketchterrain.tiles.refinement import ROOT_LEVEL
from tests import terrains

pytestmark = pytest.mark.gl

SIDE, EXTENT = 96, 3072.0
SIZE = (160, 90)
SUN = Sun(230.0, 35.0)
QUALITY = replace(
    Quality.from_level(0.25), map_texels=128, material_texels=128, tile_memory=32 << 20, plant_distance=600.0
)


def disc(image, row, column, radius, label=1):
    rows, columns = np.ogrid[:SIDE, :SIDE]
    image[(rows - row) ** 2 + (columns - column) ** 2 <= radius**2] = label


@pytest.fixture(scope="module")
def before():
    layers = {name: np.zeros((SIDE, SIDE), np.uint8) for name in ("mountain", "forest", "river", "lake")}
    disc(layers["mountain"], 20, 60, 8)
    disc(layers["forest"], 66, 40, 9)
    return build(Sketch(extent=EXTENT, seed=3, layers=layers), device=terrains.context())


def painted(terrain, *strokes):
    """Layer, row, column, radius, label of each stroke."""
    layers = {name: layer.copy() for name, layer in terrain.sketch.layers.items()}
    for layer, *stroke in strokes:
        disc(layers[layer], *stroke)
    return rebuild(terrain, terrain.sketch.replace(layers=layers))


def red_and_dry(sketch):
    return sketch.replace(climate={**sketch.climate, "aridity": 0.9}, look={"grass": {"colour": "#c83c3c"}})


def river(terrain):
    layers = {name: layer.copy() for name, layer in terrain.sketch.layers.items()}
    for step in range(50):
        disc(layers["river"], 60 + 5 * np.sin(step / 9), 15 + step, 1.0)
    return rebuild(terrain, terrain.sketch.replace(layers=layers))


@pytest.fixture(scope="module")
def camera(before):
    height = float(before.heights([1400.0], [600.0])[0])
    return Camera(eye=(1400.0, 600.0, height + 70.0), target=(1300.0, 1500.0, height - 20.0), fov=50.0)


class View:
    """A renderer with its picture."""

    def __init__(self, gl, open_renderer, terrain, *, size=SIZE, **options):
        self.texture = gl.texture(size, 4)
        self.framebuffer = gl.framebuffer([self.texture])
        self.renderer = open_renderer(terrain, **{"sun": SUN, "quality": QUALITY, **options})

    def frame(self, camera, *, elapsed=0.1):
        return self.renderer.frame(camera, self.framebuffer, elapsed=elapsed)

    def picture(self):
        return read_picture(self.texture).astype(int)

    def converged(self, camera, *, elapsed=0.1):
        for _ in range(300):
            self.stats = self.frame(camera, elapsed=elapsed)
            if self.stats.converged:
                return self.picture()
        raise AssertionError("not converged after 300 frames")

    def still(self, camera):
        self.renderer.prepare(camera, self.texture.size)
        self.renderer.draw(camera, self.framebuffer)
        return self.picture()


@pytest.fixture(scope="module")
def open_view(gl, open_renderer):
    return partial(View, gl, open_renderer)


@pytest.fixture
def view(open_view, before, camera):
    view = open_view(before)
    view.converged(camera)
    return view


def same(picture, other):
    """Equal within the tolerance of the golden pictures."""
    apart = np.abs(picture - other)
    return apart.mean() <= 1.0 and (apart.max(axis=-1) > 24).mean() <= 0.01


def drawn_vertices(renderer):
    """Return the vertices of each drawn tile as stored in OpenGL."""
    quads = QUALITY.quads
    held = np.frombuffer(renderer.stream.memory.read(), vertex_dtype(len(BUILT_IN)))
    tile = (quads + 1) ** 2
    held = held[: len(held) // tile * tile].reshape(-1, quads + 1, quads + 1)
    draws = renderer.stream.draws
    return dict(zip(draws.keys, held[draws.slots], strict=True))


def assert_tiles_are_those_of(terrain, renderer):
    """Compare drawn tiles with those of a freshly written terrain; return them."""
    held = drawn_vertices(renderer)
    keys = list(held)
    codes = every = code_of(*np.array(keys).T)
    while (decode(codes)[0] > ROOT_LEVEL).any():
        codes = np.unique(parent_of(codes[decode(codes)[0] > ROOT_LEVEL]))
        every = np.union1d(every, codes)
    store = terrain.vertex_store(len(every), quads=QUALITY.quads)
    above = np.searchsorted(every, parent_of(every))
    parents = np.where(decode(every)[0] > ROOT_LEVEL, above, -1)
    terrain.write_tiles(list(keys_of(every)), np.arange(len(every)), parents, store)
    expected = dict(zip(keys_of(every), store.download(), strict=True))
    assert all((held[key] == expected[key]).all() for key in held)
    return held


def test_visible_tiles_hold_the_new_terrain_when_set_terrain_returns(open_view, camera, before):
    ticks = count()
    bare = replace(QUALITY, without=frozenset({"trees", "shadows", "clouds", "water"}))
    view = open_view(before, quality=bare, timer=lambda: 1e-6 * next(ticks))
    view.frame(camera)
    new, areas = painted(before, ("mountain", 50, 44, 7))
    before_change = drawn_vertices(view.renderer)
    written = view.renderer.stream.written
    view.renderer.set_terrain(new, areas)
    rewritten = view.renderer.stream.written - written
    held = assert_tiles_are_those_of(new, view.renderer)
    different = sum((held[key] != before_change[key]).any() for key in held if key in before_change)
    assert 3 < different <= rewritten < len(view.renderer.stream.tiles.pool.tiles()[0])
    assert view.renderer.terrain.recipe is new.recipe
    other, areas = rebuild(new, new.sketch.replace(ground={**new.sketch.ground, "relief": 260.0}, seed=8))
    assert areas == [EVERYWHERE]
    view.renderer.set_terrain(other, areas)
    assert_tiles_are_those_of(other, view.renderer)


@pytest.mark.slow
def test_a_change_of_everything_equals_a_fresh_renderer(open_view, view, camera, before):
    """Terrain, water, plants, climate, look, hour and clouds at once."""
    old = view.converged(camera)
    wet, areas = river(before)
    new, more = painted(wet, ("mountain", 50, 44, 7), ("forest", 72, 50, 6), ("lake", 78, 48, 6))
    view.renderer.set_terrain(wet, areas)
    view.renderer.set_terrain(new, more)
    last, areas = rebuild(new, red_and_dry(new.sketch))
    view.renderer.set_terrain(last, areas)
    sun, weather = Sun(290.0, 20.0), Weather.from_sketch(before.sketch, clouds=0.9, haze=3.0)
    view.renderer.relight(sun=sun, weather=weather)
    now = view.converged(camera)
    assert not same(now, old)
    assert same(now, open_view(last, sun=sun, weather=weather).converged(camera))


def test_changes_outside_the_view_keep_the_picture_and_another_extent_is_rejected(
    view, camera, before, waves
):
    old = view.converged(camera)
    written = view.renderer.stream.written
    view.renderer.set_terrain(before, [(1200.0, -900.0, 1800.0, 100.0)])  # behind the eye
    assert view.renderer.stream.written - written <= 20
    view.frame(camera)
    assert (view.converged(camera) == old).all()
    with pytest.raises(InputError, match="same extent, 3072 m, got 1000 m"):
        view.renderer.set_terrain(waves, [EVERYWHERE])


OBJECT_KINDS = ("Texture", "Buffer", "Program", "Framebuffer", "VertexArray", "Renderbuffer")


def count_objects(kind):
    """Return the number of existing OpenGL objects of a kind."""
    is_one = gl_function(f"glIs{kind}", ctypes.c_ubyte, ctypes.c_uint)
    return sum(bool(is_one(name)) for name in range(1, 6000))


@pytest.mark.slow
def test_the_feature_overlay_follows_the_terrain(gl, view, camera, before):
    overlay = Overlay(gl, before, view.renderer.stream)
    cache = HeightCache()
    feature_lines(before, cache)
    terrain = before
    for step in range(4):
        terrain, areas = painted(terrain, ("mountain", 48 + step, 36 + 5 * step, 4))
        view.renderer.set_terrain(terrain, areas)
        overlay.set_terrain(terrain, areas)
        cache.invalidate(areas)
        np.testing.assert_array_equal(feature_lines(terrain, cache), feature_lines(terrain))
    pictures = []
    for each in (overlay, Overlay(gl, terrain, view.renderer.stream)):
        view.converged(camera)
        each.draw("features", camera.eye, view.framebuffer, samples=1)
        pictures.append(view.picture())
    assert (pictures[0] == pictures[1]).all()
    assert not same(pictures[0], view.converged(camera))


@pytest.mark.slow
def test_terrain_updates_leak_no_opengl_objects(view, camera, before):
    steps = 40
    wet, areas = river(before)
    both = [wet, before]
    counts = []
    for step in range(steps):
        view.renderer.set_terrain(both[step % 2], areas)
        if step % 10 == 0:
            view.frame(camera)
        if step in (9, steps - 1):
            counts.append([count_objects(kind) for kind in OBJECT_KINDS])
    assert np.all(np.array(counts[1]) <= np.array(counts[0]) + 12), counts


@pytest.mark.slow
def test_released_renderers_leak_no_opengl_objects(open_view, camera, before):
    counts = []
    for step in range(5):  # a leak would add up
        view = open_view(before, quality=replace(QUALITY, tile_memory=4 << 20, plant_distance=200.0))
        view.frame(camera)
        if step % 2 == 0:
            changed, areas = river(before)
            view.renderer.set_terrain(changed, areas)
            view.frame(camera)
        view.renderer.release()
        del view
        counts.append([count_objects(kind) for kind in OBJECT_KINDS])
    assert counts[-1] == counts[0]


SMALL = (160, 90)
CHEAP = replace(Quality.from_level(0.25), map_texels=128, material_texels=128, quads=64, shade_texels=256)
CHEAP = replace(CHEAP, tile_memory=64 << 20, tolerance=2.0, draw_distance=3.0)
CAMERA = Camera((500.0, 100.0, 130.0), (500.0, 800.0, 60.0))


def test_coordinates_wrap_and_are_continuous_near_the_origin():
    near = np.linspace(-0.49, 0.49, 99) * NOISE_PERIOD
    assert [wrap_to_noise_period(x) for x in near] == near.tolist()
    assert np.allclose([wrap_to_noise_period(x + 3.0 * NOISE_PERIOD) for x in near], near, atol=1e-9)


@pytest.mark.slow
def test_a_streamed_picture_converges_to_the_still_one_and_is_smaller_during_motion(open_view, waves):
    expected = open_view(waves, size=SMALL, quality=CHEAP).still(CAMERA)
    ticks = count()  # drawing takes longer than `DRAWING`
    slow = {"quality": replace(CHEAP, budget=10.0), "timer": lambda: 0.04 * next(ticks)}
    view = open_view(waves, size=SMALL, **slow)
    # Hysteresis of tile selection: differences below the tolerance.
    different = np.abs(view.converged(CAMERA, elapsed=0.05) - expected).max(axis=-1) > 8
    assert different.mean() < 0.01
    assert view.stats.size == SMALL
    assert view.stats.tiles_drawn > 0
    assert view.stats.triangles > 1000

    moved = replace(CAMERA, eye=(503.0, 100.0, 130.0))
    stats = view.frame(moved, elapsed=0.05)
    assert round(SMALL[0] * CHEAP.moving_scale) <= stats.size[0] < SMALL[0]
    assert not stats.converged
    # The same picture, coarser.
    small = view.picture()
    assert np.abs(small - view.converged(moved, elapsed=0.05)).mean() < 12.0


def test_no_frame_spends_more_than_its_budget_on_light_and_plants(open_view, waves):
    """Simulated time passes only in calls of the terrain."""
    clock = SimpleNamespace(now=0.0)
    for name, cost in (("heights", 2e-7), ("foliage", 0.0)):
        plain = getattr(waves, name)

        def slow(*arguments, plain=plain, cost=cost, **options):
            result = plain(*arguments, **options)
            clock.now += 4e-4 + cost * np.size(result)
            return result

        setattr(waves, name, slow)
    view = open_view(waves, size=SMALL, quality=CHEAP, timer=lambda: clock.now)
    spent = []
    for k in range(50):
        eye = (500.0 + 12.0 * max(k - 25, 0), 100.0, 130.0)
        each = view.frame(replace(CAMERA, eye=eye), elapsed=0.05)
        spent.append(each.light_seconds + each.plant_seconds)
    assert sum(spent) > 2.0 * CHEAP.budget
    assert max(spent) <= CHEAP.budget


def test_draw_distance_grows_with_height_up_to_a_limit(gl, waves):
    renderer = Renderer(gl, waves, sun=SUN, quality=CHEAP)
    low, high, highest = (
        renderer._clipped(Camera((500.0, 300.0, z), (500.0, 800.0, 0.0)))[:2]
        for z in (130.0, 1000.0, 20_000.0)
    )
    assert low[1] < high[1] < highest[1] == FARTHEST * waves.extent
    for camera, distance in (low, high, highest):
        assert camera.far >= 1.1 * distance * 0.999
        assert 0.1 <= camera.near <= 100.0


def test_depth_state_is_restored_for_other_drawing(gl, waves):
    renderer = Renderer(gl, waves, sun=SUN, quality=CHEAP)
    texture = gl.texture(SMALL, 4)
    framebuffer = gl.framebuffer([texture], gl.depth_texture(SMALL))
    renderer.frame(CAMERA, framebuffer, elapsed=0.05)
    framebuffer.use()
    framebuffer.clear(depth=0.5)
    gl.enable_only(moderngl.DEPTH_TEST)
    place = "vec4(gl_VertexID % 2 * 4 - 1, gl_VertexID / 2 * 4 - 1, 0.5, 1)"
    sheet = gl.program(
        vertex_shader=f"#version 430 core\nvoid main() {{ gl_Position = {place}; }}",
        fragment_shader="#version 430 core\nout vec4 c; void main() { c = vec4(1, 0, 1, 1); }",
    )
    gl.vertex_array(sheet, []).render(vertices=3)
    gl.enable_only(moderngl.NOTHING)
    assert (read_picture(texture) == 0).all()


def test_pictures_in_motion_shrink_while_drawing_is_slow_and_grow_again(open_view, waves):
    step = [0.0]
    clock = SimpleNamespace(now=0.0)

    def timer():
        clock.now += step[0]
        return clock.now

    view = open_view(waves, size=SMALL, quality=replace(CHEAP, moving_scale=0.3), timer=timer)
    widths = []
    for number in range(40):
        step[0] = 0.04 if number < 20 else 0.001  # s from one look at the time to the next
        eye = (500.0 + number, 100.0, 130.0)
        widths.append(view.frame(replace(CAMERA, eye=eye), elapsed=0.05).size[0])
    assert (np.diff(widths[:20]) <= 0).all()
    assert widths[19] == round(0.3 * SMALL[0])
    assert (np.diff(widths[21:]) >= 0).all()
    assert widths[-1] == SMALL[0]
