from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.render import Camera
from sketchterrain.render.camera import clip_planes, direction

ASPECT = 16 / 9


def to_picture(camera, point):
    clip = camera.to_clip(ASPECT) @ np.append(np.subtract(point, camera.eye), 1.0)
    return clip[:3] / clip[3]


AHEAD = ((0.0, 90.0, 0.0), (40.0, -30.0, -12.0), (-1.0, 0.0, 3.0))


def test_the_target_is_projected_to_the_centre_of_the_picture():
    for eye in ((0.0, 0.0, 10.0), (1e7, -3e6, 250.0)):
        for ahead in AHEAD:
            camera = Camera(eye, tuple(np.add(eye, ahead)))
            assert np.allclose(to_picture(camera, camera.target)[:2], 0.0, atol=1e-7), (eye, ahead)


def test_the_projection_has_north_up_east_right_and_depth_from_minus_one_to_one():
    camera = Camera((0.0, 0.0, 0.0), (0.0, 100.0, 0.0), fov=90.0, near=2.0, far=500.0)
    assert np.allclose(to_picture(camera, (10.0, 100.0, 0.0))[:2], [0.1 / ASPECT, 0.0])
    assert np.allclose(to_picture(camera, (0.0, 100.0, 100.0))[:2], [0.0, 1.0])
    assert to_picture(camera, (0.0, 2.0, 0.0))[2] == pytest.approx(-1.0)
    assert to_picture(camera, (0.0, 500.0, 0.0))[2] == pytest.approx(1.0)


def test_frustum_agrees_with_the_projection():
    camera = Camera((5000.0, -300.0, 70.0), (5400.0, 100.0, 40.0), near=1.0, far=2000.0)
    rng = np.random.default_rng(3)
    points = np.asarray(camera.eye) + rng.uniform(-900, 900, (500, 3))
    clip = (points - camera.eye) @ camera.to_clip(ASPECT)[:, :3].T + camera.to_clip(ASPECT)[:, 3]
    visible = (np.abs(clip[:, :3]) <= clip[:, 3:]).all(axis=1)
    planes = camera.frustum(ASPECT)
    assert visible.any()
    assert (((points @ planes[:, :3].T + planes[:, 3]) >= 0).all(axis=1) == visible).all()


def test_looking_straight_down_has_an_up():
    camera = Camera((0.0, 0.0, 50.0), (0.0, 0.0, 0.0))
    assert np.isfinite(camera.to_clip(1.0)).all()
    assert to_picture(camera, (0.0, 10.0, 0.0))[1] > 0


def test_invalid_cameras_are_refused():
    for bad in (
        {"target": (0.0, 0.0, 0.0)},
        {"target": (0.0, np.nan, 0.0)},
        {"fov": 180.0},
        {"near": 0.0},
        {"near": 10.0, "far": 5.0},
    ):
        with pytest.raises(InputError, match="expected"):
            Camera(**({"eye": (0.0, 0.0, 0.0), "target": (0.0, 1.0, 0.0)} | bad))


def test_a_ray_goes_through_its_place_in_the_picture():
    for ahead in AHEAD:
        camera = Camera((5.0, 6.0, 7.0), tuple(np.add((5.0, 6.0, 7.0), ahead)))
        for x, y in ((0.0, 0.0), (1.0, -1.0), (-0.3, 0.7)):
            along = camera.ray(x, y, ASPECT)
            assert np.linalg.norm(along) == pytest.approx(1.0)
            assert to_picture(camera, camera.eye + 50.0 * along)[:2] == pytest.approx([x, y]), ahead


def test_heading_is_a_compass_bearing_and_pitch_an_elevation():
    assert Camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)).heading == pytest.approx(90.0)
    assert Camera((0.0, 0.0, 0.0), (-1.0, 1.0, 0.0)).heading == pytest.approx(315.0)
    for heading, pitch in ((0.0, 0.0), (75.0, -30.0), (300.0, 80.0)):
        camera = Camera((0.0, 0.0, 0.0), tuple(20.0 * direction(heading, pitch)))
        assert (camera.heading, camera.pitch) == pytest.approx((heading, pitch))


def test_clip_planes_follow_the_height_above_ground_and_the_draw_distance():
    for clearance, near in ((0.0, 0.1), (1.7, 0.425), (80.0, 20.0), (400.0, 100.0), (2e4, 100.0)):
        assert clip_planes(clearance, 28_000.0) == pytest.approx((near, 30_800.0))
        near, far = clip_planes(clearance, 0.0)
        assert 0.0 < near < far
