import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.features.splines import catmull_rom, sample_catmull_rom, without_repeats

WILD = np.array([[0, 0], [10, 0], [10.5, 0.2], [10.4, 5], [-40, 5], [-40, 5.3], [-39, 60]], float)


def test_the_curve_goes_through_its_control_points_and_along_lines() -> None:
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


def test_the_curve_is_smooth_at_control_points_without_cusp_loop_or_overshoot() -> None:
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
    t = np.linspace(0, 1, 101)[:, None]
    tangents = 0.5 * (points[2] - points[0]), 0.5 * (points[3] - points[1])
    uniform = (
        (2 * t**3 - 3 * t**2 + 1) * points[1]
        + (t**3 - 2 * t**2 + t) * tangents[0]
        + (3 * t**2 - 2 * t**3) * points[2]
        + (t**3 - t**2) * tangents[1]
    )
    centripetal = catmull_rom(points, 1 + t[:, 0])
    assert np.abs(uniform[:, 1]).max() > 4.0
    assert np.abs(centripetal[:, 1]).max() < 1.0


def test_repeated_points_are_refused_and_can_be_dropped() -> None:
    repeated = WILD[[0, 0, 1, 2, 2, 2, 3]]
    with pytest.raises(InputError, match="no two neighbours equal"):
        catmull_rom(repeated, np.array([0.5]))
    with pytest.raises(InputError, match="two or more points"):
        catmull_rom(WILD[:1], np.array([0.0]))
    np.testing.assert_array_equal(without_repeats(repeated), WILD[:4])
    assert np.isfinite(sample_catmull_rom(without_repeats(repeated), 1.0)[0]).all()


def test_samples_keep_to_the_spacing_and_to_the_sagitta() -> None:
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
