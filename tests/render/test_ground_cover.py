"""Grass and stones: fixed places on the drawn ground, the same cover near and far."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sketchterrain.geometry.camera import Camera
from sketchterrain.render.grass import DETAILS, KINDS, LEAF, PETAL, tuft_mesh
from sketchterrain.render.ground import NEAR_WIDTH
from sketchterrain.render.ground_cover import DETAILS as ROCK_DETAILS
from sketchterrain.render.ground_cover import ROCK_LAYERS, SHAPES, GroundCover, rock_mesh
from sketchterrain.render.quality import Quality
from sketchterrain.render.scatter import (
    BAND,
    ScatterLayer,
    VisiblePoints,
    cell_distances,
    cells_in_frustum,
    cells_within,
    hash32,
    scatter_points,
)
from sketchterrain.render.sky import Sun, Weather

from .conftest import Waves
from .test_shaders import evaluate

SIZE = (96, 64)
PLAIN = Quality(samples=1, materials=1, planes=1, octaves=1, hexes=1, material_texels=64, map_texels=64)
QUALITY = replace(
    PLAIN,
    tolerance=8.0,
    draw_distance=0.6,
    shade_maps=0,
    plant_distance=60.0,
    surface_texels=512,
    grass_distance=60.0,
    ground_cover_density=0.3,
)


class Meadow(Waves):
    """All grass, but for scree in the west, and nothing else on it."""

    def __init__(self):
        super().__init__(rivers=False, plants=False)

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        return (4.0 * np.sin(x / 90.0) + 3.0 * np.cos(y / 70.0)).astype(np.float32)

    def tiles(self, keys):
        tiles = super().tiles(keys)
        for tile, (level, col, _) in zip(tiles, keys, strict=True):
            west = (col + np.arange(65) / 64) * self.extent * 2.0**-level < 400.0
            tile.materials[...] = 0.0
            tile.materials[..., 0], tile.materials[..., 3] = ~west, west
        return tiles


def camera_at(x, y, *, above=1.7, heading=(0.3, 1.0, -0.15)):
    z = float(Meadow().heights(x, y)) + above
    return Camera((x, y, z), tuple(np.add((x, y, z), heading).tolist()), fov=60.0)


class Scene:
    def __init__(self, gl, open_renderer, *, weather=None):
        self.renderer = open_renderer(Meadow(), sun=Sun(200.0, 35.0), weather=weather, quality=QUALITY)
        self.texture = gl.texture(SIZE, 4)
        self.target = gl.framebuffer([self.texture])

    def see(self, camera, *, clock=0.0):
        self.camera = camera
        self.renderer.prepare(camera, SIZE)
        self.renderer.draw(camera, self.target, clock=clock)
        return np.frombuffer(self.texture.read(), np.uint8).reshape(SIZE[1], SIZE[0], 4)

    def plants(self, kind="meadow"):
        """Foot (m in the world), height, rotation and half width of all places of a kind that grow one."""
        each = self.renderer.scenery.cover.layers[len(ROCK_LAYERS) + KINDS.index(kind)]
        count = len(each.visible._points.rows)
        rows = np.frombuffer(each.pool.instances.read(112 * count), np.float32).reshape(-1, 28)
        rows = rows[rows[:, 3] > 0.0].astype(float)
        return rows[:, :3] + self.camera.eye, rows[:, 3], rows[:, 4:6], rows[:, 6]


@pytest.fixture(scope="module")
def scene(gl, open_renderer):
    return Scene(gl, open_renderer)


@pytest.mark.slow
@pytest.mark.gl
def test_grass_covers_the_same_area_at_any_distance(scene):
    eye = camera_at(640.0, 320.0, heading=(0.0, 0.02, -1.0), above=20.0)
    wide = Camera(eye.eye, eye.target, fov=150.0)
    scene.see(wide)
    foot, _, _, half_width = scene.plants()
    away = np.linalg.norm(foot - np.array(wide.eye), axis=1)
    beside = foot[:, :2] - wide.eye[:2]
    inside = (np.abs(beside) < 45.0).all(axis=1)
    rings = np.array([22.0, 26.0, 30.0, 34.0, 38.0])  # the last third of the reach of 60 m fades
    flat = np.sqrt(np.maximum(rings**2 - 20.0**2, 0.0))
    area = np.pi * np.diff(flat**2)
    width = np.array([half_width[inside & (away >= a) & (away < b)].sum() for a, b in pairwise(rings)])
    share = width / area
    assert share.max() / share.min() < 1.35, share


@pytest.mark.gl
def test_roots_are_on_the_displayed_ground(scene):
    camera = camera_at(600.0, 300.0)
    scene.see(camera)
    foot, tall, *_ = scene.plants()
    surface = scene.renderer.scenery.surface
    texels = QUALITY.surface_texels
    drawn = np.frombuffer(surface.textures["surface"].read(), np.float32).reshape(texels, -1, 4)[:, :texels]
    west, south, per_width, base = surface.uniforms(camera.eye)["surface_near"]
    at = (foot[:, :2] - camera.eye[:2] - [west, south]) * per_width * texels - 0.5
    near = np.hypot(*(foot[:, :2] - camera.eye[:2]).T) < 0.4 * NEAR_WIDTH
    i, j = np.floor(at[near]).astype(int).T
    u, v = (at[near] - np.floor(at[near])).T
    z = drawn[..., 2]
    expected = (z[j, i] * (1 - u) + z[j, i + 1] * u) * (1 - v) + (
        z[j + 1, i] * (1 - u) + z[j + 1, i + 1] * u
    ) * v
    whole = (drawn[j, i, 3] * drawn[j + 1, i + 1, 3] * drawn[j, i + 1, 3] * drawn[j + 1, i, 3]) == 1.0
    rooted = foot[near, 2] + 0.02 * tall[near] - camera.eye[2] - base
    assert whole.sum() > 500
    assert np.abs(rooted - expected)[whole].max() < 5e-3


@pytest.mark.gl
def test_grass_and_stones_follow_the_materials(scene, monkeypatch):
    stones = []

    def note(self, array, count, uniforms):
        rows = np.frombuffer(self.layers[0].pool.instances.read(80 * count), np.float32).reshape(-1, 20)
        stones.append(int((rows[:, 3] > 0.0).sum()))

    monkeypatch.setattr(GroundCover, "_draw_contact_shadows", note)
    counts = []
    for x in (150.0, 700.0):
        scene.see(camera_at(x, 300.0))
        foot, *_ = scene.plants()
        counts.append((len(foot), sum(stones)))
        stones.clear()
    (grass_on_scree, stones_on_scree), (grass, stones_on_grass) = counts
    assert grass_on_scree == 0
    assert grass > 1000
    assert stones_on_scree > 5 * stones_on_grass


@pytest.mark.slow
@pytest.mark.gl
def test_grass_moves_only_in_the_wind(gl, open_renderer):
    camera = camera_at(600.0, 300.0)
    calm, windy = (Scene(gl, open_renderer, weather=Weather(wind=wind)) for wind in (0.0, 9.0))
    assert (calm.see(camera, clock=0.0) == calm.see(camera, clock=7.3)).all()
    assert (windy.see(camera, clock=0.0) != windy.see(camera, clock=7.3)).any()


def covered(mesh):
    """Area of a tuft's triangles, from all sides on average, for blades of one half width in heights."""
    a, b, c = np.moveaxis(
        (mesh.vertices["local_position"] + 0.02 * mesh.vertices["side"])[mesh.triangles], 1, 0
    )
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def test_tuft_details_have_equal_area_and_fewer_triangles():
    for kind in KINDS:
        meshes = [tuft_mesh(kind, detail) for detail in range(DETAILS)]
        for mesh in meshes:
            place, manner = mesh.vertices["local_position"], mesh.vertices["blade"]
            assert place[:, 2].min() > -0.15, kind
            assert 0.4 < place[:, 2].max() < 1.6, kind
            assert set(np.unique(mesh.triangles)) == set(range(len(mesh.vertices))), kind
            assert ((manner[:, :2] >= 0.0) & (manner[:, :2] <= 1.0)).all(), kind
        counts = [len(mesh.triangles) for mesh in meshes]
        assert counts == sorted(counts, reverse=True), kind
        paints = set(np.unique(meshes[0].vertices["blade"][:, 2]).tolist())
        assert LEAF in paints, kind
        assert (PETAL in paints) == (kind == "flower"), kind
        if kind in ("meadow", "tall"):
            areas = np.array([covered(mesh) for mesh in meshes])
            assert np.abs(np.log(areas / areas[0])).max() < 0.12, (kind, areas)


