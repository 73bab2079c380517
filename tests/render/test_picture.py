from __future__ import annotations

import moderngl
import numpy as np
import pytest

from sketchterrain.errors import DeviceError, InputError
from sketchterrain.render import Camera, Quality, Sun, find_sun, find_view, open_context, render_picture

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
