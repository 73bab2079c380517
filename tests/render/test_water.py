"""Functions of the shaders of water against NumPy, closed forms and integrals."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import erfc
from scipy.stats import norm

from sketchterrain.resources import source

from .test_shaders import HEADER, evaluate, smoothstep

OPTICS = ["render/water_optics.glsl"]
INDEX = 1.333


def rows(*columns):
    columns = np.broadcast_arrays(*(np.asarray(c, np.float64) for c in columns))
    return np.stack([*columns, *columns[:1] * (4 - len(columns))], axis=-1)


@pytest.mark.gl
def test_smooth_water_refracts_by_snell_and_mirrors_by_schlick(gl):
    angle = np.linspace(0.0, np.pi / 2, 91)
    got = evaluate(gl, OPTICS, "vec4(refracted_cosine(a.x))", rows(np.cos(angle)))[:, 0]
    np.testing.assert_allclose(np.sqrt(1 - got**2) * INDEX, np.sin(angle), atol=2e-4)
    cosine = np.linspace(0.0, 1.0, 101)
    got = evaluate(gl, OPTICS, "vec4(mirrored_share(a.x, 0.0))", rows(cosine))[:, 0]
    head_on = ((INDEX - 1) / (INDEX + 1)) ** 2
    np.testing.assert_allclose(got, head_on + (1 - head_on) * (1 - cosine) ** 5, atol=3e-4)


def seen_mean(function, cosine, spread):
    """Mean over normally distributed slopes towards the eye, each by the area that the eye sees of it."""
    s = np.linspace(-8, 8, 4001) * spread
    sine = np.sqrt(1 - cosine**2)
    weight = norm.pdf(s, scale=spread) * np.maximum(cosine + s * sine, 0.0)
    return np.sum(weight * function(s)) / np.sum(weight)


@pytest.mark.gl
def test_rough_water_mirrors_about_the_mean_of_its_visible_facets(gl):
    cosine = np.linspace(0.03, 1.0, 40)
    for spread in (0.03, 0.1, 0.2):
        got = evaluate(gl, OPTICS, f"vec4(mirrored_share(a.x, {spread}))", rows(cosine))[:, 0]

        def mean(c, spread=spread):
            def schlick(s):
                tilted = np.clip((c + s * np.sqrt(1 - c * c)) / np.hypot(1, s), 0, 1)
                return 0.0203 + 0.9797 * (1 - tilted) ** 5

            return seen_mean(schlick, c, spread)

        np.testing.assert_allclose(got, [mean(c) for c in cosine], atol=0.06, err_msg=f"spread {spread}")


@pytest.mark.gl
def test_visible_facets_have_the_exact_mean_slope_and_smiths_shadowing(gl):
    cosine = np.linspace(0.005, 0.999, 60)
    for spread in (0.02, 0.1, 0.3):
        got = evaluate(gl, OPTICS, f"vec4(seen_slope(a.x, {spread}))", rows(cosine))[:, 0]
        a = cosine / (spread * np.sqrt(1 - cosine**2))
        exact = spread / (a + np.exp(norm.logpdf(a) - norm.logcdf(a)))
        np.testing.assert_allclose(got, exact, rtol=2e-3, err_msg=f"spread {spread}")
        np.testing.assert_allclose(exact, [seen_mean(lambda s: s, c, spread) for c in cosine], rtol=2e-3)

    spread = 0.15
    cosine = np.linspace(0.02, 0.9, 60)
    got = evaluate(gl, OPTICS, f"vec4(hidden_share(a.x, {spread}))", rows(cosine))[:, 0]
    a = cosine / (np.sqrt(2) * spread * np.sqrt(1 - cosine**2))
    exact = (np.exp(-a * a) - a * np.sqrt(np.pi) * erfc(a)) / (2 * a * np.sqrt(np.pi))
    np.testing.assert_allclose(1 / (1 + got), 1 / (1 + exact), atol=4e-3)


@pytest.mark.gl
def test_glitter_sends_no_more_light_than_fresnel_mirrors(gl):
    up, azimuth = np.meshgrid((np.arange(300) + 0.5) / 300, (np.arange(600) + 0.5) / 600 * 2 * np.pi)
    side = np.sqrt(1 - up**2)
    eyes = rows(side.ravel() * np.cos(azimuth.ravel()), side.ravel() * np.sin(azimuth.ravel()), up.ravel())
    for spread, height in ((0.05, 0.7), (0.15, 0.3), (0.25, 0.15)):
        sun = f"vec3({np.sqrt(1 - height**2)}, 0.0, {height})"
        call = f"vec4(glitter(a.xyz, {sun}, vec2(0.0), {spread}))"
        got = evaluate(gl, OPTICS, call, eyes)[:, 0].astype(np.float64)
        sent = np.sum(got * eyes[:, 2]) * 2 * np.pi / eyes.shape[0]
        share = evaluate(gl, OPTICS, "vec4(mirrored_share(a.x, a.y))", rows([height], [spread]))[0, 0]
        assert 0.5 * share * height < sent < 1.1 * share * height, (spread, height)
        assert (got >= 0).all(), (spread, height)


@pytest.mark.gl
def test_light_is_absorbed_along_its_path_through_water(gl):
    depth, up, down = np.meshgrid(np.linspace(0, 30, 16), [0.67, 0.8, 1.0], [0.7, 1.0])
    inputs = rows(depth.ravel(), up.ravel(), down.ravel())
    call = "vec4(let_through(vec3(0.5, 0.2, 0.1), a.x, a.y, a.z), 0.0)"
    got = evaluate(gl, OPTICS, call, inputs)
    for channel, extinction in enumerate((0.5, 0.2, 0.1)):
        way = inputs[:, 0] / inputs[:, 1] + inputs[:, 0] / inputs[:, 2]
        np.testing.assert_allclose(got[:, channel], np.exp(-extinction * way), atol=1e-6)
    deep = evaluate(gl, OPTICS, "vec4(deep_colour(vec3(a.x), vec3(a.y)), 0.0)", rows([0.5], [0.02]))[0, 0]
    assert deep == pytest.approx(0.33 * 0.02 / 0.52, rel=1e-5)


@pytest.mark.gl
def test_far_foam_covers_what_near_foam_does(gl):
    noise = 0.5 * norm.ppf((np.arange(2000) + 0.5) / 2000)
    shared, covered = "vec4(foam_share(a.x, a.z, a.y))", "vec4(foam_cover(a.x, a.z, a.y))"
    files = ["render/water_foam.glsl"]
    for amount in (0.05, 0.2, 0.5):
        near = evaluate(gl, files, shared, rows(noise, 0.0, amount))[:, 0].mean()
        far = evaluate(gl, files, shared, rows([0.0], 0.5, amount))[0, 0]
        assert far == pytest.approx(near, abs=0.13), amount
        share, web = np.linspace(0, 1, 21), np.linspace(-1, 1, 21)
        got = evaluate(gl, files, covered, rows(share, web, amount))[:, 0]
        threads = 1 - smoothstep(0.02, 0.28, np.abs(web))
        blanket = smoothstep(0.06, 0.4, amount) * share
        expected = 0.85 * share * (0.75 * threads * (1 - blanket) + blanket)
        np.testing.assert_allclose(got, expected, atol=1e-6, err_msg=str(amount))
    assert (evaluate(gl, files, shared, rows(noise, 0.0, 0.0)) == 0).all()


@pytest.mark.gl
def test_foam_lies_on_steep_streams_and_at_shores(gl):
    across = np.linspace(-1, 1, 41)
    calm, steep = (
        evaluate(gl, ["render/water_foam.glsl"], f"vec4(stream_foam({fall}, a.x))", rows(across))[:, 0]
        for fall in (0.001, 0.25)
    )
    bank = smoothstep(0.72, 0.98, np.abs(across))
    np.testing.assert_allclose(calm, 0.0015 + 0.008 * bank, atol=1e-6)
    np.testing.assert_allclose(steep, np.minimum(0.5015 + 0.158 * bank, 0.8), atol=1e-6)
    depth = np.linspace(0, 1, 101)
    shore = evaluate(gl, ["render/water_foam.glsl"], "vec4(shore_foam(a.x, 0.0, 0.15))", rows(depth))[:, 0]
    assert abs(depth[shore.argmax()] - 0.45 * 0.15) < 0.02
    assert (shore[depth > 0.3] < 0.01).all()


@pytest.mark.gl
def test_banks_are_wet_near_the_water_and_low_above_it(gl):
    above, room = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-12, 5, 35))
    call = "vec4(wetness_beside(a.x, a.y, 0.1))"
    got = evaluate(gl, ["render/water_wetness.glsl"], call, rows(above.ravel(), room.ravel()))[:, 0]
    expected = (1 - smoothstep(0.14, 0.52, above + 0.1)) * smoothstep(-7.0, -2.8, room + 0.4)
    np.testing.assert_allclose(got, expected.ravel(), atol=1e-5)


@pytest.mark.gl
def test_streams_flow_fastest_in_the_middle_and_textures_restart_unseen(gl):
    time = np.linspace(0.0, 3.0, 301)
    call = "vec4(flow_phase(a.x, 0.0), flow_phase(a.x, 1.0))"
    text = [source("render/water_waves.glsl")]
    assert "RENEWAL = 3.2" in text[0]
    got = evaluate(_with_waves(gl), ["render/water_waves.glsl"], call, rows(time))
    np.testing.assert_allclose(got[:, 1] ** 2 + got[:, 3] ** 2, 1.0, atol=1e-5)
    for offset, weight in (got[:, :2].T, got[:, 2:].T):
        jumps = np.abs(np.diff(offset)) > 1.0
        assert jumps.any()
        assert (np.minimum(weight[:-1], weight[1:])[jumps] < 0.03).all()
        np.testing.assert_allclose(np.diff(offset)[~jumps], 3.2 * 0.01, atol=1e-3)

    across = np.linspace(-1.5, 1.5, 61)
    call = "vec4(stream_profile(a.x))"
    got = evaluate(_with_waves(gl), ["render/water_waves.glsl"], call, rows(across))[:, 0]
    np.testing.assert_allclose(got, np.maximum(1 - np.abs(across) ** 3, 0), atol=1e-6)
    assert got[np.abs(across) <= 1].mean() == pytest.approx(0.75, abs=0.03)


def _with_waves(gl):
    """A context that builds programs with the macro that the waves need."""
    return SimpleNamespace(
        program=lambda vertex_shader, varyings: gl.program(
            vertex_shader=vertex_shader.replace(HEADER, HEADER + "#define WAVES 1\n"), varyings=varyings
        ),
        framebuffer=gl.framebuffer,
        texture=gl.texture,
        buffer=gl.buffer,
        vertex_array=gl.vertex_array,
    )
