"""GLSL functions against NumPy: texturing, reflectance, the surface map."""

import itertools
import re

import numpy as np
import pytest

from sketchterrain.errors import BuildError
from sketchterrain.io.resources import source
from sketchterrain.render import clouds, plant_cells, scatter
from sketchterrain.render import textures as texture_places
from sketchterrain.render.atmosphere import GROUND
from sketchterrain.render.built import MARKS
from sketchterrain.render.clouds import cloud_defines
from sketchterrain.render.ground import SurfaceMap, TileRenderer
from sketchterrain.render.programs import bind_textures, build_program, set_uniforms
from sketchterrain.render.quality import Quality
from sketchterrain.render.shading import Shading
from sketchterrain.render.sky import Weather
from sketchterrain.render.targets import FrameBlock
from sketchterrain.render.textures import (
    OCTAVES,
    PERIOD,
    MaterialTextures,
    material_macros,
    texture_phases,
    texture_uniforms,
    texture_widths,
)
from sketchterrain.schema.geology import Strata
from sketchterrain.schema.materials import BUILT_IN, weight_words
from sketchterrain.schema.parameters import GEOLOGY, defaults
from sketchterrain.tiles import appearance
from sketchterrain.tiles.quadtree import tile_indices

from .conftest import Waves
from .ground_model import QUADS, SIDE, neighbours, pack_tiles, shaded

pytestmark = pytest.mark.gl

WORDS = weight_words(len(BUILT_IN))
HEADER = f"#version 430 core\n#define WEIGHT_WORDS {WORDS}\n"
SAMPLERS = {0x8B5E, 0x8B5F, 0x8B60, 0x8B62, 0x8DC1}  # 2D, 3D, cube, 2D shadow, 2D array
MOST_SAMPLERS = 16  # guaranteed per stage by OpenGL 4.3
WEIGHTS = "vec4(triplanar_weights(a.xyz), 0.0)"


def evaluate(gl, includes, call, inputs, *, set_up=lambda program: None):
    """Run a GLSL expression of `a` (vec4) for each row of `inputs`, through transform feedback."""
    text = HEADER + "".join(source(name) if name.endswith(".glsl") else name for name in includes)
    text += f"in vec4 a; out vec4 result; void main() {{ result = {call}; }}"
    program = gl.program(vertex_shader=text, varyings=["result"])
    set_up(program)
    gl.framebuffer([gl.texture((1, 1), 4)]).use()  # standalone contexts have no default framebuffer
    rows = np.ascontiguousarray(inputs, dtype=np.float32)
    output = gl.buffer(reserve=rows.nbytes)
    gl.vertex_array(program, [(gl.buffer(rows.tobytes()), "4f4", "a")]).transform(output, vertices=len(rows))
    return np.frombuffer(output.read(), np.float32).reshape(-1, 4)


