"""Sky, clouds and weather: tables and shaders against integrals, photons and NumPy."""

import dataclasses
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.atmosphere import (
    AEROSOL_ABSORBED,
    AEROSOL_HEIGHT,
    GROUND,
    GROUND_ALBEDO,
    OZONE,
    RAYLEIGH,
    RAYLEIGH_HEIGHT,
    TOP,
    Air,
)
from sketchterrain.render.clouds import BASE, MIDDLE, PERIOD, Clouds, billow_noise, cloud_defines, cloud_field
from sketchterrain.render.offscreen import read_picture
from sketchterrain.render.programs import FRAME_BINDING
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import (
    LEVELS,
    SIZE,
    SUN_IRRADIANCE,
    Sky,
    Sun,
    Weather,
    find_sun,
    irradiance_harmonics,
    level_weight,
    overcast_table,
    sky_irradiance,
    sky_table,
    sun_at,
    sun_for_view,
)
from sketchterrain.render.targets import NOISE_PERIOD, FrameBlock
from sketchterrain.schema.parameters import WEATHER

from .conftest import Waves
from .test_shaders import evaluate

CLEAR = Weather(clouds=0.0)
UP = np.array([0.0, 0.0, 1.0])
FRAME = "render/frame.glsl"
EARTH = 6360e3
LOW_SUNS = (-4.0, -1.0, 3.0, 27.0, 70.0)


@pytest.fixture(scope="module")
def air():
    return Air()


def direction(elevation, azimuth=0.0):
    """Unit vectors by degrees; the sun's azimuth is 0, along x."""
    e, a = np.radians(elevation), np.radians(azimuth)
    return np.stack(np.broadcast_arrays(np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)), axis=-1)


NEAR = np.polynomial.legendre.leggauss(200)


def optical_depth(air, height, cosine):
    """To the top of the air from a height (m), by 400 steps; (3,)."""
    r = GROUND + height
    path = -r * cosine + np.sqrt(r * r * (cosine * cosine - 1.0) + TOP**2)
    perigee = np.clip(-r * cosine, 0.0, path)
    total = np.zeros(3)
    for start, stop in ((0.0, perigee), (perigee, path)):
        along = start + 0.5 * (NEAR[0] + 1.0) * (stop - start)
        heights = np.sqrt(r * r + along**2 + 2.0 * r * along * cosine) - GROUND
        total += (air.scattering(heights)[2] * (0.5 * NEAR[1] * (stop - start))[:, None]).sum(axis=0)
    return total


def photons(air, channel, cosine, count, seed):
    """Share of sunlight that reaches level ground from the sky, by photons through flat layers of air.

    Woodcock's tracking, with all orders of scattering, both phase functions and the ground's albedo.
    """
    rng = np.random.default_rng(seed)
    ceiling = TOP - GROUND
    most = float(air.scattering(np.zeros(1))[2][0, channel])
    z = np.full(count, ceiling)
    ahead = np.tile([np.sqrt(1.0 - cosine**2), 0.0, -cosine], (count, 1))
    weight, flown = np.ones(count), np.zeros(count, bool)
    diffuse = 0.0
    for _ in range(4000):
        step = -np.log(rng.random(len(z))) / most
        z = z + ahead[:, 2] * step
        ground = z < 0.0
        diffuse += weight[ground & flown].sum()
        z[ground] = 0.0
        weight[ground] *= GROUND_ALBEDO[channel]
        up = np.sqrt(rng.random(ground.sum()))
        turn = 2.0 * np.pi * rng.random(ground.sum())
        flat = np.sqrt(1.0 - up * up)
        ahead[ground] = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=-1)
        flown |= ground
        rayleigh, aerosol, extinction = (each[:, channel] for each in air.scattering(z))
        drawn = rng.random(len(z)) * most
        met = ~ground & (drawn < extinction) & (z < ceiling)
        by_air = rng.random(len(z)) * (rayleigh + aerosol) < rayleigh
        weight[met] *= ((rayleigh + aerosol) / extinction)[met]
        ahead[met] = _rotated(ahead[met], _angle(rng, by_air[met]), rng)
        flown |= met
        alive = (z < ceiling) & (weight > 1e-3) if _ else weight > 0.0
        z, ahead, weight, flown = z[alive], ahead[alive], weight[alive], flown[alive]
        if not len(z):
            break
    return diffuse / count


