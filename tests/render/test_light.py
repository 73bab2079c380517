"""Light maps of the ground: shadows, slices within a budget, fades; tone mapping."""

import colorsys
from itertools import count

import numpy as np
import pytest

from sketchterrain.geometry.camera import Camera
from sketchterrain.io.resources import source
from sketchterrain.render.light_map import LightMap, LightMapRenderer, TexelSquare
from sketchterrain.render.lit_ground import FADE, GroundLighting
from sketchterrain.render.programs import FRAME_BINDING
from sketchterrain.render.quality import TimeBudget, WorkRate
from sketchterrain.render.sky import Sun
from sketchterrain.render.targets import FrameBlock

from .test_shaders import evaluate

SUN = Sun(90.0, 30.0)


class Wall:
    """60 m high, along x = 0; counts the queried heights."""

    sea_level = None
    extent = 1000.0

    def __init__(self):
        self.queried = 0

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.broadcast_arrays(x, y)
        self.queried += x.size
        ripples = 2.0 * np.sin(x / 31.0) * np.cos(y / 17.0)
        return (np.where(np.abs(x) < 20.0, 60.0, 0.0) + ripples).astype(np.float32)


def computed_maps(renderer, *squares):
    """Compute light maps, each with all the ones before as wider maps."""
    computed = []
    for square in squares:
        computed.append(LightMap(renderer, square, wider=computed[::-1]))
        computed[-1].advance()
    return computed


def texels(light_map):
    side = light_map.square.texels
    return np.frombuffer(light_map.light.read(), np.float16).reshape(side, side, 4)


def test_work_rate_adapts_and_recovers_from_outliers():
    pace = WorkRate(1e-3)
    assert pace.steps_within(TimeBudget(0.0104, timer=lambda: 0.0), 99) == 10
    pace.record(10, 0.0204)
    assert pace.steps_within(TimeBudget(0.0104, timer=lambda: 0.0), 99) == 5
    assert pace.steps_within(TimeBudget(0.0104, timer=lambda: 0.0), 99, step=6) == 0
    for _ in range(30):
        pace.record(10, 0.0104)
    assert pace.steps_within(TimeBudget(0.0105, timer=lambda: 0.0), 99) == 10

    pace = WorkRate(1e-3)
    pace.record(1, 1.0)
    tries = 0
    while not pace.steps_within(TimeBudget(0.01, timer=lambda: 0.0), 99):
        tries += 1
        assert tries < 60
    assert pace.steps_within(TimeBudget(0.0, timer=lambda: 0.0), 99) == 0
    pace = WorkRate(1e-3)
    assert pace.steps_within(TimeBudget(0.5, timer=lambda: 0.0), 99)
    pace.record(10, 0.5)
    assert any(pace.steps_within(TimeBudget(0.01, timer=lambda: 0.0), 99) for _ in range(150))


@pytest.mark.gl
def test_a_wall_casts_a_shadow_unless_disabled(gl):
    renderer = LightMapRenderer(gl, Wall(), SUN)
    _, computed = computed_maps(renderer, TexelSquare(-50, -50, 100, 40.0), TexelSquare(-100, -100, 200, 4.0))
    light = texels(computed)[100].astype(float)
    x = -400.0 + (np.arange(200) + 0.5) * 4.0
    # The shadow of 60 m at 30° is 104 m long and falls to the west.
    assert light[(x > -105) & (x < -40), 0].max() < 0.1
    assert light[(x < -160) | (x > 40), 0].min() > 0.9
    assert light[np.abs(x + 26) < 3, 1].max() < light[np.abs(x + 300) < 3, 1].min()

    renderer = LightMapRenderer(gl, Wall(), Sun(90.0, 5.0), shadows=False)
    (computed,) = computed_maps(renderer, TexelSquare(-64, -64, 128, 4.0))
    light = texels(computed).astype(float)
    assert (light[..., 0] == 1.0).all()
    assert light[..., 1].min() < 0.9