def unit_vectors(count, seed=1):
    v = np.random.default_rng(seed).standard_normal((count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def smoothstep(low, high, x):
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def test_triplanar_weights_equal_their_formula(gl):
    n = unit_vectors(400)
    got = evaluate(gl, ["render/triplanar.glsl"], WEIGHTS, np.c_[n, n[:, 0]])
    raw = smoothstep(0.57357644, 0.81915204, np.abs(n))
    expected = raw / np.maximum(raw.sum(axis=1, keepdims=True), 1e-4)
    assert np.allclose(got[:, :3], expected, atol=2e-5)
    flat = evaluate(gl, ["render/triplanar.glsl"], WEIGHTS, [[0.1, -0.1, 0.99, 0]])
    assert np.allclose(flat[0, :3], [0, 0, 1])


def test_a_broken_program_names_its_files(gl, monkeypatch):
    monkeypatch.setattr(
        "sketchterrain.render.programs.source", lambda *_: HEADER + "void main() { nonsense; }"
    )
    with pytest.raises(BuildError, match=r"screen\.vert\.glsl and sky\.frag\.glsl.*nonsense"):
        build_program(gl, "screen.vert.glsl", "sky.frag.glsl")


def test_no_stage_exceeds_the_guaranteed_texture_units(gl):
    quality = Quality()
    clouds = cloud_defines(quality, Weather(clouds=0.8))
    defines = Shading(
        gl,
        quality,
        BUILT_IN,
        aridity=0.2,
        look={},
        strata=Strata.from_settings(defaults(GEOLOGY)),
        clouds=clouds,
    ).defines
    painted = {"APPEARANCE": 8, "APPEARANCE_LEVELS": 16}
    programs = [
        build_program(gl, "screen.vert.glsl", "shade_ground.frag.glsl", defines={**defines, **painted}),
        build_program(gl, "rock.vert.glsl", "rock.frag.glsl", defines=defines),
        build_program(gl, "water.vert.glsl", "water.frag.glsl", defines=defines),
        build_program(gl, "built.vert.glsl", "built.frag.glsl", defines={**MARKS, **defines, "FAR": 0}),
        build_program(gl, "grass_plant.vert.glsl", captured=["foot_height"], defines={**defines, "KIND": 1}),
        build_program(gl, "rock_place.vert.glsl", captured=["centre_radius"], defines=defines),
    ]
    for program in programs:
        read = [name for name in program if getattr(program[name], "gl_type", None) in SAMPLERS]
        assert 2 < len(read) <= MOST_SAMPLERS


def test_constants_of_shaders_equal_those_of_python():
    for file, name, value in (
        ("appearance.glsl", "PAGES", appearance.PAGES),
        ("appearance.glsl", "TEXELS", appearance.TEXELS),
        ("appearance.glsl", "TEXEL_PIXELS", appearance.PIXELS),
        ("clouds.glsl", "CLOUD_PERIOD", clouds.PERIOD),
        ("clouds.glsl", "EARTH", GROUND),
        ("hex_tiling.glsl", "HEX_PERIOD", texture_places.PERIOD),
        ("matter.glsl", "RATIO", texture_places.RATIO),
        ("scatter.glsl", "BAND", scatter.BAND),
        ("tree_stand.vert.glsl", "SINK", plant_cells.SINK),
    ):
        (literal,) = re.findall(rf"const \w+ {name} = ([\d.e]+);", source(f"render/{file}"))
        assert float(literal) == value, (file, name)


HEX = ["render/hex_tiling.glsl"]
CORNERS = "hexagons(a.xy)"


def uniform(count, low, high, columns=4, seed=2):
    return np.random.default_rng(seed).uniform(low, high, (count, columns)).astype(np.float32)


def middle(ids):
    return np.stack([ids[:, 0] + 0.5 * ids[:, 1], ids[:, 1]], axis=-1) / 2.0


def hexagons(gl, places):
    rows = np.c_[places, places]
    ids = [
        evaluate(gl, HEX, f"vec4(vec2({CORNERS}.{which}), vec2(0.0))", rows)[:, :2]
        for which in ("first", "second", "third")
    ]
    weights = evaluate(gl, HEX, f"vec4({CORNERS}.weight, float({CORNERS}.count))", rows)
    return ids, weights[:, :3], weights[:, 3]


def test_height_blending_and_filtered_roughness_equal_their_formulas(gl):
    rows = uniform(500, 0.0, 1.5)
    got = evaluate(gl, ["render/height_blend.glsl"], "vec4(layer_share(a.x, a.y, a.z))", rows)[:, 0]
    below, above, weight = rows[:, 0], rows[:, 1], rows[:, 2]
    expected = smoothstep(below - 0.4, below + 0.4, weight + above) * smoothstep(0.0, 0.06, weight)
    assert np.abs(got - expected).max() < 1e-5
    rows[:, 2] = 0.0
    assert (evaluate(gl, ["render/height_blend.glsl"], "vec4(layer_share(a.x, a.y, a.z))", rows) == 0.0).all()
    rows = uniform(500, 0.0, 1.0)
    got = evaluate(gl, ["render/roughness.glsl"], "vec4(filtered_roughness(a.x, a.y))", rows)[:, 0]
    assert np.abs(got - np.clip(rows[:, 0] ** 4 + 2.0 * rows[:, 1], 0.0, 1.0) ** 0.25).max() < 1e-5


def test_hexagons_are_the_nearest_three_with_continuous_weights(gl):
    places = uniform(300, 0.0, PERIOD, 2)
    ids, weights, count = hexagons(gl, places)
    skewed = 2.0 * np.c_[places[:, 0] - 0.5 * places[:, 1], places[:, 1]]
    for each in ids:
        # Corners of the enclosing triangle of the skewed lattice.
        assert (np.abs(each - skewed) <= 1.0 + 1e-4).all()
    assert all((np.abs(a - b).max(axis=1) == 1).all() for a, b in zip(ids, [*ids[1:], ids[0]], strict=True))
    # Barycentric: the unsharpened weighted mean of the corners is the position.
    plain = weights ** (1 / 7)
    plain /= plain.sum(axis=1, keepdims=True)
    mean = sum(plain[:, k : k + 1] * middle(ids[k]) for k in range(3))
    # The seventh power of tiny weights loses precision.
    sound = weights.min(axis=1) > 1e-12
    assert np.abs(mean - places)[sound].max() < 2e-3
    assert (np.diff(weights, axis=1) <= 1e-6).all()
    assert np.allclose(weights.sum(axis=1), 1.0, atol=1e-5)
    assert (count == np.where(weights[:, 2] > 0.02, 3, np.where(weights[:, 1] > 0.02, 2, 1))).all()

    start = uniform(200, 1.0, 9.0, 2)
    step = 1e-4 * uniform(200, -1.0, 1.0, 2, seed=7)
    here, there = hexagons(gl, start), hexagons(gl, start + step)

    def weight_of(found, expected):
        ids, weights, _ = found
        return sum(weights[:, k] * (ids[k] == expected).all(axis=1) for k in range(3))

    for each in here[0]:
        assert np.abs(weight_of(here, each) - weight_of(there, each)).max() < 5e-3


def test_hexagons_repeat_after_the_period_and_are_independent_within_it(gl):
    places = np.round(uniform(200, 0.0, 8.0, 2) * 1024) / 1024
    chance = f"vec4(hex_hash({CORNERS}.first), {CORNERS}.weight.x)"
    for shift in ((PERIOD, 0), (0, PERIOD), (-PERIOD, 2 * PERIOD)):
        here, there = (
            evaluate(gl, HEX, chance, np.c_[each, each]) for each in (places, places + np.array(shift))
        )
        assert np.allclose(here, there, atol=1e-4)

    ids = np.stack(np.meshgrid(np.arange(64), np.arange(64)), axis=-1).reshape(-1, 2)
    got = evaluate(gl, HEX, "vec4(hex_hash(ivec2(a.xy)), 0.0)", np.c_[ids, ids])[:, :3]
    assert np.allclose(got[:, :2].mean(axis=0), 0.5, atol=0.02)
    assert np.allclose(got[:, :2].std(axis=0), 12**-0.5, atol=0.01)
    assert abs(got[:, 2].mean()) < 0.04
    assert got[:, 2].min() >= -1.0
    assert got[:, 2].max() < 1.0
    assert len(np.unique(got, axis=0)) > 4000
    table = got[:, 0].reshape(64, 64)
    neighbours = np.corrcoef(table[:, :-1].ravel(), table[:, 1:].ravel())[0, 1]
    assert abs(neighbours) < 0.05


WORD_AT = """
vec4 weight_word(vec2 place, int word)
{
    vec4 weights[WEIGHT_WORDS];
    drawn_weights(place, weights);
    return weights[word];
}
"""

TILED = """
uniform float across; // textures over the picture
in vec2 uv;
out vec4 texel;
void main()
{
    float width = texture_tiling[LAYER].x;
    MaterialSample m = sample_octave(LAYER, Plane(2, uv * across * width), 0, across * width / SIDE);
    texel = vec4(m.albedo, m.height);
}
"""


def tiled(gl, textures, layer, hexes, *, across=4, side=256):
    """Draw a plane of one layer from above: (side, side, 4), albedo and height."""
    defines = {"PLANES": 1, "SIZES": 1, "HEXES": hexes, "DETAIL": 1, "OCTAVES": OCTAVES, "PI": 3.14159265}
    defines |= material_macros(BUILT_IN)
    macros = "".join(f"#define {name} {value}\n" for name, value in defines.items())
    macros += f"#define LAYER {layer}\n#define SIDE {side}.0\n"
    program = gl.program(
        vertex_shader=source("render/screen.vert.glsl"),
        fragment_shader="#version 430 core\n" + macros + source("render/matter.glsl") + TILED,
    )
    widths = texture_widths(BUILT_IN)
    phases = [tuple(phase) for phase in texture_phases(BUILT_IN, (0.031, 0.053, 0.0), widths).tolist()]
    units = {"material_colour": 0, "material_relief": 1, "phases": phases, "across": float(across)}
    set_uniforms(program, units | texture_uniforms(BUILT_IN, widths))
    textures.colour.use(0)
    textures.relief.use(1)
    target = gl.texture((side, side), 4, dtype="f4")
    gl.framebuffer([target]).use()
    gl.enable_only(gl.NOTHING)
    gl.vertex_array(program, []).render(vertices=3)
    return np.frombuffer(target.read(), np.float32).reshape(side, side, 4)


def test_hexagons_hide_the_repetition_and_keep_mean_and_contrast(gl):
    textures = MaterialTextures(gl, Waves.sketch, None, Quality(material_texels=256))

    def correlation(picture, shift):
        height = picture[..., 3]
        return np.corrcoef(height[:, :-shift].ravel(), height[:, shift:].ravel())[0, 1]

    for name in ("grass", "scree", "river_bed", "rock", "snow"):
        plain, hidden = (tiled(gl, textures, list(BUILT_IN.layers).index(name), hexes) for hexes in (1, 3))
        # A texture's width is 64 pixels here.
        assert correlation(plain, 64) > 0.99, name
        assert abs(correlation(hidden, 64)) < 0.08, name
        assert hidden[..., :3].mean() == pytest.approx(plain[..., :3].mean(), rel=0.01), name
        assert hidden[..., 3].std() > 0.92 * plain[..., 3].std(), name


SURFACE = ["render/surface.glsl"]
ROUGHNESS = (0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0)
F0 = 0.04


def sphere_grid(cosines, turns):
    """Directions of a hemisphere with equal projected solid angles."""
    nl = np.sqrt((np.arange(cosines) + 0.5) / cosines)
    turn = (np.arange(turns) + 0.5) / turns * np.pi
    nl, turn = (grid.ravel() for grid in np.meshgrid(nl, turn))
    flat = np.sqrt(1.0 - nl**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), nl], axis=-1)


