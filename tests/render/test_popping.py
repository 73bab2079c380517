"""Refinement and morphing of tiles without a pop, before a camera at rest and in flight."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest

from sketchterrain.render import Quality
from sketchterrain.render.ground_stream import LEAP, GroundStream, view_of
from sketchterrain.tiles import ScreenError

from .ground_model import TILE_BYTES
from .ground_pictures import Shade, camera_towards, change

pytestmark = pytest.mark.gl

SIZE = (192, 108)
RATE = 30.0
SMALL = Quality(quads=64, tile_memory=600 * TILE_BYTES)
REACH = 16_000.0
BOUND = 4.0
"""Of 255 levels, at 30 frames a second; beyond what an edge that moves by a pixel brings."""


@pytest.mark.slow
@pytest.mark.parametrize(("z", "pitch"), [(95.0, -4.0), (180.0, -25.0)])
def test_tiles_morph_without_a_pop_before_a_camera_at_rest(gl, waves, z, pitch):
    stream = GroundStream(gl, waves, SMALL, metric=ScreenError(tolerance=0.3, quad=10.0))
    shade = Shade(gl, stream, SIZE)
    stream.settle(
        camera_towards((300.0, 200.0, z + 400.0), 0.0, 200.0, -20.0, REACH), SIZE, draw_distance=REACH
    )
    camera = camera_towards((350.0, 260.0, z + 350.0), 0.0, 20.0, pitch, REACH)
    assert np.hypot(np.hypot(50.0, 60.0), 50.0) < LEAP * waves.extent
    biggest = []
    drawn = set()
    first = before = None
    for _ in range(90):
        stats = stream.update(camera, SIZE, elapsed=1 / RATE, budget=0.006, draw_distance=REACH)
        assert not stats.leapt
        picture = shade.see(camera, REACH)
        if before is None:
            first = picture
        else:
            biggest.append(change(before, picture).max())
        before = picture
        drawn.add(stats.triangles)
    assert stats.settled
    assert len(drawn) >= 3
    assert max(biggest) < BOUND
    # There was something to be seen.
    assert np.abs(first - before).max() > 0.5
    assert max(biggest[-5:]) == 0.0


@pytest.mark.slow
def test_in_flight_no_frame_differs_by_more_than_the_motion(gl, waves):
    """From one place, the tiles of the frame before and those of this one show all but the same."""
    speed = 40.0
    metric = ScreenError(tolerance=0.3, quad=10.0)
    ticks = count()  # a batch takes 2 ms however busy the machine is
    stream = GroundStream(gl, waves, SMALL, metric=metric, timer=lambda: 2e-3 * next(ticks))
    shade = Shade(gl, stream, SIZE)
    biggest, drawn = [], set()
    for frame in range(50):
        place = (300.0 + speed * frame / RATE, 200.0, 150.0 + 20.0 * np.sin(frame / 20.0))
        camera = camera_towards(place, 0.0, 90.0 + 0.3 * frame, -12.0, REACH)
        if frame:
            view = view_of(camera, SIZE, draw_distance=REACH)
            stream.pool.place(stream.tiles.draws(view), camera.eye)
            before = shade.see(camera, REACH)
        stats = stream.update(camera, SIZE, elapsed=1 / RATE, budget=0.006, draw_distance=REACH)
        assert stats.leapt == (frame == 0)
        if frame > 15:  # the first picture has become as good as it gets
            biggest.append(change(before, shade.see(camera, REACH)).max())
            drawn.add(stats.triangles)
    assert len(drawn) > 10
    assert 0.0 < max(biggest) < BOUND
