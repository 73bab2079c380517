import dataclasses

import moderngl
import numpy as np
import pytest

from sketchterrain.render import Camera, Quality, Renderer, Sun
from sketchterrain.render.draw_distance import FARTHEST
from sketchterrain.render.frame import NOISE_PERIOD, within_period

SIZE = (160, 90)
SUN = Sun(250.0, 35.0)
CHEAP = dataclasses.replace(
    Quality.of(0.25),
    quads=64,
    map_texels=128,
    material_texels=128,
    shade_texels=256,
    tile_memory=64 << 20,
    tolerance=2.0,
    reach=3.0,
)
HASTY = dataclasses.replace(CHEAP, budget=1.0)
"""For tests that wait for the end: a slow machine must not make them slow."""
CAMERA = Camera((500.0, 100.0, 130.0), (500.0, 800.0, 60.0))

pytestmark = pytest.mark.gl


class Clock:
    """Goes on by a set step at each look, and by what the terrain's answers are said to take."""

    def __init__(self, step=2e-5):
        self.now, self.step = 0.0, step

    def __call__(self):
        self.now += self.step
        return self.now


def canvas(gl):
    return gl.framebuffer([gl.texture(SIZE, 4)])


def picture(framebuffer):
    return np.frombuffer(framebuffer.read(components=3), np.uint8).reshape(SIZE[1], SIZE[0], 3).astype(int)


def streamed(renderer, camera, framebuffer, *, frames=200):
    """Draw frames until nothing is missing; return what they told."""
    stats = []
    for _ in range(frames):
        stats.append(renderer.frame(camera, framebuffer, elapsed=0.05))
        if stats[-1].settled:
            return stats
    raise AssertionError(f"not settled after {frames} frames: {stats[-1]}")


def test_places_repeat_and_do_not_jump_near_the_origin():
    near = np.linspace(-0.49, 0.49, 99) * NOISE_PERIOD
    assert [within_period(x) for x in near] == near.tolist()
    assert np.allclose([within_period(x + 3.0 * NOISE_PERIOD) for x in near], near, atol=1e-9)


@pytest.mark.slow
def test_a_streamed_picture_ends_as_the_prepared_one(gl, waves):
    framebuffer = canvas(gl)
    still = Renderer(gl, waves, sun=SUN, quality=HASTY)
    still.prepare(CAMERA, SIZE)
    still.draw(CAMERA, framebuffer)
    expected = picture(framebuffer)
    renderer = Renderer(gl, waves, sun=SUN, quality=HASTY)
    stats = streamed(renderer, CAMERA, framebuffer)
    assert stats[-1].size == SIZE
    # Tiles that were once nearer in the choice may still differ by less than the tolerance.
    different = np.abs(picture(framebuffer) - expected).max(axis=-1) > 8
    assert different.mean() < 0.01
    assert stats[-1].tiles_drawn > 0
    assert stats[-1].triangles > 1000


@pytest.mark.slow
def test_a_moving_eye_gets_a_smaller_picture_at_once(gl, waves):
    framebuffer = canvas(gl)
    renderer = Renderer(gl, waves, sun=SUN, quality=HASTY)
    streamed(renderer, CAMERA, framebuffer)
    moved = dataclasses.replace(CAMERA, eye=(503.0, 100.0, 130.0))
    stats = renderer.frame(moved, framebuffer, elapsed=0.05)
    scale = CHEAP.moving_scale
    assert stats.size == (round(SIZE[0] * scale), round(SIZE[1] * scale))
    assert not stats.settled
    # It is the same picture, only coarser.
    small = picture(framebuffer)
    streamed(renderer, moved, framebuffer)
    assert np.abs(small - picture(framebuffer)).mean() < 12.0


def test_no_frame_spends_more_than_its_budget_on_light_and_plants(gl, waves):
    """Time stands still but for what is asked of the terrain: all of it is counted, none is overdrawn."""
    clock = Clock(step=0.0)
    for name, cost in (("heights", 2e-7), ("foliage", 0.0)):
        plain = getattr(waves, name)

        def slow(*arguments, plain=plain, cost=cost, **options):
            result = plain(*arguments, **options)
            clock.now += 4e-4 + cost * np.size(result)
            return result

        setattr(waves, name, slow)
    renderer = Renderer(gl, waves, sun=SUN, quality=CHEAP, timer=clock)
    framebuffer = canvas(gl)
    spent = []
    for k in range(80):
        eye = (500.0 + 12.0 * max(k - 40, 0), 100.0, 130.0)
        each = renderer.frame(dataclasses.replace(CAMERA, eye=eye), framebuffer, elapsed=0.05)
        spent.append(each.light_seconds + each.plant_seconds)
    assert sum(spent) > 2.0 * CHEAP.budget
    assert max(spent) <= CHEAP.budget


def test_draw_distance_grows_with_height_and_has_an_end(gl, waves):
    renderer = Renderer(gl, waves, sun=SUN, quality=CHEAP)
    low, high, highest = (
        renderer._clipped(Camera((500.0, 300.0, z), (500.0, 800.0, 0.0)))[:2]
        for z in (130.0, 1000.0, 20_000.0)
    )
    assert low[1] < high[1] < highest[1] == FARTHEST * waves.extent
    for camera, distance in (low, high, highest):
        assert camera.far >= 1.1 * distance * 0.999
        assert 0.1 <= camera.near <= 100.0


@pytest.mark.slow
def test_water_hides_under_no_ground_that_is_within_the_tolerance(gl, waves):
    """Seen from above the river is a band of water of its own width, however coarse the ground is."""
    blue = []
    camera = Camera((500.0, 120.0, 260.0), (500.0, 500.0, 0.0))
    framebuffer = canvas(gl)
    for tolerance in (1.0, 6.0):
        quality = dataclasses.replace(CHEAP, tolerance=tolerance)
        renderer = Renderer(gl, waves, sun=SUN, quality=quality)
        renderer.prepare(camera, SIZE)
        renderer.draw(camera, framebuffer)
        shown = picture(framebuffer)
        dry = Renderer(gl, type(waves)(rivers=False), sun=SUN, quality=quality)
        dry.prepare(camera, SIZE)
        dry.draw(camera, framebuffer)
        blue.append((np.abs(shown - picture(framebuffer)).max(axis=-1) > 10).mean())
    assert blue[0] > 0.01
    assert blue[1] == pytest.approx(blue[0], rel=0.25)


def test_depth_testing_is_left_as_other_drawing_expects_it(gl, waves):
    renderer = Renderer(gl, waves, sun=SUN, quality=CHEAP)
    framebuffer = gl.framebuffer([gl.texture(SIZE, 4)], gl.depth_texture(SIZE))
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
    assert (picture(framebuffer) == 0).all()
