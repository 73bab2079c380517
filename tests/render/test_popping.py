"""Before a camera that stands still, tiles refine and morph without a jump."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.render import Quality
from sketchterrain.render.ground_stream import LEAP, GroundStream
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


@pytest.mark.parametrize(("z", "pitch"), [(95.0, -4.0), (180.0, -25.0)])
def test_tiles_come_and_go_unseen(gl, waves, z, pitch):
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
