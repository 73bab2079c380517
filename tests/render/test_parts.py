"""Quality, and parts of a picture."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.look.water_surfaces import ACROSS, sheet, strip
from sketchterrain.render import Quality, Sun
from sketchterrain.render.plant_shade import shade_matrix
from sketchterrain.render.relief import HeightMap
from sketchterrain.render.sky import irradiance_harmonics, sky_irradiance
from sketchterrain.render.textures import tileable_noise


def test_irradiance_of_the_sky_and_suns_below_twilight():
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


def test_height_map_interpolates_a_plane_exactly():
    along = np.arange(32) + 0.5
    plane = HeightMap(100.0, -50.0, 32.0, (along[None, :] + 2 * along[:, None]).astype(np.float32))
    x, y = np.array([110.3, 120.0]), np.array([-40.2, -30.7])
    assert np.allclose(plane.at(x, y), (x - 100.0) + 2 * (y + 50.0))


def test_lake_sheet_covers_the_lake_and_faces_up():
    for side in (60, 1001):
        step = np.arange(side) - side // 2
        inside = (0.3 * side - np.hypot(step, step[:, None])) * 4.0
        field = SimpleNamespace(west=100.0, south=-50.0, spacing=4.0, inside=inside.astype(np.float32))
        place, course, room, _, triangles = sheet(field, 7.5)
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


def test_river_strip_is_as_wide_as_told_and_faces_up():
    line = np.stack([np.linspace(0, 100, 11), np.zeros(11), np.linspace(5, 4, 11)], axis=1)
    place, course, inside, _, triangles = strip(line, np.full(11, 10.0, np.float32))
    assert place[:, 1].max() == pytest.approx(9.0)
    assert np.allclose(course[:, 2:], [1.0, 0.0])
    assert np.allclose(inside, 5.0 - np.abs(place[:, 1]))
    assert course[-1, 1] == pytest.approx(np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1).sum())
    a, b, c = (place[triangles[k::3], :2] for k in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (turn > 0).all()
    assert len(triangles) == 10 * (ACROSS - 1) * 6


def test_noise_is_tileable():
    field = tileable_noise(64)
    inner = np.abs(np.diff(field, axis=0)).max(axis=(0, 1))
    seam = np.abs(field[0] - field[-1]).max(axis=0)
    assert (seam <= 1.5 * inner).all()
    assert np.allclose(field.mean(axis=(0, 1)), 0, atol=1e-6)


def test_shade_matrix_looks_along_the_light():
    sun = Sun(210.0, 35.0)
    centre = np.array([10.0, 20.0, -3.0])
    matrix = shade_matrix(sun, centre, 50.0, 400.0)
    along = matrix @ np.append(centre + 100.0 * sun.direction, 1.0)
    assert np.allclose(along, [0.0, 0.0, -0.25, 1.0])


CHEAPER_WHEN_GREATER = {"tolerance", "steep", "thin"}
FIXED = {"split"}


def test_a_greater_number_never_costs_less():
    assert Quality.of(1.0) == Quality()
    steps = [Quality.of(number) for number in np.linspace(0.0, 1.0, 101)]
    assert all(quality.map_texels % 64 == 0 for quality in steps)  # light maps lie on whole blocks
    for field in dataclasses.fields(Quality):
        if field.name == "without":
            continue
        values = np.array([getattr(quality, field.name) for quality in steps], dtype=float)
        change = np.diff(values)
        if field.name in CHEAPER_WHEN_GREATER:
            assert (change < 0.0).all()
        else:
            assert (change >= 0.0).all()
            assert (values[-1] > values[0]) != (field.name in FIXED)


def test_a_driver_without_a_gpu_gets_a_cheap_picture():
    software = Quality.for_renderer("llvmpipe (LLVM 15.0.6, 256 bits)")
    shared = Quality.for_renderer("Mesa Intel(R) UHD Graphics 620 (KBL GT2)")
    card = Quality.for_renderer("NVIDIA H100 80GB HBM3/PCIe/SSE2")
    assert software.woods < shared.woods < card.woods <= Quality().woods
    assert software.materials * software.planes * software.octaves == 1
    assert software.moving_scale < card.moving_scale


def test_parts_are_left_out_by_name():
    quality = Quality.of(0.5, without=["grass"])
    assert not quality.has("grass")
    assert quality.has("trees")


def test_other_numbers_and_parts_are_refused():
    for number in (-0.01, 1.01, float("nan")):
        with pytest.raises(InputError, match="from 0 to 1"):
            Quality.of(number)
    with pytest.raises(InputError, match=r"one of shadows.*got 'gras'"):
        Quality.of(0.5, without=["gras"])
