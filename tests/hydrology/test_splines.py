"""Centripetal Catmull-Rom splines, and their arcs."""

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.geometry.splines import catmull_rom, cubics, drop_repeats, sample_catmull_rom
from sketchterrain.terrain.centrelines import bisect, nearest_on_arc

WILD = np.array([[0, 0], [10, 0], [10.5, 0.2], [10.4, 5], [-40, 5], [-40, 5.3], [-39, 60]], float)


def test_curves_interpolate_control_points_and_reproduce_lines():
    np.testing.assert_array_equal(catmull_rom(WILD, np.arange(7.0)), WILD)
    curve, u = sample_catmull_rom(WILD, 0.7)
    np.testing.assert_array_equal(curve[u == np.floor(u)], WILD)

    x = np.array([0.0, 1.0, 1.1, 9.0, 30.0, 30.5])
    curve, _ = sample_catmull_rom(np.column_stack([x, 2 * x]), 0.05)
    np.testing.assert_allclose(curve[:, 1], 2 * curve[:, 0], atol=1e-9)
    assert np.all(np.diff(curve[:, 0]) > 0)
    two, _ = sample_catmull_rom(np.array([[0.0, 0.0], [6.0, 8.0]]), 1.0)
    np.testing.assert_allclose(two[:, 0] * 8, two[:, 1] * 6, atol=1e-12)
    assert np.all(np.diff(two[:, 0]) > 0)


def test_curves_are_smooth_without_cusp_loop_or_overshoot():
    # C1 in the centripetal parameter: directions on both sides of a control point agree.
    step = 1e-6
    for knot in range(1, len(WILD) - 1):
        before, after = catmull_rom(WILD, np.array([knot - step, knot + step])) - WILD[knot]
        cosine = -(before @ after) / np.hypot(*before) / np.hypot(*after)
        assert cosine > 1 - 1e-6

    # Yuksel et al. 2011: inside a segment the curve never turns back on its chord by a right angle or more
    # so as to cross itself; sampled finely, no two samples far apart along it come close together.
    u = np.linspace(0, 1, 400)
    for segment in range(len(WILD) - 1):
        curve = catmull_rom(WILD, segment + u)
        steps = np.hypot(*np.diff(curve, axis=0).T)
        assert steps.min() > 0
        arc = np.concatenate([[0], np.cumsum(steps)])
        gap = np.hypot(*(curve[:, None] - curve).transpose(2, 0, 1))
        assert np.all(gap >= 0.2 * np.abs(arc[:, None] - arc) - 1e-9)

    # Where the uniform parameterisation overshoots by several times the segment's length.
    points = np.array([[-30.0, -40.0], [0.0, 0.0], [1.0, 0.0], [31.0, -40.0]])
    assert np.abs(catmull_rom(points, np.linspace(1, 2, 101))[:, 1]).max() < 1.0


def test_repeated_points_raise_and_can_be_dropped():
    repeated = WILD[[0, 0, 1, 2, 2, 2, 3]]
    with pytest.raises(InputError, match="no two neighbours equal"):
        catmull_rom(repeated, np.array([0.5]))
    with pytest.raises(InputError, match="two or more points"):
        catmull_rom(WILD[:1], np.array([0.0]))
    np.testing.assert_array_equal(drop_repeats(repeated), WILD[:4])
    assert np.isfinite(sample_catmull_rom(drop_repeats(repeated), 1.0)[0]).all()


def test_samples_respect_spacing_and_sagitta():
    curve, _ = sample_catmull_rom(WILD, 0.5)
    assert np.hypot(*np.diff(curve, axis=0).T).max() < 0.5 * 1.6
    controls = WILD[[0, 1, 3, 4, 6]]
    for sagitta in (1.0, 0.1, 0.01):
        curve, u = sample_catmull_rom(controls, 1000.0, sagitta=sagitta)
        middle = catmull_rom(controls, 0.5 * (u[1:] + u[:-1]))
        off = np.hypot(*(middle - 0.5 * (curve[1:] + curve[:-1])).T)
        assert off.max() <= sagitta
        few, _ = sample_catmull_rom(controls, 1000.0, sagitta=sagitta, most=7)
        assert len(few) <= 4 * 7 + 1


def test_the_distance_to_an_arc_is_that_to_its_circle_or_its_ends():
    """Arcs around the origin, with a radius of 50 m."""
    radius = 50.0
    for angle in (-1.9, -0.3, 1e-6, 0.7, 1.9):
        places = np.random.default_rng(3).uniform(-120, 120, (500, 2))
        # Positive angles turn left: the bulge is to the right then.
        first, last = (radius * np.array([np.cos(a), np.sin(a)]) for a in (0.3, 0.3 + angle))
        bend = -np.tan(angle / 4)
        t, square = nearest_on_arc(last - first, np.array(bend), places - first)
        around = (np.arctan2(places[:, 1], places[:, 0]) - 0.3) * np.sign(angle)
        within = np.mod(around, 2 * np.pi) < abs(angle)
        ends = np.minimum(*(np.hypot(*(places - end).T) for end in (first, last)))
        expected = np.where(within, np.abs(np.hypot(*places.T) - radius), ends)
        clear = np.hypot(*places.T) > 0.02 * radius  # near the centre an end stands for the arc
        np.testing.assert_allclose(np.sqrt(square)[clear], expected[clear], atol=1e-6, err_msg=str(angle))
        assert np.all((t >= 0) & (t <= 1)), angle


def test_arcs_of_a_circle_are_few_and_straight_lines_one():
    angle = np.linspace(0, 1.5 * np.pi, 9)
    circle = cubics(100.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    arcs, chords = (bisect(circle, 0.01, arcs=each).within(0.01) for each in (True, False))
    assert len(arcs.bend) * 3 < len(chords.bend)
    line = cubics(np.array([[0.0, 0.0], [10.0, 5.0], [30.0, 15.0]]))
    assert len(bisect(line, 1e-6).within(1e-6).bend) == 2
    assert np.all(bisect(line, 1e-6).within(1e-6).bend == 0.0)
