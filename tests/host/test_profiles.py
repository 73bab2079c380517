"""Heights of roads: envelopes, means and least squares against other ways to find them."""

from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sketchterrain.host.library import host_function

FREE = 1 << 60


def graph(random, nodes, edges):
    """Return neighbours of nodes: starts, targets, edges that lead both ways and their weights."""
    ends, weight = random.integers(0, nodes, (2, edges)), random.integers(1, 50, edges)
    source, target = np.append(*ends), np.append(*ends[::-1])
    order = np.argsort(source, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(source, minlength=nodes)))
    return starts, target[order], np.tile(weight, 2)[order]


def legs(random, counts):
    """Return the first stations of legs, and all places along them."""
    first = np.append(0, np.cumsum(counts, dtype=np.int64))
    along = [np.append(0.0, np.cumsum(random.choice([0.5, 1.0, 2.5], max(n - 1, 0)))) for n in counts]
    return first, np.concatenate([np.zeros(0), *along])


def test_envelopes_are_the_shortest_ways_from_values():
    random = np.random.default_rng(1)
    for nodes, edges in ((1, 0), (2, 1), (3, 5), (30, 40)):
        starts, to, weight = graph(random, nodes, edges)
        values = np.where(random.random(nodes) < 0.5, random.integers(-90, 90, nodes), FREE)
        found, queue = np.zeros((2, nodes), np.int64)
        given = values, starts, to, weight, FREE
        host_function("lower_envelope")(*given, found, queue, np.zeros(nodes, np.bool_))
        dense = np.full((nodes, nodes), np.inf)
        np.minimum.at(dense, (np.repeat(np.arange(nodes), np.diff(starts)), to), weight)
        ways = dijkstra(csr_array(np.where(np.isfinite(dense), dense, 0.0)))
        expected = np.min(np.where(values < FREE, values, np.inf)[:, None] + ways, axis=0)
        assert np.where(found < FREE, found, np.inf).tolist() == expected.tolist()
    none = np.zeros(0, np.int64)
    given = none, np.zeros(1, np.int64), none, none, FREE
    host_function("lower_envelope")(*given, none, none, np.zeros(0, np.bool_))


def test_junctions_share_their_excess():
    starts, to = np.array([0, 1, 3, 4, 4]), np.array([1, 0, 2, 1])
    height = np.array([0.0, 8.0, 8.0, 5.0])
    host_function("share_excess")(starts, to, np.array([2.0, 2.0, 9.0, 9.0]), height, np.zeros(4))
    assert np.allclose(height, [3.0, 5.0, 8.0, 5.0])  # the mean of both ends stays
    random = np.random.default_rng(2)
    starts, to, weight = graph(random, 25, 30)
    height = random.normal(0.0, 40.0, 25)
    apart, most = np.repeat(np.arange(25), np.diff(starts)), weight.astype(np.float64)
    before = np.abs(height[to] - height[apart]) - most
    host_function("share_excess")(starts, to, most, height, np.zeros(25))
    assert (np.abs(height[to] - height[apart]) - most).max() < 0.02 * before.max()


def test_least_squares_are_no_farther_from_the_ground_than_the_best_of_a_grid():
    random = np.random.default_rng(3)
    step = 0.5
    for _ in range(30):
        first, along = legs(random, random.integers(2, 9, 3))
        ground = np.round(random.normal(0.0, 3.0, len(along)) / step) * step
        share = random.choice([0.0, 1.0, 2.5], len(along))
        most = step * random.integers(1, 5, len(along) - 1)
        ends = ground[np.stack([first[:-1], first[1:] - 1], axis=1)]
        for leg in range(3):  # ends within reach of each other
            reach = most[first[leg] : first[leg + 1] - 1].sum()
            ends[leg, 1] = np.clip(ends[leg, 1], ends[leg, 0] - reach, ends[leg, 0] + reach)
        found = np.zeros(len(along))
        host_function("least_squares")(first, ground, share, most, ends, found, np.zeros((4, 40)))
        for leg in range(3):
            own = slice(first[leg], first[leg + 1])
            z, w, aim, limit = found[own], share[own], ground[own], most[first[leg] : first[leg + 1] - 1]
            assert z[[0, -1]].tolist() == ends[leg].tolist()
            assert (np.abs(np.diff(z)) <= limit + 1e-6).all()  # walls are steep, not upright
            grid = ends[leg, 0] + step * np.arange(-60, 61)
            cost = np.where(grid == ends[leg, 0], 0.0, np.inf)
            for i in range(1, len(z)):
                near = np.abs(grid[:, None] - grid) <= limit[i - 1]
                cost = np.min(np.where(near, cost, np.inf), axis=1)
                if i < len(z) - 1:
                    cost += w[i] * (grid - aim[i]) ** 2
            own_cost = (w * (z - aim) ** 2)[1:-1].sum()
            best = cost[np.flatnonzero(grid == ends[leg, 1])[0]]
            assert own_cost <= best + 1e-6
            # Between points of the grid the cost is lower by no more than the parabolas are.
            assert own_cost >= best - (w[1:-1] * (2.0 * np.abs(z - aim)[1:-1] * step + step**2)).sum()


def test_means_are_integrals_over_half_of_a_reach_to_both_sides():
    random = np.random.default_rng(4)
    first, along = legs(random, [2, 3, 9, 20])
    height, reach = random.normal(0.0, 5.0, len(along)), np.zeros(len(along))
    for a, b in pairwise(first):
        room = np.minimum(along[a:b], along[b - 1] - along[a:b])
        reach[a:b] = np.minimum(random.choice([1e-3, 1.0, 6.0, 90.0]), room)
    mean, integral = np.zeros((2, len(along)))
    host_function("mean_heights")(len(first) - 1, along, first, height, reach, mean, integral)
    for a, b in pairwise(first):
        for i in range(a, b):
            low, high = along[i] - 0.5 * reach[i], along[i] + 0.5 * reach[i]
            x = np.unique([*np.clip(along[a:b], low, high), low, high])
            z = np.interp(x, along[a:b], height[a:b])
            area = (0.5 * np.diff(x) * (z[1:] + z[:-1])).sum()
            expected = area / reach[i] if reach[i] >= 2e-3 else height[i]
            assert abs(mean[i] - expected) < 1e-9


def test_reaches_unite_those_of_all_stations_of_a_leg():
    random = np.random.default_rng(5)
    for counts in ([], [1], [2, 1], [40, 3, 25]):
        first, along = legs(random, counts)
        reach, found = random.uniform(0.0, 12.0, len(along)), np.zeros(len(along))
        host_function("united_reaches")(len(counts), along, first, reach, found)
        for a, b in pairwise(first):
            square = reach[a:b] ** 2 - 0.75 * (along[a:b, None] - along[a:b]) ** 2
            assert np.allclose(found[a:b], np.sqrt(np.maximum(square, 0.0)).max(axis=1, initial=0.0))
