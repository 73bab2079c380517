import itertools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.geometry.splines import arc_length
from sketchterrain.landforms.hydrology.network import skeletons
from sketchterrain.landforms.hydrology.river_shape import MIN_GRADIENT, bend_lean, width_swing
from tests.terrain.conftest import tiers
from tests.traced import trace_hydrology

SIZE = 160
ROW, COLUMN = np.mgrid[:SIZE, :SIZE]


def painted(*lines, half=2.5, label=1):
    """Strokes through points of (column, row)."""
    picture = np.zeros((SIZE, SIZE), np.uint8)
    for line in lines:
        for (x0, y0), (x1, y1) in itertools.pairwise(line):
            for t in np.linspace(0, 1, 2 * int(np.hypot(x1 - x0, y1 - y0)) + 2):
                distance = np.hypot(ROW - y0 - t * (y1 - y0), COLUMN - x0 - t * (x1 - x0))
                picture[distance <= half] = label
    return picture


def sketch(picture, fidelity=0.8, **changes):
    return Sketch(extent=10.0 * SIZE, fidelity=fidelity, layers={"river": picture}, **changes)


def hilly(x, y):
    return 60 * np.sin(x / 170) * np.cos(y / 130) + 0.08 * y


def southward(x, y):
    return 0.1 * y + 0.0 * x


def trace(picture, ground=hilly, fidelity=0.8, **changes):
    rivers = trace_hydrology(sketch(picture, fidelity, **changes), seed=3, ground=ground).rivers
    for river in rivers:
        check(river)
    return rivers


def check(river):
    line = river.centreline
    steps = np.hypot(*np.diff(line[:, :2], axis=0).T)
    assert np.isfinite(line).all()
    assert np.all(steps > 0)
    assert np.all(np.diff(line[:, 2]) <= 0)  # level only in a lake
    assert len(line) == len(river.centreline_width) == len(river.centreline_depth)
    assert len(river.points) == len(river.width) == len(river.depth)
    assert np.all(river.centreline_width > 0)
    assert np.all(river.centreline_depth > 0)
    assert cKDTree(line).query(river.points)[0].max() == 0.0
    np.testing.assert_array_equal(river.points[[0, -1]], line[[0, -1]])
    assert 4 << 48 <= river.id < 5 << 48


def ends_on(river, other):
    return bool((other.centreline == river.centreline[-1]).all(axis=1).any())


def joined(rivers):
    """Count the rivers that end on another one."""
    return sum(any(ends_on(river, other) for other in rivers if other is not river) for river in rivers)


def test_rivers_flow_downhill_or_along_the_label_and_have_its_size():
    picture = painted([(80, 30), (70, 80), (90, 130)], label=4)
    (river,) = trace(picture, southward, labels={("river", 4): {"width": 20.0, "depth": 3.0}})
    assert river.label == 4
    assert river.points[0, 1] > river.points[-1, 1]
    assert river.width[-1] == pytest.approx(20.0)
    assert river.width[0] == pytest.approx(8.0)
    assert river.depth[-1] == pytest.approx(3.0)
    (back,) = trace(picture, lambda x, y: -southward(x, y))
    assert back.points[0, 1] < back.points[-1, 1]

    picture = painted([(40, 130), (120, 30)])
    for flow in (0.0, 90.0, 180.0):
        (river,) = trace(picture, southward, labels={("river", 1): {"flow": flow}})
        run = river.points[-1, :2] - river.points[0, :2]
        assert run @ [np.sin(np.deg2rad(flow)), np.cos(np.deg2rad(flow))] > 0, flow


def test_the_centreline_follows_the_skeleton_below_the_terrain():
    picture = painted([(30, 40), (60, 60), (70, 110), (120, 120), (140, 60)])
    (skeleton,) = skeletons(picture > 0)
    at = np.column_stack([(skeleton.columns + 0.5) * 10, (SIZE - skeleton.rows - 0.5) * 10])
    for fidelity in (0.0, 0.8, 1.0):
        (river,) = trace(picture, fidelity=fidelity)
        distance = cKDTree(river.centreline[:, :2]).query(at)[0] / 10
        assert distance.mean() < (0.75 if fidelity == 1.0 else 1.5), fidelity

    (river,) = trace(painted([(80, 20), (80, 140)]), southward)
    line = river.centreline
    assert np.all(line[:, 2] < southward(line[:, 0], line[:, 1]))
    falls = -np.diff(line[:, 2]) / np.hypot(*np.diff(line[:, :2], axis=0).T)
    assert falls.min() >= MIN_GRADIENT * 0.999


