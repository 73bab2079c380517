"""Changes of a terrain while it is drawn: the result is that of a fresh renderer."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.render import Camera, Quality, Renderer, Sun, Weather
from sketchterrain.render.gl_functions import gl_function
from sketchterrain.render.overlay_lines import KnownHeights, feature_lines
from sketchterrain.render.overlays import Overlay
from sketchterrain.render.snapshot import read_picture
from sketchterrain.sketch import Sketch
from sketchterrain.terrain import build, rebuild
from sketchterrain.terrain.changes import EVERYWHERE
from sketchterrain.terrain.vertices import VERTEX
from sketchterrain.tiles.codes import codes_of, keys_of, parent_of, place_of
from sketchterrain.tiles.wanted import ROOT_LEVEL

pytestmark = pytest.mark.gl

SIDE, EXTENT = 96, 3072.0
SIZE = (240, 136)
SUN = Sun(230.0, 35.0)
QUALITY = replace(Quality.of(0.25), map_texels=128, material_texels=128, budget=0.25, tile_memory=32 << 20)


def disc(image, row, column, radius, label=1):
    rows, columns = np.ogrid[:SIDE, :SIDE]
    image[(rows - row) ** 2 + (columns - column) ** 2 <= radius**2] = label


@pytest.fixture(scope="module")
def before():
    layers = {name: np.zeros((SIDE, SIDE), np.uint8) for name in ("mountain", "forest", "river", "lake")}
    disc(layers["mountain"], 20, 60, 8)
    disc(layers["forest"], 66, 40, 9)
    return build(Sketch(extent=EXTENT, seed=3, layers=layers))


def painted(terrain, *strokes):
    """Layer, row, column, radius, label of each stroke."""
    layers = {name: layer.copy() for name, layer in terrain.sketch.layers.items()}
    for layer, *stroke in strokes:
        disc(layers[layer], *stroke)
    return rebuild(terrain, terrain.sketch.replace(layers=layers))


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
    """A renderer and the picture that it draws."""

    def __init__(self, gl, terrain, *, quality=QUALITY):
        self.texture = gl.texture(SIZE, 4)
        self.framebuffer = gl.framebuffer([self.texture])
        self.renderer = Renderer(gl, terrain, sun=SUN, quality=quality)

    def frame(self, camera, *, elapsed=0.1):
        return self.renderer.frame(camera, self.framebuffer, elapsed=elapsed)

    def settled(self, camera):
        for _ in range(300):
            if self.frame(camera).settled:
                return read_picture(self.texture).astype(int)
        raise AssertionError("it never settled")


@pytest.fixture
def view(gl, before, camera):
    view = View(gl, before)
    view.settled(camera)
    return view


def same(picture, other):
    """As close as the golden pictures are held."""
    apart = np.abs(picture - other)
    return apart.mean() <= 1.0 and (apart.max(axis=-1) > 24).mean() <= 0.01


def drawn_vertices(renderer):
    """Of each drawn tile, as OpenGL holds them."""
    quads = QUALITY.quads
    held = np.frombuffer(renderer.ground.memory.read(), VERTEX)
    tile = (quads + 1) ** 2
    held = held[: len(held) // tile * tile].reshape(-1, quads + 1, quads + 1)
    draws = renderer.ground.draws
    return dict(zip(draws.keys, held[draws.slots], strict=True))


def fresh_vertices(terrain, keys):
    """The same, written by a terrain that was never another one."""
    codes = every = codes_of(keys)
    while (place_of(codes)[0] > ROOT_LEVEL).any():
        codes = np.unique(parent_of(codes[place_of(codes)[0] > ROOT_LEVEL]))
        every = np.union1d(every, codes)
    store = terrain.vertex_store(len(every), quads=QUALITY.quads)
    above = np.searchsorted(every, parent_of(every))
    parents = np.where(place_of(every)[0] > ROOT_LEVEL, above, -1)
    terrain.write_tiles(list(keys_of(every)), np.arange(len(every)), parents, store)
    return dict(zip(keys_of(every), store.download(), strict=True))


def test_tiles_hold_the_new_terrain_when_change_returns(view, camera, before):
    new, areas = painted(before, ("mountain", 50, 44, 7))
    before_change = drawn_vertices(view.renderer)
    done = view.renderer.change(new, areas)
    held = drawn_vertices(view.renderer)
    wanted = fresh_vertices(new, list(held))
    assert all((held[key] == wanted[key]).all() for key in held)
    different = sum((held[key] != before_change[key]).any() for key in held if key in before_change)
    assert 3 < different <= done.tiles_rewritten < len(view.renderer.ground.tiles.pool.all()[0])
    assert 0.0 < done.tile_seconds <= done.seconds
    assert view.renderer.terrain.recipe is new.recipe
    other, areas = rebuild(new, new.sketch.replace(ground={**new.sketch.ground, "relief": 260.0}, seed=8))
    assert areas == [EVERYWHERE]
    view.renderer.change(other, areas)
    held = drawn_vertices(view.renderer)
    wanted = fresh_vertices(other, list(held))
    assert all((held[key] == wanted[key]).all() for key in held)


def test_a_change_of_everything_is_that_of_a_fresh_renderer(gl, view, camera, before):
    """Ground, water, plants, climate, look, hour and clouds at once; the slow tests change each alone."""
    old = view.settled(camera)
    wet, areas = river(before)
    new, more = painted(wet, ("mountain", 50, 44, 7), ("forest", 72, 50, 6), ("lake", 78, 48, 6))
    view.renderer.change(wet, areas)
    view.renderer.change(new, more)
    sketch = new.sketch.replace(
        climate={**new.sketch.climate, "aridity": 0.9}, look={"grass": {"colour": "#c83c3c"}}
    )
    last, areas = rebuild(new, sketch)
    view.renderer.change(last, areas)
    sun, weather = Sun(290.0, 20.0), Weather.of(before.sketch, clouds=0.9, haze=3.0)
    view.renderer.relight(sun=sun, weather=weather)
    now = view.settled(camera)
    assert not same(now, old)
    fresh = View(gl, last)
    fresh.renderer = Renderer(gl, last, sun=sun, weather=weather, quality=QUALITY)
    assert same(now, fresh.settled(camera))


RED_GRASS = {"grass": {"colour": "#c83c3c"}}


@pytest.mark.slow
def test_each_kind_of_change_is_that_of_a_fresh_renderer(gl, view, camera, before):
    first = old = view.settled(camera)
    terrain = before
    changes = (
        lambda now: painted(now, ("mountain", 50, 44, 7), ("forest", 72, 50, 6)),
        lambda now: painted(river(now)[0], ("lake", 78, 48, 6)),
        lambda now: rebuild(
            now, now.sketch.replace(climate={**now.sketch.climate, "aridity": 0.9}, look=RED_GRASS)
        ),
        lambda now: rebuild(now, now.sketch.replace(ground={**now.sketch.ground, "relief": 260.0}, seed=8)),
        lambda now: (before, [EVERYWHERE]),
    )
    for number, change in enumerate(changes):
        terrain, areas = change(terrain)
        view.renderer.change(terrain, [EVERYWHERE] if number == 1 else areas)
        now = view.settled(camera)
        assert not same(now, old), number
        assert same(now, first if terrain is before else View(gl, terrain).settled(camera)), number
        old = now
    for sun, weather in (
        (Sun(290.0, 12.0), Weather.of(before.sketch, haze=3.0, wind=9.0)),
        (SUN, Weather.of(before.sketch, clouds=0.0)),
        (SUN, Weather.of(before.sketch, clouds=1.0)),
        (SUN, Weather.of(before.sketch)),
    ):
        view.renderer.relight(sun=sun, weather=weather)
        fresh = View(gl, before)
        fresh.renderer = Renderer(gl, before, sun=sun, weather=weather, quality=QUALITY)
        now = view.settled(camera)
        assert same(now, fresh.settled(camera)), weather
        assert same(now, first) == (weather == Weather.of(before.sketch))


@pytest.mark.slow
def test_a_still_picture_after_a_change_is_that_of_a_fresh_renderer(gl, camera, before):
    new, areas = painted(before, ("mountain", 50, 44, 7), ("forest", 72, 50, 6))
    pictures = []
    for terrain in (before, new):
        view = View(gl, terrain)
        view.renderer.prepare(camera, SIZE)
        view.renderer.draw(camera, view.framebuffer)
        if terrain is before:
            view.renderer.change(new, areas)
            view.renderer.prepare(camera, SIZE)
            view.renderer.draw(camera, view.framebuffer)
        pictures.append(read_picture(view.texture).astype(int))
    assert same(*pictures)


@pytest.mark.slow
def test_the_newest_of_quick_changes_is_shown(gl, view, camera, before):
    terrain = before
    for step in range(6):
        terrain, areas = painted(
            terrain, ("mountain", 40 + 3 * step, 36 + 4 * step, 4), ("forest", 70, 40 + step, 5)
        )
        view.renderer.change(terrain, areas)
        if step % 2:
            view.frame(camera)
            held = drawn_vertices(view.renderer)
            wanted = fresh_vertices(terrain, list(held))
            assert all((held[key] == wanted[key]).all() for key in held)
    assert same(view.settled(camera), View(gl, terrain).settled(camera))


def test_changes_out_of_view_keep_the_picture_and_another_extent_is_refused(view, camera, before):
    old = view.settled(camera)
    done = view.renderer.change(before, [(1200.0, -900.0, 1800.0, 100.0)])  # behind the eye
    assert done.tiles_rewritten <= 20
    view.frame(camera)
    assert (view.settled(camera) == old).all()
    other = build(before.sketch.replace(extent=2 * EXTENT))
    with pytest.raises(InputError, match="same extent, 3072 m, got 6144 m"):
        view.renderer.change(other, [EVERYWHERE])


@pytest.mark.slow
def test_plants_go_with_their_forest_and_the_others_stay(view, camera, before):
    forest = view.renderer.scenery.forest
    many = forest.count
    assert many > 50
    new, areas = painted(before, ("mountain", 60, 40, 3))
    view.renderer.change(new, areas)
    counts = []
    for _ in range(40):  # not one frame is without those that stay
        done = view.frame(camera, elapsed=0.05).settled
        counts.append(forest.count)
        if done:
            break
    assert min(counts) > 0.5 * many
    bare, areas = painted(before, ("forest", 66, 40, 12, 0))
    view.renderer.change(bare, [EVERYWHERE])
    view.frame(camera)
    view.settled(camera)
    assert forest.count < 0.2 * many
    view.renderer.change(before, areas)
    view.settled(camera)
    assert forest.count > 0.8 * many


@pytest.mark.slow
@pytest.mark.parametrize("slow", [False, True])
def test_a_view_at_rest_stays_sharp_if_that_is_quick_and_sharpens_again_if_not(gl, camera, before, slow):
    clock = [0.0]

    def timer():
        clock[0] += 0.2 if slow else 0.0
        return clock[0]

    view = View(gl, before)
    view.renderer = Renderer(gl, before, sun=SUN, quality=replace(QUALITY, budget=50.0), timer=timer)
    view.settled(camera)
    new, areas = painted(before, ("mountain", 50, 44, 7))
    view.renderer.change(new, areas)
    sizes = []
    for _ in range(60):
        stats = view.frame(camera, elapsed=0.05)
        sizes.append(stats.size)
        if stats.size == SIZE:
            break
    assert (len(sizes) == 1) != slow
    assert not stats.settled  # light still follows
    view.frame(replace(camera, eye=(camera.eye[0] + 5.0, *camera.eye[1:])))
    assert view.frame(camera).size != SIZE  # a camera that moves sees a smaller one as before


KINDS = ("Texture", "Buffer", "Program", "Framebuffer", "VertexArray", "Renderbuffer")


def alive(what):
    """How many of the first names are objects of OpenGL's."""
    is_one = gl_function(f"glIs{what}", ctypes.c_ubyte, ctypes.c_uint)
    return sum(bool(is_one(name)) for name in range(1, 6000))


