"""Drainage: each loop of ``kernels/host/drainage.c`` against NumPy or plain Python, on small rasters."""

from itertools import pairwise, product

import numpy as np
import pytest

from sketchterrain.benchmarks.host_drainage import empty_rasters
from sketchterrain.host.library import host_function

SPACING, PER_AREA, LEAST_SLOPE = 20.0, 1.0 / 400.0, 2.0**-13
INNER, OUTLET, OPEN_END = 1, 2, 3
STEPS = [step for step in product((-1, 0, 1), repeat=2) if step != (0, 0)]
SHAPES = ((1, 1), (1, 2), (2, 2), (1, 9), (5, 3), (9, 12))


def source(shape, seed=0):
    """Return uplift, repose, rain, base, domain and free courses of a raster with outlets at a side."""
    random = np.random.default_rng(seed)
    uplift, repose, rain = random.random((3, *shape)) + 0.1
    base = np.where(np.indices(shape)[1] == 0, random.integers(0, 3, shape), np.nan)
    return uplift, repose, 400.0 * rain, base, np.ones(shape, np.bool_), np.full(base.size, -1, np.int32)


def pack(packed, onto=None, start=None, place=(0, 0, 0, 0, 0)):
    rasters = empty_rasters(*packed[0].shape)
    onto = packed[3] if onto is None else onto
    start = np.full((1, 1), np.nan) if start is None else start
    return host_function("pack_drainage")(rasters, *packed, onto, start, *place), rasters


def level(shape, seed=0, *, courses=()):
    """Return the rasters of a level whose heights are whole numbers, so that many are equal."""
    packed = source(shape, seed)
    packed[4].flat[np.random.default_rng(seed).random(packed[4].size) < 0.1] = False
    for course in courses:
        packed[4].flat[list(course)] = True
        packed[5][list(course[:-1])] = course[1:]
    onto = np.random.default_rng(seed + 1).integers(0, 9, shape).astype(np.float64)
    right, rasters = pack(packed, onto)
    assert right
    return rasters


def hashed_unit(row, column, level):
    """Return SplitMix64's finalizer of a node as a number in [0, 1), in Python's integers."""
    mask = 2**64 - 1
    h = row * 0x9E3779B97F4A7C15 & mask
    h = (h ^ h >> 29) + column * 0xD1B54A32D192ED03 & mask
    h = (h ^ h >> 30) * 0xBF58476D1CE4E5B9 + level & mask
    h = (h ^ h >> 27) * 0x94D049BB133111EB & mask
    return ((h ^ h >> 31) >> 11) * 2.0**-53


@pytest.mark.parametrize("shape", SHAPES)
def test_packed_level_starts_from_noise(shape):
    packed = source(shape)
    packed[4][-1, -1] = False
    right, (*_, reals, integers, kinds) = pack(packed, place=(-5, 8, 2, 0, 0))
    inside = np.pad(packed[4], 1)
    lowest = np.nanmin(np.where(packed[4], packed[3], np.nan)) if packed[4][:, 0].any() else 0.0
    noise = [[hashed_unit(i - 5, j + 8, 2) for j in range(shape[1])] for i in range(shape[0])]
    expected = np.where(np.isnan(packed[3]), lowest + 0.01 * SPACING * np.array(noise), packed[3])
    assert right
    assert np.array_equal(reals[5], np.where(inside, np.pad(expected, 1), np.inf))
    assert np.array_equal(kinds[0], np.where(inside, np.pad(1 + ~np.isnan(packed[3]), 1), 0))
    for plane, values in enumerate((packed[0], 0.92**2 * packed[1], packed[2])):
        np.testing.assert_allclose(reals[plane], np.where(inside, np.pad(values, 1), 0.0), rtol=1e-15)
    assert (reals[3] == -np.inf).all()
    assert not reals[4].any()
    assert (integers[:2] == -1).all()