def test_white_furnace_reflects_at_most_all_light(gl):
    light = sphere_grid(300, 300)
    for roughness, to_eye in itertools.product(ROUGHNESS, (0.05, 0.15, 0.3, 0.6, 1.0)):
        eye = f"vec3({np.sqrt(1.0 - to_eye**2)}, 0.0, {to_eye})"
        up = "vec3(0.0, 0.0, 1.0)"
        call = f"vec4(reflectance(vec3(1.0), vec3({F0}), {roughness}, {up}, {eye}, a.xyz), 0.0)"
        got = evaluate(gl, SURFACE, call, np.c_[light, light[:, 0]])[:, 0].astype(float)
        share = float((got / light[:, 2]).mean() * np.pi)
        assert (0.87 if to_eye >= 0.6 else 0.4) <= share <= 1.003, (roughness, to_eye)


def test_reflectance_equals_its_formula(gl):
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
"""Texels: rasterizer precision of vertices and interpolation."""


class Scene:
    """A surface map of five tiles."""

    def __init__(self, gl, terrain, eye, *, lift=0.0):
        self.gl, self.eye = gl, np.asarray(eye)
        keys, self.draws = neighbours(eye)
        self.vertices = pack_tiles(terrain, keys)
        self.vertices["height"] += np.float32(lift)
        self.vertices["parent_height"] += np.float32(lift)
        self.extent = terrain.extent
        self.tile_renderer = TileRenderer(gl, terrain.extent, gl.buffer(self.vertices.tobytes()), WORDS)
        self.frame = FrameBlock(gl)
        self.map = SurfaceMap(gl, self.tile_renderer, texels=TEXELS, radius=REACH)
        self.draw(eye)

    def draw(self, eye, *, moving=False):
        self.eye = np.asarray(eye, float)
        self.frame["eye"] = (0.0, 0.0, eye[2])
        self.frame.upload()
        self.tile_renderer.set_tiles(self.draws, tuple(eye))
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

    def evaluate(self, call, rows):
        """Evaluate a GLSL expression of `a` (vec4) at rows."""

        def set_up(program):
            set_uniforms(program, bind_textures(self.map.textures) | self.map.uniforms(tuple(self.eye)))

        return evaluate(self.gl, ["render/surface_map.glsl", WORD_AT], call, rows, set_up=set_up)


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("far", [False, True])
def test_surface_map_equals_the_drawn_triangles(gl, waves, eye, far):
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
    # Normals are normalised per texel.
    flat = expected[known, 1:]
    np.testing.assert_allclose(got[known, :2], flat, atol=0.02)