@pytest.mark.slow
def test_the_overlay_of_features_follows(gl, view, camera, before):
    overlay = Overlay(gl, before, view.renderer.ground)
    known = KnownHeights()
    feature_lines(before, known)
    terrain = before
    for step in range(4):
        terrain, areas = painted(terrain, ("mountain", 48 + step, 36 + 5 * step, 4))
        view.renderer.change(terrain, areas)
        overlay.change(terrain, areas)
        known.change(areas)
        for kept, fresh in zip(feature_lines(terrain, known), feature_lines(terrain), strict=True):
            np.testing.assert_array_equal(kept, fresh)
    pictures = []
    for each in (overlay, Overlay(gl, terrain, view.renderer.ground)):
        view.settled(camera)
        each.draw("features", camera.eye, view.framebuffer, samples=1)
        pictures.append(read_picture(view.texture).astype(int))
    assert (pictures[0] == pictures[1]).all()
    assert not same(pictures[0], view.settled(camera))


@pytest.mark.slow
def test_changes_leave_no_opengl_objects_behind(view, camera, before):
    steps = 200
    wet, areas = river(before)
    terrains = [wet, before]
    counts = []
    for step in range(steps):
        view.renderer.change(terrains[step % 2], areas)
        if step % 10 == 0:
            view.frame(camera)
        if step in (9, steps - 1):
            counts.append([alive(what) for what in KINDS])
    assert np.all(np.array(counts[1]) <= np.array(counts[0]) + 12), counts