def test_rivers_join_over_small_gaps_only():
    rivers = trace(painted([(80, 20), (80, 140)], [(20, 40), (80, 90)]), southward)
    stem, tributary = sorted(rivers, key=lambda river: -len(river.centreline))
    at = np.flatnonzero((stem.centreline == tributary.centreline[-1]).all(axis=1))
    assert len(at) == 1
    assert stem.centreline_width[-1] > stem.centreline_width[at[0]]
    assert tributary.centreline[-2, 2] > tributary.centreline[-1, 2]

    stem = painted([(80, 20), (80, 140)])
    for gap in (1, 3):
        side = painted([(20, 70), (110, 70)])
        side[:, 80 - 2 - gap :] = 0
        rivers = trace(stem | side, southward)
        assert len(rivers) == 2, gap
        longer, joining = sorted(rivers, key=lambda river: -len(river.centreline))
        assert ends_on(joining, longer), gap

    far = painted([(20, 70), (70, 70)])
    far[:, 80 - 2 - 8 :] = 0
    beside = painted([(72, 30), (72, 120)])
    for other in (far, beside):
        first, second = trace(painted([(80, 20), (80, 140)]) | other, southward)
        assert joined((first, second)) == 0
    assert len(trace(painted([(80, 20), (80, 70)]) | painted([(80, 78), (80, 140)]), southward)) == 2


@tiers("seed", [1], range(6))
def test_confluences_meet_on_any_terrain(seed):
    rng = np.random.default_rng(seed)
    phase = rng.random(4) * 6

    def ground(x, y):
        return 80 * np.sin(x / 150 + phase[0]) * np.sin(y / 110 + phase[1]) + 30 * np.sin(
            (x + y) / 70 + phase[2]
        )

    forks = painted([(80, 15), (75, 145)], [(15, 30), (78, 70)], [(140, 60), (77, 100)], [(40, 20), (45, 50)])
    rivers = trace(forks, ground)
    assert len(rivers) >= 3
    assert joined(rivers) == len(rivers) - 1


@tiers("half", [4.0], [1.0, 2.5])
def test_self_crossing_rivers_fall_all_the_way(half):
    turn, bow = np.linspace(0, 2 * np.pi, 160), np.linspace(-1.3, 1.3, 100)
    eight = [(80 + 50 * np.sin(2 * a), 80 + 60 * np.sin(a)) for a in turn]
    alpha = [(80 + 60 * (t * t - 0.6), 80 + 80 * t * (t * t - 0.9)) for t in bow]
    for line, arms in ((eight, (2, 4)), (alpha, (3,))):  # where arms only touch, they run past each other
        rivers = trace(painted(line, half=half), southward)
        assert len(rivers) in arms
        assert joined(rivers) >= len(rivers) - 1