def test_standing_height_is_on_the_drawn_terrain(gl, waves):
    eye = EYES[0]
    lift = 25.0
    scene = Scene(gl, waves, eye, lift=lift)
    away = np.random.default_rng(3).uniform(-140.0, 140.0, (120, 2))
    true = waves.heights(away[:, 0] + eye[0], away[:, 1] + eye[1]) - eye[2]
    got = scene.evaluate("vec4(standing_height(a.xyz))", np.c_[away, true, true])[:, 0]
    drawn = scene.drawn_at(away)[:, 0]
    known = np.isfinite(drawn)
    assert np.abs(got - drawn)[known].max() < 0.35  # texels of 1.6 and 3.1 m on quads of 4 m
    assert np.abs(got - true)[known].min() > 0.5 * lift


def test_surface_weights_equal_the_vertices_and_outside_the_map_the_foot_is_returned(gl, waves):
    scene = Scene(gl, waves, EYES[0])
    rows = [[0.0, 5000.0, -12.5, 0.0], [-900.0, 3.0, 77.0, 0.0]]
    assert (scene.evaluate("vec4(standing_height(a.xyz))", rows)[:, 0] == [-12.5, 77.0]).all()
    assert (
        scene.evaluate("vec4(drawn_normal(drawn_surface(a.xy)), 1.0)", rows)[:, :3] == [0.0, 0.0, 1.0]
    ).all()

    rows = np.random.default_rng(4).uniform(-90.0, 90.0, (40, 4))
    for word in range(WORDS):
        got = scene.evaluate(f"weight_word(a.xy, {word})", rows)
        assert np.abs(got - np.array([0.75, 0.0, 0.25, 0.0]) * (word == 0)).max() < 1.5 / 255.0


