"""Water: functions against NumPy, closed forms or integrals; surfaces and pictures."""

from dataclasses import replace
from types import SimpleNamespace

import moderngl
import numpy as np
import pytest
from scipy.special import erfc
from scipy.stats import norm

from sketchterrain.geometry.camera import Camera
from sketchterrain.io.resources import source
from sketchterrain.look.objects import (
    ACROSS,
    flow_speed_and_slope,
    lake_surface,
    river_surface,
    terrain_objects,
)
from sketchterrain.render.navigation import intersect_terrain
from sketchterrain.render.programs import bind_textures, set_uniforms
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Sun
from sketchterrain.render.targets import FrameBlock
from sketchterrain.render.water import (
    BAND,
    GRAVITY,
    LAYERS,
    LEVELS,
    STATIONS,
    Water,
    chunk_commands,
    inland_mesh,
    wave_layers,
    wave_mipmaps,
    wave_phases,
    wave_slopes,
)
from sketchterrain.schema.layers import LAYERS as PAINTED

from .conftest import Waves
from .test_shaders import evaluate, smoothstep

OPTICS = ["render/water_optics.glsl"]
WAVES = ["#define WAVES 1\n", "render/water_waves.glsl"]
FOAM = ["render/water_foam.glsl"]
INDEX = 1.333


def rows(*columns):
    columns = np.broadcast_arrays(*(np.asarray(c, np.float64) for c in columns))
    return np.stack([*columns, *columns[:1] * (4 - len(columns))], axis=-1)


@pytest.mark.gl
def test_optics_wetness_and_foam_match_their_formulas(gl):
    """Snell's and Schlick's, absorption along a path, wet banks, foam."""
    cosine, across = np.linspace(0.0, 1.0, 101), np.linspace(-1, 1, 41)
    head_on = ((INDEX - 1) / (INDEX + 1)) ** 2
    depth, up, down = map(np.ravel, np.meshgrid(np.linspace(0, 30, 16), [0.67, 0.8, 1.0], [0.7, 1.0]))
    above, room = map(np.ravel, np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-12, 5, 35)))
    wet = (1 - smoothstep(0.14, 0.52, above + 0.1)) * smoothstep(-7.0, -2.8, room + 0.4)
    bank = smoothstep(0.72, 0.98, np.abs(across))
    water, beside = "let_through(vec3(0.5, 0.2, 0.1), a.x, a.y, a.z)", ["render/water_wetness.glsl"]
    for files, call, inputs, expected, bound in (
        (OPTICS, "mirrored_share(a.x, 0.0)", [cosine], head_on + (1 - head_on) * (1 - cosine) ** 5, 3e-4),
        *(
            (
                OPTICS,
                f"{water}[{n}]",
                [depth, up, down],
                np.exp(-k * (depth / up + depth / down)),
                1e-6,
            )
            for n, k in enumerate((0.5, 0.2, 0.1))
        ),
        (OPTICS, "deep_colour(vec3(a.x), vec3(a.y)).x", [[0.5], [0.02]], 0.33 * 0.02 / 0.52, 1.2e-7),
        (beside, "wetness_beside(a.x, a.y, 0.1)", [above, room], wet, 1e-5),
        (FOAM, "stream_foam(0.001, a.x)", [across], 0.0015 + 0.008 * bank, 1e-6),
        (FOAM, "stream_foam(0.25, a.x)", [across], np.minimum(0.5015 + 0.158 * bank, 0.8), 1e-6),
    ):
        got = evaluate(gl, files, f"vec4({call})", rows(*inputs))[:, 0]
        np.testing.assert_allclose(got, expected, atol=bound, err_msg=call)
    angle = np.linspace(0.0, np.pi / 2, 91)
    got = evaluate(gl, OPTICS, "vec4(refracted_cosine(a.x))", rows(np.cos(angle)))[:, 0]
    np.testing.assert_allclose(np.sqrt(1 - got**2) * INDEX, np.sin(angle), atol=2e-4)
    depth = np.linspace(0, 1, 101)
    shore = evaluate(gl, FOAM, "vec4(shore_foam(a.x, 0.0, 0.15))", rows(depth))[:, 0]
    assert abs(depth[shore.argmax()] - 0.45 * 0.15) < 0.02
    assert (shore[depth > 0.3] < 0.01).all()


