"""Where clouds are, and what they let through."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sketchterrain.render import Camera, Quality, Renderer, Sun, Weather
from sketchterrain.render.clouds import cloud_defines, cloud_field, cloud_puffs
from sketchterrain.render.frame import NOISE_PERIOD

from .test_shaders import evaluate

FRAME = "render/frame.glsl"
EARTH = 6360e3


def test_clouds_cover_the_share_asked_for_and_more_cover_only_adds_clouds():
    for cover in (0.05, 0.35, 0.8):
        assert (cloud_field(cover) > 0.0).mean() == pytest.approx(cover, abs=2e-3)
    assert (cloud_field(0.0) < 0.0).all()
    assert (cloud_field(1.0) > 0.0).all()
    assert (cloud_field(0.5) > cloud_field(0.3)).all()


def test_fields_of_clouds_tile_without_a_seam_and_fill_their_range():
    field = cloud_field(0.4, 256)
    inner = np.abs(np.diff(field, axis=0)).max()
    assert np.abs(field[0] - field[-1]).max() <= inner
    assert np.abs(field[:, 0] - field[:, -1]).max() <= 1.2 * np.abs(np.diff(field, axis=1)).max()
    puffs = cloud_puffs(32)
    assert puffs.min() == 0.0
    assert puffs.max() == 1.0
    assert 0.3 < puffs.mean() < 0.6
    assert np.abs(puffs[0] - puffs[-1]).mean() < 1.2 * np.abs(np.diff(puffs, axis=0)).mean()


def test_quality_and_weather_choose_how_clouds_are_drawn():
    fair = Weather()
    assert cloud_defines(Quality(), Weather(clouds=0.9)) == {"CLOUDS": 2, "GREY": 1}
    assert cloud_defines(Quality(), fair) == {"CLOUDS": 2, "GREY": 0}
    assert cloud_defines(Quality.of(0.2), fair) == {"CLOUDS": 1, "GREY": 0}
    assert cloud_defines(Quality.of(0.2), Weather(clouds=0.0)) == {"CLOUDS": 0, "GREY": 0}
    assert cloud_defines(Quality.of(1.0, without=["clouds"]), fair)["CLOUDS"] == 0


@pytest.mark.gl
def test_the_distance_to_the_cloud_layer_follows_the_round_earth(gl):
    rise = np.linspace(0.0, 1.0, 50)
    up = 1900.0
    rows = np.c_[np.full(50, up), rise, rise, rise]
    got = evaluate(gl, [FRAME, "render/clouds.glsl"], "vec4(to_layer(a.x, a.y))", rows)[:, 0]
    # Where the line's height over the round ground, to second order, is the layer's.
    assert np.allclose(rise * got + got**2 / (2.0 * EARTH), up, rtol=1e-3)
    assert got[0] == pytest.approx(np.sqrt(2.0 * EARTH * up), rel=1e-4)


@pytest.mark.gl
def test_the_phase_function_of_clouds_integrates_to_one(gl):
    cosine = np.linspace(-1.0, 1.0, 20_001)
    includes = [FRAME, "render/cloud_light.glsl"]
    for g in (-0.15, 0.0, 0.75):
        rows = np.c_[cosine, np.full_like(cosine, g), cosine, cosine]
        share = evaluate(gl, includes, "vec4(scattered(a.x, a.y))", rows)[:, 0].astype(float)
        assert 2.0 * np.pi * np.trapezoid(share, cosine) == pytest.approx(1.0, abs=2e-3), g


def drawn(gl, waves, weather, quality, clock=0.0):
    camera = Camera((500.0, 100.0, 160.0), (500.0, 700.0, 200.0), far=20_000.0)
    renderer = Renderer(gl, waves, sun=Sun(250.0, 35.0), weather=weather, quality=quality)
    framebuffer = gl.framebuffer([gl.texture((160, 90), 4)])
    renderer.prepare(camera, (160, 90))
    renderer.draw(camera, framebuffer, clock=clock)
    return np.frombuffer(framebuffer.read(components=3), np.uint8).reshape(90, 160, 3)[50:].astype(float)


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.parametrize("number", [0.1, 0.5])
def test_clouds_whiten_the_sky_and_the_wind_moves_them(gl, waves, number):
    plain = Quality.of(number, without=["trees", "grass", "rocks", "water", "detail"])
    quality = dataclasses.replace(plain, quads=64, map_texels=64, material_texels=64, tile_memory=64 << 20)
    clear, fair, later, grey = (
        drawn(gl, waves, weather, quality, clock)
        for weather, clock in (
            (Weather(clouds=0.0), 0.0),
            (Weather(clouds=0.4), 0.0),
            (Weather(clouds=0.4), 200.0),
            (Weather(clouds=1.0), 0.0),
        )
    )
    blue = [float((sky[..., 2] - sky[..., 0]).mean()) for sky in (clear, fair, grey)]
    assert blue[0] > blue[1] + 5.0 > blue[2] + 10.0
    assert np.ptp(grey, axis=2).max() < 30.0
    assert np.abs(fair - later).mean() > 2.0
    # They come round, and do not jump as they begin to move, wherever to.
    for bearing, clock in ((270.0, NOISE_PERIOD / 4.0), (90.0, 0.01)):
        weather = Weather(clouds=0.4, wind_from=bearing)
        assert (
            np.abs(drawn(gl, waves, weather, quality, clock) - drawn(gl, waves, weather, quality)).mean()
            < 0.5
        )