def test_surface_heights_are_stable_when_the_eye_moves(gl, waves):
    eye = np.array(EYES[0])
    scene = Scene(gl, waves, eye)
    places = np.random.default_rng(6).uniform(-60.0, 60.0, (50, 2)) + eye[:2]
    heights = []
    for shift in ((0.0, 0.0, 0.0), (0.31, -0.17, 0.6), (1.9, 3.3, -2.0), (9.0, 14.0, 5.0)):
        now = eye + shift
        scene.draw(now)
        rows = np.c_[places - now[:2], np.zeros((len(places), 2))]
        heights.append(scene.evaluate("vec4(standing_height(a.xyz))", rows)[:, 0] + now[2])
    heights = np.array(heights)
    assert np.abs(heights - heights[0]).max() < 0.01

    scene = Scene(gl, waves, eye)
    place = eye[:2] + np.array([20.0, 30.0])
    row = [[*(place - eye[:2]), 0.0, 0.0]]
    before = scene.evaluate("vec4(standing_height(a.xyz))", row)[0, 0] + eye[2]
    scene.eye = eye + np.array([3.0, -2.0, 10.0])  # with the old map
    row = [[*(place - scene.eye[:2]), 0.0, 0.0]]
    after = scene.evaluate("vec4(standing_height(a.xyz))", row)[0, 0] + scene.eye[2]
    assert after == pytest.approx(before, abs=2e-3)


def test_an_unchanged_surface_map_is_not_redrawn(gl, waves, monkeypatch):
    scene = Scene(gl, waves, EYES[0])
    drawn = []
    monkeypatch.setattr(scene.tile_renderer, "draw", lambda *args, **kwargs: drawn.append(1))
    scene.draw(np.add(EYES[0], 0.2))
    assert not drawn
    scene.draws.morph[1, 1, 1] *= 0.5
    for _ in range(4):
        scene.draw(np.add(EYES[0], 0.2), moving=True)
    assert len(drawn) == 2