@pytest.mark.gl
def test_close_map_shadows_continue_on_wider_maps_and_are_sharp(gl):
    """The wall is 300 m away; its shadow is 690 or 165 m long."""
    for elevation, lit in ((5.0, 0.0), (20.0, 1.0)):
        squares = (
            TexelSquare(-64, -64, 128, 20.0),
            TexelSquare(-128, -16, 64, 4.0),
            TexelSquare(-350, -32, 64, 1.0),
        )
        *_, close = computed_maps(LightMapRenderer(gl, Wall(), Sun(90.0, elevation)), *squares)
        found = texels(close)[..., 0].astype(float).mean()
        assert found == pytest.approx(lit, abs=0.12), elevation  # steps are as wide as the wall

    squares = (
        TexelSquare(-64, -64, 128, 20.0),
        TexelSquare(-64, -64, 128, 4.0),
        TexelSquare(-160, -64, 128, 1.0),
    )
    *_, close = computed_maps(LightMapRenderer(gl, Wall(), SUN), *squares)
    across = texels(close)[64, :, 0].astype(float)  # from 160 to 32 m west of the wall's middle
    half = np.flatnonzero((across > 0.1) & (across < 0.9))
    assert across[-10:].max() < 0.05
    assert across[:10].min() > 0.95
    assert 1 <= len(half) <= 12


@pytest.mark.gl
def test_sliced_maps_are_bit_equal_and_reuse_heights(gl):
    terrain = Wall()
    renderer = LightMapRenderer(gl, terrain, SUN)
    wide, known = computed_maps(renderer, TexelSquare(-64, -64, 128, 40.0), TexelSquare(0, -64, 192, 4.0))
    square = TexelSquare(-64, -128, 192, 4.0)
    whole = LightMap(renderer, square, wider=[wide])
    whole.advance()
    terrain.queried = 0
    # The other renderer's rates of work were measured by the clock.
    computed = LightMap(LightMapRenderer(gl, terrain, SUN), square, wider=[wide], previous=known)
    frames, ticks = 0, count()
    while not computed.ready:
        computed.advance(TimeBudget(0.002, timer=lambda: 1e-4 * next(ticks)))
        frames += 1
        assert frames < 2000
    assert frames > 3
    assert (computed.relief.heights == whole.relief.heights).all()
    assert computed.light.read() == whole.light.read()
    assert terrain.queried == 192 * 192 - 128 * 128


@pytest.mark.gl
@pytest.mark.parametrize("close", [False, True])
def test_streamed_light_converges_to_the_settled_one_without_jumps(gl, waves, close):
    lit, still = (GroundLighting(gl, waves, SUN, texels=64 if close else 128, close=close) for _ in range(2))
    start = Camera((500.0, 100.0, 130.0), (500.0, 800.0, 60.0))
    goal = Camera((700.0, 500.0, 130.0), (100.0, 800.0, 60.0))
    elapsed = 0.05
    strengths = [(0.0,) * (3 if close else 2)]
    while not lit.converged:
        lit.update(start, elapsed, TimeBudget(1.0))
        strengths.append(lit.uniforms(start.eye)["map_strength"])
    assert np.diff(strengths, axis=0).max() <= elapsed / FADE + 1e-9
    assert set(strengths[-1]) == {1.0}
    before = lit.uniforms((0.0, 0.0, 0.0))
    for frame in range(600):
        lit.update(goal, elapsed, TimeBudget(1.0))
        after = lit.uniforms((0.0, 0.0, 0.0))
        step = np.abs(np.subtract(after["near_window"], before["near_window"])).max()
        assert step <= 0.5 * 1300.0 * elapsed / FADE
        before = after
        if lit.converged and frame > 3:
            break
    assert lit.converged
    still.converge(goal)
    assert lit.uniforms(goal.eye) == still.uniforms(goal.eye)
    assert lit.haze_base == still.haze_base
    for name, texture in lit.textures.items():
        assert texture.read() == still.textures[name].read()


