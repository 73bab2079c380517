"""Surfaces and waves of water, and rivers thinner than a pixel."""

from __future__ import annotations

from types import SimpleNamespace

import moderngl
import numpy as np
import pytest

from sketchterrain.look.water_surfaces import current, strip, surfaces
from sketchterrain.render import Camera
from sketchterrain.render.frame import FrameBlock
from sketchterrain.render.water import Water
from sketchterrain.render.water_waves import (
    LAYERS,
    wave_layers,
    wave_mipmaps,
    wave_phases,
    wave_slopes,
)
from sketchterrain.resources import source

from .test_shaders import evaluate
from .test_water import rows


def river(points, width):
    line = np.asarray(points, np.float64)
    return SimpleNamespace(centreline=line, centreline_width=np.full(len(line), width, np.float32))


def straight(z=(0.0, 0.0), *, width=10.0, start=(0.0, 0.0), end=(1000.0, 0.0), count=101):
    t = np.linspace(0.0, 1.0, count)[:, None]
    ends = np.array([[*start, z[0]], [*end, z[1]]])
    return river(ends[0] + t * (ends[1] - ends[0]), width)


def test_mipmaps_of_waves_keep_what_is_rough():
    levels = wave_mipmaps(wave_slopes())
    assert levels[0].shape == (256, 256, 4)
    assert levels[-1].shape == (1, 1, 4)
    for level in levels:
        np.testing.assert_allclose(level[..., :2].mean(axis=(0, 1)), 0.0, atol=1e-5)
        assert level[..., 2].mean() == pytest.approx(1.0, abs=1e-5)
        # What is not slope any more is roughness, which is no less than nothing.
        assert (level[..., 2] - (level[..., :2] ** 2).sum(axis=-1) > -1e-5).all()
    resolved = [(level[..., :2] ** 2).sum(axis=-1).mean() for level in levels]
    assert (np.diff(resolved) < 0).all()
    assert resolved[0] == pytest.approx(1.0, abs=1e-5)


def test_slopes_of_waves_are_those_of_their_height():
    field = wave_slopes()
    size = len(field)
    for axis, channel in ((1, 0), (0, 1)):
        height = field[..., 2]
        steps = np.roll(height, -1, axis=axis) - np.roll(height, 1, axis=axis)
        # A central difference of a wave of k texels is its slope times sinc(2 / k).
        error = steps * size / 2 - field[..., channel]
        assert np.sqrt(np.mean(error**2)) < 0.25 * np.sqrt(np.mean(field[..., channel] ** 2))


def test_waves_run_with_the_wind_and_come_back_after_a_side():
    layers = wave_layers((3.0, 4.0))
    assert len(layers) == len(LAYERS)
    np.testing.assert_allclose((layers[:, 2] ** 2).sum(), 1.0)
    for layer, (side, turn, _) in zip(layers, LAYERS, strict=True):
        assert np.hypot(*layer[:2]) == pytest.approx(1 / side)
        assert np.arctan2(layer[1], layer[0]) == pytest.approx(np.arctan2(4, 3) + turn)
    here = wave_phases(layers, (5e6, -3e6, 10.0), 7.0)
    assert ((here >= 0) & (here < 1)).all()
    step = layers[:, :2] / np.hypot(*layers[:, :2].T)[:, None] ** 2
    for k, (east, north) in enumerate(step):
        there = wave_phases(layers, (5e6 + east, -3e6 + north, 10.0), 7.0)[k]
        np.testing.assert_allclose((there - here[k] + 0.5) % 1.0, 0.5, atol=1e-6)
        # A crest that lies at the eye lies downwind of it a moment later.
        later = wave_phases(layers, (5e6, -3e6, 10.0), 7.01)[k]
        moved = (later[0] - here[k][0] + 0.5) % 1.0 - 0.5
        assert -0.1 < moved < 0
    assert wave_layers((3.0, 4.0), 1)[0, 2] == 1.0


def test_the_speed_of_a_river_follows_mannings_formula():
    line = straight((5.0, 0.0), width=18.0)
    speed, fall = current(line.centreline, line.centreline_width)
    np.testing.assert_allclose(fall, 0.005)
    np.testing.assert_allclose(speed, 4 / 3 * np.sqrt(0.005) / 0.042, rtol=1e-9)
    still = straight()
    speed, fall = current(still.centreline, still.centreline_width)
    assert (fall == 0).all()
    assert (speed == 0.25).all()
    line = straight((20.0, 0.0), width=18.0)
    surface = strip(line.centreline, line.centreline_width)
    assert (surface.nature[:, 3] == 9.0).all()
    assert (surface.nature[:, 2] == 1.0).all()
    np.testing.assert_allclose(surface.nature[:, 1], 0.02)


def features(*rivers, lakes=()):
    return SimpleNamespace(rivers=rivers, lakes=lakes)


