"""Longitudinal profiles: limits of grade, heights at junctions, smoothness, straight bridges, bounds."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from sketchterrain.features.table import on_grid
from sketchterrain.roads.alignment import align
from sketchterrain.roads.network import way_graph
from sketchterrain.roads.profile import ProfileInput, ProfileSolver, nearest_heights, station_graph
from sketchterrain.roads.road_types import GROUND, axis_points, grades, profile_at
from sketchterrain.schema.layers import id_of_vector
from tests.sample_roads import contents, hills, network_on, sketch_with


def random_features(seed, count=12):
    """Return roads, railways and paths of all grades and structures, most from a vertex of another one."""
    rng, found = np.random.default_rng(seed), []
    for number in range(1, count + 1):
        points = rng.uniform(50, 970, 2) + np.cumsum(rng.normal(0, 80, (rng.integers(2, 9), 2)), axis=0)
        if found and rng.random() < 0.7:
            points[0] = rng.choice(found[rng.integers(len(found))][1])
        own = {"id": number, "grade": float(rng.choice([0.03, 0.06, 0.1, 0.2]))}
        for key, values in {
            "smooth": [0, 1],
            "structure": ["bridge", "tunnel", "ground", "automatic", "automatic"],
            "level": [-1, 0, 0, 0, 1, 2],
        }.items():
            own[key] = rng.choice(values).item()
        found.append((str(rng.choice(["road", "road", "railway", "path"])), on_grid(points), own))
    return found


def limits_of(features):
    return {id_of_vector(layer, own["id"]): own["grade"] for layer, _, own in features}


@cache
def random_network(seed):
    return network_on(sketch_with(*random_features(seed)))


@pytest.mark.parametrize(
    "seeds",
    [
        range(15),
        pytest.param(range(15, 100), marks=pytest.mark.slow),
        pytest.param(range(100, 400), marks=pytest.mark.soak),
    ],
)
def test_grades_keep_their_limits_and_heights_meet(seeds) -> None:
    for seed in seeds:
        network, limits = random_network(seed), limits_of(random_features(seed))
        ends = {}
        for road in network.roads:
            assert np.abs(grades(road)).max() <= limits[road.id] + 1e-3, (seed, road.id)
            assert all(
                np.isfinite(each).all() for each in vars(road).values() if isinstance(each, np.ndarray)
            )
            for end in (0, -1):
                ends.setdefault(tuple(road.axis[end, :2]), set()).add(road.axis[end, 2])
        assert max(map(len, ends.values())) == 1, seed


def legs_of(network):
    legs = {}
    for road in network.roads:
        legs.setdefault(road.leg, []).append(road)
    return legs.values()


def test_profiles_are_smooth_along_legs() -> None:
    """Position, height and slope are continuous between parts, pieces and halves of pieces."""
    for seed in range(5):
        for parts in legs_of(random_network(seed)):
            for before, after in pairwise(parts):
                assert np.array_equal(before.axis[-1], after.axis[0])
                assert before.slope[-1] == after.slope[0]
                assert before.along[-1] == after.along[0]
            for road in parts:
                piece, length = np.arange(len(road.bend)), np.diff(road.along)
                for t, slope in ((0.0, road.slope[:-1]), (1.0, road.slope[1:])):
                    ahead, at = (
                        profile_at(road, piece, np.full(len(piece), each)) for each in (abs(t - 1e-4), t)
                    )
                    found = (ahead - at) / (1e-4 * length) * (1.0 - 2.0 * t)
                    assert found == pytest.approx(slope, abs=1e-4)
                halves = [profile_at(road, piece, np.full(len(piece), each)) for each in (0.5 - 1e-9, 0.5)]
                assert halves[0] == pytest.approx(halves[1], abs=1e-7)


def test_bends_are_tangent() -> None:
    for seed in range(5):
        for parts in legs_of(random_network(seed)):
            for road in parts:
                chord = np.diff(road.axis[:, :2], axis=0)
                direction, half = np.arctan2(*chord.T[::-1]), 2.0 * np.arctan(road.bend)
                turn = (direction[1:] + half[1:]) - (direction[:-1] - half[:-1])
                turn = np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi)
                assert turn[np.hypot(*chord[:-1].T) > 0.5].max(initial=0.0) < 0.02 or road.axis.shape[0] < 3


def test_bridges_and_tunnels_are_straight() -> None:
    """But for a few through parts of several limits, where a chord would be too steep."""
    off = []
    for seed in range(15):
        for road in random_network(seed).roads:
            if road.structure != GROUND:
                points = axis_points(road, 0.01)
                ends = points.along[[0, -1]], points.position[[0, -1], 2]
                off.append(np.abs(points.position[:, 2] - np.interp(points.along, *ends)).max())
    assert len(off) > 180
    assert np.mean(np.array(off) > 0.05) < 0.01


def test_a_change_of_the_ground_changes_legs_near_it() -> None:
    features = [(layer, points, own | {"structure": "ground"}) for layer, points, own in random_features(3)]
    sketch = sketch_with(*features)
    before, count = network_on(sketch), 0
    for road in [road for road in before.roads if len(road.axis) > 30][::3]:
        x, y, _ = road.axis[len(road.axis) // 2]

        def raised(at_x, at_y, x=x, y=y):
            return hills(at_x, at_y) + 3.0 * (np.hypot(at_x - x, at_y - y) < 12.0)

        found = [
            [(each.leg, each.axis.tobytes()) for each in network_on(sketch, ground).roads]
            for ground in (hills, raised)
        ]
        changed = {one[0] for one, two in zip(*found, strict=True) if one != two}
        count += len(changed)
        near = {each.leg for each in before.roads if np.hypot(*(each.axis[:, :2] - (x, y)).T).min() < 40.0}
        assert changed <= near
    assert count > 1


def test_bits_do_not_depend_on_the_order_of_features_or_on_the_run() -> None:
    features = random_features(5)
    expected = contents(network_on(sketch_with(*features)))
    rng = np.random.default_rng(1)
    for _ in range(4):
        assert (
            contents(network_on(sketch_with(*(features[k] for k in rng.permutation(len(features))))))
            == expected
        )


def test_bounds_that_contradict_each_other_are_told_and_shared() -> None:
    sketch = sketch_with(("road", [(0, 0), (100, 0), (1000, 0)], {"grade": 0.1}))
    graph = way_graph(sketch)
    line, _ = align(graph.ways, graph.legs)
    stations = station_graph(graph.ways, graph.legs, line)
    x = line.at[:, 0]
    lower, upper = np.where(x == 0.0, 60.0, -np.inf), np.where(x == 100.0, 0.0, np.inf)
    nearest = nearest_heights(stations, line, np.zeros(len(x)), np.zeros(len(x), np.bool_))
    ground, runs = np.zeros(len(x) - 1, np.int64), np.zeros((0, 2), np.int64)
    wanted = ProfileInput(nearest, ground, runs, runs)
    profile = ProfileSolver(stations, line).solve(wanted, lower, upper)
    assert profile.violation.max() == pytest.approx(50.0, abs=0.1)  # 60 m less the 10 m of the grade
    for value, bound in ((lower - profile.height, 25.0), (profile.height - upper, 25.0)):
        assert value.max() == pytest.approx(bound, abs=0.5)
    assert np.abs(profile.slope).max() <= 0.1001
    assert profile.violation[x > 700.0].max() == 0.0


def test_a_solver_of_closer_and_closer_bounds_finds_what_a_new_one_does() -> None:
    graph = way_graph(sketch_with(*random_features(4)))
    line, _ = align(graph.ways, graph.legs)
    stations, rng = station_graph(graph.ways, graph.legs, line), np.random.default_rng(1)
    count, ground = len(line.at), 20.0 * np.sin(0.01 * line.at[:, 0])
    solver, structure = ProfileSolver(stations, line), np.zeros(count - 1, np.int64)
    lower, upper, kept = np.full(count, -np.inf), np.full(count, np.inf), []
    runs = np.zeros((0, 2), np.int64)
    for step in range(12):
        if step % 3 == 2:  # another straight structure
            leg = int(rng.integers(len(line.first) - 1))
            runs = np.append(runs, [[line.first[leg], line.first[leg + 1] - 1]], axis=0)
            structure = structure.copy()
            structure[slice(*runs[-1].tolist())] = step
        for bound, closer, side in ((lower, np.maximum, -3.0), (upper, np.minimum, 3.0)):
            at = rng.integers(count, size=2)
            bound[at] = closer(bound[at], ground[at] + side)
        nearest = nearest_heights(stations, line, ground, np.zeros(count, np.bool_))
        given = ProfileInput(nearest, structure, runs, runs), lower, upper
        found, other = solver.solve(*given), ProfileSolver(stations, line).solve(*given)
        for name in ("height", "slope", "violation"):
            assert getattr(found, name).tobytes() == getattr(other, name).tobytes(), (step, name)
        kept.append((found.height, found.height.copy()))
    assert all(np.array_equal(*each) for each in kept)  # later ones leave earlier ones alone


def test_far_from_the_origin_the_shape_is_the_same() -> None:
    features = random_features(2)
    near = network_on(sketch_with(*features))
    away = np.array([1e6, -1e6])
    moved = [(layer, np.asarray(points) + away, own) for layer, points, own in features]
    far = network_on(sketch_with(*moved), lambda x, y: hills(x - away[0], y - away[1]))
    assert len(near.roads) == len(far.roads)
    for one, two in zip(near.roads, far.roads, strict=True):
        np.testing.assert_allclose(two.axis - [*away, 0.0], one.axis, atol=2e-3)