def test_packed_level_starts_from_the_coarser_one():
    """A plane stays one but for the moves by up to half a coarse node; missing heights leave their weight."""
    packed = source((9, 11))
    packed[3][:] = np.nan
    row, column = np.mgrid[:7, :8].astype(np.float64)
    start = 3.0 + 10.0 * row + 2.0 * column
    _, (*_, reals, _, _) = pack(packed, start=start, place=(4, -6, 0, 1, -4))
    fine = np.mgrid[4 - 2 : 4 - 2 + 9, -6 + 8 : -6 + 8 + 11] / 2.0
    plane = 3.0 + 10.0 * fine[0] + 2.0 * fine[1]
    moved = np.abs(reals[5][1:-1, 1:-1] - plane)
    assert 1.0 < moved.max() <= 6.0
    start[3:, :] = np.nan
    onto = np.full((9, 11), 100.0)
    _, (*_, raised, _, _) = pack(packed, onto, start, (4, -6, 0, 1, -4))
    beyond = fine[0] > 3.6
    assert beyond.any()
    assert (raised[5][1:-1, 1:-1][beyond] == 100.0).all()
    near = fine[0] < 1.4
    assert np.array_equal(raised[5][1:-1, 1:-1][near], (100.0 + reals[5][1:-1, 1:-1])[near])


def test_course_must_lead_to_a_neighbour():
    for step, right in ((1, True), (5, True), (7, True), (8, False), (12, False), (0, False)):
        packed = source((5, 6))
        packed[5][9] = 9 + step
        assert pack(packed)[0] is right


