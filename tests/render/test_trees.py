"""Trees: meshes, wind, and forests in whole pictures."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.geometry.camera import Camera
from sketchterrain.look.tree_levels import DETAILS, VARIANTS, leaf_mask, level, plant_mesh, plant_view
from sketchterrain.look.tree_species import BROAD, HEIGHTS, NEEDLES, SOLID, SPECIES
from sketchterrain.render.offscreen import canvas
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun, Weather
from sketchterrain.vegetation.plants import STOREYS

from .conftest import Waves
from .test_shaders import evaluate


def test_meshes_are_unit_height_and_deterministic_with_fewer_triangles():
    assert STOREYS["woody"] == SPECIES
    assert len(HEIGHTS) == len(SPECIES)
    total = 0
    for species, variant in itertools.product(SPECIES, range(VARIANTS)):
        meshes = [plant_mesh(species, variant, detail) for detail in range(DETAILS)]
        total += sum(mesh.nbytes for mesh in meshes)
        counts = [len(mesh) // 3 for mesh in meshes]
        assert counts == sorted(counts, reverse=True), (species, variant)
        assert counts[0] > (2000 if species == "shrub" else 4000), (species, variant)
        assert counts[-2:] == [12, 3], (species, variant)
        for mesh in meshes:
            assert -0.2 < mesh["position"][:, 2].min() < (0.05 if len(mesh) > 9 else 0.5), (species, variant)
            assert 0.85 < mesh["position"][:, 2].max() < 1.2, (species, variant)
            outward = mesh["normal"][:, :3] / 127.5 - 1.0
            assert np.abs(np.linalg.norm(outward, axis=1) - 1.0).max() < 0.02, (species, variant)
        wood = meshes[0]["position"][meshes[0]["normal"][:, 3] == 0]
        foot = wood[wood[:, 2] < 0.0]
        assert np.abs(foot[:, :2]).max() < 0.1, (species, variant)
    assert total < 20e6  # bytes
    first, second = (plant_mesh("oak", variant, 1) for variant in (0, 1))
    assert first.tobytes() != second.tobytes()
    plant_mesh.cache_clear()
    assert plant_mesh("oak", 0, 1).tobytes() == first.tobytes()


@pytest.mark.parametrize(
    "species", [SPECIES[0], *(pytest.param(species, marks=pytest.mark.slow) for species in SPECIES[1:])]
)
def test_levels_match_the_finest_area_and_colour(species):
    """From other sides than those that the levels were fitted to."""
    views = (0.9, 2.6, 4.1)
    areas = np.zeros((DETAILS, VARIANTS))
    for variant in range(VARIANTS):
        finest, *coarser = (
            plant_view(level(species, variant, detail), views=views) for detail in range(DETAILS)
        )
        areas[:, variant] = [each.area for each in (finest, *coarser)]
        for coarse in coarser:
            assert coarse.area == pytest.approx(finest.area, rel=0.15)
            assert coarse.colour == pytest.approx(finest.colour, rel=0.25, abs=0.02)
    means = areas.mean(axis=1)
    assert means == pytest.approx(np.full(DETAILS, means[0]), rel=0.08)


@pytest.mark.gl
def test_shader_leaf_mask_matches_the_oracle(gl):
    rng = np.random.default_rng(4)
    across, along, spray = rng.uniform(-1, 1, 4000), rng.uniform(0, 1, 4000), rng.integers(0, 256, 4000)
    for kind, wide in ((SOLID, 1), (BROAD, 1), (BROAD, 2), (NEEDLES, 1), (NEEDLES, 2)):
        rows = np.stack([across, along, np.full(4000, kind), spray], axis=1).astype(np.float32)
        call = f"vec4(leaf_mask(a.xy, a.z, uint(a.w), {wide:.1f}), 0.0, 0.0)"
        got = evaluate(gl, ["render/sprig.glsl"], call, rows)[:, 0]
        x, y, mask, _ = rows.astype(np.float64).T
        expected, *beside = (
            leaf_mask(x + 1e-5 * side, y + 1e-5 * up, mask, spray, wide=wide)
            for side, up in ((0, 0), (1, 1), (-1, 1), (1, -1), (-1, -1))
        )
        inner = (np.abs(beside - expected) < 2e-3).all(axis=0)  # a leaf's neighbour begins elsewhere
        assert inner.mean() > 0.97, (kind, wide)
        assert np.abs(got - expected)[inner].max() < 1e-4, (kind, wide)
        covered = (expected > 0.0).mean()
        assert covered == 1.0 if kind == SOLID else 0.35 < covered < 0.75, kind


def test_clusters_cover_the_same_as_their_leaves():
    """A far spray keeps its mean cover."""
    x, y = np.meshgrid(np.linspace(-1, 1, 200), np.linspace(0, 1, 200))
    for kind in (BROAD, NEEDLES):
        fine, far = (
            np.mean(
                [
                    leaf_mask(x, y, np.full(x.shape, kind), np.full(x.shape, spray), wide=wide) > 0.0
                    for spray in range(3, 256, 16)
                ]
            )
            for wide in (1, 2)
        )
        assert far == pytest.approx(fine, rel=0.05)


FILES = ["render/tree_wind.glsl"]
TURN = 2 * np.pi / 70.0


def gust(place, wind, time):
    speed = np.hypot(*wind)
    along = np.array(wind) / speed
    run, across = place @ along - speed * time, place @ [-along[1], along[0]]
    wide = np.sin(run * TURN + 1.7 * np.sin(across * TURN * 0.37))
    return 1.0 + 0.45 * wide + 0.25 * np.sin(run * TURN * 2.3 + across * TURN)


def rows(count, seed=2):
    return np.random.default_rng(seed).uniform(0.0, 1.0, (count, 4)).astype(np.float32)


def swayed(gl, points, wind, time, leafy=1.0):
    """Where points (n, 4: at, phase) of a plant 12 m high are moved to."""
    sway = f"sway_of(vec2(31.0, -7.0), 12.0, vec2({wind[0]:.4f}, {wind[1]:.4f}), {time:.4f})"
    call = f"vec4(swayed(a.xyz, 12.0, {sway}, a.w, {leafy:.1f}, {time:.4f}), 0.0)"
    return evaluate(gl, FILES, call, points)[:, :3]


@pytest.mark.gl
def test_gusts_travel_with_the_wind_and_feet_do_not_move(gl):
    places = rows(400) * 300.0
    call = "vec4(gust(a.xy, vec2(3.0, 4.0), 2.0), gust(a.xy + vec2(1.5, 2.0), vec2(3.0, 4.0), 2.5), 0.0, 0.0)"
    got = evaluate(gl, FILES, call, places)
    expected = gust(places[:, :2].astype(float), (3.0, 4.0), 2.0)
    assert np.abs(got[:, 0] - expected).max() < 1e-3
    assert np.abs(got[:, 1] - expected).max() < 1e-3
    assert abs(gust(rows(20_000)[:, :2] * 9000.0, (3.0, 4.0), 0.0).mean() - 1.0) < 0.02

    points = rows(500)
    still = np.c_[points[:, :3], np.zeros(500)].astype(np.float32)
    call = "vec4(swayed(a.xyz, 12.0, sway_of(vec2(31.0, -7.0), 12.0, a.ww, 3.7), 0.3, 1.0, 3.7), 0.0)"
    assert (evaluate(gl, FILES, call, still) == 0.0).all()
    points[:, 2] = 0.0
    assert (swayed(gl, points, (9.0, -12.0), 3.7) == 0.0).all()


@pytest.mark.gl
def test_wood_leans_with_height_squared_and_leaves_flutter(gl):
    points = rows(60)
    points[:, :2], points[:, 2] = 0.0, np.linspace(0.05, 1.0, 60)
    many = np.mean(
        [swayed(gl, points, (15.0, 0.0), time, leafy=0.0) for time in np.linspace(0, 400, 80)], axis=0
    )
    lean = 12.0 * 0.16 * 15.0**2 / (15.0**2 + 18.0**2)
    assert np.abs(many[:, 0] - lean * points[:, 2] ** 2).max() < 0.05 * lean
    assert np.abs(many[:, 1]).max() < 0.03 * lean
    weak, strong = (np.abs(swayed(gl, points, (speed, 0.0), 1.0, leafy=0.0)[-1, 0]) for speed in (2.0, 20.0))
    assert weak < 0.1 * strong
    assert strong < 0.3 * 12.0

    points = rows(300)
    points[:, 2] = 0.3 + 0.6 * points[:, 2]
    calm, later = (swayed(gl, points, (6.0, 0.0), time) for time in (1.0, 1.1))
    wood, wood_later = (swayed(gl, points, (6.0, 0.0), time, leafy=0.0) for time in (1.0, 1.1))
    assert (
        np.linalg.norm(later - calm, axis=1).mean() > 1.2 * np.linalg.norm(wood_later - wood, axis=1).mean()
    )
    assert np.linalg.norm(later - calm, axis=1).max() < 0.1


SIZE = (240, 136)
SUN = Sun(200.0, 35.0)
CAMERA = Camera((430.0, 235.0, 110.0), (430.0, 304.0, 40.0))
STILL = ("grass", "water", "clouds", "rocks")


class Woods(Waves):
    """A row of plants, near each other."""

    def heights(self, x, y, *, cell_size=0.0):
        ripples = 3.6 * np.sin(np.asarray(x, float) / 4.1) * np.cos(np.asarray(y, float) / 5.3)
        return super().heights(x, y) + ripples.astype(np.float32)

    def foliage(self, west, south, east, north):
        plants = super().foliage(-1e9, -1e9, 1e9, 1e9)
        plants["x"] = np.linspace(380.0, 480.0, len(plants))
        plants["z"] = self.heights(plants["x"], plants["y"])
        inside = (plants["x"] >= west) & (plants["x"] < east) & (plants["y"] >= south) & (plants["y"] < north)
        return plants[inside]


CHEAP = Quality(materials=1, planes=1, octaves=1, hexes=1, material_texels=128, map_texels=128, samples=1)


@pytest.fixture(scope="module")
def picture(draw):
    def picture(*, without=STILL, clock=0.0, wind=0.0, **changes):
        maps = {"light_maps": 2, "surface_texels": 256, "shade_texels": 512, "tile_memory": 64 << 20}
        quality = replace(CHEAP, without=frozenset(without), **maps, **changes)
        given = {"sun": SUN, "weather": Weather(wind=wind, clouds=0.0), "quality": quality, "clock": clock}
        return draw(Woods(rivers=False), CAMERA, size=SIZE, **given)

    return picture


@pytest.mark.gl
@pytest.mark.slow
def test_trees_cast_shadows_and_move_only_in_wind(picture):
    bare, planted = picture(without=(*STILL, "trees")), picture()
    changed = np.abs(planted - bare).max(axis=2) > 12
    assert 0.02 < changed.mean() < 0.5
    unshaded = picture(without=(*STILL, "shadows"))
    plants = np.abs(unshaded - picture(without=(*STILL, "shadows", "trees"))).max(axis=2) > 12
    assert 0.01 < plants.mean() < 0.9 * changed.mean()  # the shadows are gone, the plants are not

    assert (picture(clock=0.0) == picture(clock=3.3)).all()
    windy = [picture(clock=clock, wind=12.0) for clock in (0.0, 3.3)]
    moved = np.abs(windy[1] - windy[0]).max(axis=2) > 4
    assert moved.sum() > 60
    bare = picture(without=(*STILL, "trees"))
    plants = np.any([np.abs(each - bare).max(axis=2) > 2 for each in windy], axis=0)
    assert not (moved & ~plants).any()


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.parametrize("maps", [0, 2])
def test_vertex_lighting_matches_pixel_lighting(picture, monkeypatch, maps):
    bare = picture(without=(*STILL, "trees"), shade_maps=maps)
    coarse = {"plant_lod_scale": 0.03, "shade_maps": maps}  # all of them coarse
    at_vertices = picture(**coarse)
    monkeypatch.setattr("sketchterrain.render.forest.VERTEX_LIT", DETAILS)
    at_pixels = picture(**coarse)
    changed = [np.abs(each - bare).max(axis=2) > 20 for each in (at_vertices, at_pixels)]
    both = changed[0] & changed[1]
    assert both.sum() > 200
    assert both.sum() > 0.8 * max(each.sum() for each in changed)
    light, exact = (((each[both] / 255.0) ** 2.2).mean(axis=0) for each in (at_vertices, at_pixels))
    assert light == pytest.approx(exact, rel=0.25)


@pytest.mark.gl
@pytest.mark.slow
def test_feet_are_on_the_displayed_ground():
    """With coarse tiles the drawn ground is off the true one; feet follow it."""
    quality = replace(CHEAP, without=frozenset(STILL), shade_maps=0, tolerance=12.0)
    camera = Camera((430.0, 296.0, 130.0), (430.0, 300.0, 40.0))
    terrain = Woods(rivers=False)
    size = (400, 300)
    with canvas(size) as (context, _, framebuffer):
        renderer = Renderer(context, terrain, sun=SUN, weather=Weather(wind=0.0), quality=quality)
        renderer.prepare(camera, size)
        renderer.draw(camera, framebuffer)
        batches = renderer.scenery.forest._batches
        feet = []
        for batch in batches:
            rows = np.frombuffer(batch._instances.read(), np.float32).reshape(-1, 8)[: batch.count]
            ground = np.frombuffer(batch._captured.read(), np.float32)[:: batch._captured_bytes // 4][
                : batch.count
            ]
            feet.append(np.c_[rows[:, :2] + renderer.scenery.forest._origin, ground + camera.eye[2] + 0.15])
        feet = np.concatenate(feet)
        # The same ground without plants: its depth at the feet.
        bare = replace(quality, without=frozenset((*STILL, "trees")))
        ground = Renderer(context, terrain, sun=SUN, weather=Weather(wind=0.0), quality=bare)
        ground.prepare(camera, size)
        ground.draw(camera, framebuffer)
        depth = np.frombuffer(ground.scenery._targets[size].depth.read(), np.float32).reshape(size[::-1])
        matrix = ground.scenery._frame_block._values["to_clip"].T.astype(float)
    clip = (matrix @ np.c_[feet - camera.eye, np.ones(len(feet))].T).T
    inside = (np.abs(clip[:, :2]) < 0.98 * clip[:, 3:]).all(axis=1)
    assert inside.sum() > 12
    clip, feet = clip[inside], feet[inside]
    seen = clip[:, :3] / clip[:, 3:]
    at = np.floor((seen[:, :2] * 0.5 + 0.5) * size).astype(int)
    drawn = (
        np.c_[seen[:, :2], depth[at[:, 1], at[:, 0]] * 2.0 - 1.0, np.ones(len(at))] @ np.linalg.inv(matrix).T
    )
    drawn = drawn[:, 2] / drawn[:, 3] + camera.eye[2]
    assert np.abs(feet[:, 2] - drawn).max() < 0.3
    true = terrain.heights(feet[:, 0], feet[:, 1])
    assert np.abs(true - drawn).max() > 0.4  # else the test could not fail
