"""Surface of the ground near the eye: its shader functions and its maps."""

import itertools

import numpy as np
import pytest

from sketchterrain.render.frame import FrameBlock
from sketchterrain.render.ground import GroundPool
from sketchterrain.render.programs import set_uniforms
from sketchterrain.render.surface_map import NEAR_WIDTH, SurfaceMap
from sketchterrain.resources import source
from sketchterrain.tiles.borders import tile_indices

from .ground_model import QUADS, SIDE, neighbours, pack_tiles, shaded
from .test_shaders import evaluate, unit_vectors

pytestmark = pytest.mark.gl

SURFACE = ["render/surface.glsl"]
ROUGHNESS = (0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0)
F0 = 0.04


def sphere_grid(cosines, turns):
    """Directions of a hemisphere and the same share of it, over its projected area, for each."""
    nl = np.sqrt((np.arange(cosines) + 0.5) / cosines)
    turn = (np.arange(turns) + 0.5) / turns * np.pi
    nl, turn = (grid.ravel() for grid in np.meshgrid(nl, turn))
    flat = np.sqrt(1.0 - nl**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), nl], axis=-1)


def test_a_white_furnace_gets_no_brighter(gl):
    """Of white light from all around a white surface sends back all at most, seen from anywhere."""
    light = sphere_grid(300, 300)
    for roughness, to_eye in itertools.product(ROUGHNESS, (0.05, 0.15, 0.3, 0.6, 1.0)):
        eye = f"vec3({np.sqrt(1.0 - to_eye**2)}, 0.0, {to_eye})"
        up = "vec3(0.0, 0.0, 1.0)"
        call = f"vec4(reflectance(vec3(1.0), vec3({F0}), {roughness}, {up}, {eye}, a.xyz), 0.0)"
        got = evaluate(gl, SURFACE, call, np.c_[light, light[:, 0]])[:, 0].astype(float)
        share = float((got / light[:, 2]).mean() * np.pi)
        assert (0.87 if to_eye >= 0.6 else 0.4) <= share <= 1.003, (roughness, to_eye)


def test_reflectance_is_reciprocal(gl):
    light, eye = unit_vectors(400, seed=2), unit_vectors(400, seed=3)
    light[:, 2], eye[:, 2] = np.abs(light[:, 2]) + 0.02, np.abs(eye[:, 2]) + 0.02
    light, eye = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (light, eye))
    for roughness in ROUGHNESS:
        # Two directions in four numbers: x and y of each, z follows.
        call = (
            f"vec4(reflectance(vec3(0.3, 0.5, 0.7), vec3({F0}), {roughness}, vec3(0.0, 0.0, 1.0),"
            " vec3(a.xy, sqrt(1.0 - dot(a.xy, a.xy))), vec3(a.zw, sqrt(1.0 - dot(a.zw, a.zw)))), 0.0)"
        )
        there = evaluate(gl, SURFACE, call, np.c_[eye[:, :2], light[:, :2]])[:, :3] / light[:, 2:]
        back = evaluate(gl, SURFACE, call, np.c_[light[:, :2], eye[:, :2]])[:, :3] / eye[:, 2:]
        assert np.allclose(there, back, rtol=5e-4, atol=1e-6), roughness


def test_rough_ground_is_brightest_with_the_sun_behind_the_eye(gl):
    eye = np.array([np.sin(1.0), 0.0, np.cos(1.0)])
    rows = [[*eye, 0.0], [-eye[0], 0.0, eye[2], 0.0]]
    call = "vec4(reflectance(vec3(0.2), vec3(0.03), 1.0, vec3(0.0, 0.0, 1.0), vec3({}, 0.0, {}), a.xyz), 0.0)"
    behind, ahead = evaluate(gl, SURFACE, call.format(eye[0], eye[2]), rows)[:, 1]
    assert behind > 1.5 * ahead


def test_reflectance_is_its_formula(gl):
    """Hammon's diffuse part and Trowbridge and Reitz's facets, in double precision."""
    g, f0, albedo = 0.49, 0.04, 0.5
    light, eye = unit_vectors(200, seed=7), np.array([0.48, 0.36, 0.8])
    light[:, 2] = np.abs(light[:, 2])
    between = light + eye
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    nl, nh, lh, lv = light[:, 2], between[:, 2], (light * between).sum(axis=1), light @ eye
    facets = g**2 / (np.pi * (nh**2 * (g**2 - 1.0) + 1.0) ** 2)
    smith = 0.5 / (2.0 * nl * eye[2] * (1.0 - g) + (nl + eye[2]) * g)
    facing = 0.5 + 0.5 * lv
    rough = facing * (0.9 - 0.4 * facing) * (0.5 + nh) / nh
    even = 1.05 * (1.0 - f0) * (1.0 - (1.0 - nl) ** 5) * (1.0 - (1.0 - eye[2]) ** 5)
    inside = albedo * ((even + (rough - even) * g) / np.pi + 0.1159 * g * albedo) / (1.03 + 0.165 * g**3)
    expected = nl * (inside + (f0 + (1.0 - f0) * (1.0 - lh) ** 5) * facets * smith)
    up, to_eye = "vec3(0.0, 0.0, 1.0)", "vec3(0.48, 0.36, 0.8)"
    call = f"vec4(reflectance(vec3(0.5), vec3(0.04), 0.7, {up}, {to_eye}, a.xyz), 0.0)"
    got = evaluate(gl, SURFACE, call, np.c_[light, nl])[:, 0]
    assert np.allclose(got, expected, rtol=1e-4, atol=1e-6)


