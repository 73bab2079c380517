"""Rendered pictures against golden ones.

They are llvmpipe's: other drivers round differently. ``pytest tests/render/test_goldens.py
--regenerate-goldens`` rewrites them. The message of a failure names the new picture and the
amplified (8×) difference.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image

from sketchterrain.geometry.camera import Camera
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Weather, sun_for_view
from tests import terrains

pytestmark = [pytest.mark.gl, pytest.mark.xdist_group("goldens")]

GOLDENS = Path(__file__).with_name("goldens")
SIZE = (320, 180)
# One driver gives the same bytes each time, with one thread or two, with vectors of 256 bits or of 128
# (LP_NATIVE_VECTOR_WIDTH). Other versions round otherwise, which moves single pixels along edges, at most ten
# a scene between Mesa 22.3 and 25.0: the bounds allow for that. A material, light or feature that goes wrong
# moves whole areas.
MEAN = 1.0
"""Of 255, by which pixels may differ on average."""
FAR_OFF = 24
"""Of 255."""
SHARE = 0.01
"""Of the pixels that may differ by more than `FAR_OFF` in a channel."""


class Scene(NamedTuple):
    eye: tuple[float, float, float]  # m, z above the ground
    target: tuple[float, float, float]  # m, z above the eye
    fov: float
    hour: float
    clouds: float
    quality: float = 1.0


SCENES = {
    "alpine_range-ground": Scene((10864, 2768, 4), (11549, -3750, -752), 44, 7.0, 0.25),
    "alpine_range-hill": Scene((11264, 614, 30), (7412, 5916, -521), 40, 15.0, 0.3),
    "alpine_range-air": Scene((10123, -176, 450), (9438, 6342, -1176), 40, 10.0, 1.0),
    "desert_mountains-ground": Scene((5772, 3910, 4), (7410, 6748, -346), 44, 7.0, 0.25),
    "desert_mountains-hill": Scene((2765, 2765, 30), (114, 4691, -435), 40, 15.0, 0.3),
    "desert_mountains-air": Scene((6349, 3131, 350), (5668, 6336, -625), 40, 10.0, 1.0, 0.1),
    "rolling_hills-ground": Scene((1569, 1023, 4), (2069, 2146, -86), 44, 7.0, 0.25),
    "rolling_hills-hill": Scene((1498, 1267, 30), (1877, 99, -100), 40, 15.0, 0.3),
    "rolling_hills-air": Scene((1415, -33, 130), (801, 1031, -240), 40, 10.0, 1.0, 0.5),
    "valley_river-ground": Scene((3401, 1926, 4), (4401, 4171, -174), 44, 7.0, 0.25),
    "valley_river-hill": Scene((3763, 1613, 30), (2319, 3601, -282), 40, 15.0, 0.3),
    "valley_river-air": Scene((2831, 5244, 220), (4819, 3800, -440), 40, 10.0, 1.0, 0.1),
}


DEFAULT = ("valley_river-air",)
"""Scenes of the default tier."""


def marks_of(name):
    return [] if name in DEFAULT else pytest.mark.slow


def drawn(name, draw):
    scene = SCENES[name]
    terrain = terrains.preset(name.partition("-")[0])
    x, y, above = scene.eye
    z = float(terrain.heights(x, y)) + above
    target = (*scene.target[:2], z + scene.target[2])
    camera = Camera((x, y, z), target, fov=scene.fov)
    weather = Weather.from_sketch(terrain.sketch, hour=scene.hour, clouds=scene.clouds)
    sun = sun_for_view(terrain, camera, weather)
    quality = Quality.from_level(scene.quality)
    return draw(terrain, camera, size=SIZE, sun=sun, weather=weather, quality=quality).astype(np.uint8)


def compare(golden, picture):
    """Return by how much two pictures differ: of 255 on average, share of pixels far off, all differences."""
    apart = np.abs(golden.astype(np.int16) - picture.astype(np.int16))
    return float(apart.mean()), float((apart.max(axis=-1) > FAR_OFF).mean()), apart


@pytest.mark.parametrize("name", [pytest.param(name, marks=marks_of(name)) for name in SCENES])
def test_pictures_match_their_goldens(name, gl, draw, request, tmp_path):
    if "llvmpipe" not in gl.info["GL_RENDERER"]:
        pytest.skip("golden pictures are llvmpipe's")
    picture = drawn(name, draw)
    path = GOLDENS / f"{name}.png"
    if request.config.getoption("--regenerate-goldens"):
        GOLDENS.mkdir(exist_ok=True)
        Image.fromarray(picture).save(path, optimize=True)
        return
    mean, share, apart = compare(np.asarray(Image.open(path)), picture)
    if mean > MEAN or share > SHARE:
        Image.fromarray(picture).save(tmp_path / f"{name}.png")
        Image.fromarray(np.minimum(apart * 8, 255).astype(np.uint8)).save(tmp_path / f"{name}-difference.png")
        pytest.fail(
            f"{name}: {mean:.2f} of 255 on average, {share:.2%} of the pixels far off; see {tmp_path}"
        )


def test_changes_of_brightness_and_position_are_detected():
    assert {path.stem for path in GOLDENS.glob("*.png")} == set(SCENES)
    golden = np.asarray(Image.open(GOLDENS / "valley_river-hill.png"))
    darker = (golden * 0.97).astype(np.uint8)
    shifted = np.roll(golden, 2, axis=1)
    for other in (darker, shifted):
        mean, share, _ = compare(golden, other)
        assert mean > MEAN or share > SHARE