def test_course_with_an_open_end_falls():
    course = [10, 16, 22, 28]
    reals, integers, kinds = level((6, 6), courses=[course])[2:]
    nodes = [(at // 6 + 1) * 8 + at % 6 + 1 for at in course]
    assert np.array_equal(integers[0].ravel()[nodes[:-1]], nodes[1:])
    assert kinds[0].ravel()[nodes[-1]] == OPEN_END
    heights = reals[5].ravel()[nodes]
    assert (np.diff(heights) <= -1e-6 * 0.99).all()
    assert not kinds[1].any()


def flow_oracle(height, kind, rain):
    """Return receivers by a minimum spanning tree of basins (Kruskal), and areas, without courses."""
    width = height.shape[1]
    flat, kinds = height.ravel(), kind.ravel()
    to = np.full(flat.size, -1)
    around = [-1, 1, -width, width, -width - 1, 1 - width, width - 1, width + 1]
    nodes = np.flatnonzero(kinds)
    for at in np.flatnonzero(kinds == INNER):
        falls = [
            (flat[at] - flat[at + step]) * (1.0 if k < 4 else np.sqrt(0.5)) for k, step in enumerate(around)
        ]
        best = int(np.argmax(falls))
        to[at] = at + around[best] if falls[best] > 0.0 else -1

    def bottom(at):
        return at if to[at] < 0 else bottom(to[at])

    # All outlets are one basin, which everything drains to.
    basin = {at: -1 if kinds[bottom(at)] == OUTLET else bottom(at) for at in nodes}
    links = sorted(
        (max(flat[at], flat[at + step]), at, at + step)
        for at in nodes
        for step in (1, width - 1, width, width + 1)
        if kinds[at + step] and basin[at] != basin[at + step]
    )
    part, tree = {label: label for label in basin.values()}, {label: [] for label in basin.values()}
    for _, a, b in links:
        ends = part[basin[a]], part[basin[b]]
        if ends[0] != ends[1]:
            tree[basin[a]].append((b, a))
            tree[basin[b]].append((a, b))
            part = {label: ends[0] if each == ends[1] else each for label, each in part.items()}
    seen, queue = {-1}, [-1]
    for label in queue:
        for donor, beyond in tree[label]:
            if basin[donor] in seen:
                continue
            seen.add(basin[donor])
            queue.append(basin[donor])
            at, following = donor, beyond
            while at >= 0:
                after, to[at] = to[at], following
                at, following = after, at
    area = rain.ravel().copy()
    for at in nodes:
        down = to[at]
        while down >= 0:
            area[down] += rain.flat[at]
            down = to[down]
    return to.reshape(height.shape), area.reshape(height.shape)


@pytest.mark.parametrize("seed", range(6))
def test_water_leaves_hollows_through_the_minimum_spanning_tree_of_basins(seed):
    rasters = level((9, 12), seed)
    reals, integers, kinds = rasters[2:]
    kinds[0][reals[5] == np.inf] = 0
    assert np.isfinite(reals[5][kinds[0] > 0]).all()
    count = host_function("route_drainage")(rasters)
    to, area = flow_oracle(reals[5], kinds[0], reals[2])
    assert np.array_equal(integers[1], to)
    np.testing.assert_allclose(reals[6], area, rtol=1e-12)
    assert np.array_equal(reals[7], reals[5])
    order = integers[2].ravel()[:count]
    assert np.array_equal(np.sort(order), np.flatnonzero(kinds[0]))
    position = np.argsort(order)
    place = dict(zip(order[position], position, strict=True))
    assert all(place[at] < place[to.flat[at]] for at in order if to.flat[at] >= 0)
    before = reals[6].copy()
    assert host_function("accumulate_drainage")(rasters) == count
    np.testing.assert_allclose(reals[6], before, rtol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_level_without_outlets_keeps_one_pit(shape):
    packed = source(shape)
    packed[3][:] = np.nan
    rasters = pack(packed)[1]
    assert host_function("route_drainage")(rasters) == packed[3].size
    assert (rasters.integers[1][1:-1, 1:-1] < 0).sum() == 1
    host_function("run_drainage")(rasters, 2)
    assert np.isfinite(rasters.reals[5][1:-1, 1:-1]).all()


def test_course_into_a_pit_is_released_and_stays():
    """What drains to an open end leaves its basin, and crosses no course."""
    courses = [[57, 58, 59], [70, 83, 96]]
    for seed in range(5):
        rasters = level((9, 13), seed, courses=courses)
        host_function("run_drainage")(rasters, 3)
        to, kind = rasters.integers[1].ravel(), rasters.bytes[0].ravel()
        for course in courses:
            nodes = [(at // 13 + 1) * 15 + at % 13 + 1 for at in course]
            assert [int(to[at]) for at in nodes[:-1]] == nodes[1:]
            at = nodes[-1]
            for _ in range(to.size):
                at = to[at] if to[at] >= 0 else at
            assert kind[at] == OUTLET or not (rasters.bytes[0] == OUTLET)[1:-1, 1:-1].any()


def built(shape, seed=0, courses=()):
    rasters = level(shape, seed, courses=courses)
    rasters.reals[4] = np.where(
        rasters.bytes[0] > 0, np.random.default_rng(seed).random(rasters.reals[4].shape) - 0.5, 0.0
    )
    return host_function("route_drainage")(rasters), rasters


def test_heights_are_built_from_slopes_of_areas():
    count, rasters = built((9, 12), courses=[[29, 28, 27]])
    reals, integers, kinds = rasters[2:]
    reals[3][4, 4] = 500.0
    uplift, repose, rain, lowest, strata, height, area = (each.ravel() for each in reals[:7])
    s = uplift / np.maximum((area - 0.5 * rain) * PER_AREA, 1e-9) ** 0.375
    s, most = np.maximum(s, LEAST_SLOPE), np.maximum(repose, LEAST_SLOPE)
    slope = np.where(integers[0].ravel() < 0, (s**-4 + most**-4) ** -0.25, np.minimum(s, most))
    expected = height.copy()
    for at in integers[2].ravel()[:count][::-1]:
        to = integers[1].flat[at]
        if to < 0:
            continue
        up = SPACING * slope[at] * np.hypot(*np.subtract(np.divmod(at, 14), np.divmod(to, 14)))
        if strata[at] > 0.0:
            layer = (expected[to] + 0.5 * up) / SPACING / 5.0
            hard = np.clip(0.5 + 2.0 * (abs(2.0 * (layer % 1.0) - 1.0) - 0.5), 0.0, 1.0)
            up *= 1.0 + strata[at] * (0.7 * hard - 0.65 * (1.0 - hard))
        expected[at] = max(expected[to] + up, lowest[at])
    host_function("integrate_drainage")(rasters, count)
    np.testing.assert_allclose(reals[5].ravel(), expected, rtol=1e-9)
    assert kinds[0][4, 4] != INNER or reals[5][4, 4] >= 500.0


def test_slopes_are_limited_in_sweeps():
    count, rasters = built((9, 12), 3, courses=[[29, 28, 27]])
    reals, integers, kinds = rasters[2:]
    host_function("integrate_drainage")(rasters, count)
    reals[5][kinds[0] == INNER] *= 3.0
    height, to = reals[5].copy(), integers[1].copy()
    rise = SPACING * np.maximum(reals[1] * (1.0 + (1.7 - 1.0) * reals[4]), LEAST_SLOPE)
    for direction in (1, -1, 1, -1):
        for at in range(height.size)[::direction]:
            i, j = divmod(at, 14)
            if kinds[0][i, j] != INNER or integers[0][i, j] >= 0:
                continue
            for a, b in ((0, -1), (-1, 0), (-1, -1), (-1, 1)):
                p, q = i + direction * a, j + direction * b
                z = height[p, q] + (np.sqrt(2.0) if a and b else 1.0) * rise[i, j]
                if z < height[i, j]:
                    height[i, j], to[i, j] = z, p * 14 + q
    free = integers[0] < 0
    host_function("limit_slopes")(rasters)
    unmoved = free & (kinds[0] == INNER)
    np.testing.assert_array_equal(integers[1][unmoved], to[unmoved])
    np.testing.assert_allclose(reals[5][unmoved], height[unmoved], rtol=1e-12)


def test_courses_sink_to_the_lowest_ground_beside_them():
    course = [40, 39, 38, 37]
    rasters = level((7, 12), courses=[course])
    reals, integers, kinds = rasters[2:]
    before = reals[5].copy()
    host_function("sink_courses")(rasters)
    nodes = [(at // 12 + 1) * 14 + at % 12 + 1 for at in course]
    on_course = np.isin(np.arange(before.size), nodes).reshape(before.shape)
    assert np.array_equal(reals[5][~on_course], before[~on_course])
    assert (np.diff(reals[5].flat[nodes]) < 0.0).all()
    ground = np.where((kinds[0] == INNER) & (integers[0] < 0), before, np.inf)
    for at in nodes[:-1]:
        i, j = divmod(at, 14)
        assert reals[5].flat[at] <= ground[max(i - 2, 0) : i + 3, max(j - 2, 0) : j + 3].min()


def test_barriers_are_carved_down_to_a_floor():
    count, rasters = built((9, 12), 2)
    reals, integers, kinds = rasters[2:]
    floor = np.where(np.indices(reals[5].shape)[0] < 5, 2.0, -np.inf)
    expected = reals[5].ravel().copy()
    for at in integers[2].ravel()[:count]:
        to = integers[1].flat[at]
        if to >= 0 and kinds[0].flat[to] & 1:
            expected[to] = min(expected[to], max(expected[at] - LEAST_SLOPE * SPACING, floor.flat[to]))
    assert (expected < reals[5].ravel()).any()
    host_function("carve_barriers")(rasters, count, floor)
    assert np.array_equal(reals[5].ravel(), expected)


def test_relaxed_heights_lie_between():
    rasters = built((5, 6))[1]
    reals, _, kinds = rasters[2:]
    reals[5] += 3.0
    expected = np.where(kinds[0] & 1, reals[7] + 1.5, reals[5])
    host_function("relax_heights")(rasters)
    assert np.array_equal(reals[5], expected)


def test_shares_of_areas_add_up():
    count, rasters = built((9, 12), 1)
    kinds = rasters.bytes
    parts = np.random.default_rng(0).random((2, *kinds[0].shape)) * (kinds[0] > 0)
    parts[1] = (1.0 - parts[0]) * (kinds[0] > 0)
    for part in parts:
        host_function("drainage_shares")(rasters, count, part)
    np.testing.assert_allclose(parts.sum(0)[kinds[0] > 0], 1.0)
    assert (parts >= 0.0).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_ground_ramps_away_from_outlets(shape):
    """One outlet in a free raster: the steps of a king's way to it."""
    base, repose = np.full(shape, np.nan), np.full(shape, 2.0)
    base[-1, 0] = 50.0
    lowest = np.empty(shape)
    host_function("outlet_ramps")(base, repose, np.ones(shape, np.bool_), SPACING, lowest)
    away = np.abs(np.indices(shape) - np.array([shape[0] - 1, 0])[:, None, None])
    steps = away.max(0) + (np.sqrt(2.0) - 1.0) * away.min(0)
    np.testing.assert_allclose(lowest, 50.0 - 0.8 * 2.0 * SPACING * steps)


@pytest.mark.parametrize("first", [(0, 0), (1, 0), (1, 1)])
@pytest.mark.parametrize("shape", [(2, 2), (9, 12), (4, 3)])
def test_coarse_fields_are_means_of_the_domain(first, shape):
    uplift, repose, rain, base, domain, course = source(shape, 5)
    domain.flat[np.random.default_rng(5).random(domain.size) < 0.3] = False
    coarse = tuple((size - start + 1) // 2 for size, start in zip(shape, first, strict=True))
    fields, domains = np.empty((4, *coarse)), np.empty(coarse, np.bool_)
    courses, scratch = np.empty(coarse[0] * coarse[1], np.int32), np.empty((3, domain.size), np.int32)
    coarsen = host_function("coarsen_drainage")
    assert coarsen(uplift, repose, rain, base, domain, course, *first, fields, domains, courses, scratch)
    kept = tuple(slice(start, None, 2) for start in first)

    def around(values, fill=0.0):
        padded = np.pad(np.where(domain, values, fill), 1, constant_values=fill)
        return np.stack([padded[i : i + shape[0], j : j + shape[1]] for i in range(3) for j in range(3)])

    count = around(np.ones(shape)).sum(0)
    lowest = around(np.where(np.isnan(base), np.inf, base), np.inf).min(0)
    bases = np.where(np.isnan(base), np.where(np.isinf(lowest), np.nan, lowest), base)
    with np.errstate(invalid="ignore"):
        means = [
            around(values).sum(0) / count * scale for values, scale in ((uplift, 1), (repose, 1), (rain, 4))
        ]
    expected = np.stack(
        [np.where(domain, values, 0.0) for values in means] + [np.where(domain, bases, np.nan)]
    )
    assert np.array_equal(domains, domain[kept])
    np.testing.assert_allclose(fields, expected[(slice(None), *kept)])
    assert (courses == -1).all()


def coarsened_course(nodes, shape=(7, 8)):
    arguments = source(shape)
    for at, to in pairwise(nodes):
        arguments[5][at] = to
    courses, scratch = np.empty(16, np.int32), np.empty((3, shape[0] * shape[1]), np.int32)
    fields = np.empty((4, 4, 4)), np.empty((4, 4), np.bool_)
    right = host_function("coarsen_drainage")(*arguments, 0, 0, *fields, courses, scratch)
    return right, {int(at): int(courses[at]) for at in np.flatnonzero(courses >= 0)}


def test_coarse_courses_follow_fine_ones():
    """Each coarse node drains to what the last fine node in it leads to; halves are rounded up."""
    assert coarsened_course([1, 2, 3, 4, 5, 6]) == (True, {1: 2, 2: 3})
    assert coarsened_course([0, 9, 18, 27, 36]) == (True, {0: 5, 5: 10})
    assert coarsened_course([18, 26]) == (True, {5: 9})
    assert coarsened_course([9, 10]) == (True, {})
    assert coarsened_course([9, 10, 18, 17, 9])[0] is False
