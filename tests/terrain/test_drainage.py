"""Drained relief: analytic profiles, invariants of routing, and bits that depend on the domain alone."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sketchterrain.landforms.drainage import (
    LEAST_SLOPE,
    ROUNDS,
    DrainageInput,
    Drained,
    coarsened,
    drain,
)

CELL = 30.0


def source_of(shape, *, seed=0, **changes):
    """A raster of uneven uplift whose border is an outlet at sea level."""
    random = np.random.default_rng(seed)
    coarse = random.random((shape[0] // 8 + 2, shape[1] // 8 + 2)) < 0.4
    uplift = np.where(np.kron(coarse, np.ones((8, 8)))[: shape[0], : shape[1]], 1.2, 0.1)
    base = np.full(shape, np.nan)
    base[[0, -1]] = base[:, [0, -1]] = 0.0
    source = DrainageInput(
        uplift=uplift,
        repose=np.full(shape, 0.8),
        rain=np.full(shape, CELL**2),
        base=base,
        domain=np.ones(shape, bool),
        course=np.full(shape, -1, np.int32),
    )
    return replace(source, **changes)


def levels_of(source, count=4):
    levels = [source]
    while len(levels) < count:
        levels.append(coarsened(levels[-1]))
    return levels[::-1]


def drained(source):
    return drain(levels_of(source), CELL, ROUNDS)[-1]


def check_routing(result: Drained, source: DrainageInput):
    """Water runs downhill to outlets, drainage areas add up, and no slope exceeds repose."""
    shape = source.base.shape
    inner = source.domain & np.isnan(source.base)
    to = result.receiver[inner]
    assert np.isfinite(result.height[source.domain]).all()
    assert np.isnan(result.height[~source.domain]).all()
    assert (result.receiver[~inner] == -1).all()
    assert (to >= 0).all(), "a pit"
    assert source.domain.flat[to].all()
    row, column = np.nonzero(inner)
    run = np.hypot(row - to // shape[1], column - to % shape[1])
    assert run.max() < 1.5
    slope = (result.height[inner] - result.height.flat[to]) / (run * CELL)
    assert slope.min() > 0.99 * LEAST_SLOPE
    assert (slope <= source.repose[inner] * (1 + 1e-9)).all()
    assert result.area[~inner & source.domain].sum() == pytest.approx(source.rain[source.domain].sum())
    outlets = source.domain & ~inner
    assert np.array_equal(result.height[outlets], source.base[outlets])


def test_river_has_the_analytic_profile():
    count = 60
    base = np.full((1, count), np.nan)
    base[0, 0] = 7.0
    source = source_of(
        (1, count), base=base, uplift=np.full((1, count), 0.9), repose=np.full((1, count), 0.5)
    )
    height = drained(source).height[0]
    area = np.arange(count - 1, 0, -1.0) - 0.5  # in the middle of nodes 1, 2, …
    steps = ((0.9 * area**-0.375) ** -4 + 0.5**-4) ** -0.25 * CELL
    assert np.allclose(height, 7.0 + np.concatenate([[0.0], np.cumsum(steps)]), rtol=1e-12)


def test_plane_at_repose_is_a_roof():
    source = source_of((33, 65), uplift=np.full((33, 65), 1e6))
    row, column = np.mgrid[:33, :65]
    distance = np.minimum(np.minimum(row, 32 - row), np.minimum(column, 64 - column))
    height = drained(source).height
    assert (height >= 0.8 * CELL * distance - 1e-9).all()
    assert (height <= 0.8 * CELL * distance * 1.42 + 1e-9).all()


@pytest.mark.parametrize("seed", range(4))
def test_water_runs_downhill_to_outlets(seed):
    """Also through one alone."""
    random = np.random.default_rng(seed)
    source = source_of((70, 83), seed=seed)
    row, column = np.mgrid[:70, :83]
    source.domain[np.hypot(row - 35, column - 40) > 36] = False
    source.base[random.random(source.base.shape) < 0.01] = 90.0
    check_routing(drained(source), source)
    base = np.full((41, 41), np.nan)
    base[20, 20] = -5.0
    source = source_of((41, 41), base=base, seed=seed)
    check_routing(result := drained(source), source)
    assert np.nanargmin(result.height) == 20 * 41 + 20


def course_through(shape, nodes):
    course = np.full(shape, -1, np.int32)
    for node, following in pairwise(nodes):
        course[node] = following[0] * shape[1] + following[1]
    return course


@pytest.mark.parametrize("seed", range(6))
def test_courses_with_open_ends_lead_on_to_outlets(seed):
    random = np.random.default_rng(seed)
    shape, taken, course = (40, 44), set(), np.full((40, 44), -1, np.int32)
    for _ in range(4):
        node, direction = tuple(random.integers(5, 35, 2).tolist()), random.uniform(0, 6.28)
        for _ in range(60):
            direction += random.normal(0, 0.5)
            following = (node[0] + round(np.sin(direction)), node[1] + round(np.cos(direction)))
            if following in taken or node in taken or not (min(following) > 0 and max(following) < 39):
                break
            taken.add(node)
            course[node] = following[0] * shape[1] + following[1]
            node = following
        taken.add(node)
    source = source_of(shape, seed=seed, course=course, origin=(1, 0))
    result = drained(source)
    check_routing(result, source)
    assert np.array_equal(result.receiver[course >= 0], course[course >= 0])


def test_courses_in_circles_or_of_long_steps_are_refused():
    nodes = [(10, 10), (10, 11), (11, 11), (11, 10), (10, 10)]
    with pytest.raises(ValueError, match="circle"):
        coarsened(source_of((20, 20), course=course_through((20, 20), nodes)))
    course = course_through((20, 20), [(10, 10), (10, 12)])
    with pytest.raises(ValueError, match="neighbours"):
        drain([source_of((20, 20), course=course)], CELL, ROUNDS[:1])


def test_domain_has_the_same_bits_in_any_rectangle():
    row, column = np.mgrid[:64, :64]
    source = source_of((64, 64), domain=np.hypot(row - 30, column - 33) < 22, origin=(-7, 1_000_003))
    source.base[:] = np.where(np.hypot(row - 30, column - 33) > 20, 0.01 * column, np.nan)
    whole = drained(source)
    for low, high in (((7, 10), (55, 58)), ((2, 9), (64, 61))):
        window = tuple(slice(*each) for each in zip(low, high, strict=True))
        fields = {
            name: getattr(source, name)[window] for name in ("uplift", "repose", "rain", "base", "domain")
        }
        cut = replace(
            source,
            **fields,
            course=np.full(fields["base"].shape, -1, np.int32),
            origin=(source.origin[0] + low[0], source.origin[1] + low[1]),
        )
        result = drained(cut)
        assert np.array_equal(result.height, whole.height[window], equal_nan=True)
        assert np.array_equal(result.area, whole.area[window])


def test_threads_and_runs_give_the_same_bits():
    rasters = [levels_of(source_of((48, 51), seed=seed, origin=(seed * 48, -9))) for seed in range(6)]
    alone = [drain(levels, CELL, ROUNDS) for levels in rasters]
    with ThreadPoolExecutor(3) as executor:
        together = list(executor.map(lambda levels: drain(levels, CELL, ROUNDS), rasters))
    for a, b in zip(alone, together, strict=True):
        for coarse, other in zip(a, b, strict=True):
            assert np.array_equal(coarse.height, other.height)
            assert np.array_equal(coarse.receiver, other.receiver)


def test_no_walls_stand_at_divides():
    base = np.full((65, 65), np.nan)
    base[0], base[-1] = 0.0, 2000.0
    height = drain(levels_of(source_of((65, 65), base=base)), CELL, ROUNDS)[-1].height
    inner = height[1:-1]
    steepest = 2.0 * 0.8 * CELL
    assert np.abs(np.diff(inner[:-1], axis=0)).max() <= steepest
    assert np.abs(np.diff(inner, axis=1)).max() <= steepest


def test_coarse_nodes_stand_at_even_global_indices():
    for origin, start in (((0, 0), (0, 0)), ((-3, 5), (1, 1)), ((4, -7), (0, 1))):
        base = np.arange(20.0 * 23).reshape(20, 23)
        coarse = coarsened(source_of((20, 23), base=base, origin=origin))
        assert coarse.origin == ((origin[0] + start[0]) // 2, (origin[1] + start[1]) // 2)
        assert np.array_equal(coarse.base, base[start[0] :: 2, start[1] :: 2])
        assert coarse.level == 1
