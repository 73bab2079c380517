"""Random cameras over every preset: no hole and no pop, while tiles stream and after."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.render import Quality
from sketchterrain.render.draw_distance import draw_distance
from sketchterrain.render.ground_stream import GroundStream
from sketchterrain.resources import preset_names
from sketchterrain.sketch import load_sketch
from sketchterrain.terrain import build

from .ground_pictures import Eye, Shade, camera_towards, change, holes, must_be_covered

pytestmark = [pytest.mark.gl, pytest.mark.slow]

CAMERAS = 75
"""For each of four presets."""
SIZE = (128, 72)
REACH = 4.0
FRAMES = 3
FARTHEST = 16.0
BOUND = 20.0
"""Of 255 levels, between frames 1/30 s apart; beyond what an edge that moves by a pixel brings."""
QUICK = Quality(tolerance=2.0, quads=32, tile_memory=128 << 20)


@pytest.fixture(scope="module", params=preset_names())
def terrain(request):
    if not list_devices():
        pytest.skip("no OpenCL device")
    return build(load_sketch(request.param), device=ComputeContext())


def test_no_holes(gl, terrain):
    rng = np.random.default_rng(11)
    eye, stream = Eye(gl, SIZE), GroundStream(gl, terrain, QUICK)
    bad, covered = [], 0
    for number in range(CAMERAS):
        east, north = rng.uniform(-0.5, 1.5, 2) * terrain.extent
        height = 1.7 * (20_000.0 / 1.7) ** rng.uniform()
        bearing, pitch = rng.uniform(0.0, 360.0), np.degrees(np.arcsin(rng.uniform(-1.0, 0.3)))
        for frame in range(FRAMES):
            ground = float(terrain.heights(east, north))
            reach = draw_distance(height, extent=terrain.extent, reach=REACH)
            camera = camera_towards((east, north, ground + height), ground, bearing, pitch, reach)
            if frame < FRAMES - 1 or number % 3:
                stats = stream.update(camera, SIZE, elapsed=0.05, budget=0.008, draw_distance=reach)
                settled = stats.settled
            else:
                stream.settle(camera, SIZE, draw_distance=reach)
                settled = True
            lowest = float(stream.tiles.pool.bottom.min())
            found = holes(eye.see(stream, camera), camera, reach, lowest)
            covered += must_be_covered(camera, SIZE, reach, lowest).mean() / (CAMERAS * FRAMES)
            if found:
                bad.append((number, frame, found, round(height, 1), round(pitch), settled))
            east, north = east + rng.uniform(-0.1, 0.1) * height, north + rng.uniform(-0.1, 0.1) * height
            bearing += rng.uniform(-60.0, 60.0)
    assert not bad
    assert covered > 0.3


def test_no_pops_before_a_camera_that_stands_still(gl, terrain):
    rng = np.random.default_rng(7)
    stream = GroundStream(gl, terrain, QUICK)
    shade = Shade(gl, stream, SIZE)
    biggest = []
    for height in (3.0, 40.0, 900.0):
        place = np.array([*rng.uniform(0.2, 0.8, 2) * terrain.extent, 0.0])
        bearing = rng.uniform(0.0, 360.0)
        for step, turn in ((0.03, 100.0), (0.0, 0.0)):
            east, north = place[:2] + step * terrain.extent
            ground = float(terrain.heights(east, north))
            eye = (east, north, ground + height)
            camera = camera_towards(eye, ground, bearing + turn, -12.0, FARTHEST * terrain.extent)
            if step:
                stream.settle(camera, SIZE, draw_distance=FARTHEST * terrain.extent)
        before = None
        for _ in range(50):
            stats = stream.update(
                camera, SIZE, elapsed=1 / 30, budget=0.008, draw_distance=FARTHEST * terrain.extent
            )
            picture = shade.see(camera, FARTHEST * terrain.extent)
            biggest.append(0.0 if before is None else change(before, picture).max())
            before = picture
            assert not stats.leapt
    assert max(biggest) < BOUND