@pytest.mark.slow
def test_another_hour_while_the_ground_changes(gl, view, camera, before):
    """Neither starves the other."""
    terrain = before
    for step in range(5):
        terrain, areas = painted(terrain, ("mountain", 40 + 3 * step, 36 + 4 * step, 4))
        view.renderer.change(terrain, areas)
        view.frame(camera)
        view.renderer.relight(sun=Sun(230.0 + 5 * step, 30.0))
        view.frame(camera)
    fresh = View(gl, terrain)
    fresh.renderer = Renderer(gl, terrain, sun=Sun(250.0, 30.0), quality=QUALITY)
    assert same(view.settled(camera), fresh.settled(camera))


@pytest.mark.slow
def test_light_follows_though_the_ground_changes_all_the_time(view, camera, before):
    terrains = [painted(before, ("mountain", 50, 44, 7))[0], before]
    layers = view.renderer.scenery.lit._layers
    for step in range(50):
        view.renderer.change(terrains[step % 2], [(1000.0, 1000.0, 2000.0, 2000.0)])
        view.frame(camera, elapsed=0.05)
    assert all(layer.version > 20 for _, layer in layers)


@pytest.mark.slow
def test_renderers_leave_no_opengl_objects_behind(gl, camera, before):
    counts = []
    for step in range(20):  # what each leaves would be there twenty times
        view = View(gl, before, quality=replace(QUALITY, tile_memory=4 << 20))
        view.frame(camera)
        if step % 4 == 0:
            changed, areas = river(before)
            view.renderer.change(changed, areas)
            view.frame(camera)
        view.renderer.release()
        del view
        counts.append([alive(what) for what in KINDS])
    assert counts[-1] == counts[0]
