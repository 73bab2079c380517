from __future__ import annotations

import moderngl
import numpy as np
import pytest

from sketchterrain.errors import DeviceError, InputError
from sketchterrain.render import Camera, Quality, Sun, find_sun, find_view, open_context, render_picture
from sketchterrain.render.frame import FrameBlock
from sketchterrain.render.ground import DrawnGround
from sketchterrain.render.relief import sample_heights
from sketchterrain.render.targets import Targets
from sketchterrain.tiles import select_tiles

SIZE = (320, 180)
SMALL = Quality(samples=1, map_texels=128)


def test_the_chosen_camera_stands_over_the_ground_and_is_always_the_same(waves):
    camera = find_view(waves)
    assert camera == find_view(waves)
    assert camera.eye[2] >= float(waves.heights(*camera.eye[:2])) + 15.0
    assert find_sun(waves, camera) == find_sun(waves, camera)


def test_impossible_sizes_are_refused(waves):
    with pytest.raises(InputError, match="8192"):
        render_picture(waves, size=(0, 100))


def test_no_opengl_is_one_clear_line(monkeypatch):
    def fail(**_):
        raise Exception("libEGL.so.1: no such file")

    monkeypatch.setattr(moderngl, "create_context", fail)
    with pytest.raises(DeviceError, match="apt install libegl1") as caught:
        open_context()
    assert "\n" not in str(caught.value)


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_same_bytes_twice(waves):
    first = render_picture(waves, size=SIZE, quality=SMALL)
    assert first.shape == (180, 320, 3)
    assert first.dtype == np.uint8
    assert (render_picture(waves, size=SIZE, quality=SMALL) == first).all()


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_blue_sky_over_green_ground(waves):
    timings = {}
    camera = Camera((500.0, 100.0, 160.0), (500.0, 700.0, 130.0), far=20_000.0)
    picture = render_picture(
        waves, size=SIZE, camera=camera, sun=Sun(250.0, 35.0), quality=SMALL, timings=timings
    ).astype(float)
    sky, ground = picture[:20].mean(axis=(0, 1)), picture[-40:].mean(axis=(0, 1))
    assert sky[2] > sky[0]
    assert ground[1] > ground[2]
    assert sky.sum() > 1.2 * ground.sum()
    assert {"view", "tiles", "draw"} <= set(timings)


@pytest.mark.gl
@pytest.mark.parametrize(
    ("eye", "target"),
    [
        ((500.0, 100.0, 130.0), (500.0, 800.0, 60.0)),
        ((40.0, 40.0, 95.0), (900.0, 900.0, 40.0)),
        ((-3000.0, 7000.0, 300.0), (-2000.0, 6500.0, 100.0)),
        ((500.0, 400.0, 700.0), (510.0, 430.0, 0.0)),
    ],
)
def test_the_ground_has_no_holes(gl, waves, eye, target):
    camera = Camera(eye, target, near=1.0, far=20_000.0)
    aspect = SIZE[0] / SIZE[1]
    far = sample_heights(waves, eye[:2], 5000.0, 128)
    keys = select_tiles(
        eye, waves.extent, draw_distance=7000.0, frustum=camera.frustum(aspect), height_range=far.bounds
    )
    ground = DrawnGround(gl, waves.extent, keys, waves.tiles(keys))
    frame = FrameBlock(gl)
    frame["to_clip"] = camera.to_clip(aspect)
    frame["eye"] = (0.0, 0.0, eye[2])
    frame.upload()
    targets = Targets(gl, SIZE, 2)
    targets.seen.use()
    targets.seen.clear(depth=1.0)
    gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
    ground.draw(eye)
    gl.enable_only(moderngl.NOTHING)
    depth = np.frombuffer(targets.depth.read(), np.float32).reshape(360, 640)
    covered = depth < 1.0
    # Row 0 is the bottom: where sky has begun in a column, no ground may follow above it.
    first_sky = np.where(covered.all(axis=0), 360, np.argmin(covered, axis=0))
    rows = np.arange(360)[:, None]
    assert covered.any()
    assert not (covered & (rows > first_sky + 2)).any()


@pytest.mark.gl
def test_drawn_surface_is_that_of_its_vertices(gl, waves):
    keys = select_tiles((500.0, 500.0), waves.extent, draw_distance=3000.0)
    ground = DrawnGround(gl, waves.extent, keys, waves.tiles(keys))
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 1000, (2, 300))
    height, cell = ground.surface(x, y)
    assert np.abs(height - waves.heights(x, y)).max() < 0.1
    assert np.isfinite(cell).all()
    outside, far = ground.surface(np.array([1e6]), np.array([0.0]))
    assert np.isnan(outside).all()
    assert np.isinf(far).all()
