"""Views that are found, and pictures of them."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import moderngl
import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.errors import DeviceError, InputError
from sketchterrain.render import (
    VIEWS,
    Camera,
    Quality,
    Sun,
    Weather,
    find_sun,
    find_view,
    open_context,
    render_picture,
)
from sketchterrain.render.kept import Kept
from sketchterrain.render.relief import sample_heights
from sketchterrain.render.stands import Cover, find_stands, free_ahead
from sketchterrain.render.studio import Studio
from sketchterrain.render.sunlight import sun_at
from sketchterrain.render.view_aim import light_of
from sketchterrain.sketch import Sketch
from sketchterrain.terrain import build
from sketchterrain.terrain.water import standing_water

HEIGHTS = {"auto": (15.0, 195.0), "ground": (1.7, 4.0), "hill": (1.7, 4.0), "air": (240.0, 710.0)}
"""m above the ground."""


@pytest.fixture(scope="module")
def terrain() -> st.Terrain:
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
        )
    )


@pytest.fixture(scope="module")
def cameras(terrain: st.Terrain) -> dict[str, Camera]:
    return {kind: find_view(terrain, kind) for kind in VIEWS}


def test_a_view_is_from_its_height_and_its_horizon_lies_high(
    terrain: st.Terrain, cameras: dict[str, Camera]
) -> None:
    for kind, camera in cameras.items():
        x, y, z = camera.eye
        low, high = HEIGHTS[kind]
        assert low <= z - float(terrain.heights(x, y)) <= high, kind
        # Where the farthest ground is in the picture: in the upper third, none of it over the border.
        bearing = np.radians(camera.heading) + np.radians(np.linspace(-25.0, 25.0, 21))[:, None]
        distance = np.geomspace(10.0, 1.5 * terrain.extent, 90)
        ground = terrain.heights(
            x + np.sin(bearing) * distance, y + np.cos(bearing) * distance, cell_size=8.0
        )
        skyline = ((ground - z) / distance).max(axis=1)
        half = np.tan(np.radians(camera.fov) / 2.0)
        at = (skyline - np.tan(np.radians(camera.pitch))) / half
        assert 0.2 <= np.median(at) <= 0.95, kind
        assert at.max() < 1.0, kind
    assert find_view(terrain, "ground") == cameras["ground"]


def test_views_from_the_ground_are_dry_level_and_open(
    terrain: st.Terrain, cameras: dict[str, Camera]
) -> None:
    for kind in ("ground", "hill"):
        camera = cameras[kind]
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


def test_stands_are_dry_open_and_in_the_sketch(terrain: st.Terrain) -> None:
    relief = sample_heights(terrain, (1500.0, 1125.0), 3900.0, 256)
    cover = Cover(terrain, relief)
    for raised in (False, True):
        x, y = find_stands(terrain, relief, cover, raised=raised).T
        assert 20 < len(x) <= 220
        assert ((x > 0) & (x < 3000.0) & (y > 0) & (y < 2250.0)).all()
        ground = terrain.heights(x, y)
        wet = [standing_water(terrain.recipe, layer, x, y, ground) for layer in ("river", "lake")]
        assert not np.any(wet)
    # Rises are over what surrounds them.
    x, y = find_stands(terrain, relief, cover, raised=True).T
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)[:, None]
    around = terrain.heights(x + 130.0 * np.sin(angle), y + 130.0 * np.cos(angle)).mean(axis=0)
    assert np.median(terrain.heights(x, y) - around) > 1.0


def test_distances_to_shores_are_measured_from_the_bank(terrain: st.Terrain) -> None:
    cover = Cover(terrain, sample_heights(terrain, (1500.0, 1125.0), 3900.0, 128))
    river = terrain.features.rivers[0]
    middle = len(river.centreline) // 2
    along = river.centreline[middle + 1, :2] - river.centreline[middle - 1, :2]
    aside = np.array([-along[1], along[0]]) / np.hypot(*along)
    half = float(river.centreline_width[middle]) / 2.0
    places = river.centreline[middle, :2] + np.array([0.0, half + 10.0, half + 500.0])[:, None] * aside
    assert cover.shore(*places.T) == pytest.approx([-half, 10.0, 60.0], abs=1.5)
    assert cover.wet(*places.T).tolist() == [True, False, False]


def test_the_view_ahead_ends_at_the_first_plant(terrain: st.Terrain) -> None:
    plants = terrain.foliage(0.0, 0.0, *terrain.size)
    plant = plants[len(plants) // 2]
    eye = np.array([plant["x"] - 8.0, plant["y"], 0.0])
    free = free_ahead(terrain, eye, np.pi / 2.0, reach=30.0)  # it looks east
    assert free <= 8.0 + 1e-6
    assert free_ahead(terrain, np.array([plant["x"] - 2.0, plant["y"], 0.0]), np.pi / 2.0, reach=30.0) == 0.0


def test_light_from_the_side_is_preferred_to_light_from_behind() -> None:
    weather = Weather(hour=9.0, clouds=0.0)
    sun = sun_at(9.0, weather.latitude)
    side, behind, front = (np.radians(sun.azimuth + turn) for turn in (75.0, 180.0, 0.0))
    light = light_of(weather)(np.array([side, behind, front]))
    assert light[0] > light[2] > light[1]
    assert light_of(Weather(hour=9.0, clouds=1.0))(np.array([side, behind])) == pytest.approx([0.0, 0.0])
    assert light_of(None)(np.array([side, behind])).tolist() == [0.0, 0.0]
    assert light_of(Weather(hour=None))(np.array([side, behind])).tolist() == [0.0, 0.0]


def test_unknown_views_and_hours_of_the_night_are_refused(terrain: st.Terrain) -> None:
    with pytest.raises(InputError, match="expected a view, one of auto, ground, hill, air, got 'moon'"):
        find_view(terrain, "moon")
    with pytest.raises(InputError, match="expected an hour from"):
        find_view(terrain, "air", weather=Weather(hour=1.0))


SIZE = (160, 90)


def sketch(seed, *, extent=1024.0, look=None):
    layers = {name: np.zeros((32, 32), np.uint8) for name in ("mountain", "forest", "river")}
    layers["mountain"][4:10, 20:28] = 1
    layers["forest"][18:28, 4:14] = 1
    layers["river"][14:16] = 1
    return Sketch(extent=extent, seed=seed, layers=layers, look=look or {})


@pytest.mark.gl
@pytest.mark.slow
def test_the_same_bytes_in_any_order():
    other = sketch(2, extent=700.0, look={"grass": {"colour": "#c83c3c"}})
    terrains = [build(sketch(1)), build(other)]
    with ThreadPoolExecutor(1) as thread:
        studio = thread.submit(Studio, SIZE).result()
        found = [thread.submit(studio.picture, terrains[number]).result() for number in (0, 1, 0)]
        thread.submit(studio.close).result()
    assert (found[1] == render_picture(terrains[1], size=SIZE)).all()
    assert (found[0] == found[2]).all()
    assert not (found[0] == found[1]).all()


@pytest.mark.gl
def test_invalid_sizes_and_views_are_refused():
    with pytest.raises(InputError, match="pixels a side"):
        Studio((8, 8))
    with Studio((32, 32)) as studio, pytest.raises(InputError, match="expected a view"):
        studio.picture(build(sketch(1)), view="odd")


def test_one_resource_of_each_kind_is_cached():
    kept, closed = Kept(), []
    first = kept.of("a", 1, lambda: ["first"], close=lambda thing: closed.append(thing[0]))
    assert kept.of("a", 1, lambda: ["never"]) is first
    other = kept.of("b", 1, lambda: ["other"])
    assert kept.of("a", 2, lambda: ["second"], close=lambda thing: closed.append(thing[0])) == ["second"]
    assert (closed, kept.of("b", 1, lambda: ["never"]) is other) == (["first"], True)
    kept.close()
    assert closed == ["first", "second"]
    assert kept.of("a", 2, lambda: ["third"]) == ["third"]


def test_lent_resources_outlive_their_borrower_and_failures_are_not_cached():
    kept, closed = Kept(), []
    lent = kept.lent()
    thing = lent.of("a", 1, lambda: ["made"], close=lambda thing: closed.append(thing[0]))
    lent.close()
    lent.lent().close()
    assert closed == []
    assert kept.of("a", 1, lambda: ["never"]) is thing
    kept.close()
    assert closed == ["made"]

    def fail():
        raise RuntimeError("no room")

    with pytest.raises(RuntimeError):
        kept.of("a", 1, fail)
    assert kept.of("a", 1, lambda: "made") == "made"


PICTURE_SIZE = (240, 136)
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
    options = {"size": PICTURE_SIZE, "camera": camera, "sun": Sun(250.0, 35.0), "quality": SMALL}
    picture = render_picture(waves, **options, timings=timings)
    assert picture.shape == (136, 240, 3)
    assert picture.dtype == np.uint8
    sky, ground = picture[:15].mean(axis=(0, 1)), picture[-30:].mean(axis=(0, 1))
    assert sky[2] > sky[0]
    assert ground[1] > ground[2]
    assert sky.sum() > 1.2 * ground.sum()
    assert {"view", "tiles", "draw"} <= set(timings)
    assert (render_picture(waves, **options) == picture).all()