LIGHT_AT = """#version 430 core
{frame}
in vec2 at;
out vec2 lit;
void main() {{ lit = ground_light(at).rg; }}
"""


def light_everywhere(gl, lit, program, frame):
    """Sun and sky visibility as the shaders see them, on a grid of places around the origin."""
    for field, value in lit.uniforms((0.0, 0.0, 0.0)).items():
        frame[field] = value
    frame.upload()
    program["Frame"].binding = FRAME_BINDING
    for unit, name in enumerate(("near_light", "far_light"), start=1):
        lit.textures[name].use(unit)
        program[name].value = unit
    along = np.linspace(-2500.0, 3500.0, 90, dtype=np.float32)
    places = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    output = gl.buffer(reserve=8 * len(places))
    gl.vertex_array(program, [(gl.buffer(places.tobytes()), "2f4", "at")]).transform(
        output, vertices=len(places)
    )
    return np.frombuffer(output.read(), np.float32).reshape(-1, 2)


@pytest.mark.gl
def test_light_never_changes_suddenly(gl, waves):
    """While maps follow the eye, a frame changes a place by no more than its share of a fade."""
    program = gl.program(vertex_shader=LIGHT_AT.format(frame=source("render/frame.glsl")), varyings=["lit"])
    frame = FrameBlock(gl)
    lit = GroundLighting(gl, waves, Sun(90.0, 12.0), texels=128)
    lit.converge(Camera((500.0, 100.0, 130.0), (500.0, 800.0, 60.0)))
    before = light_everywhere(gl, lit, program, frame)
    elapsed, changes = 0.02, []
    for step in range(4):
        camera = Camera((500.0 + 300.0 * step, 100.0 + 200.0 * step, 130.0), (2000.0, 4000.0, 60.0))
        for _ in range(200):
            lit.update(camera, elapsed, TimeBudget(1.0))
            after = light_everywhere(gl, lit, program, frame)
            changes.append(np.abs(after - before).max())
            before = after
    # A soft border that passes, or a fade: 1.5 is the steepest a smooth step gets.
    assert 0.0 < max(changes) <= 0.15


def film(gl, colours):
    rows = np.c_[colours, np.zeros(len(colours))]
    return evaluate(gl, ["render/tone.glsl"], "vec4(film(a.rgb), 0.0)", rows)[:, :3].astype(float)


def decoded(encoded):
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@pytest.mark.gl
def test_tone_curve_is_monotonic_and_preserves_grey_and_hue(gl):
    grey = np.geomspace(1e-4, 50.0, 400)[:, None] * np.ones(3)
    toned = film(gl, grey)
    assert (np.diff(toned, axis=0) > -2e-4).all()
    assert toned[0].max() < 0.01
    assert toned[-1].min() > 0.98
    assert np.ptp(toned, axis=1).max() < 2e-3
    darker, middle, brighter = decoded(film(gl, [[0.09] * 3, [0.18] * 3, [0.36] * 3]))
    assert middle == pytest.approx(0.18, abs=0.012)
    assert 0.05 < darker[0] < 0.1
    assert 0.3 < brighter[0] < 0.5

    for hue in np.linspace(0.0, 1.0, 13)[:-1]:
        colour = np.array(colorsys.hsv_to_rgb(hue, 0.6, 1.0))
        toned = film(gl, np.geomspace(0.05, 4.0, 30)[:, None] * colour)
        chroma = np.ptp(toned, axis=1)
        hues = np.array([colorsys.rgb_to_hsv(*c)[0] for c in toned])
        turned = np.abs((hues - hue + 0.5) % 1.0 - 0.5)
        assert turned[chroma > 0.03].max() < 0.07, hue
        assert chroma[-1] < 0.6 * chroma.max(), hue