def seen_mean(function, cosine, spread):
    """Mean over normally distributed slopes towards the eye, each by the area that the eye sees of it."""
    s = np.linspace(-8, 8, 4001) * spread
    sine = np.sqrt(1 - cosine**2)
    weight = norm.pdf(s, scale=spread) * np.maximum(cosine + s * sine, 0.0)
    return np.sum(weight * function(s)) / np.sum(weight)


@pytest.mark.gl
def test_rough_reflectance_slope_and_shadowing_match_integrals(gl):
    cosine = np.linspace(0.03, 1.0, 40)
    for spread in (0.03, 0.1, 0.2):
        got = evaluate(gl, OPTICS, f"vec4(mirrored_share(a.x, {spread}))", rows(cosine))[:, 0]

        def mean(c, spread=spread):
            def schlick(s):
                tilted = np.clip((c + s * np.sqrt(1 - c * c)) / np.hypot(1, s), 0, 1)
                return 0.0203 + 0.9797 * (1 - tilted) ** 5

            return seen_mean(schlick, c, spread)

        np.testing.assert_allclose(got, [mean(c) for c in cosine], atol=0.06, err_msg=f"spread {spread}")

    cosine = np.linspace(0.005, 0.999, 60)
    for spread in (0.02, 0.1, 0.3):
        got = evaluate(gl, OPTICS, f"vec4(seen_slope(a.x, {spread}))", rows(cosine))[:, 0]
        a = cosine / (spread * np.sqrt(1 - cosine**2))
        exact = spread / (a + np.exp(norm.logpdf(a) - norm.logcdf(a)))
        np.testing.assert_allclose(got, exact, rtol=2e-3, err_msg=f"spread {spread}")
        np.testing.assert_allclose(exact, [seen_mean(lambda s: s, c, spread) for c in cosine], rtol=2e-3)
        call = f"vec4(seen_spread(a.x, {spread}, a.y))"
        got = evaluate(gl, OPTICS, call, rows(cosine, exact))[:, 0]
        squares = [seen_mean(lambda s: s * s, c, spread) for c in cosine]
        np.testing.assert_allclose(got, np.sqrt(squares - exact**2), rtol=5e-3, err_msg=f"spread {spread}")

    spread = 0.15
    cosine = np.linspace(0.02, 0.9, 60)
    got = evaluate(gl, OPTICS, f"vec4(hidden_share(a.x, {spread}))", rows(cosine))[:, 0]
    a = cosine / (np.sqrt(2) * spread * np.sqrt(1 - cosine**2))
    exact = (np.exp(-a * a) - a * np.sqrt(np.pi) * erfc(a)) / (2 * a * np.sqrt(np.pi))
    np.testing.assert_allclose(1 / (1 + got), 1 / (1 + exact), atol=4e-3)


@pytest.mark.gl
def test_glitter_conserves_energy(gl):
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
def test_foam_coverage_is_resolution_independent(gl):
    noise = 0.5 * norm.ppf((np.arange(2000) + 0.5) / 2000)
    shared, covered = "vec4(foam_share(a.x, a.z, a.y))", "vec4(foam_cover(a.x, a.z, a.y))"
    for amount in (0.05, 0.2, 0.5):
        near = evaluate(gl, FOAM, shared, rows(noise, 0.0, amount))[:, 0].mean()
        far = evaluate(gl, FOAM, shared, rows([0.0], 0.5, amount))[0, 0]
        assert far == pytest.approx(near, abs=0.13), amount
        share, web = np.linspace(0, 1, 21), np.linspace(-1, 1, 21)
        got = evaluate(gl, FOAM, covered, rows(share, web, amount))[:, 0]
        threads = 1 - smoothstep(0.02, 0.28, np.abs(web))
        blanket = smoothstep(0.06, 0.4, amount) * share
        expected = 0.85 * share * (0.75 * threads * (1 - blanket) + blanket)
        np.testing.assert_allclose(got, expected, atol=1e-6, err_msg=str(amount))
    assert (evaluate(gl, FOAM, shared, rows(noise, 0.0, 0.0)) == 0).all()