def test_stone_meshes_are_closed_and_outward_at_every_detail():
    for shape in range(len(SHAPES)):
        volumes = []
        for detail in range(ROCK_DETAILS):
            mesh = rock_mesh(shape, detail)
            place, triangles = mesh.vertices["local_position"].astype(float), mesh.triangles.astype(np.int64)
            edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
            assert set(map(tuple, edges.tolist())) == set(map(tuple, edges[:, ::-1].tolist()))
            a, b, c = (place[triangles[:, k]] for k in range(3))
            volume = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
            assert (volume > 0.0).all(), (shape, detail)
            volumes.append(volume.sum())
            outward = mesh.vertices["local_normal"]
            assert np.abs(np.linalg.norm(outward, axis=1) - 1.0).max() < 1e-5, (shape, detail)
            assert (np.einsum("ij,ij->i", outward, place) > 0.0).all(), (shape, detail)
        assert min(volumes) > 0.75 * max(volumes), shape


LAYER = ScatterLayer(
    salt=7, density=20.0, full_distance=6.0, draw_distance=80.0, cell_size=4.0, details=(10.0, 30.0)
)
EYES = [(3.2, -7.9, 2.0), (-1e6 + 0.3, 4e6 + 3.1, 55.0)]
INCLUDES = ["render/scatter.glsl"]
STEP = (3242174889, 2447445414)
JITTER = 0.52


