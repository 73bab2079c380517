"""Distant woods: their ground has the colour of drawn trees."""

from dataclasses import replace

import numpy as np
import pytest
from skimage.color import deltaE_ciede2000, rgb2lab

from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import build
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.offscreen import read_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Sun, Weather
from tests import terrains

SIZE = 480, 270
EXTENT, PIXELS = 6000.0, 64
EYE = 220.0  # m over the ground
BAND = 950.0, 1350.0  # m from the eye, where woods are compared
SUNS = [Sun(180.0, 25.0), Sun(90.0, 25.0), Sun(0.0, 55.0)]  # behind the eye, beside it, high in front of it
MOST = 2.0  # CIEDE2000: just noticeable side by side
MOST_OF_ONE = 3.0


@pytest.fixture(scope="module")
def wood():
    forest = np.zeros((PIXELS, PIXELS), np.uint8)
    forest[6:58, 6:58] = 1
    return build(
        Sketch(extent=EXTENT, seed=5, layers={"forest": forest}, density={"forest": 0.0}),
        device=terrains.context(),
    )


def view(terrain):
    middle = EXTENT / 2
    level = float(terrain.heights(np.array([middle]), np.array([middle]))[0])
    return Camera((middle, middle - 1150.0, level + EYE), (middle, middle, level))


def pictures(open_renderer, gl, terrain, **changes):
    """Yield the picture of each sun."""
    quality = replace(Quality.for_still(SIZE), material_texels=256, **changes)
    weather = Weather(clouds=0.0, wind=0.0)
    renderer = open_renderer(terrain, sun=SUNS[0], weather=weather, quality=quality)
    texture = gl.texture(SIZE, 4)
    for sun in SUNS:
        renderer.relight(sun=sun)
        renderer.prepare(view(terrain), SIZE)
        renderer.draw(view(terrain), gl.framebuffer([texture]))
        yield read_picture(texture)


def mean_colour(shown, camera):
    """Return the CIELAB colour of the mean light of the band."""
    pitch = np.radians(-camera.pitch)
    down = [np.tan(pitch - np.arctan2(EYE, away)) / np.tan(np.radians(camera.fov / 2)) for away in BAND]
    last, first = (round(SIZE[1] / 2 * (1 - each)) for each in down)
    light = ((shown[first:last] / 255.0) ** 2.2).mean(axis=(0, 1))
    return rgb2lab(light[None, None] ** (1 / 2.2))[0, 0]


@pytest.mark.gl
@pytest.mark.soak
def test_a_distant_canopy_has_the_colour_of_drawn_trees(gl, open_renderer, wood):
    """Where trees turn into ground, neither a ring nor a step of brightness gives it away."""
    camera, differences = view(wood), []
    drawn = pictures(open_renderer, gl, wood)
    painted = pictures(open_renderer, gl, wood, without=frozenset({"trees"}), canopy_distance=200.0)
    for both in zip(drawn, painted, strict=True):
        colours = (mean_colour(each, camera) for each in both)
        differences.append(float(deltaE_ciede2000(*colours)))
    assert np.mean(differences) < MOST, differences
    assert max(differences) < MOST_OF_ONE, differences