@pytest.mark.gl
def test_flow_phases_restart_at_zero_weight_and_profile_is_cubic(gl):
    time = np.linspace(0.0, 3.0, 301)
    call = "vec4(flow_phase(a.x, 0.0), flow_phase(a.x, 1.0))"
    assert "RENEWAL = 3.2" in source("render/water_waves.glsl")
    got = evaluate(gl, WAVES, call, rows(time))
    np.testing.assert_allclose(got[:, 1] ** 2 + got[:, 3] ** 2, 1.0, atol=1e-5)
    for offset, weight in (got[:, :2].T, got[:, 2:].T):
        jumps = np.abs(np.diff(offset)) > 1.0
        assert jumps.any()
        assert (np.minimum(weight[:-1], weight[1:])[jumps] < 0.03).all()
        np.testing.assert_allclose(np.diff(offset)[~jumps], 3.2 * 0.01, atol=1e-3)

    across = np.linspace(-1.5, 1.5, 61)
    call = "vec4(stream_profile(a.x))"
    got = evaluate(gl, WAVES, call, rows(across))[:, 0]
    np.testing.assert_allclose(got, np.maximum(1 - np.abs(across) ** 3, 0), atol=1e-6)
    assert got[np.abs(across) <= 1].mean() == pytest.approx(0.75, abs=0.03)


@pytest.mark.gl
def test_dominant_waves_are_those_of_jonswap(gl):
    speed, fetch = map(np.ravel, np.meshgrid([0.5, 1.7, 6.0], [5.0, 200.0, 5000.0]))
    got = evaluate(gl, WAVES, "vec4(longest_wave(a.x, a.y))", rows(speed, fetch))[:, 0]
    frequency = 3.5 * GRAVITY / speed * (GRAVITY * fetch / speed**2) ** (-1 / 3)
    np.testing.assert_allclose(got, GRAVITY / (2 * np.pi * frequency**2), rtol=3e-3)
    assert f"BAND = vec2{BAND};" in source("render/water_waves.glsl")


def straight(z=(0.0, 0.0), *, width=10.0, start=(0.0, 0.0), end=(1000.0, 0.0), count=101):
    t = np.linspace(0.0, 1.0, count)[:, None]
    ends = np.array([[*start, z[0]], [*end, z[1]]])
    line = ends[0] + t * (ends[1] - ends[0])
    return SimpleNamespace(
        id=PAINTED["river"].code << 48, centreline=line, centreline_width=np.full(count, width, np.float32)
    )


def test_wave_slopes_match_heights_and_mipmaps_preserve_variance():
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

    field = wave_slopes()
    size = len(field)
    for axis, channel in ((1, 0), (0, 1)):
        height = field[..., 2]
        steps = np.roll(height, -1, axis=axis) - np.roll(height, 1, axis=axis)
        # A central difference of a wave of k texels is its slope times sinc(2 / k).
        error = steps * size / 2 - field[..., channel]
        assert np.sqrt(np.mean(error**2)) < 0.25 * np.sqrt(np.mean(field[..., channel] ** 2))


def test_waves_run_downwind_and_are_periodic():
    layers = wave_layers((3.0, 4.0))
    assert len(layers) == len(LAYERS)
    np.testing.assert_allclose((layers[:, 2:] ** 2).sum(axis=0), 1.0)
    for layer, (side, turn, *_) in zip(layers, LAYERS, strict=True):
        assert np.hypot(*layer[:2]) == pytest.approx(1 / side)
        assert np.arctan2(layer[1], layer[0]) == pytest.approx(np.arctan2(4, 3) + turn)
    here = wave_phases(layers, (5e6, -3e6, 10.0), 7.0)
    assert ((here >= 0) & (here < 1)).all()
    step = layers[:, :2] / np.hypot(*layers[:, :2].T)[:, None] ** 2
    for k, (east, north) in enumerate(step):
        there = wave_phases(layers, (5e6 + east, -3e6 + north, 10.0), 7.0)[k]
        np.testing.assert_allclose((there - here[k] + 0.5) % 1.0, 0.5, atol=1e-6)
        # A crest at the eye is downwind of it a moment later.
        later = wave_phases(layers, (5e6, -3e6, 10.0), 7.01)[k]
        moved = (later[0] - here[k][0] + 0.5) % 1.0 - 0.5
        assert -0.1 < moved < 0
    assert wave_layers((3.0, 4.0), 1)[0, 2] == 1.0