def unit(h):
    return (h >> np.uint32(8)).astype(np.float64) / 2.0**24


def scatter_position(seed, rank):
    """The oracle of scatter.glsl's function."""
    seed, rank = np.uint32(seed), np.uint32(rank)
    with np.errstate(over="ignore"):
        h = hash32(seed ^ (rank * np.uint32(0x9E3779B9) + np.uint32(0x7F4A7C15)))
        turned = [
            hash32(seed + np.uint32(k)) + (rank + np.uint32(1)) * np.uint32(step)
            for k, step in enumerate(STEP)
        ]
        shaken = [unit(hash32(h + np.uint32(k + 1))) - 0.5 for k in range(2)]
    spread = JITTER / np.sqrt(rank.astype(np.float64) + 1.0)
    return np.stack([np.mod(unit(t) + spread * s, 1.0) for t, s in zip(turned, shaken, strict=True)], axis=-1)


@pytest.mark.gl
def test_shader_positions_and_presence_match_the_oracle(gl):
    rng = np.random.default_rng(3)
    seed, rank = rng.integers(0, 2**32, 300, dtype=np.uint32), rng.integers(0, 2000, 300).astype(np.uint32)
    whole = "uint(a.x) * 65536u + uint(a.y)"
    halves = np.c_[seed >> 16, seed & 0xFFFF, rank, np.zeros(300)]
    got = evaluate(gl, INCLUDES, f"vec4(scatter_position({whole}, uint(a.z)), 0.0, 0.0)", halves)[:, :2]
    off = np.abs(got - scatter_position(seed, rank))
    assert np.minimum(off, 1.0 - off).max() < 1e-6

    rng = np.random.default_rng(4)
    rank, away = rng.integers(0, 320, 400), rng.uniform(0.0, 90.0, 400)
    got = evaluate(
        gl, INCLUDES, "vec4(presence(uint(a.x), 320.0, a.y, 6.0, 80.0))", np.c_[rank, away, away, away]
    )[:, 0]
    share = 6.0 / np.maximum(away, 6.0)
    up = np.clip((share * (1.0 + BAND) - (rank + 0.5) / 320.0) / (BAND * share), 0.0, 1.0)
    expected = up * np.clip((80.0 - away) / (0.35 * 80.0), 0.0, 1.0)
    np.testing.assert_allclose(got, expected, atol=2e-4)


def test_every_prefix_of_a_cell_is_evenly_spread():
    for count in (16, 60, 200):
        gaps = []
        for seed in np.random.default_rng(5).integers(0, 2**32, 40, dtype=np.uint32):
            places = scatter_position(np.full(count, seed), np.arange(count))
            away = np.abs(places[:, None] - places[None])
            away = np.hypot(*np.moveaxis(np.minimum(away, 1.0 - away), -1, 0)) + 2.0 * np.eye(count)
            gaps.append(away.min(axis=1).mean())
        assert np.mean(gaps) > 0.62 / np.sqrt(count)  # at random 0.5, on a square lattice 1


