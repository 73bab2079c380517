"""Methods for the distance to a spline: which are exact, how often others fail, and the reference itself."""

import itertools

import numpy as np
import pytest

from sketchterrain.benchmarks.splines import (
    ARCS,
    CELL_SIZES,
    KINDS,
    SEGMENTS,
    SplineQueries,
    distances,
    failures,
    pieces_of,
    splines_and_places,
)
from sketchterrain.compute.context import ComputeContext
from sketchterrain.geometry.splines import catmull_rom, cubics
from sketchterrain.terrain.centrelines import flatten, nearest_on_arc, position
from tests.devices import DEVICES

COUNT, EACH = 20, 64
NEVER_WRONG = ("all roots", SEGMENTS, ARCS)
# Failures at cells of 2 m among 20 splines with 64 places each, %: at least, at most.
KNOWN = {
    "Newton": {"river": (0.0, 2.0), "random": (25.0, 45.0), "cusps": (25.0, 45.0), "hairpins": (5.0, 15.0)},
    "two steps": {"river": (5.0, 20.0), "random": (20.0, 40.0), "loops": (25.0, 45.0)},
    "iterated sampling": {"river": (0.0, 0.5), "cusps": (4.0, 25.0), "hairpins": (2.0, 10.0)},
}


@pytest.fixture(scope="module")
def suite(context) -> dict[str, tuple[SplineQueries, np.ndarray]]:
    """Splines and places of every kind, and the true distances."""
    found = {}
    for kind in KINDS:
        queries = SplineQueries(context, *splines_and_places(kind, COUNT, each=EACH, seed=4))
        found[kind] = (queries, distances(queries.cubics, queries.places))
    return found


Suite = dict[str, tuple[SplineQueries, np.ndarray]]


@pytest.mark.slow
def test_exact_methods_are_never_wrong_by_a_hundredth_of_a_cell(suite):
    for kind, (queries, expected) in suite.items():
        for method, cell in itertools.product(NEVER_WRONG, CELL_SIZES):
            error = np.abs(queries.distances(method, cell) - expected)
            assert not failures(error, cell).any(), (kind, method, cell)
        # float32 positions of some hundreds of metres step by 3e-5 m.
        assert np.abs(queries.distances("all roots", 1.0) - expected).max() < 1e-4, kind


def test_approximate_methods_fail_as_often_as_known_and_by_metres(suite):
    for method, kinds in KNOWN.items():
        errors = {kind: queries.distances(method, 2.0) - known for kind, (queries, known) in suite.items()}
        for kind, (least, most) in kinds.items():
            share = 100 * failures(np.abs(errors[kind]), 2.0).mean()
            assert least <= share <= most, (method, kind)
        # By more than a river is wide, so that a picture shows it; and never nearer than the curve is.
        assert min(error.min() for error in errors.values()) > -1e-3, method
        assert max(error.max() for error in errors.values()) > 3.0, method


def test_the_reference_distance_lies_within_bounds():
    """Against branch and bound: no interval left out can hold a nearer place."""
    for kind in KINDS:
        controls, places = splines_and_places(kind, 2, each=12, seed=9)
        curves = cubics(controls)
        expected = distances(curves, places)
        for curve, around, known in zip(curves, places, expected, strict=True):
            for place, distance in zip(around, known, strict=True):
                lowest, highest = bounded_distance(curve, place, gap=2e-4)
                assert lowest - 1e-9 <= distance <= highest + 1e-9, kind


def bounded_distance(curve: np.ndarray, place: np.ndarray, *, gap: float) -> tuple[float, float]:
    """Bounds of the distance, at most `gap` (m) apart: stretches that can't come so near are dropped."""
    piece, low, high = np.arange(len(curve)), np.zeros(len(curve)), np.ones(len(curve))
    best, dropped = np.inf, np.inf
    while piece.size:
        c, half = curve[piece], 0.5 * (high - low)
        middle = 0.5 * (low + high)
        distance = np.hypot(*(position(c, middle[:, None])[:, 0] - place).T)
        best = min(best, float(distance.min()))
        slope = c[..., 1] + 2 * middle[:, None] * c[..., 2] + 3 * middle[:, None] ** 2 * c[..., 3]
        bend = 2 * np.abs(c[..., 2]) + 6 * np.maximum(np.abs(low), np.abs(high))[:, None] * np.abs(c[..., 3])
        reach = half * np.hypot(*(np.abs(slope) + half[:, None] * bend).T)
        least = distance - reach
        kept = least < best - gap
        dropped = min(dropped, float(least[~kept].min(initial=np.inf)))
        piece, low, middle, high = piece[kept], low[kept], middle[kept], high[kept]
        piece = np.repeat(piece, 2)
        low, high = np.stack([low, middle], -1).ravel(), np.stack([middle, high], -1).ravel()
    return min(dropped, best), best


def test_in_double_all_roots_are_the_reference():
    with_double = [device for device in DEVICES if device.has_double]
    if not with_double:
        pytest.skip("no device with 64-bit floats")
    drawn = [splines_and_places(kind, 6, each=EACH, seed=8) for kind in KINDS]
    controls, places = (np.concatenate(part) for part in zip(*drawn, strict=True))
    queries = SplineQueries(ComputeContext(with_double[0], real="double"), controls, places)
    expected = distances(queries.cubics, queries.places)
    np.testing.assert_allclose(queries.distances("all roots", 1.0), expected, rtol=0, atol=1e-6)


def test_cubics_are_the_spline_and_pieces_join_in_order():
    controls = splines_and_places("random", 1, each=1, seed=1)[0][0]
    u = np.linspace(0, 5, 501)[:-1]
    piece = u.astype(int)
    at = position(cubics(controls)[piece], (u - piece)[:, None])[:, 0]
    np.testing.assert_allclose(at, catmull_rom(controls, u), atol=1e-9)

    controls, _ = splines_and_places("loops", 5, each=1, seed=2)
    starts, begins, chords = pieces_of(cubics(controls), 0.02, arcs=True)
    assert starts[0] == 0
    assert starts[-1] == len(begins)
    for first, last in itertools.pairwise(starts):
        ends = begins[first:last] + chords[first:last, :2]
        np.testing.assert_allclose(begins[first + 1 : last], ends[:-1], atol=1e-9)


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
    arcs, chords = (flatten(circle, 0.01, arcs=each) for each in (True, False))
    assert len(arcs.bend) * 3 < len(chords.bend)
    line = cubics(np.array([[0.0, 0.0], [10.0, 5.0], [30.0, 15.0]]))
    assert len(flatten(line, 1e-6).bend) == 2
    assert np.all(flatten(line, 1e-6).bend == 0.0)