def test_river_speed_follows_manning():
    line = straight((5.0, 0.0), width=18.0)
    speed, fall = flow_speed_and_slope(line.centreline, line.centreline_width)
    np.testing.assert_allclose(fall, 0.005)
    np.testing.assert_allclose(speed, 4 / 3 * np.sqrt(0.005) / 0.042, rtol=1e-9)
    still = straight()
    speed, fall = flow_speed_and_slope(still.centreline, still.centreline_width)
    assert (fall == 0).all()
    assert (speed == 0.25).all()
    line = straight((20.0, 0.0), width=18.0)
    surface = river_surface(line.centreline, line.centreline_width)
    assert (surface.stream[:, 3] == 9.0).all()
    assert (surface.stream[:, 2] == 1.0).all()
    np.testing.assert_allclose(surface.stream[:, 1], 0.02)


def test_lake_mesh_covers_the_lake_and_faces_up():
    for side in (60, 1001):
        step = np.arange(side) - side // 2
        inside = (0.3 * side - np.hypot(step, step[:, None])) * 4.0
        field = SimpleNamespace(west=100.0, south=-50.0, spacing=4.0, inside=inside.astype(np.float32))
        place, course, room, _, triangles = lake_surface(field, 7.5)
        assert -30.0 < room.min() < 0.0 < room.max()
        assert (place[:, 2] == 7.5).all()
        np.testing.assert_allclose(np.hypot(course[:, 2], course[:, 3]), 1.0)
        a, b, c = (place[triangles[i::3], :2] for i in range(3))
        area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        assert (area > 0.0).all()
        lake = np.pi * (0.3 * side * 4.0) ** 2
        assert lake < area.sum() < lake * (1.0 + 20.0 / side)
        middle = np.array([100.0, -50.0]) + 4.0 * (side // 2)
        assert np.hypot(*(place[:, :2] - middle).T).max() < 0.3 * side * 4.0 + 30.0


def test_river_mesh_has_the_right_width_and_faces_up():
    line = straight((5.0, 4.0), end=(100.0, 0.0), count=11).centreline
    place, course, inside, _, triangles = river_surface(line, np.full(11, 10.0, np.float32))
    assert place[:, 1].max() == pytest.approx(9.0)
    assert np.allclose(course[:, 2:], [1.0, 0.0])
    assert np.allclose(inside, 5.0 - np.abs(place[:, 1]))
    assert course[-1, 1] == pytest.approx(np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1).sum())
    a, b, c = (place[triangles[k::3], :2] for k in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (turn > 0).all()
    assert len(triangles) == 10 * (ACROSS - 1) * 6


def features(*rivers, lakes=(), sea_level=None):
    return SimpleNamespace(rivers=rivers, lakes=lakes, sea_level=sea_level)


def surfaces(*rivers, **others):
    return [each.mesh((0.0, 0.0, 0.0, 0.0)) for each in terrain_objects(features(*rivers, **others))]


def test_one_of_two_overlapping_waters_is_visible():
    step = 5.0 * np.arange(41)
    inside = 60.0 - np.hypot(step - 100.0, (step - 100.0)[:, None])
    field = SimpleNamespace(west=900.0, south=-100.0, spacing=5.0, inside=inside.astype(np.float32))
    lake = SimpleNamespace(id=PAINTED["lake"].code << 48, shape=field, level=0.0)
    main = straight(width=20.0, count=1001)
    tributary = straight(width=8.0, start=(500.0, 300.0), end=(500.0, 0.0))
    sheet_, wide, narrow = surfaces(main, tributary, lakes=[lake])
    assert (sheet_.stream[:, 2] == 1).all()
    off = np.abs(narrow.position[:, 1])
    assert (narrow.stream[off >= 10.0, 2] == 1).all()
    assert (narrow.stream[off <= 5.0, 2] == 0).all()
    from_middle = np.hypot(*(wide.position[:, :2] - [1000.0, 0.0]).T)
    assert (wide.stream[from_middle < 50.0, 2] == 0).all()
    assert (wide.stream[from_middle > 60.0, 2] == 1).all()
    # Where one continues as the other both are visible.
    first = straight(width=12.0, end=(500.0, 0.0))
    second = straight(width=10.0, start=(500.0, 0.0))
    for surface in surfaces(first, second):
        visible = surface.stream[:, 2].reshape(101, -1)
        assert (visible[2:-2] == 1).all()


def test_rivers_fade_into_the_sea():
    river, sea = surfaces(straight((4.0, 0.0), count=201), sea_level=1.0)
    high = river.position[:, 2] - 1.0
    np.testing.assert_allclose(river.stream[:, 2], np.clip(high / 0.15, 0.0, 1.0))
    assert (sea.stream[:, 3] == -1.0).all()


@pytest.mark.gl
def test_surf_breaks_in_shallow_water_and_whitecaps_need_wind(gl):
    depth = np.linspace(0.0, 4.0, 401)
    height = 0.35 + 0.0214 * 5.0**2
    got = evaluate(gl, FOAM, "vec4(surf_foam(a.x, surf_height(5.0), a.y, 1.0))", rows(depth, 0.5))[:, 0]
    assert (got[depth > 1.28 * height] == 0.0).all()
    assert got[0] > 0.4
    # A pixel that resolves no bore has the mean of one.
    passed = (np.arange(1000) + 0.5) / 1000
    call = "vec4(surf_foam(0.6, 1.0, a.x, a.y))"
    fine, coarse = (evaluate(gl, FOAM, call, rows(passed, seen))[:, 0] for seen in (1.0, 0.0))
    assert coarse[0] == pytest.approx(fine.mean(), rel=1e-3)
    number = evaluate(gl, FOAM, "vec4(waves_to_shore(a.x, 7.0))", rows(depth))[:, 0]
    np.testing.assert_allclose(number, 2.0 * np.sqrt(depth / 9.81) / (0.05 * 7.0), rtol=1e-5)
    wind = np.array([0.0, 5.0, 10.0, 100.0])
    white = evaluate(gl, FOAM, "vec4(whitecaps(a.x))", rows(wind))[:, 0]
    np.testing.assert_allclose(white, np.minimum(3.84e-6 * wind**3.41, 0.3), rtol=1e-4)


@pytest.mark.gl
def test_the_sea_covers_ground_below_its_level_and_nothing_else(draw):
    """Rays that meet the ground under the level see water; those above it the same as before."""
    size, level = (96, 64), 10.0
    camera = Camera((500.0, -60.0, 120.0), (500.0, 420.0, 0.0), fov=50.0, near=5.0, far=30_000.0)
    quality = replace(
        Quality.from_level(0.0), quads=64, material_texels=64, map_texels=64, tile_memory=32 << 20
    )
    given = {"size": size, "quality": quality, "sun": Sun(200.0, 40.0)}
    dry, wet = (
        draw(Waves(rivers=False, plants=False, sea_level=sea), camera, **given).astype(float)
        for sea in (None, level)
    )
    rows_, columns_ = (axis.ravel() for axis in np.mgrid[1 : size[1] : 3, 1 : size[0] : 3])
    below, above = [], []
    for row, column in zip(rows_.tolist(), columns_.tolist(), strict=True):
        along = camera.ray((column + 0.5) / size[0] * 2 - 1, 1 - (row + 0.5) / size[1] * 2, size[0] / size[1])
        place = intersect_terrain(Waves().heights, camera.eye, along, max_distance=2500.0)
        if place is not None and place[2] < level - 5.0:
            below.append((row, column))
        elif place is not None and place[2] > level + 5.0:
            above.append((row, column))
    assert min(len(below), len(above)) > 30
    there = tuple(np.transpose(below))
    blue = [(picture[..., 2] - picture[..., 1])[there] for picture in (dry, wet)]
    assert (blue[1] - blue[0] > 10).all()
    there = tuple(np.transpose(above))
    exposure = np.median(wet[there] / dry[there])  # the haze lies on the sea, not on its bed
    assert np.percentile(np.abs(dry[there] * exposure - wet[there]), 95.0) <= 10.0


@pytest.mark.gl
def test_no_ground_is_mirrored_beyond_the_height_map(gl):
    """The map's border repeated outwards would draw streaks on the sea."""
    frame = FrameBlock(gl)
    frame["near_map"] = (-100.0, -50.0, 1 / 200.0, 1.0)
    frame.upload()
    mirror = source("render/water_mirror.glsl", (("CLOUDS", "0"), ("MATERIALS", "2")))
    places = np.random.default_rng(4).uniform(-300.0, 300.0, (500, 4)).astype(np.float32)
    mapped = evaluate(gl, [mirror], "vec4(is_mapped(a.xy))", places)[:, 0]
    expected = (np.abs(places[:, :2] - (0.0, 50.0)) < 100.0).all(axis=1)
    assert expected.any()
    np.testing.assert_array_equal(mapped, expected)


@pytest.mark.gl
def test_columns_of_a_mirrored_picture_are_frayed_on_rippled_water(gl):
    """Clouds 10 px wide in a picture of 640 px would draw stripes down a lake."""
    camera, frame = Camera((0.0, 0.0, 50.0), (0.0, 1000.0, 50.0), fov=50.0), FrameBlock(gl)
    to_clip = camera.to_clip(640 / 360)
    frame["to_clip"], frame["from_clip"] = to_clip, np.linalg.inv(to_clip)
    frame["near_map"], frame["sun_light"] = (1e7, 1e7, 1.0, 1.0), (100.0, 100.0, 100.0, 0.0)
    frame["view_range"] = (1e7, 0.0, 640.0, 360.0)
    frame["haze"] = frame["air"] = (0.0, 0.0, 0.0, 1e3)
    frame.upload()
    stripes = np.where(np.arange(640) // 10 % 2, 1.0, 0.0).astype("f2")
    textures = {
        "scene": gl.texture((640, 360), 1, np.tile(stripes, 360).tobytes(), dtype="f2"),
        "scene_depth": gl.texture((1, 1), 1, np.ones(1, "f4").tobytes(), dtype="f4"),
        "sky_view": gl.texture((2, 4), 4, np.ones(32, "f4").tobytes(), dtype="f4"),
    }
    textures["scene"].repeat_x = textures["scene"].repeat_y = False

    def set_up(program):
        set_uniforms(program, bind_textures(textures))

    mirror = source("render/water_mirror.glsl", (("CLOUDS", "0"), ("MATERIALS", "2")))
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 400), np.linspace(600.0, 900.0, 16))
    places = np.stack([x * y, y, np.full_like(x, -50.0), np.zeros_like(x)], axis=-1).reshape(-1, 4)
    ray = "normalize(a.xyz * vec3(1.0, 1.0, -1.0)), vec3(0.0, 0.0, 0.1), 0.0"
    found = evaluate(gl, [mirror], f"vec4(mirrored(a.xyz, {ray}), 1.0)", places, set_up=set_up)
    columns = found[:, 0].reshape(x.shape).mean(axis=0)
    assert columns.mean() == pytest.approx(0.5, abs=0.1)
    assert columns.std() < 0.2  # of stripes with one of 0.5


