"""Projection, occlusion and marks of the 3-D view."""

import numpy as np
import pytest

from sketchterrain.geometry.camera import Camera
from sketchterrain.landforms.placement.feature_types import FEATURE
from sketchterrain.ui.engine.protocol import FrameFacts, Placement, Relief
from sketchterrain.ui.models.workspace import Selection
from sketchterrain.ui.view3d.camera import Projection, TerrainHeights, circle, overview, scale_bar
from sketchterrain.ui.view3d.marks import MarkBuilder

PLACE = (10.0, 20.0, 640.0, 480.0)
EYE, TARGET = (1000.0, -500.0, 800.0), (1200.0, 900.0, 100.0)


def projection_of(eye=EYE, target=TARGET, *, fov: float = 50.0) -> Projection:
    camera = Camera(eye, target, fov=fov, near=1.0, far=1e5)
    return Projection(FrameFacts(640, 480, 1, camera, 0.1, 0.0, 1, 1, True, 1), PLACE)


def terrain_of(heights: np.ndarray, spacing: float = 50.0) -> TerrainHeights:
    return TerrainHeights(Relief(1, 1, heights, heights.astype(np.uint8)), spacing)


def flat(side: int = 64, spacing: float = 50.0, height: float = 0.0) -> TerrainHeights:
    return terrain_of(np.full((side, side), height, np.float32), spacing)


def test_projection_agrees_with_its_rays_and_scale():
    projection = projection_of()
    assert projection.project([TARGET]).pixels[0] == pytest.approx([330.0, 260.0], abs=1e-6)
    assert projection.project(np.add(TARGET, (0.0, 0.0, 50.0))).pixels[0, 1] < 260.0
    assert projection.project(np.add(TARGET, (50.0, 0.0, 0.0))).pixels[0, 0] > 330.0

    rng = np.random.default_rng(1)
    for place in np.add(TARGET, rng.normal(0.0, 300.0, (100, 3))):
        projected = projection.project(place)
        if not projected.in_front[0]:
            continue
        along = projection.ray(*projected.pixels[0])
        off = place - projection.eye
        assert np.linalg.norm(np.cross(along, off)) < 1e-6 * np.linalg.norm(off)
        assert along @ off > 0

    distance = float(np.linalg.norm(np.subtract(TARGET, EYE)))
    expected = 2.0 * distance * np.tan(np.radians(25.0)) / 480.0
    assert projection.metres_per_px(TARGET) == pytest.approx(expected)
    assert projection.metres_per_px(np.subtract(EYE, np.subtract(TARGET, EYE))) == 0.0


def test_rays_meet_a_level_below_the_horizon():
    projection = projection_of()
    rng = np.random.default_rng(2)
    for x, y in rng.uniform(-500.0, 3000.0, (100, 2)):
        projected = projection.project([[x, y, 120.0]])
        if projected.in_front[0]:
            met = projection.intersect_level(*projected.pixels[0], 120.0)
            slope = abs(projection.ray(*projected.pixels[0])[2])
            assert (met is None) == (slope < 0.02)
            if met is not None:
                assert met == pytest.approx((x, y), abs=0.01)

    projection = projection_of((0.0, 0.0, 100.0), (0.0, 1000.0, 100.0))
    levels = ((100.0, 0.0), (260.0, 0.0), (450.0, 200.0), (450.0, 0.0))
    met = [projection.intersect_level(330.0, y, level) is not None for y, level in levels]
    assert met == [False, False, False, True]


def test_segments_are_clipped_just_before_the_eye():
    projection = projection_of((0.0, 0.0, 100.0), (0.0, 100.0, 100.0))
    line = np.array([(-50.0, y, 0.0) for y in np.linspace(-500.0, 500.0, 21)])
    pixels, visible = projection.project_segments(line[:-1], line[1:])
    assert np.flatnonzero(visible).tolist() == list(range(10, 20))
    assert np.isfinite(pixels).all()
    assert np.array_equal(pixels[1:, :2], pixels[:-1, 2:])
    back, _ = projection.project_segments(line[1:], line[:-1])
    assert np.array_equal(back, pixels[:, [2, 3, 0, 1]])
    behind, _ = projection.project_segments(line[:4], line[1:5])
    assert len(behind) == 0


def test_heights_are_bilinear():
    ground = terrain_of(np.arange(12, dtype=np.float32).reshape(3, 4), 10.0)  # row 0 is the north
    places = ((5.0, 25.0), (35.0, 5.0), (10.0, 25.0), (5.0, 20.0), (-100.0, -100.0))
    assert [ground.height(*place) for place in places] == [0.0, 11.0, 0.5, 2.0, 8.0]
    assert ground.contains([0.0, 40.0, 41.0], [0.0, 30.0, 5.0]).tolist() == [True, True, False]