def test_one_of_two_waters_is_shown_where_they_meet():
    step = 5.0 * np.arange(41)
    inside = 60.0 - np.hypot(step - 100.0, (step - 100.0)[:, None])
    field = SimpleNamespace(west=900.0, south=-100.0, spacing=5.0, inside=inside.astype(np.float32))
    lake = SimpleNamespace(shape=field, level=0.0)
    main = straight(width=20.0, count=1001)
    tributary = straight(width=8.0, start=(500.0, 300.0), end=(500.0, 0.0))
    sheet_, wide, narrow = surfaces(features(main, tributary, lakes=[lake]))
    assert (sheet_.nature[:, 2] == 1).all()
    off = np.abs(narrow.place[:, 1])
    assert (narrow.nature[off >= 10.0, 2] == 1).all()
    assert (narrow.nature[off <= 5.0, 2] == 0).all()
    from_middle = np.hypot(*(wide.place[:, :2] - [1000.0, 0.0]).T)
    assert (wide.nature[from_middle < 50.0, 2] == 0).all()
    assert (wide.nature[from_middle > 60.0, 2] == 1).all()
    # Where one goes on as the other neither gives way.
    first = straight(width=12.0, end=(500.0, 0.0))
    second = straight(width=10.0, start=(500.0, 0.0))
    for surface in surfaces(features(first, second)):
        shown = surface.nature[:, 2].reshape(101, -1)
        assert (shown[2:-2] == 1).all()


@pytest.mark.gl
def test_a_strip_is_no_thinner_than_a_pixel_and_covers_no_more(gl):
    rng = np.random.default_rng(3)
    width = np.exp(rng.uniform(np.log(0.01), np.log(20.0), 400))
    off = rng.uniform(-1, 1, 400)
    call = "vec4(widened(vec2(30.0, 40.0) + a.y * vec2(-0.6, 0.8), vec2(30.0, 40.0),"
    call += " vec2(30.0, 40.0) + 0.5 * a.x * vec2(-0.6, 0.8), vec2(0.8, 0.6) * 7.0), 0.0)"
    got = evaluate(gl, ["render/water_strip.glsl"], call, rows(width, 0.5 * width * off))
    drawn = (got[:, :2] - [30.0, 40.0]) @ [-0.6, 0.8]
    times = np.maximum(1.25 / width, 1.0)
    np.testing.assert_allclose(got[:, 2], 1 / times, rtol=1e-4)
    np.testing.assert_allclose(drawn, 0.5 * width * off * times, atol=2e-4)
    along = (got[:, :2] - [30.0, 40.0]) @ [0.8, 0.6]
    np.testing.assert_allclose(along, 0.0, atol=2e-5)


PLAIN = """#version 430 core
in float wet_room; in float coverage; out vec4 radiance;
void main() { if (wet_room < 0.0) discard; radiance = vec4(1.0, 1.0, 1.0, coverage); }
"""


@pytest.mark.gl
def test_a_far_river_fades_by_its_share_of_a_pixel(gl, monkeypatch):
    """Its light in a column of the picture is its width in pixels, from many of them to a fifth of one."""
    read = source

    def plain(name):
        return PLAIN if name == "render/water.frag.glsl" else read(name)

    monkeypatch.setattr("sketchterrain.render.programs.source", plain)
    size = (64, 256)
    far = straight(width=24.0, start=(-4e4, 0.0), end=(4e4, 0.0), count=2001)
    water = Water(gl, features(far), defines={"MATERIALS": 1})
    array = water._arrays[-1]
    target = gl.framebuffer([gl.texture(size, 4, dtype="f4")], gl.depth_texture(size))
    frame = FrameBlock(gl)
    expected, got = [], []
    for distance in np.geomspace(100.0, 20_000.0, 80):
        eye = (0.0, -float(distance), 0.35 * float(distance))
        camera = Camera(eye, (0.0, 0.0, 0.0), fov=40.0, near=1.0, far=1e5)
        to_clip = camera.to_clip(size[0] / size[1])
        frame["to_clip"], frame["reach"] = to_clip, (1e5, 0.0, *size)
        frame.upload()
        edges = np.array([[0.0, y, 0.0, 1.0] for y in (-12.0, 12.0)]) - [*eye, 0.0]
        clip = edges @ np.asarray(to_clip).T
        rows_ = clip[:, 1] / clip[:, 3] * 0.5 * size[1]
        expected.append(abs(rows_[1] - rows_[0]))
        target.use()
        target.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        gl.enable_only(moderngl.BLEND)
        gl.blend_func = moderngl.DEFAULT_BLENDING
        array.program["lift"].value = 1.0  # as far away: no water in the banks
        array.program["anchor"].value = tuple(water._anchor - eye)
        array.render()
        pixels = np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(*size[::-1], 4)
        got.append(pixels[..., 0].sum(axis=0))
        assert (got[-1] > 0).all()
    gl.disable(moderngl.BLEND)
    mean = np.array([column.mean() for column in got])
    expected = np.array(expected)
    assert expected.min() < 0.2 < 10 < expected.max()
    # Rows are whole: a strip of 1.25 px covers one or two of them.
    np.testing.assert_allclose(mean, expected, atol=1.0)
    thin = expected < 1.25
    assert (mean[thin] / expected[thin] > 0.7).all()
    assert (mean[thin] / expected[thin] < 1.7).all()
    assert (np.abs(np.diff(mean[thin])) < 0.6).all()


@pytest.mark.gl
def test_water_left_out_is_not_drawn(gl):
    assert not Water(gl, features(straight()), part=False)
    assert not Water(gl, features())