@pytest.mark.gl
def test_strips_are_widened_to_a_pixel_and_coverage_compensates(gl):
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
def test_distant_river_brightness_is_its_projected_width(gl, monkeypatch):
    """Its light in a column of the picture is its width in pixels, from many of them to a fifth of one."""
    read = source

    def plain(name, *given):
        return PLAIN if name == "render/water.frag.glsl" else read(name, *given)

    monkeypatch.setattr("sketchterrain.render.programs.source", plain)
    size = (64, 256)
    far = straight(width=24.0, start=(-4e4, 0.0), end=(4e4, 0.0), count=2001)
    assert not Water(gl, features(far), enabled=False)
    assert not Water(gl, features())
    water = Water(gl, features(far), defines={"MATERIALS": 1})
    array = water._arrays[-1][0]
    target = gl.framebuffer([gl.texture(size, 4, dtype="f4")], gl.depth_texture(size))
    frame = FrameBlock(gl)
    expected, got = [], []
    for distance in np.geomspace(100.0, 20_000.0, 80):
        eye = (0.0, -float(distance), 0.35 * float(distance))
        camera = Camera(eye, (0.0, 0.0, 0.0), fov=40.0, near=1.0, far=1e5)
        to_clip = camera.to_clip(size[0] / size[1])
        frame["to_clip"], frame["view_range"] = to_clip, (1e5, 0.0, *size)
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
        array.program["anchor"].value = tuple(water._anchors[0] - eye)
        count = water.select(camera, size[0] / size[1], lift=np.radians(40.0) / size[1])
        array.render_indirect(water._commands, moderngl.TRIANGLES, count=count)
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


