"""Automatic viewpoints, quality levels, resource cache, snapshots."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial

import moderngl
import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import DeviceError, InputError
from sketchterrain.generation.building import build
from sketchterrain.measure.adherence_rivers import standing_water
from sketchterrain.render.offscreen import SnapshotRenderer, render_picture
from sketchterrain.render.programs import ResourceCache, open_context
from sketchterrain.render.quality import Quality
from sketchterrain.render.scene import sample_heights
from sketchterrain.render.sky import Weather, sun_at
from sketchterrain.render.viewpoints import TREES, LandCover, sun_preference, unobstructed_distance
from sketchterrain.render.views import find_view
from tests import terrains

HEIGHTS = {"auto": (15.0, 195.0), "ground": (1.7, 4.0), "hill": (1.7, 4.0), "air": (240.0, 710.0)}
"""m above the terrain."""


@pytest.fixture(scope="module")
def terrain():
    mountain, river, forest, lake = (np.zeros((48, 64), np.uint8) for _ in range(4))
    mountain[4:18, 44:60] = 1
    river[24:27, :34] = 1
    forest[30:46, 6:30] = 1
    lake[33:42, 40:52] = 1
    return st.build(
        st.Sketch(
            extent=3000.0,
            seed=5,
            density={"hill": 1.0},
            layers={"mountain": mountain, "river": river, "forest": forest, "lake": lake},
            labels={("mountain", 1): {"height": 400.0}, ("river", 1): {"width": 20.0}},
        ),
        device=terrains.context(),
    )


@pytest.fixture(scope="module")
def camera_of(terrain):
    return cache(partial(find_view, terrain))


@pytest.mark.slow
def test_views_have_their_height_and_a_high_horizon(terrain, camera_of):
    cover = LandCover(terrain, sample_heights(terrain, (1500.0, 1125.0), 3900.0, 128))
    for kind, (low, high) in HEIGHTS.items():
        camera = camera_of(kind)
        x, y, z = camera.eye
        assert low <= z - float(terrain.heights(x, y)) <= high, kind
        # The skyline, of trees at eye level, is in the upper third, below the border.
        bearing = np.radians(camera.heading) + np.radians(np.linspace(-25.0, 25.0, 21))[:, None]
        distance = np.geomspace(10.0, 1.5 * terrain.extent, 90)
        east, north = x + np.sin(bearing) * distance, y + np.cos(bearing) * distance
        ground = terrain.heights(east, north, cell_size=8.0).astype(np.float64)
        if kind in ("ground", "hill"):
            ground += TREES * cover.woods.at(east, north) * (distance > 2.0 * TREES)
        skyline = ((ground - z) / distance).max(axis=1)
        half = np.tan(np.radians(camera.fov) / 2.0)
        at = (skyline - np.tan(np.radians(camera.pitch))) / half
        assert 0.2 <= np.median(at) <= 0.95, kind
        assert at.max() < 1.0, kind
    assert find_view(terrain, "ground") == camera_of("ground")


def test_a_rectangle_is_framed_and_seen(terrain):
    for box in ((0.0, 0.0, *terrain.size), (900.0, 700.0, 1200.0, 1000.0), (2000.0, 2000.0, 2000.0, 2000.0)):
        camera = find_view(terrain, "layers", framed=box)
        west, south, east, north = box
        x, y = np.array([(west, south), (east, south), (east, north), (west, north)]).T
        places = np.stack([x, y, terrain.heights(x, y), np.ones(4)])
        across, up, _, w = camera.to_clip(16 / 9) @ (places - [*np.reshape((*camera.eye, 0.0), (4, 1))])
        assert (np.maximum(np.abs(across), np.abs(up)) <= w).all()
        assert camera.eye[2] > float(terrain.heights(*camera.eye[:2])) + 20.0


def test_eye_level_views_are_dry_level_and_open(terrain, camera_of):
    for kind in ("ground", "hill"):
        camera = camera_of(kind)
        x, y, _ = camera.eye
        plants = terrain.foliage(x - 5.0, y - 5.0, x + 5.0, y + 5.0)
        assert not (np.hypot(plants["x"] - x, plants["y"] - y) < 5.0).any(), kind
        ground = terrain.heights([x], [y])
        for layer in ("river", "lake"):
            wet = standing_water(terrain.recipe, layer, np.array([x]), np.array([y]), ground)
            assert not wet.any(), (kind, layer)
        near = terrain.heights(x + np.array([0.0, 4.0, 0.0]), y + np.array([0.0, 0.0, 4.0]))
        assert np.hypot(near[1] - near[0], near[2] - near[0]) / 4.0 < 0.3, kind
        ahead = camera.forward[:2] / np.hypot(*camera.forward[:2])
        run = np.linspace(3.0, 30.0, 10)
        rise = terrain.heights(x + ahead[0] * run, y + ahead[1] * run) - ground[0]
        assert (rise < 0.5 * run).all(), kind


def painted_share(terrain, camera):
    """Return the share of the rays through a picture that first hit the terrain where it is painted."""
    painted = np.any([image > 0 for image in terrain.sketch.layers.values()], axis=0)
    (width, height), grid = terrain.size, np.linspace(-0.9, 0.9, 25)
    relief = sample_heights(terrain, (width / 2, height / 2), 1.5 * terrain.extent, 512)
    rays = np.array([camera.ray(x, y, 16 / 9) for y in grid for x in grid])
    along = np.array(camera.eye) + rays[:, None] * np.geomspace(3.0, 1.5 * terrain.extent, 400)[:, None]
    below = relief.at(along[..., 0], along[..., 1]) > along[..., 2]
    x, y, _ = along[np.arange(len(rays)), below.argmax(axis=1)].T
    row, column = np.floor(np.stack([height - y, x]) / terrain.sketch.pixel_size).astype(int)
    inside = (row >= 0) & (row < painted.shape[0]) & (column >= 0) & (column < painted.shape[1])
    hit = below.any(axis=1) & inside
    return painted[row[hit], column[hit]].sum() / len(rays)


@pytest.mark.parametrize(
    "layer",
    [
        pytest.param(name, marks=pytest.mark.soak if name == "mountain" else pytest.mark.slow)
        for name in ("plateau", "lake", "mountain")
    ],
)
def test_views_show_the_small_features_of_a_wide_plain(layer):
    image = np.zeros((64, 64), np.uint8)
    image[18:24, 16:24] = 1
    extent = 10000.0 if layer == "lake" else 6000.0
    terrain = build(Sketch(extent=extent, seed=16, layers={layer: image}), device=terrains.context())
    for kind in ("air", "hill", "ground"):
        assert painted_share(terrain, find_view(terrain, kind)) > 0.02, kind


def test_distance_to_water_is_zero_at_the_bank_and_plants_obstruct_views(terrain):
    cover = LandCover(terrain, sample_heights(terrain, (1500.0, 1125.0), 3900.0, 128))
    river = terrain.features.rivers[0]
    middle = len(river.centreline) // 2
    along = river.centreline[middle + 1, :2] - river.centreline[middle - 1, :2]
    across = np.array([-along[1], along[0]]) / np.hypot(*along)
    half = float(river.centreline_width[middle]) / 2.0
    places = river.centreline[middle, :2] + np.array([0.0, half + 10.0, half + 500.0])[:, None] * across
    assert cover.distance_to_water(*places.T) == pytest.approx([-half, 10.0, 60.0], abs=1.5)
    assert (cover.distance_to_water(*places.T) <= 0.0).tolist() == [True, False, False]

    plants = terrain.foliage(0.0, 0.0, *terrain.size)
    plant = plants[len(plants) // 2]
    eye = np.array([plant["x"] - 8.0, plant["y"], 0.0])
    free = unobstructed_distance(terrain, eye, np.pi / 2.0, max_distance=30.0)  # to the east
    assert free <= 8.0 + 1e-6
    assert (
        unobstructed_distance(
            terrain, np.array([plant["x"] - 2.0, plant["y"], 0.0]), np.pi / 2.0, max_distance=30.0
        )
        == 0.0
    )


def test_light_from_the_side_is_preferred_to_light_from_behind():
    weather = Weather(hour=9.0, clouds=0.0)
    sun = sun_at(9.0, weather.latitude)
    side, behind, front = (np.radians(sun.azimuth + turn) for turn in (75.0, 180.0, 0.0))
    light = sun_preference(weather)(np.array([side, behind, front]))
    assert light[0] > light[2] > light[1]
    assert sun_preference(Weather(hour=9.0, clouds=1.0))(np.array([side, behind])) == pytest.approx(
        [0.0, 0.0]
    )
    assert sun_preference(None)(np.array([side, behind])).tolist() == [0.0, 0.0]
    assert sun_preference(Weather(hour=None))(np.array([side, behind])).tolist() == [0.0, 0.0]


SIZE = (160, 90)


def sketch(seed, *, extent=1024.0, look=None):
    layers = {name: np.zeros((32, 32), np.uint8) for name in ("mountain", "forest", "river")}
    layers["mountain"][4:10, 20:28] = 1
    layers["forest"][18:28, 4:14] = 1
    layers["river"][14:16] = 1
    return Sketch(extent=extent, seed=seed, layers=layers, look=look or {})


@pytest.mark.gl
@pytest.mark.soak
def test_snapshots_do_not_depend_on_their_order():
    other = sketch(2, extent=700.0, look={"grass": {"colour": "#c83c3c"}})
    built = [build(sketch(1)), build(other)]
    with ThreadPoolExecutor(1) as thread:
        snapshots = thread.submit(SnapshotRenderer, SIZE).result()
        found = [thread.submit(snapshots.picture, built[number]).result() for number in (0, 1, 0)]
        thread.submit(snapshots.close).result()
    timings = {}
    assert (found[1] == render_picture(built[1], size=SIZE, timings=timings)).all()
    assert {"view", "tiles", "draw"} <= set(timings)
    assert (found[0] == found[2]).all()
    assert not (found[0] == found[1]).all()


CHEAPER_WHEN_GREATER = {"tolerance", "neighbour_limit", "finest_quad", "thinning_pixels"}
FIXED = {"plant_distance", "draw_distance"}


def test_costs_are_monotonic_in_the_quality_level_and_cpu_drivers_get_a_low_one():
    assert Quality.from_level(1.0) == Quality()
    steps = [Quality.from_level(number) for number in np.linspace(0.0, 1.0, 101)]
    assert all(quality.map_texels % 64 == 0 for quality in steps)  # light maps consist of whole blocks
    for field in dataclasses.fields(Quality):
        if field.name in ("without", "cloud_texels"):  # clouds are in a dome, or in the picture
            continue
        values = np.array([getattr(quality, field.name) for quality in steps], dtype=float)
        change = np.diff(values)
        if field.name in CHEAPER_WHEN_GREATER:
            assert (change < 0.0).all()
        else:
            assert (change >= 0.0).all()
            assert (values[-1] > values[0]) != (field.name in FIXED)

    software = Quality.for_renderer("llvmpipe (LLVM 15.0.6, 256 bits)")
    shared = Quality.for_renderer("Mesa Intel(R) UHD Graphics 620 (KBL GT2)")
    card = Quality.for_renderer("NVIDIA H100 80GB HBM3/PCIe/SSE2")
    assert software.max_plants < shared.max_plants < card.max_plants <= Quality().max_plants
    assert software.cloud_texels
    assert not card.cloud_texels
    assert software.materials * software.planes * software.octaves == 1
    assert software.moving_scale < card.moving_scale


def test_invalid_input_and_missing_opengl_are_errors(terrain, waves, monkeypatch):
    assert not Quality.from_level(0.5, without=["grass"]).includes("grass")
    assert Quality.from_level(0.5, without=["grass"]).includes("trees")
    for message, call in (
        ("ground, hill, air, layers, got 'moon'", lambda: find_view(terrain, "moon")),
        ("expected an hour from", lambda: find_view(terrain, "air", weather=Weather(hour=1.0))),
        ("8192", lambda: render_picture(waves, size=(0, 100))),
        ("pixels a side", lambda: SnapshotRenderer((8, 8))),
        ("from 0 to 1", lambda: Quality.from_level(-0.01)),
        ("from 0 to 1", lambda: Quality.from_level(1.01)),
        ("from 0 to 1", lambda: Quality.from_level(float("nan"))),
        (r"one of shadows.*got 'gras'", lambda: Quality.from_level(0.5, without=["gras"])),
    ):
        with pytest.raises(InputError, match=message):
            call()

    def fail(**_):
        raise Exception("libEGL.so.1: no such file")

    monkeypatch.setattr(moderngl, "create_context", fail)
    with pytest.raises(DeviceError, match="apt install libegl1") as caught:
        open_context()
    assert "\n" not in str(caught.value)


def test_one_resource_of_each_kind_is_cached_and_borrowed_ones_outlive_their_borrower():
    cache, closed = ResourceCache(), []

    def get(cache, kind, key, thing):
        return cache.get_or_create(kind, key, lambda: [thing], close=lambda thing: closed.append(thing[0]))

    first = get(cache, "a", 1, "first")
    assert get(cache, "a", 1, "never") is first
    other = get(cache, "b", 1, "other")
    assert get(cache, "a", 2, "second") == ["second"]
    assert (closed, get(cache, "b", 1, "never") is other) == (["first"], True)
    borrowed = cache.borrow()
    thing = get(borrowed, "c", 1, "third")
    borrowed.close()
    borrowed.borrow().close()
    assert closed == ["first"]
    assert get(cache, "c", 1, "never") is thing
    cache.close()
    assert sorted(closed) == ["first", "other", "second", "third"]
    with pytest.raises(ZeroDivisionError):
        cache.get_or_create("a", 2, lambda: 1 / 0)
    assert get(cache, "a", 2, "created") == ["created"]
