"""Tiling and blending of materials: GLSL functions against NumPy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sketchterrain.look.texture_maker import LAYERS
from sketchterrain.look.texture_mips import roughened
from sketchterrain.render import Camera, Quality, Sun, render_picture
from sketchterrain.render.programs import set_uniforms
from sketchterrain.render.texture_places import (
    OCTAVES,
    PERIOD,
    texture_phases,
    texture_uniforms,
    texture_widths,
)
from sketchterrain.render.textures import MaterialTextures
from sketchterrain.resources import source

from .test_shaders import evaluate, smoothstep

pytestmark = pytest.mark.gl

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


def test_a_layer_shows_where_it_stands_higher(gl):
    rows = uniform(500, 0.0, 1.5)
    got = evaluate(gl, ["render/height_blend.glsl"], "vec4(layer_share(a.x, a.y, a.z))", rows)[:, 0]
    below, above, weight = rows[:, 0], rows[:, 1], rows[:, 2]
    expected = smoothstep(below - 0.4, below + 0.4, weight + above) * smoothstep(0.0, 0.06, weight)
    assert np.abs(got - expected).max() < 1e-5
    rows[:, 2] = 0.0
    assert (evaluate(gl, ["render/height_blend.glsl"], "vec4(layer_share(a.x, a.y, a.z))", rows) == 0.0).all()


def test_roughness_of_scatter_is_that_of_the_mipmaps(gl):
    rows = uniform(500, 0.0, 1.0)
    got = evaluate(gl, ["render/roughness.glsl"], "vec4(roughened(a.x, a.y))", rows)[:, 0]
    assert np.abs(got - roughened(rows[:, 0], rows[:, 1])).max() < 1e-5


def test_hexagons_over_a_place_are_the_nearest_three(gl):
    places = uniform(300, 0.0, PERIOD, 2)
    ids, weights, count = hexagons(gl, places)
    skewed = 2.0 * np.c_[places[:, 0] - 0.5 * places[:, 1], places[:, 1]]
    for each in ids:
        # Corners of the triangle of the skewed lattice that the place lies in.
        assert (np.abs(each - skewed) <= 1.0 + 1e-4).all()
    assert all((np.abs(a - b).max(axis=1) == 1).all() for a, b in zip(ids, [*ids[1:], ids[0]], strict=True))
    # Barycentric: the corners' mean by the weights before they are sharpened is the place.
    plain = weights ** (1 / 7)
    plain /= plain.sum(axis=1, keepdims=True)
    mean = sum(plain[:, k : k + 1] * middle(ids[k]) for k in range(3))
    # Weights of a tiny part lose their digits in the seventh power.
    sound = weights.min(axis=1) > 1e-12
    assert np.abs(mean - places)[sound].max() < 2e-3
    assert (np.diff(weights, axis=1) <= 1e-6).all()
    assert np.allclose(weights.sum(axis=1), 1.0, atol=1e-5)
    assert (count == np.where(weights[:, 2] > 0.02, 3, np.where(weights[:, 1] > 0.02, 2, 1))).all()


def test_weights_are_continuous_across_hexagons(gl):
    start = uniform(200, 1.0, 9.0, 2)
    step = 1e-4 * uniform(200, -1.0, 1.0, 2, seed=7)
    here, there = hexagons(gl, start), hexagons(gl, start + step)

    def weight_of(found, wanted):
        ids, weights, _ = found
        return sum(weights[:, k] * (ids[k] == wanted).all(axis=1) for k in range(3))

    for each in here[0]:
        assert np.abs(weight_of(here, each) - weight_of(there, each)).max() < 5e-3


def test_hexagons_repeat_after_the_period_and_are_independent_within_it(gl):
    places = np.round(uniform(200, 0.0, 8.0, 2) * 1024) / 1024
    chance = f"vec4(hex_chance({CORNERS}.first), {CORNERS}.weight.x)"
    for shift in ((PERIOD, 0), (0, PERIOD), (-PERIOD, 2 * PERIOD)):
        here, there = (
            evaluate(gl, HEX, chance, np.c_[each, each]) for each in (places, places + np.array(shift))
        )
        assert np.allclose(here, there, atol=1e-4)

    ids = np.stack(np.meshgrid(np.arange(64), np.arange(64)), axis=-1).reshape(-1, 2)
    got = evaluate(gl, HEX, "vec4(hex_chance(ivec2(a.xy)), 0.0)", np.c_[ids, ids])[:, :3]
    assert np.allclose(got[:, :2].mean(axis=0), 0.5, atol=0.02)
    assert np.allclose(got[:, :2].std(axis=0), 12**-0.5, atol=0.01)
    assert abs(got[:, 2].mean()) < 0.04
    assert got[:, 2].min() >= -1.0
    assert got[:, 2].max() < 1.0
    assert len(np.unique(got, axis=0)) > 4000
    table = got[:, 0].reshape(64, 64)
    neighbours = np.corrcoef(table[:, :-1].ravel(), table[:, 1:].ravel())[0, 1]
    assert abs(neighbours) < 0.05


def roughness_of(picture):
    """Mean difference of neighbouring pixels of the ground, the lower third."""
    ground = picture[-len(picture) // 3 :].astype(float)
    return np.abs(np.diff(ground, axis=1)).mean()


@pytest.mark.slow
@pytest.mark.parametrize("number", [0.0, 1.0])
def test_without_detail_the_ground_is_smooth(gl, waves, number):
    camera = Camera((500.0, 100.0, 130.0), (500.0, 300.0, 60.0), far=20_000.0)
    others = ("grass", "rocks", "trees", "clouds", "shadows")
    pictures = [
        render_picture(
            waves,
            size=(192, 108),
            camera=camera,
            sun=Sun(250.0, 35.0),
            quality=dataclasses.replace(Quality.of(number, without=[*others, *more]), quads=64),
        )
        for more in ((), ("detail",))
    ]
    detailed, plain = (roughness_of(picture) for picture in pictures)
    assert plain < 0.5 * detailed
    # The materials are the same: only their structure is gone.
    means = [picture[-36:].mean(axis=(0, 1)) for picture in pictures]
    assert np.abs(means[0] - means[1]).max() < 12.0


LAID = """
uniform float across; // textures over the picture
in vec2 uv;
out vec4 texel;
void main()
{
    float width = laid[LAYER].x;
    Matter m = at_octave(LAYER, Plane(2, uv * across * width), 0, across * width / SIDE);
    texel = vec4(m.albedo, m.height);
}
"""


def laid_out(gl, textures, layer, hexes, *, across=4, side=256):
    """Draw a plane of one layer from above: (side, side, 4), albedo and height."""
    defines = {"PLANES": 1, "SIZES": 1, "HEXES": hexes, "DETAIL": 1, "OCTAVES": OCTAVES, "PI": 3.14159265}
    macros = "".join(f"#define {name} {value}\n" for name, value in defines.items())
    macros += f"#define LAYER {layer}\n#define SIDE {side}.0\n"
    program = gl.program(
        vertex_shader=source("render/screen.vert.glsl"),
        fragment_shader="#version 430 core\n" + macros + source("render/matter.glsl") + LAID,
    )
    widths = texture_widths()
    phases = [tuple(phase) for phase in texture_phases((0.031, 0.053, 0.0), widths).tolist()]
    units = {"material_colour": 0, "material_relief": 1, "phases": phases, "across": float(across)}
    set_uniforms(program, units | texture_uniforms(widths))
    textures.colour.use(0)
    textures.relief.use(1)
    target = gl.texture((side, side), 4, dtype="f4")
    gl.framebuffer([target]).use()
    gl.enable_only(gl.NOTHING)
    gl.vertex_array(program, []).render(vertices=3)
    return np.frombuffer(target.read(), np.float32).reshape(side, side, 4)


def test_hexagons_hide_the_repetition_and_keep_mean_and_contrast(gl):
    textures = MaterialTextures(gl, None, size=256, looks={})

    def likeness(picture, shift):
        height = picture[..., 3]
        return np.corrcoef(height[:, :-shift].ravel(), height[:, shift:].ravel())[0, 1]

    for name in ("grass", "scree", "river_bed", "rock", "snow"):
        plain, hidden = (laid_out(gl, textures, list(LAYERS).index(name), hexes) for hexes in (1, 3))
        # A texture's width is 64 pixels here.
        assert likeness(plain, 64) > 0.99, name
        assert abs(likeness(hidden, 64)) < 0.08, name
        assert hidden[..., :3].mean() == pytest.approx(plain[..., :3].mean(), rel=0.01), name
        assert hidden[..., 3].std() > 0.92 * plain[..., 3].std(), name