def test_a_ridge_occludes_only_what_is_behind_it():
    heights = np.zeros((64, 64), np.float32)
    heights[30:34] = 400.0
    ground = terrain_of(heights)
    eye = (1600.0, 100.0, 200.0)
    behind, before, above = (1600.0, 2800.0, 0.0), (1600.0, 1000.0, 0.0), (1600.0, 2800.0, 900.0)
    assert ground.occludes(eye, [behind, before, above]).tolist() == [True, False, False]
    places = ground.drape(circle(1600.0, 800.0, 400.0))
    assert not ground.occludes(eye, places).any()
    assert np.allclose(np.hypot(places[:, 0] - 1600.0, places[:, 1] - 800.0), 400.0)


def placed_with(*places: tuple[float, float]) -> Placement:
    points = np.zeros(len(places), FEATURE)
    points["id"] = np.arange(1, len(places) + 1)
    points["x"], points["y"] = np.array(places).T
    points["radius"], points["strength"], points["painted"] = 300.0, 100.0, True
    return Placement(1, points, (), ())


def test_marks_are_projected_features_and_are_thinned():
    projection, ground = projection_of(), flat()
    placed = placed_with((1200.0, 900.0), (1900.0, 1500.0), (1000.0, -9e4))
    marks = MarkBuilder(projection, ground, placed, None).marks(all_features=True)
    assert [each.selection.id for each in marks.dots] == [1, 2], "the third feature is behind the eye"
    for dot in marks.dots:
        at = placed.points[dot.selection.id - 1]
        assert [dot.x, dot.y] == pytest.approx(projection.project([[at["x"], at["y"], 0.0]]).pixels[0])
        assert marks.dot_at(dot.x + 3.0, dot.y, reach=11.0) == dot
    assert marks.dot_at(-100.0, 0.0, reach=11.0) is None
    selection = MarkBuilder(projection, ground, placed, Selection("feature", 2)).marks(all_features=True)
    assert [each.selection.id for each in selection.dots] == [1]
    assert [each.handle.role for each in selection.handles] == ["move", "radius"]
    assert selection.outline
    mark = selection.handles[0]
    assert selection.handle_at(mark.x + 2.0, mark.y, reach=11.0) == mark
    assert selection.handle_at(mark.x + 200.0, mark.y, reach=11.0) is None

    crowd = placed_with(*[(1200.0 + 0.1 * step, 900.0) for step in range(50)])
    assert len(MarkBuilder(projection_of(), flat(), crowd, None).marks(all_features=True).dots) <= 2


def test_river_handles_keep_their_distance(placed):
    river = placed.rivers[0]
    x, y, z = river.centreline[len(river.centreline) // 2]
    projection = projection_of((x, y - 6e3, z + 4e3), (x, y, z))
    selection = Selection("course", river.id)
    ground = flat(256, 24.0)
    far = MarkBuilder(projection, ground, placed, selection).marks(all_features=False)
    points = [each for each in far.handles if each.handle.role == "point"]
    assert 3 < len(points) < len(river.points)
    apart = np.hypot(*np.diff([(each.x, each.y) for each in points], axis=0).T)
    assert apart.min() >= 13.0
    visible = {each.handle.selection.index for each in points}
    hidden = min(set(range(len(river.points))) - visible)
    selected = MarkBuilder(projection, ground, placed, Selection("course", river.id, hidden)).marks(
        all_features=False
    )
    assert hidden in [each.handle.selection.index for each in selected.handles]


def test_the_scale_bar_and_headings():
    projection = projection_of()
    length, wide = scale_bar(projection, Camera(EYE, TARGET), most=110.0)
    assert wide <= 110.0
    assert length / wide == pytest.approx(projection.metres_per_px(TARGET))

    for heading, target in ((0.0, (0, 1, 0)), (90.0, (1, 0, 0)), (180.0, (0, -1, 5)), (270.0, (-1, 0, 0))):
        assert Camera((0.0, 0.0, 0.0), target).heading == pytest.approx(heading)


def test_overview_fits_all_corners():
    for aspect in [0.4, 4 / 3, 3.0]:
        for size in [(6144.0, 6144.0), (3000.0, 9000.0), (9000.0, 1000.0)]:
            pose = overview((0.0, 0.0, *size), 120.0, aspect=aspect)
            camera = Camera(pose.eye, pose.target, fov=pose.fov, near=1.0, far=1e6)
            corners = [(x, y, 120.0) for x in (0.0, size[0]) for y in (0.0, size[1])]
            to_clip = camera.to_clip(aspect)
            clip = np.subtract(corners, pose.eye) @ to_clip[:, :3].T + to_clip[:, 3]
            projected = np.abs(clip[:, :2] / clip[:, 3:])
            assert (clip[:, 3] > 0).all(), (aspect, size)
            assert projected.max() == pytest.approx(0.94), (aspect, size)
