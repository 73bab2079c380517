"""GLSL functions against plain NumPy."""

from __future__ import annotations

import re

import numpy as np
import pytest

from sketchterrain.errors import BuildError
from sketchterrain.look.texture_maker import LAYERS
from sketchterrain.render import Quality, Weather, clouds, plant_stand, scatter, texture_places
from sketchterrain.render.atmosphere import GROUND
from sketchterrain.render.clouds import cloud_defines
from sketchterrain.render.programs import build_program, build_transform
from sketchterrain.render.shading import Shading
from sketchterrain.resources import source

pytestmark = pytest.mark.gl

HEADER = "#version 430 core\n"
SAMPLERS = {0x8B5E, 0x8B5F, 0x8B60, 0x8B62, 0x8DC1}  # 2D, 3D, cube, 2D shadow, 2D array
MOST_SAMPLERS = 16  # in a stage, that every OpenGL 4.3 has room for
WEIGHTS = "vec4(triplanar_weights(a.xyz), 0.0)"


def evaluate(gl, includes, call, inputs):
    """Run a GLSL expression of `a` (vec4) for each row of `inputs`, through transform feedback."""
    text = HEADER + "".join(source(name) for name in includes)
    text += f"in vec4 a; out vec4 result; void main() {{ result = {call}; }}"
    program = gl.program(vertex_shader=text, varyings=["result"])
    gl.framebuffer([gl.texture((1, 1), 4)]).use()  # a context without a window has none of its own
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


def test_triplanar_weights_are_those_of_the_formula(gl):
    n = unit_vectors(400)
    got = evaluate(gl, ["render/triplanar.glsl"], WEIGHTS, np.c_[n, n[:, 0]])
    raw = smoothstep(0.57357644, 0.81915204, np.abs(n))
    expected = raw / np.maximum(raw.sum(axis=1, keepdims=True), 1e-4)
    assert np.allclose(got[:, :3], expected, atol=2e-5)
    flat = evaluate(gl, ["render/triplanar.glsl"], WEIGHTS, [[0.1, -0.1, 0.99, 0]])
    assert np.allclose(flat[0, :3], [0, 0, 1])


def test_facets_cover_the_surface_once(gl):
    theta = (np.arange(20_000) + 0.5) / 20_000 * np.pi / 2
    for roughness in (0.2, 0.5, 1.0):
        rows = np.c_[np.cos(theta), np.full_like(theta, roughness), theta, theta]
        density = evaluate(gl, ["render/surface.glsl"], "vec4(trowbridge_reitz(a.x, a.y))", rows)[:, 0]
        projected = 2 * np.pi * np.sum(density * np.cos(theta) * np.sin(theta)) * (theta[1] - theta[0])
        assert projected == pytest.approx(1.0, abs=2e-3), roughness


def test_schlick_is_its_formula_and_a_white_surface_reflects_no_more_than_it_receives(gl):
    cosine = np.linspace(0, 1, 50)
    got = evaluate(gl, ["render/surface.glsl"], "vec4(schlick(vec3(0.04), a.x), 0.0)", np.c_[[cosine] * 4].T)
    assert np.allclose(got[:, 0], 0.04 + 0.96 * (1 - cosine) ** 5, atol=1e-6)

    light = unit_vectors(40_000, seed=5)
    light[:, 2] = np.abs(light[:, 2])
    to_eye = "normalize(vec3(0.6, 0, 0.8))"
    call = f"vec4(reflectance(vec3(1.0), vec3(0.04), 0.6, vec3(0, 0, 1), {to_eye}, a.xyz), 0.0)"
    got = evaluate(gl, ["render/surface.glsl"], call, np.c_[light, light[:, 0]])[:, 0]
    assert 2 * np.pi * got.mean() <= 1.02


def test_a_broken_program_names_its_files(gl, monkeypatch):
    monkeypatch.setattr(
        "sketchterrain.render.programs.source", lambda name: HEADER + "void main() { nonsense; }"
    )
    with pytest.raises(BuildError, match=r"screen\.vert\.glsl and sky\.frag\.glsl.*nonsense"):
        build_program(gl, "screen.vert.glsl", "sky.frag.glsl")


def test_no_stage_reads_more_textures_than_every_driver_has_room_for(gl):
    quality = Quality()
    clouds = cloud_defines(quality, Weather(clouds=0.8))
    defines = Shading(gl, quality, aridity=0.2, look={}, clouds=clouds).defines
    programs = [
        build_program(gl, "screen.vert.glsl", "shade_ground.frag.glsl", defines=defines),
        build_program(gl, "rock.vert.glsl", "rock.frag.glsl", defines=defines),
        build_program(gl, "water.vert.glsl", "water.frag.glsl", defines=defines),
        build_transform(gl, "grass_plant.vert.glsl", ["stand"], defines={**defines, "KIND": 1}),
        build_transform(gl, "rock_place.vert.glsl", ["stand"], defines=defines),
    ]
    for program in programs:
        read = [name for name in program if getattr(program[name], "gl_type", None) in SAMPLERS]
        assert 2 < len(read) <= MOST_SAMPLERS


def test_constants_of_shaders_are_those_of_the_program():
    for file, name, value in (
        ("clouds.glsl", "CLOUD_PERIOD", clouds.PERIOD),
        ("clouds.glsl", "EARTH", GROUND),
        ("hex_tiling.glsl", "HEX_PERIOD", texture_places.PERIOD),
        ("matter.glsl", "RATIO", texture_places.RATIO),
        ("scatter.glsl", "BAND", scatter.BAND),
        ("tree_stand.vert.glsl", "SINK", plant_stand.SINK),
    ):
        (said,) = re.findall(rf"const \w+ {name} = ([\d.e]+);", source(f"render/{file}"))
        assert float(said) == value, (file, name)
    for file in ("matter.glsl", "rock.frag.glsl", "rock_place.vert.glsl", "variety.glsl"):
        text = source(f"render/{file}")
        numbers = dict(re.findall(r"#define (\w+) (\d)$", text, re.MULTILINE))
        own = {name: int(numbers[name.upper()]) for name in LAYERS if name.upper() in numbers}
        assert own, file
        assert own == {name: list(LAYERS).index(name) for name in own}, file
        assert all(int(size) == len(LAYERS) for size in re.findall(r"uniform \w+ \w+\[(\d+)", text)), file
