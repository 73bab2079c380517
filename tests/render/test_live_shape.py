"""The shape that frames of low quality show, beside the still's."""

import numpy as np
import pytest

from sketchterrain.benchmarks.live import LatencyProbe
from sketchterrain.benchmarks.live_shape import (
    PictureShape,
    columns_alike,
    measured_engine,
    saved_shape,
    still_shape,
    water_overlap,
)
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build, rebuild
from sketchterrain.geometry.camera import Camera
from sketchterrain.render import sky
from sketchterrain.render.offscreen import canvas, read_picture
from sketchterrain.render.quality import ON_CPU, Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import LARGE_WORLD, Sun
from sketchterrain.render.views import find_view
from sketchterrain.ui.view3d.camera import overview
from tests import terrains

pytestmark = [pytest.mark.gl, pytest.mark.slow]
SIZE = (320, 180)
PLAIN = ("clouds", "trees", "rocks", "grass", "shadows")


def whole(terrain):
    pose = overview((0.0, 0.0, *terrain.size), 0.0, aspect=SIZE[0] / SIZE[1])
    return Camera(pose.eye, pose.target, fov=pose.fov)


def assert_alike(renderer, terrain, camera):
    shape, still = PictureShape(*renderer.shape(camera, SIZE)), still_shape(terrain, camera, SIZE)
    assert columns_alike(shape, still) >= 0.99
    assert water_overlap(shape, still) >= 0.8


def wait_until_alike(probe, saved):
    """Wait for a frame of the window's camera that has the shape of its still."""
    facts, terrain = probe.frames[-1][1], build(probe.document.sketch, device=terrains.context())
    size, pose = (facts.width, facts.height), facts.pose
    still = still_shape(terrain, Camera(pose.eye, pose.target, fov=pose.fov), size)

    def is_alike():
        shape = saved_shape(saved, size)
        return columns_alike(shape, still) >= 0.99 and water_overlap(shape, still) >= 0.8

    probe.wait(is_alike)


@pytest.mark.parametrize("level", [0.0, ON_CPU])
@pytest.mark.parametrize("camera", [find_view, whole])
def test_live_views_have_the_silhouettes_and_the_water_of_the_still(camera, level):
    terrain = terrains.preset("mountain_pass")
    with canvas(SIZE) as (context, _, framebuffer):
        quality = Quality.from_level(level, without=PLAIN)
        renderer = Renderer(context, terrain, sun=Sun(180.0), quality=quality)
        for _ in range(4):
            stats = renderer.frame(camera(terrain), framebuffer, elapsed=0.3, budget=60.0)
        assert stats.size == SIZE
        assert_alike(renderer, terrain, camera(terrain))


def test_a_large_sketch_seen_as_a_whole_has_twice_the_contrast_of_real_air(monkeypatch):
    image = np.zeros((64, 64), np.uint8)
    image[14:24, 12:32] = image[36:44, 28:50] = 1
    terrain = build(Sketch(extent=65_536.0, layers={"mountain": image}), device=terrains.context())
    found = []
    for power in (0.0, LARGE_WORLD[1]):
        monkeypatch.setattr(sky, "LARGE_WORLD", (LARGE_WORLD[0], power))
        with canvas(SIZE) as (context, texture, framebuffer):
            renderer = Renderer(context, terrain, sun=Sun(120.0, 40.0), quality=Quality.for_still(SIZE))
            renderer.prepare(whole(terrain), SIZE)
            renderer.draw(whole(terrain), framebuffer)
            ground = renderer.shape(whole(terrain), SIZE)[2]
            found.append((read_picture(texture)[..., :3] @ (0.2126, 0.7152, 0.0722))[ground].std())
    assert found[1] > 2.0 * found[0]


def test_the_first_frame_of_a_changed_terrain_shows_its_shape():
    plain, image = terrains.plain(), np.zeros((64, 64), np.uint8)
    image[24:34, 16:48] = 1
    camera = Camera((512.0, -600.0, 300.0), (512.0, 600.0, 0.0), fov=50.0)
    with canvas(SIZE) as (context, _, framebuffer):
        quality = Quality.from_level(ON_CPU, without=PLAIN)
        renderer = Renderer(context, plain, sun=Sun(180.0), quality=quality)
        for _ in range(4):
            renderer.frame(camera, framebuffer, elapsed=0.3, budget=60.0)
        terrain, areas = rebuild(plain, plain.sketch.replace(layers={"mountain": image}))
        renderer.set_terrain(terrain, areas)
        renderer.frame(camera, framebuffer, elapsed=0.02, budget=60.0)
        assert_alike(renderer, terrain, camera)


def test_the_window_shows_the_shape_of_the_still_at_rest_and_after_a_stroke(tmp_path):
    saved, sketch = tmp_path / "shape", load_sketch("mountain_pass")
    with measured_engine(saved):
        probe = LatencyProbe(sketch)
    try:
        probe.look(overview((0.0, 0.0, *sketch.size), 0.0, aspect=16 / 9))
        wait_until_alike(probe, saved)
        probe.stroke("mountain", 1, [(300.0 + x, 200.0) for x in range(0, 120, 4)], 30.0)
        wait_until_alike(probe, saved)
    finally:
        probe.end()