def test_levels_of_a_river_deviate_by_their_error_at_most_and_only_chunks_in_view_are_drawn():
    along = np.linspace(0.0, 3000.0, 700)
    line = np.column_stack([along, 60.0 * np.sin(along / 90.0), 20.0 - 0.004 * along])
    width = (8.0 + 3.0 * np.sin(along / 200.0)).astype(np.float32)
    mesh = river_surface(line, width)
    step = np.arange(60) - 30.0
    inside = (72.0 - 4.0 * np.hypot(step, step[:, None])).astype(np.float32)
    lake = lake_surface(SimpleNamespace(west=100.0, south=-50.0, spacing=4.0, inside=inside), 7.5)
    _, _, indices, chunks = inland_mesh([lake, mesh])
    is_river = chunks["count"][:, 1] > 0
    assert is_river.sum() == -(-(len(line) - 1) // STATIONS)
    ranges = zip(chunks["first"][:, 0], chunks["count"][:, 0], strict=True)
    whole = np.concatenate([np.arange(first, first + count) for first, count in ranges])
    finest = indices[whole].reshape(-1, 3)
    finest = finest[(finest != np.roll(finest, 1, axis=1)).all(axis=1)]  # the last station is repeated
    assert len(finest) == len(lake.triangles) // 3 + len(mesh.triangles) // 3
    assert (chunks["error"][is_river, 0] == 0.0).all()
    middle = len(lake.position) + np.arange(len(line)) * ACROSS + ACROSS // 2
    for chunk in np.flatnonzero(is_river)[[0, 7, -1]]:
        for level in range(len(LEVELS)):
            first, count = chunks["first"][chunk, level], chunks["count"][chunk, level]
            kept = np.intersect1d(indices[first : first + count], middle)
            x = line[(kept - middle[0]) // ACROSS]
            stations = line[(kept[0] - middle[0]) // ACROSS : (kept[-1] - middle[0]) // ACROSS + 1]
            apart = np.abs(np.interp(stations[:, 0], x[:, 0], x[:, 1]) - stations[:, 1]).max()
            assert apart <= chunks["error"][chunk, level] * 1.05 + 1e-9, (chunk, level)
    ahead = Camera((-200.0, 0.0, 60.0), (1000.0, 0.0, 0.0))
    fine, coarse = (chunk_commands(chunks, ahead, 1.5, tolerance)["count"].sum() for tolerance in (0.0, 0.01))
    assert coarse - len(lake.triangles) < 0.1 * (fine - len(lake.triangles))
    assert len(chunk_commands(chunks, Camera((-500.0, 0.0, 60.0), (-1000.0, 0.0, 0.0)), 1.5, 0.0)) == 0


def test_lakes_of_few_samples_have_a_mesh():
    for count in (5, 8, 9, 12):
        y, x = 2.0 * np.mgrid[:count, :count]
        inside = (0.7 * count - np.hypot(x - count, y - count)).astype(np.float32)
        assert (
            len(lake_surface(SimpleNamespace(west=0.0, south=0.0, spacing=2.0, inside=inside), 1.0).triangles)
            > 0
        )
