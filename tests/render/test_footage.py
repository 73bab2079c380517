"""Footage along a flight: complete frames, and frames as a viewer shows them."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.render import Camera, Quality, find_sun, footage, render_picture
from sketchterrain.render.flight import Flight, Key

SIZE = (96, 54)
QUICK = dataclasses.replace(Quality.of(0.25), map_texels=128, material_texels=128, quads=64)
WHOLE = Quality(samples=1, map_texels=128)


@pytest.fixture
def views():
    """Four frames across hills and the river, with a cut to the other end of the sketch in the middle."""
    keys = [Key(t, (500.0, 100.0 + 60.0 * t, 140.0), (520.0, 500.0 + 60.0 * t, 30.0)) for t in range(3)]
    keys += [Key(2.001 + t, (200.0 + 50.0 * t, 900.0, 160.0), (300.0, 400.0, 30.0)) for t in range(3)]
    return Flight(tuple(keys)).at([0.0, 2.0, 2.001, 3.0])


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("quality", [QUICK, pytest.param(WHOLE, marks=pytest.mark.slow)])
def test_a_complete_frame_equals_the_picture_of_its_camera(waves, views, quality):
    # So many frames a second that water, which goes by the clock, stands.
    frames = list(footage(waves, views, fps=1e9, size=SIZE, quality=quality))
    cameras = [
        Camera(tuple(eye), tuple(target), fov=fov)
        for eye, target, fov in zip(*(part.tolist() for part in views[:3]), strict=True)
    ]
    sun = find_sun(waves, cameras[0])
    for number in (1, 2):
        shot, picture = frames[number]
        alone = render_picture(waves, size=SIZE, camera=cameras[number], sun=sun, quality=quality)
        np.testing.assert_array_equal(picture, alone)
        assert shot.settled
    assert all(shot.triangles > 1000 and shot.tiles_drawn > 0 for shot, _ in frames)
    assert frames[0][0].tiles_generated > frames[1][0].tiles_generated
    assert all(0.0 < shot.generation_seconds < shot.seconds for shot, _ in frames)


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.usefixtures("gl")
def test_frames_as_a_viewer_shows_them_are_never_empty(waves, views):
    frames = list(footage(waves, views, fps=30.0, size=SIZE, complete=False, quality=QUICK))
    assert all(shot.tiles_drawn > 0 and shot.triangles > 0 for shot, _ in frames)
    assert all(shot.seconds > 0.0 for shot, _ in frames)
    assert all(np.abs(a[1].astype(int) - b[1]).mean() > 0.5 for a, b in itertools.pairwise(frames))
    shots = list(footage(waves, views, fps=30.0, size=SIZE, quality=QUICK, complete=False, pixels=False))
    assert [picture for _, picture in shots] == [None] * 4
    with pytest.raises(InputError, match="8192"):
        next(footage(waves, views, fps=30.0, size=(9000, 10)))