TEXELS = 128
REACH = 150.0
EYES = [(502.3, 248.7, 190.0), (-3e6 + 502.123, 7e6 + 251.77, 1234.5)]
SNAP = 1.0 / 128.0
"""Texels by which a rasterizer may move a vertex, and twice as much for the interpolation."""


class Scene:
    """A map of five tiles' ground."""

    def __init__(self, gl, terrain, eye, *, lift=0.0):
        self.gl, self.eye = gl, np.asarray(eye)
        keys, self.draws = neighbours(eye)
        self.vertices = pack_tiles(terrain, keys)
        self.vertices["height"] += np.float32(lift)
        self.vertices["parent_height"] += np.float32(lift)
        self.extent = terrain.extent
        self.pool = GroundPool(gl, terrain.extent, gl.buffer(self.vertices.tobytes()))
        self.frame = FrameBlock(gl)
        self.map = SurfaceMap(gl, self.pool, texels=TEXELS, reach=REACH)
        self.see(eye)

    def see(self, eye, *, moving=False):
        self.eye = np.asarray(eye, float)
        self.frame["eye"] = (0.0, 0.0, eye[2])
        self.frame.upload()
        self.pool.place(self.draws, tuple(eye))
        self.map.update(tuple(eye), moving=moving)

    def texels(self, far):
        """Places (n, n, 2) m from the eye, and texels (n, n, 4), of one square."""
        west, south, per_width, base = self.map.uniforms(tuple(self.eye))[
            "surface_far" if far else "surface_near"
        ]
        whole = np.frombuffer(self.map.textures["surface"].read(), np.float32).reshape(TEXELS, -1, 4)
        texels = whole[:, TEXELS:].copy() if far else whole[:, :TEXELS].copy()
        texels[..., 2] += base * texels[..., 3]
        along = (np.arange(TEXELS) + 0.5) / (TEXELS * per_width)
        x, y = np.meshgrid(west + along, south + along)
        return np.stack([x, y], axis=-1), texels

    def drawn_at(self, places):
        """Height (m) and normal's x, y of the drawn triangles at places (k, 2) m from the eye, NaN beside."""
        corners, _, slope, _ = shaded(self.draws, self.vertices, self.extent, self.eye)
        values = np.concatenate([corners[..., 2:], slope / 32767.0], axis=-1).reshape(len(corners), -1, 3)
        flat = corners.reshape(len(corners), SIDE**2, 3)[..., :2].astype(float)
        indices, first, count = tile_indices(QUADS)
        found = np.full((len(places), 3), np.nan)
        for tile, case in enumerate(self.draws.cases):
            triangles = indices[first[case] : first[case] + count[case]].reshape(-1, 3)
            a, b, c = (flat[tile][triangles[:, k]] for k in range(3))
            area = _cross(b - a, c - a)
            for row, place in enumerate(places):
                u, v = _cross(c - b, place - b) / area, _cross(a - c, place - c) / area
                inside = np.flatnonzero((u >= 0) & (v >= 0) & (u + v <= 1))
                if len(inside):
                    k = inside[0]
                    share = np.array([u[k], v[k], 1.0 - u[k] - v[k]])
                    found[row] = share @ values[tile][triangles[k]]
        return found

    def ask(self, call, rows):
        """Evaluate a GLSL expression of `a` (vec4) at rows."""
        text = "#version 430 core\n" + source("render/surface_map.glsl")
        text += f"in vec4 a; out vec4 result; void main() {{ result = {call}; }}"
        program = self.gl.program(vertex_shader=text, varyings=["result"])
        for unit, (name, texture) in enumerate(self.map.textures.items()):
            texture.use(unit)
            set_uniforms(program, {name: unit})
        set_uniforms(program, self.map.uniforms(tuple(self.eye)))
        rows = np.ascontiguousarray(rows, np.float32)
        output = self.gl.buffer(reserve=rows.nbytes)
        array = self.gl.vertex_array(program, [(self.gl.buffer(rows.tobytes()), "4f4", "a")])
        array.transform(output, vertices=len(rows))
        return np.frombuffer(output.read(), np.float32).reshape(-1, 4)


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("far", [False, True])
def test_texels_are_the_drawn_triangles(gl, waves, eye, far):
    scene = Scene(gl, waves, eye)
    places, texels = scene.texels(far)
    pick = np.random.default_rng(2).integers(0, TEXELS, (150, 2))
    got = texels[pick[:, 0], pick[:, 1]]
    expected = scene.drawn_at(places[pick[:, 0], pick[:, 1]])
    known = got[:, 3] == 1.0
    assert (known == np.isfinite(expected[:, 0])).all()
    assert known.sum() > 100
    texel = places[0, 1, 0] - places[0, 0, 0]
    steepest = 1.5  # m a metre
    np.testing.assert_allclose(got[known, 2], expected[known, 0], atol=SNAP * texel * steepest + 1e-3)
    # Vertices' normals are made one long at each texel.
    flat = expected[known, 1:]
    np.testing.assert_allclose(got[known, :2], flat, atol=0.02)