def _angle(rng, by_air):
    """Cosines of angles of scattering, by molecules or by aerosols (Cornette & Shanks, by rejection)."""
    cosine = np.empty(len(by_air))
    u = 4.0 * rng.random(len(by_air)) - 2.0
    cubic = np.cbrt(u + np.sqrt(u * u + 1.0))
    cosine[by_air] = (cubic - 1.0 / cubic)[by_air]
    g, left = 0.76, np.flatnonzero(~by_air)
    while len(left):
        s = (1.0 - g * g) / (1.0 - g + 2.0 * g * rng.random(len(left)))
        trial = (1.0 + g * g - s * s) / (2.0 * g)
        accepted = rng.random(len(left)) * 2.0 < 1.0 + trial * trial
        cosine[left[accepted]] = trial[accepted]
        left = left[~accepted]
    return cosine


def _rotated(ahead, cosine, rng):
    turn = 2.0 * np.pi * rng.random(len(ahead))
    helper = np.where(np.abs(ahead[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(ahead, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(ahead, side)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    return (
        cosine[:, None] * ahead
        + (sine * np.cos(turn))[:, None] * side
        + (sine * np.sin(turn))[:, None] * other
    )


def aerosol_optical_depth(air):
    """Vertical optical depth of aerosols, in closed form; (3,)."""
    return air.scattering(np.zeros(1))[1][0] * (1.0 + AEROSOL_ABSORBED)


def test_transmittance_matches_closed_form_and_quadrature(air):
    molecules = RAYLEIGH * RAYLEIGH_HEIGHT
    aerosols = aerosol_optical_depth(air) * AEROSOL_HEIGHT
    ozone = OZONE * 15e3
    got = air.transmittance(np.array(GROUND), np.array(1.0))
    assert np.allclose(got, np.exp(-molecules - aerosols - ozone), rtol=5e-4)

    rng = np.random.default_rng(1)
    height = rng.uniform(0.0, 1.0, 60) ** 3 * 60e3
    dip = -np.sqrt(1.0 - (GROUND / (GROUND + height)) ** 2)
    cosine = dip + (1.0 - dip) * rng.uniform(0.0, 1.0, 60) ** 2
    expected = [np.exp(-optical_depth(air, h, c)) for h, c in zip(height, cosine, strict=True)]
    assert np.abs(air.transmittance(GROUND + height, cosine) - expected).max() < 6e-3

    shares = air.sunlight(np.zeros(5), np.sin(np.radians([1.0, 0.267, 0.0, -0.267, -2.0])))[:, 0]
    assert (np.diff(shares) < 0.0)[:3].all()
    assert shares[3] == pytest.approx(0.0, abs=1e-12)
    assert shares[4] == 0.0


def test_scattering_converges(air):
    number = np.arange(512) + 0.5
    z, turn = 1.0 - 2.0 * number / 512, number * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(1.0 - z * z)
    directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=-1)
    height, cosine = np.meshgrid([0.0, 500.0, 3000.0, 12_000.0], [0.0, 0.02, 0.3, 0.9])
    expected = air.multiple_scattering_source(height, cosine, directions, steps=64)
    assert np.abs(air.multiple_scattering(height, cosine) / expected - 1.0).max() < 0.1
    assert np.abs(air.multiple_scattering(height, cosine) / expected - 1.0).mean() < 0.03

    directions = direction(np.array([0.3, 2.0, 10.0, 45.0, 90.0])[:, None], np.linspace(0.0, 180.0, 9))
    for elevation in LOW_SUNS:
        few, many = (air.sky(20.0, directions, direction(elevation), steps=n).radiance for n in (24, 300))
        assert np.abs(few / many - 1.0).max() < 0.04, elevation


@pytest.mark.parametrize("elevation", [pytest.param(20.0, marks=pytest.mark.slow), 50.0])
def test_sky_irradiance_matches_monte_carlo(air, elevation):
    """All orders of scattering, by photons in flat air; in the table later orders are the same all around."""
    sun = Sun(0.0, elevation)
    radiance = sky_table(air, sun, 0.0)[SIZE:] / SUN_IRRADIANCE
    height = sun.direction[2]
    harmonics = irradiance_harmonics(radiance, sun, air.sunlight(np.zeros(()), np.array(height)))
    got = sky_irradiance(harmonics, UP)
    for channel in range(3):
        expected = photons(air, channel, height, 30_000, seed=5) * height
        assert got[channel] == pytest.approx(expected, rel=0.1)


def test_sky_is_interpolated_between_levels(air):
    sun = Sun(0.0, 27.0)
    for height in (150.0, 500.0, 2000.0):
        expected = sky_table(air, sun, height)
        lower, share = level_weight(height)
        low, high = (sky_table(air, sun, LEVELS[number]) for number in (lower, lower + 1))
        gap = np.abs(low + share * (high - low) - expected)
        assert (gap / expected.mean(axis=(0, 1))).mean() < 0.04
    assert level_weight(LEVELS[0]) == (0, 0.0)
    assert level_weight(LEVELS[1]) == (1, 0.0)
    assert level_weight(1e9) == (len(LEVELS) - 2, 1.0)


def test_irradiance_of_clear_and_overcast_skies_and_suns_below_twilight():
    harmonics = irradiance_harmonics(np.ones((64, 64, 3)), Sun(40.0, 30.0), np.zeros(3))
    # Overhead sky of radiance 1 over ground that returns its albedo of it.
    assert np.allclose(sky_irradiance(harmonics, np.array([0.0, 0.0, 1.0])), np.pi, rtol=0.04)
    east, west = (sky_irradiance(harmonics, np.array([x, 0.0, 0.0])) for x in (1.0, -1.0))
    assert np.allclose(east, west)
    assert (sky_irradiance(harmonics, np.array([0.0, 0.0, -1.0])) < east).all()
    radiance = np.repeat(np.linspace(2.0, 0.0, 64)[None, :, None], 64, axis=0).repeat(3, axis=2)
    harmonics = irradiance_harmonics(radiance, Sun(90.0, 20.0), np.zeros(3))
    east, west = (sky_irradiance(harmonics, np.array([x, 0.0, 0.0])) for x in (1.0, -1.0))
    assert (east > 1.5 * west).all()

    for elevation in (-4.1, -10.0, 91.0, np.nan):
        with pytest.raises(InputError, match="elevation"):
            Sun(0.0, elevation)

    table = overcast_table(np.full(3, 5.0))
    assert np.allclose(table[-1], 3.0 * table[SIZE])
    harmonics = irradiance_harmonics(table[SIZE:], Sun(0.0, 30.0), np.zeros(3))
    assert np.allclose(sky_irradiance(harmonics, UP), 5.0, rtol=0.03)


@pytest.mark.gl
def test_overcast_is_darker_and_exposure_follows_partly(gl):
    sun = Sun(0.0, 40.0)
    clear, grey = Sky(gl, sun, CLEAR), Sky(gl, sun, Weather(clouds=1.0))
    assert (grey.sunlight == 0.0).all()
    total = clear.sunlight * sun.direction[2] + sky_irradiance(clear.harmonics, UP)
    assert 0.2 < (sky_irradiance(grey.harmonics, UP) / total).mean() < 0.5
    assert grey.exposure(0.0) > 1.5 * clear.exposure(90.0)

    noon, dawn, dusk = (Sky(gl, Sun(0.0, e), CLEAR) for e in (45.0, 4.0, -4.0))
    light = [float(sky_irradiance(sky.harmonics, UP).mean()) for sky in (noon, dawn, dusk)]
    displayed = [a * sky.exposure(90.0) for a, sky in zip(light, (noon, dawn, dusk), strict=True)]
    assert noon.exposure(90.0) < dawn.exposure(90.0) < dusk.exposure(90.0)
    assert displayed[2] < 1.5 * displayed[1]
    assert dawn.exposure(0.0) < dawn.exposure(180.0)
    steps = np.abs(np.diff([np.log(dawn.exposure(h)) for h in range(-180, 181)]))
    assert steps.max() < 0.05


def looked_up(gl, sky, call, rows, *, eye=50.0):
    """Evaluate an expression of `a` with a sky's table and its air, seen from a height (m)."""
    frame = FrameBlock(gl)
    frame["to_sun"] = sky.sun.direction
    frame["eye"] = (0.0, 0.0, eye)
    frame["haze"] = (*sky.haze, AEROSOL_HEIGHT)
    frame["air"] = (*sky.rayleigh, RAYLEIGH_HEIGHT)
    frame["view_range"] = (1e7, 0.0, 1.0, 1.0)
    frame.upload()
    sky.set_height(eye)

    def set_up(program):
        program["Frame"].binding = FRAME_BINDING
        sky.view.use(1)
        program["sky_view"].value = 1

    return evaluate(gl, [FRAME], f"vec4({call}, 1.0)", rows, set_up=set_up)[:, :3]


@pytest.mark.gl
def test_shader_sky_matches_its_table_and_is_continuous_at_the_horizon(gl):
    sun = Sun(120.0, 20.0)
    sky = Sky(gl, sun, CLEAR)
    share = np.linspace(0.0, 1.0, SIZE)
    elevation, turn = np.meshgrid(90.0 * share**2, 180.0 * share**2, indexing="ij")
    flat = np.cos(np.radians(elevation))
    azimuth = np.radians(sun.azimuth + turn)
    directions = np.stack(
        [flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(np.radians(elevation))], axis=-1
    )
    rows = np.c_[directions.reshape(-1, 3), np.zeros(SIZE * SIZE)]
    got = looked_up(gl, sky, "clear_sky(a.xyz)", rows, eye=0.0).reshape(SIZE, SIZE, 3)
    expected = sky_table(Air(), sun, 0.0)[SIZE:]
    # Half floats, and a share of a texel by the angles' rounding; at the zenith all azimuths are one.
    assert np.abs(got / expected - 1.0)[:-1].max() < 5e-3

    # Distant objects at the horizon fade into the sky.
    sky = Sky(gl, Sun(120.0, 20.0), CLEAR)
    azimuth = np.linspace(0.0, 2.0 * np.pi, 90)
    rows = np.stack([np.sin(azimuth), np.cos(azimuth), 0.0 * azimuth, 0.0 * azimuth], axis=-1)
    above, below = (looked_up(gl, sky, f"{name}(a.xyz)", rows) for name in ("clear_sky", "air_light"))
    assert np.abs(above / below - 1.0).max() < 0.1


@pytest.mark.gl
@pytest.mark.parametrize("elevation", [4.0, *(pytest.param(e, marks=pytest.mark.slow) for e in (27.0, 60.0))])
def test_aerial_perspective_matches_integration(gl, elevation):
    """Over 0.5 to 16 km, from three heights; the bounds are shares of the light at the horizon there."""
    sun, air = Sun(90.0, elevation), Air()
    sky = Sky(gl, sun, CLEAR)
    worst = []
    for eye in (30.0, 300.0, 1500.0):
        distance = np.geomspace(500.0, 16e3, 6)
        rise = np.array([-eye, -0.5 * eye, 0.0, 300.0, 900.0])
        azimuth = np.radians(np.linspace(0.0, 180.0, 7))
        far, up, turn = (grid.ravel() for grid in np.meshgrid(distance, rise, azimuth))
        place = np.stack([far * np.cos(turn), far * np.sin(turn), up], axis=-1)
        length = np.linalg.norm(place, axis=-1)
        path = air.integrate(np.array(eye), place / length[:, None], direction(elevation), length, steps=200)
        ground = 0.03 * SUN_IRRADIANCE
        expected = path.radiance * SUN_IRRADIANCE + path.clear * ground
        rows, behind = np.c_[place, up], ", ".join(map(str, ground))
        got = looked_up(gl, sky, f"through_air(vec3({behind}), a.xyz)", rows, eye=eye)
        scale = looked_up(gl, sky, "air_light(vec3(normalize(a.xy), 0.0))", rows, eye=eye)
        worst.append(np.abs(got - expected) / np.maximum(scale, expected))
    error = np.concatenate(worst)
    assert np.sqrt((error**2).mean()) < 0.025
    assert error.max() < 0.2


@pytest.mark.gl
def test_air_leaves_twice_the_contrast_on_a_large_sketch_seen_as_a_whole(gl):
    """Dark and light ground in the middle of 65 km, 26° below the eye, in real air and in the sketch's."""
    sun, weather = Sun(120.0, 40.0), Weather()
    real, usual, large, murky = (
        Sky(gl, sun, weather, extent=extent)
        for extent, weather in (
            (np.inf, weather),
            (16_384.0, weather),
            (65_536.0, weather),
            (65_536.0, Weather(haze=4.0)),
        )
    )
    assert (usual.haze == real.haze).all()
    assert usual.extinction == real.extinction
    rows = [[0.0, 72e3 * np.cos(np.radians(26.0)), -72e3 * np.sin(np.radians(26.0)), 0.0]]

    def contrast(sky):
        grounds = [sky.sunlight * albedo / np.pi for albedo in (0.05, 0.15)]
        calls = [f"through_air(vec3({', '.join(map(str, ground))}), a.xyz)" for ground in grounds]
        dark, light = (looked_up(gl, sky, call, rows, eye=-rows[0][2]).mean() for call in calls)
        return (light - dark) / (light + dark)

    assert contrast(large) > 2.0 * contrast(real)
    assert np.allclose(murky.haze, 4.0 * large.haze)
    assert large.extinction == pytest.approx(real.extinction * (large.haze / real.haze)[1], rel=1e-6)
    assert contrast(murky) < contrast(large)


def test_cloud_field_has_the_requested_cover_and_tiles():
    for cover in (0.05, 0.35, 0.8):
        for sky in ("cumulus", "stratocumulus"):
            field = cloud_field(Weather(clouds=cover, sky=sky), 256)
            assert (field > 0.0).mean() == pytest.approx(cover, abs=2e-3), (cover, sky)
    assert (cloud_field(Weather(clouds=0.0)) < 0.0).all()
    assert (cloud_field(Weather(sky="cirrus"), 64) < 0.0).all()
    assert (cloud_field(Weather(clouds=1.0)) > 0.0).all()
    assert (cloud_field(Weather(clouds=0.5)) >= cloud_field(Weather(clouds=0.3))).all()

    field = cloud_field(Weather(clouds=0.4), 256)
    for axis in (0, 1):
        inner = np.abs(np.diff(field, axis=axis)).max()
        assert np.abs(np.take(field, 0, axis) - np.take(field, -1, axis)).max() <= inner
    billows = billow_noise(32)
    assert billows.min() == 0.0
    assert billows.max() == 1.0
    assert 0.3 < billows.mean() < 0.6
    assert np.abs(billows[0] - billows[-1]).mean() < 1.2 * np.abs(np.diff(billows, axis=0)).mean()


def test_clouds_have_sizes_over_a_decade_domed_tops_and_streets_along_the_wind():
    cell = PERIOD / 512
    field = cloud_field(Weather(clouds=0.3, wind_from=90.0))
    labels, count = ndimage.label(field > 0.0)
    index = np.arange(1, count + 1)
    diameter = cell * np.sqrt(4.0 / np.pi * ndimage.sum_labels(field > 0.0, labels, index))
    number, _ = np.histogram(diameter, [200.0, 400.0, 800.0, 1600.0, 3200.0])
    assert (number[1:] <= 0.8 * number[:-1]).all(), number  # ∝ D⁻² over sizes in octaves: half as many
    assert diameter.max() > 2000.0
    top = 1e3 * np.sqrt(ndimage.maximum(field, labels, index))
    wide = diameter > 400.0
    assert 0.15 < np.median(top[wide] / diameter[wide]) < 0.7
    assert top.max() < 1200.0

    # Outside: never more than the distance to the next cloud, measured on the torus.
    away = ndimage.distance_transform_edt(np.pad(field <= 0.0, 256, mode="wrap"))[256:-256, 256:-256]
    assert (-field[field <= 0.0] <= away[field <= 0.0] * cell / 1e3 + 1e-6).all()

    spectrum = np.abs(np.fft.rfft2(field > 0.0)) ** 2
    assert spectrum[3:10, 0].sum() > 2.0 * spectrum[0, 3:10].sum()  # the wind is along x


@pytest.mark.gl
def test_cloud_layer_distance_on_a_spherical_earth(gl):
    rise = np.linspace(0.0, 1.0, 50)
    up = 1900.0
    rows = np.c_[np.full(50, up), rise, rise, rise]
    got = evaluate(gl, [FRAME, "render/clouds.glsl"], "vec4(to_layer(a.x, a.y))", rows)[:, 0]
    # Where the line's height over the round ground, to second order, is the layer's.
    assert np.allclose(rise * got + got**2 / (2.0 * EARTH), up, rtol=1e-3)
    assert got[0] == pytest.approx(np.sqrt(2.0 * EARTH * up), rel=1e-4)


def sky_picture(draw, waves, weather, quality, clock=0.0):
    camera = Camera((500.0, 100.0, 160.0), (500.0, 700.0, 200.0), far=20_000.0)
    given = {"sun": Sun(250.0, 35.0), "weather": weather, "quality": quality, "clock": clock}
    return draw(waves, camera, size=(160, 90), **given)[:40].astype(float)


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.parametrize("number", [0.1, 0.5])
def test_clouds_whiten_the_sky_and_drift(draw, waves, number):
    plain = Quality.from_level(number, without=["trees", "grass", "rocks", "water", "detail"])
    quality = dataclasses.replace(plain, quads=64, map_texels=64, material_texels=64, tile_memory=64 << 20)
    clear, fair, later, grey = (
        sky_picture(draw, waves, weather, quality, clock)
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
        moved, still = (sky_picture(draw, waves, weather, quality, each) for each in (clock, 0.0))
        assert np.abs(moved - still).mean() < 0.5


def test_sun_path_is_smooth_and_night_is_refused():
    noon = sun_at(12.0, 47.0)
    assert (noon.azimuth, noon.elevation) == (pytest.approx(180.0), pytest.approx(43.0))
    south = sun_at(12.0, -20.0)
    assert (south.azimuth % 360.0, south.elevation) == (pytest.approx(0.0, abs=1e-9), pytest.approx(70.0))
    for latitude in (-60.0, 0.0, 45.0):
        rise, set_ = sun_at(6.0, latitude), sun_at(18.0, latitude)
        assert rise.elevation == pytest.approx(0.0, abs=1e-9), latitude
        assert rise.azimuth == pytest.approx(90.0), latitude
        assert set_.azimuth == pytest.approx(270.0), latitude
    suns = [sun_at(hour, 45.0) for hour in np.linspace(5.7, 18.3, 200)]
    assert (np.diff([sun.azimuth for sun in suns]) > 0.0).all()
    assert np.linalg.norm(np.diff([sun.direction for sun in suns], axis=0), axis=1).max() < 0.02

    with pytest.raises(InputError, match=r"from 5:38 to 18:22.*45°, got 3:30") as caught:
        sun_at(3.5, 45.0)
    assert "\n" not in str(caught.value)
    for hour in (5 + 38 / 60, 18 + 22 / 60):
        assert -4.0 <= sun_at(hour, 45.0).elevation < -3.6


def test_weather_is_read_from_the_sketch_and_validated():
    sketch = Sketch(weather={"hour": 7.5, "clouds": 1.0, "haze": 2.0})
    assert Weather.from_sketch(sketch) == Weather(hour=7.5, clouds=1.0, haze=2.0)
    assert Weather.from_sketch(sketch, hour=12.0, clouds=0.0) == Weather(hour=12.0, clouds=0.0, haze=2.0)
    assert Weather.from_sketch(Sketch()) == Weather()
    assert Weather.from_sketch(SimpleNamespace(weather={})) == Weather()

    assert Weather.from_sketch(Sketch(weather={"sky": "cirrus"})).sky == "cirrus"
    with pytest.raises(InputError, match=r"one of cumulus, stratocumulus, .* got 'fog'"):
        Weather(sky="fog")
    for sky, low_clouds, grey, ice in (
        ("cumulus", 2, 0, 1),
        ("stratocumulus", 2, 0, 0),
        ("stratus", 0, 1, 0),
        ("cirrus", 0, 0, 1),
        ("clear", 0, 0, 0),
    ):
        defines = cloud_defines(Quality(), Weather(sky=sky))
        assert defines == {"CLOUDS": low_clouds, "GREY": grey, "CIRRUS": ice}, sky

    for name, parameter in WEATHER.items():
        if parameter.choices:
            continue
        low = max(parameter.low, 0.0) if name == "hour" else parameter.low
        for value in (low, parameter.high):
            dataclasses.replace(Weather(), **{name: value})
        for value in (low - 0.01, parameter.high + 0.01, np.nan):
            with pytest.raises(InputError, match="expected"):
                dataclasses.replace(Weather(), **{name: value})


def test_sun_follows_hour_or_view_and_drift_the_wind(waves):
    camera = Camera((500.0, 100.0, 130.0), (500.0, 800.0, 60.0))
    assert sun_for_view(waves, camera, Weather()) == find_sun(waves, camera)
    assert sun_for_view(waves, camera, Weather(hour=12.0, latitude=30.0)) == sun_at(12.0, 30.0)

    assert np.allclose(Weather(wind=3.0, wind_from=270.0).drift, (3.0, 0.0))
    assert np.allclose(Weather(wind=2.0, wind_from=0.0).drift, (0.0, -2.0))


@pytest.mark.gl
def test_a_cloud_dome_shows_the_clouds_of_the_picture_after_eye_and_wind_moved(gl, open_renderer):
    """Clouds are at least 1.9 km away: 200 m to the side turn them by 6° at most, which is corrected."""
    size = (480, 270)  # a dome is sharper than a small picture
    texture = gl.texture(size, 4)
    framebuffer = gl.framebuffer([texture])
    waves = Waves()
    east = (0.0, 200.0)
    cameras = [Camera((500.0 + x, 500.0, 80.0), (500.0 + x, 900.0, 250.0), fov=50.0) for x in east]
    quality = replace(Quality.from_level(0.25), quads=64, map_texels=128, material_texels=128, cloud_steps=96)

    def pictures(cloud_texels, *, clouds=0.6):
        own = replace(quality, cloud_texels=cloud_texels)
        weather = Weather(clouds=clouds, wind=5.0)
        renderer = open_renderer(waves, sun=Sun(200.0, 40.0), weather=weather, quality=own)
        renderer.prepare(cameras[0], size)
        for number, camera in enumerate(cameras):
            # Not as of a view at rest, whose dome is from its own place.
            seen = renderer._clipped(camera)
            for _ in renderer.scenery.draw(seen, framebuffer, size=size, clock=10.0 * number, moving=True):
                pass
            yield read_picture(texture).astype(float)[: size[1] // 2]

    (clear, _), expected, found = list(pictures(0, clouds=0.0)), list(pictures(0)), list(pictures(768))
    clouds = np.abs(expected[0] - clear).mean()
    assert clouds > 10.0
    assert np.abs(expected[1] - expected[0]).mean() > 0.3 * clouds  # they moved
    for number in range(2):
        assert np.abs(found[number] - expected[number]).mean() < 0.25 * clouds, number
        darkest, least = (each[number].mean(axis=-1).min() for each in (expected, found))
        assert least > darkest - 1.0, number


@pytest.mark.gl
def test_every_direction_that_shows_a_cloud_dome_is_computed_and_none_is_below_the_horizon(gl):
    """From eyes below, in and above the clouds, level and steep, at rest and up to 1.5 km past the dome."""
    quality = Quality.from_level(0.25)
    sky = Sky(gl, Sun(200.0, 40.0), Weather())
    clouds = Clouds(gl, Weather(), sky, quality=quality, defines=cloud_defines(quality, Weather()))
    frame, rng, aspect = FrameBlock(gl), np.random.default_rng(3), 16.0 / 9.0
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 160), np.linspace(-1.0, 1.0, 90))
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.5), np.ones(x.size)], axis=-1)
    for height in (30.0, 300.0, 1700.0, 3000.0):
        for pitch in (-26.0, -5.0, 20.0, 60.0):
            eye = np.array([500.0, 100.0, height])
            for moved in (np.zeros(3), rng.normal(size=3), rng.normal(size=3)):
                eye = eye + 800.0 * moved / max(np.linalg.norm(moved), 1.0)
                ahead = direction(pitch, rng.uniform(0.0, 360.0))
                camera = Camera(tuple(eye), tuple(eye + 100.0 * ahead), fov=50.0)
                given = clouds.follow(camera, aspect, base=0.0, clock=0.0, moving=True)
                above = max(BASE + MIDDLE - eye[2], 300.0)  # m; seen from over the clouds, they are streaks
                assert given["cloud_origin"][2] < 0.8 * above, (height, pitch, moved)
                for _, dome, blocks in clouds._queue:
                    for _ in dome.blocks(blocks):
                        pass
                frame["eye"], frame["view_range"] = eye, np.zeros(4)
                frame.upload()
                computed = np.repeat(clouds._domes[0]._computed.astype("f2"), 48, 0).repeat(48, 1)
                view = gl.texture((768, 768), 4, np.stack([computed] * 4, axis=-1).tobytes(), dtype="f2")
                rays = places @ np.linalg.inv(camera.to_clip(aspect)).T
                rays[:, :3] /= np.linalg.norm(rays[:, :3], axis=1, keepdims=True)
                found = sampled(gl, view, given["cloud_origin"], rays)
                assert found[:, 3].min() > 0.999, (height, pitch, moved)
                assert np.abs(found[rays[:, 2] < -0.004] - [0.0, 0.0, 0.0, 1.0]).max(initial=0.0) == 0.0


def sampled(gl, view, origin, rows):
    """Evaluate `dome_clouds` of directions with a texture instead of a dome's."""
    view.repeat_x = view.repeat_y = False

    def set_up(program):
        program["Frame"].binding = FRAME_BINDING
        view.use(1)
        program["cloud_view"].value = 1
        program["cloud_origin"].value = origin

    return evaluate(gl, [FRAME, "render/clouds.glsl"], "dome_clouds(a.xyz)", rows, set_up=set_up)