def test_a_narrow_river_joins_a_wide_one():
    picture = painted([(20, 40), (80, 90)], half=1.5, label=2)
    stem = painted([(80, 20), (80, 140)])
    picture[stem > 0] = 1
    labels = {("river", 1): {"width": 30.0}, ("river", 2): {"width": 6.0}}
    rivers = trace(picture, southward, labels=labels)
    assert {river.label for river in rivers} == {1, 2}
    narrow, wide = (next(river for river in rivers if river.label == label) for label in (2, 1))
    assert narrow.width[len(narrow.width) // 2] == pytest.approx(6.0, rel=0.1)
    assert wide.width[-1] == pytest.approx(np.hypot(30.0, 6.0), rel=1e-3)  # drained areas add up
    assert ends_on(narrow, wide)


def test_a_painted_wedge_sets_the_width_also_at_confluences():
    half = 1.0 + (ROW - 20) / 20  # px: from 20 m wide to 140 m, by 1 m in a metre
    wedge = ((np.abs(COLUMN - 80.2) <= half) & (ROW >= 20) & (ROW < 140)).astype(np.uint8)
    (river,) = trace(wedge, southward, labels={("river", 1): {"width": 0.0, "depth": 2.0}})
    row = SIZE - river.centreline[:, 1] / 10
    inside = (row > 30) & (row < 124)
    width = river.centreline_width[inside]
    assert np.all(np.abs(width / (20.0 + row[inside] - 20.0) - 1) < 0.15)
    assert np.all(np.diff(width) > -0.1)
    assert np.all(np.diff(river.centreline_depth[inside][[0, 20, -1]]) > 0)

    picture = painted([(80, 20), (80, 140)], [(20, 40), (80, 90)])
    rivers = trace(picture, southward, labels={("river", 1): {"width": 0.0}})
    stem = max(rivers, key=lambda river: len(river.centreline))
    assert len(rivers) == 2
    assert np.all(np.abs(stem.width[1:-1] / 50.0 - 1) < 0.35)
    assert stem.width[-4] == pytest.approx(50.0, rel=0.1)


@pytest.mark.parametrize(("thick", "turn"), [(1, 0.0), (2, 0.4), (3, np.pi / 4), (4, 0.0), (7, 0.4)])
def test_painted_width_is_the_width_of_the_stroke(thick, turn):
    u = (COLUMN - 79.5) * np.cos(turn) + (ROW - 79.5) * np.sin(turn)
    v = (ROW - 79.5) * np.cos(turn) - (COLUMN - 79.5) * np.sin(turn) + 0.25
    stroke = ((np.abs(u) < 60) & (v > -thick / 2) & (v <= thick / 2)).astype(np.uint8)
    (river,) = trace(stroke, labels={("river", 1): {"width": 0.0}})
    share = 10 * stroke.sum() / 120  # area over length
    middle = river.centreline_width[len(river.centreline) // 4 : -len(river.centreline) // 4]
    assert middle.mean() == pytest.approx(share, rel=0.15)


def test_rivers_extend_beyond_the_edge():
    picture = painted([(80, 60), (70, 159)])
    (river,) = trace(picture, southward)
    beyond = river.centreline[:, 1] < 0
    assert beyond.sum() > 10
    assert river.centreline[-1, 1] < -0.2 * 10 * SIZE
    first = int(np.argmax(beyond))
    assert beyond[first:].all()
    # The mouth is at the edge although the ground rises to it a little.
    (river,) = trace(picture, lambda x, y: -0.005 * y + 0 * x)
    assert river.points[-1, 1] < 0

    (river,) = trace(painted([(0, 80), (159, 70)]), lambda x, y: 0.05 * x + 0 * y)
    assert river.centreline[0, 0] > 10 * SIZE + 200
    assert river.centreline[-1, 0] < -200
    entry = int(np.argmax(river.centreline[:, 0] < 10 * SIZE))
    line = river.centreline
    swing = width_swing(line[:, :2], arc_length(line), np.full(len(line), river.centreline_width[-1]))
    assert river.centreline_width[entry] / swing[entry] > 0.9 * river.centreline_width[-1]
    assert river.centreline_width[0] == pytest.approx(0.4 * river.centreline_width[-1])
    # An end near the edge that runs along it stays inside.
    (river,) = trace(painted([(40, 156), (120, 156)], half=1.5))
    assert river.centreline[:, 1].min() > 0


def test_dabs_loops_and_thick_brushes():
    for size in ((1, 1), (2, 2), (1, 2), (9, 9), (3, 3)):
        picture = np.zeros((SIZE, SIZE), np.uint8)
        assert trace(picture) == ()
        picture[60 : 60 + size[0], 70 : 70 + size[1]] = 1
        (river,) = trace(picture, southward)
        length = np.hypot(*(river.points[-1] - river.points[0])[:2])
        assert 15 <= length <= 20 + 10 * max(size), size
        centre = river.points[[0, -1], :2].mean(axis=0)
        middle = [(70 + size[1] / 2) * 10, (SIZE - 60 - size[0] / 2) * 10]
        assert np.abs(centre - middle).max() <= 10, size

    distance = np.hypot(ROW - 80, COLUMN - 80)
    rivers = trace((np.abs(distance - 50) < 2.5).astype(np.uint8), southward)
    assert len(rivers) == 2
    np.testing.assert_array_equal(rivers[0].centreline[-1], rivers[1].centreline[-1])
    assert rivers[0].centreline[-1, 1] < 10 * (SIZE - 120)
    springs = [river.centreline[0, :2] for river in rivers]
    assert np.hypot(*(springs[0] - springs[1])) < 100

    rng = np.random.default_rng(3)
    picture = np.zeros((SIZE, SIZE), np.uint8)
    for t in np.linspace(0, 1, 200):
        picture[np.hypot(ROW - 25 - 110 * t, COLUMN - 80 - 20 * np.sin(5 * t)) < 7 + rng.normal()] = 1
    assert len(trace(picture)) == 1


def test_separate_rivers_are_independent():
    one = painted([(30, 20), (40, 140)])
    (alone,) = trace(one)
    pair = trace(one | painted([(120, 20), (110, 140)]))
    (same,) = (river for river in pair if river.id == alone.id)
    np.testing.assert_array_equal(same.centreline, alone.centreline)


def test_non_finite_terrain_raises():
    picture = painted([(80, 20), (80, 140)])
    for ground in (lambda x, _: x * np.nan, lambda x, _: x[:1]):
        with pytest.raises(InputError, match="finite ground heights"):
            trace_hydrology(sketch(picture), seed=1, ground=ground)


def test_the_current_leans_outward_in_bends_and_widths_swing():
    turn = np.linspace(0.0, np.pi, 200)
    line = 300.0 * np.column_stack([np.sin(turn), np.cos(turn)])  # clockwise: a bend to the right
    width = np.full(200, 40.0)
    lean = bend_lean(line, arc_length(line), width)
    np.testing.assert_allclose(lean[100], np.sin(60.0 / 300.0) / 0.5, rtol=0.02)
    np.testing.assert_allclose(bend_lean(line[::-1], arc_length(line[::-1]), width), -lean[::-1], atol=2e-3)
    assert lean[0] == lean[-1] == 0.0
    swing = width_swing(line, arc_length(line), width)
    assert swing[0] == swing[-1] == 1.0
    assert 0.7 <= swing.min() < swing.max() <= 1.45