def test_points_do_not_depend_on_the_eye():
    for eye in EYES:
        near = np.add(eye, [0.5, -0.3, 0.1])
        found = []
        for each in (eye, near):
            cells = cells_within(each, LAYER.draw_distance, LAYER.cell_size)
            rows = scatter_points(LAYER, cells, each, 1.7).rows
            corner = rows["corner"] + np.asarray(each[:2])
            names = np.round(corner / LAYER.cell_size).astype(int)
            keys = list(zip(*names.T.tolist(), rows["rank"].tolist(), strict=True))
            found.append(dict(zip(keys, zip(rows["seed"].tolist(), corner, strict=True), strict=True)))
        both = found[0].keys() & found[1].keys()
        assert len(both) > 0.9 * len(found[0])
        for key in list(both)[::50]:
            assert found[0][key][0] == found[1][key][0]
            np.testing.assert_allclose(
                found[0][key][1], found[1][key][1], atol=1e-2 if abs(eye[0]) > 1e5 else 1e-4
            )


def test_all_present_points_are_returned_by_distance():
    eye = EYES[0]
    cells = cells_within(eye, LAYER.draw_distance, LAYER.cell_size)
    places = scatter_points(LAYER, cells, eye, 0.0)
    returned = np.zeros(len(cells), int)
    code = {tuple(cell): k for k, cell in enumerate(cells.tolist())}
    corner = np.round((places.rows["corner"] + np.asarray(eye[:2])) / LAYER.cell_size).astype(int)
    for cell in corner.tolist():
        returned[code[tuple(cell)]] += 1
    nearest = cell_distances(eye, cells, LAYER.cell_size)
    share = LAYER.full_distance / np.maximum(nearest, LAYER.full_distance)
    present = (np.arange(LAYER.capacity) + 0.5) / LAYER.capacity < share[:, None] * (1.0 + BAND)
    assert (returned >= present.sum(axis=1)).all()
    assert returned.sum() < 1.1 * present.sum()

    assert places.counts.sum() == len(places.rows)
    corner = places.rows["corner"] + LAYER.cell_size / 2
    away = np.hypot(*np.maximum(np.abs(corner) - LAYER.cell_size / 2, 0.0).T)
    ends = np.cumsum(places.counts)
    assert away[: ends[0]].max() < 10.0 + 1e-3
    assert away[ends[0] : ends[1]].min() >= 10.0 - 1e-3
    assert away[ends[1] :].min() >= 30.0 - 1e-3
    assert len(scatter_points(LAYER, cells, eye, 100.0).rows) == 0  # from so high nothing is near


def test_visible_cells_are_never_culled_and_points_cached_per_view():
    eye = (10.0, 20.0, 31.7)
    camera = Camera(eye, (40.0, 45.0, 30.0))
    cells = cells_within(eye, 60.0, 4.0)
    seen = {
        tuple(cell) for cell in cells[cells_in_frustum(camera.frustum(1.5), cells, 4.0, eye, 1.7)].tolist()
    }
    rng = np.random.default_rng(8)
    places = rng.uniform(-40.0, 40.0, (4000, 2)) + eye[:2]
    away = np.hypot(*(places - eye[:2]).T)
    up = 30.0 + rng.uniform(-1.2, 1.2, 4000) * away
    clip = np.c_[places - eye[:2], up - eye[2], np.ones(4000)] @ camera.to_clip(1.5).T
    visible = (np.abs(clip[:, :2]) < clip[:, 3:]).all(axis=1) & (clip[:, 3] > 0.2)
    cells_of = np.floor(places[visible] / 4.0).astype(int)
    assert {tuple(cell) for cell in cells_of.tolist()} <= seen
    assert len(seen) < 0.5 * len(cells)

    nearby, again = VisiblePoints(LAYER), VisiblePoints(LAYER)
    other = replace(camera, eye=(10.0, 20.1, 31.7))
    places = nearby.points(camera, 1.5, 1.7)
    assert nearby.points(camera, 1.5, 1.7) is places
    for view in ((other, 1.5, 1.7), (camera, 1.2, 1.7), (camera, 1.5, 9.0)):
        moved = nearby.points(*view)
        assert moved is not places
        assert moved.rows.tobytes() == again.points(*view).rows.tobytes()