def test_what_stands_stands_on_the_drawn_ground_not_on_the_true_one(gl, waves):
    eye = EYES[0]
    lift = 25.0
    scene = Scene(gl, waves, eye, lift=lift)
    away = np.random.default_rng(3).uniform(-140.0, 140.0, (120, 2))
    true = waves.heights(away[:, 0] + eye[0], away[:, 1] + eye[1]) - eye[2]
    got = scene.ask("vec4(standing_height(a.xyz))", np.c_[away, true, true])[:, 0]
    drawn = scene.drawn_at(away)[:, 0]
    known = np.isfinite(drawn)
    assert np.abs(got - drawn)[known].max() < 0.35  # texels of 1.6 and 3.1 m on quads of 4 m
    assert np.abs(got - true)[known].min() > 0.5 * lift


def test_weights_are_those_of_the_vertices_and_beyond_the_map_the_true_foot_counts(gl, waves):
    scene = Scene(gl, waves, EYES[0])
    rows = [[0.0, 5000.0, -12.5, 0.0], [-900.0, 3.0, 77.0, 0.0]]
    assert (scene.ask("vec4(standing_height(a.xyz))", rows)[:, 0] == [-12.5, 77.0]).all()
    assert (scene.ask("vec4(drawn_normal(drawn_surface(a.xy)), 1.0)", rows)[:, :3] == [0.0, 0.0, 1.0]).all()

    rows = np.random.default_rng(4).uniform(-90.0, 90.0, (40, 4))
    got = scene.ask("drawn_weights_low(a.xy)", rows)
    assert np.abs(got - [0.75, 0.0, 0.25, 0.0]).max() < 1.5 / 255.0
    assert (scene.ask("drawn_weights_high(a.xy)", rows) == 0.0).all()


def test_heights_stay_when_the_eye_moves_also_with_an_old_map(gl, waves):
    eye = np.array(EYES[0])
    scene = Scene(gl, waves, eye)
    places = np.random.default_rng(6).uniform(-60.0, 60.0, (50, 2)) + eye[:2]
    heights = []
    for shift in ((0.0, 0.0, 0.0), (0.31, -0.17, 0.6), (1.9, 3.3, -2.0), (9.0, 14.0, 5.0)):
        now = eye + shift
        scene.see(now)
        rows = np.c_[places - now[:2], np.zeros((len(places), 2))]
        heights.append(scene.ask("vec4(standing_height(a.xyz))", rows)[:, 0] + now[2])
    heights = np.array(heights)
    assert np.abs(heights - heights[0]).max() < 0.01

    scene = Scene(gl, waves, eye)
    place = eye[:2] + np.array([20.0, 30.0])
    row = [[*(place - eye[:2]), 0.0, 0.0]]
    before = scene.ask("vec4(standing_height(a.xyz))", row)[0, 0] + eye[2]
    scene.eye = eye + np.array([3.0, -2.0, 10.0])  # the map is not drawn again
    row = [[*(place - scene.eye[:2]), 0.0, 0.0]]
    after = scene.ask("vec4(standing_height(a.xyz))", row)[0, 0] + scene.eye[2]
    assert after == pytest.approx(before, abs=2e-3)


def test_nothing_is_drawn_again_while_nothing_changes(gl, waves, monkeypatch):
    scene = Scene(gl, waves, EYES[0])
    drawn = []
    monkeypatch.setattr(scene.pool, "draw", lambda *args, **kwargs: drawn.append(1))
    scene.see(np.add(EYES[0], 0.2))
    assert not drawn
    scene.draws.morph[1, 1, 1] *= 0.5
    for _ in range(4):
        scene.see(np.add(EYES[0], 0.2), moving=True)
    assert len(drawn) == 2


def test_tiles_beside_a_square_are_left_out(gl, waves):
    scene = Scene(gl, waves, EYES[0])
    half = NEAR_WIDTH / 2
    assert scene.pool.tiles_within(-half, -half, half, half).tolist() == [0, 1, 3]
    assert scene.pool.tiles_within(10.0, 20.0, half, half).tolist() == [1]
    assert scene.pool.tiles_within(-half, 600.0, half, 700.0).tolist() == []
