"""Pictures of a terrain: the view chosen, refusals, the same bytes twice."""

from __future__ import annotations

import dataclasses

import moderngl
import numpy as np
import pytest

from sketchterrain.errors import DeviceError, InputError
from sketchterrain.render import Camera, Quality, Sun, find_sun, find_view, open_context, render_picture

SIZE = (240, 136)
SMALL = dataclasses.replace(Quality.of(0.25), map_texels=128, material_texels=128, quads=64)


def test_the_default_camera_stands_over_the_ground_and_is_repeatable(waves):
    camera = find_view(waves)
    assert camera == find_view(waves)
    assert camera.eye[2] >= float(waves.heights(*camera.eye[:2])) + 15.0
    assert find_sun(waves, camera) == find_sun(waves, camera)


def test_invalid_sizes_and_a_missing_opengl_are_refused(waves, monkeypatch):
    with pytest.raises(InputError, match="8192"):
        render_picture(waves, size=(0, 100))

    def fail(**_):
        raise Exception("libEGL.so.1: no such file")

    monkeypatch.setattr(moderngl, "create_context", fail)
    with pytest.raises(DeviceError, match="apt install libegl1") as caught:
        open_context()
    assert "\n" not in str(caught.value)


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_a_picture_has_blue_sky_over_green_ground_and_the_same_bytes_twice(waves):
    timings = {}
    camera = Camera((500.0, 100.0, 160.0), (500.0, 700.0, 130.0), far=20_000.0)
    options = {"size": SIZE, "camera": camera, "sun": Sun(250.0, 35.0), "quality": SMALL}
    picture = render_picture(waves, **options, timings=timings)
    assert picture.shape == (136, 240, 3)
    assert picture.dtype == np.uint8
    sky, ground = picture[:15].mean(axis=(0, 1)), picture[-30:].mean(axis=(0, 1))
    assert sky[2] > sky[0]
    assert ground[1] > ground[2]
    assert sky.sum() > 1.2 * ground.sum()
    assert {"view", "tiles", "draw"} <= set(timings)
    assert (render_picture(waves, **options) == picture).all()
