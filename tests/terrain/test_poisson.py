"""Poisson-disk points with one distance: apart, dense, nested by levels, and a function of the world."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sketchterrain.errors import InputError
from sketchterrain.features.hashing import hashed
from sketchterrain.terrain.poisson import GREATEST_DENSITY, PoissonDisk, poisson_disk
from sketchterrain.terrain.poisson_cells import SIDE, schedule

if TYPE_CHECKING:
    from sketchterrain.compute import ComputeContext

RADIUS = 9000
FAR = 1 << 42  # lattice units: over 1,000 km in any preset
PLACES = (0, -RADIUS * 777 - 7, FAR, -FAR - 1)


def nearest(points: np.ndarray) -> float:
    """Return the smallest distance of two points, found in float64 about their corner."""
    apart, _ = cKDTree((points - points.min(axis=0)).astype(np.float64)).query(
        (points - points.min(axis=0)).astype(np.float64), k=2
    )
    return float(apart[:, 1].min())


def test_points_keep_their_distance(context: ComputeContext) -> None:
    side = 150 * RADIUS
    for origin in PLACES:
        points = poisson_disk(context, (origin, -origin, origin + side, side - origin), RADIUS, seed=1)
        assert nearest(points) >= RADIUS, origin
        assert len(points) / 150**2 > 0.9 * GREATEST_DENSITY, origin
    points = poisson_disk(context, (-200, -200, 200, 200), 2, seed=1)
    assert len(points) > 1000
    assert nearest(points) >= 2


@pytest.mark.slow
def test_ten_million_points_keep_their_distance(context: ComputeContext) -> None:
    """Piece by piece, with the borders between the pieces."""
    side = math.ceil(math.sqrt(1e7 / (0.92 * GREATEST_DENSITY))) * RADIUS
    west = FAR - 3 * RADIUS
    pieces = PoissonDisk(context, RADIUS, seed=5).pieces((west, 5, west + side, 5 + side))
    points = np.concatenate([piece.position for piece in pieces])
    assert len(points) >= 10_000_000
    assert nearest(points) >= RADIUS


@pytest.mark.parametrize(
    "cases",
    [
        [(-RADIUS * 777 - 7, 4), (FAR, 16)],
        pytest.param([(origin, cuts) for origin in PLACES for cuts in (1, 4, 16)], marks=pytest.mark.slow),
    ],
    ids=["two", "all"],
)
def test_points_are_a_function_of_the_world(context: ComputeContext, cases: list[tuple[int, int]]) -> None:
    """One rectangle, or 1, 16 and 256 tiles in shuffled order: the same points."""
    side = 96 * RADIUS + 13
    disk = PoissonDisk(context, RADIUS, seed=3, trials=16, levels=1)
    for origin, cuts in cases:
        whole = disk.within((origin, origin, origin + side, origin + side))
        edges = [origin + side * i // cuts for i in range(cuts + 1)]
        tiles = [(i, j) for i in range(cuts) for j in range(cuts)]
        np.random.default_rng(0).shuffle(tiles)
        parts = [disk.within((edges[i], edges[j], edges[i + 1], edges[j + 1])) for i, j in tiles]
        rows = [np.column_stack([each.position, each.level]) for each in (whole, *parts)]
        together = np.concatenate(rows[1:])
        np.testing.assert_array_equal(
            together[np.lexsort(together.T)], rows[0][np.lexsort(rows[0].T)], strict=True
        )


def test_windows_join_without_a_seam_and_in_order(
    context: ComputeContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    area = (-7, 5, 90 * RADIUS, 70 * RADIUS)
    disk = PoissonDisk(context, RADIUS, seed=1, levels=2)
    whole = disk.within(area)
    monkeypatch.setattr("sketchterrain.terrain.poisson.WINDOW", 37)
    for small in (disk.within(area), *[_together(disk, area)]):
        np.testing.assert_array_equal(small.position, whole.position)
        np.testing.assert_array_equal(small.level, whole.level)


def _together(disk: PoissonDisk, area: tuple[int, int, int, int]) -> object:
    pieces = list(disk.pieces(area))
    assert len(pieces) > 1
    return type(pieces[0])(*(np.concatenate(each) for each in zip(*pieces, strict=True)))


def test_coarser_levels_keep_their_own_distance(context: ComputeContext) -> None:
    side = 200 * RADIUS
    points = PoissonDisk(context, RADIUS, seed=2, levels=3).within((0, 0, side, side))
    for level in range(4):
        chosen = points.position[points.level >= level]
        assert nearest(chosen) >= RADIUS * 2**level
        fill = len(chosen) * 4**level / 200**2 / GREATEST_DENSITY
        assert fill > (0.9 if level < 3 else 0.85)  # few points at the coarsest, and a border


def test_more_darts_leave_less_room(context: ComputeContext) -> None:
    side = 200 * RADIUS
    many = [len(poisson_disk(context, (0, 0, side, side), RADIUS, seed=4, trials=k)) for k in (1, 4, 8, 16)]
    assert many == sorted(many)
    assert many[-1] / 200**2 > 0.88 * GREATEST_DENSITY


def test_every_dart_lands_where_its_hash_says(context: ComputeContext) -> None:
    """The first round against NumPy: a dart a cell, kept if it is the earliest of those it conflicts with."""
    side = math.ceil((RADIUS + math.sqrt(2)) / math.sqrt(2))
    count = 40
    points = poisson_disk(context, (0, 0, count * side, count * side), RADIUS, seed=9, trials=1)
    rim = 3
    index = np.arange(-rim, count + rim)
    column, row = np.meshgrid(index, index)
    salt = np.uint32(hashed(9, "poisson disk", 0) & np.uint64(0xFFFFFFFF))
    bits = _mixed(_cell_hash(column, row, salt))
    x, y, time = bits & (SIDE - 1), (bits >> 12) & (SIDE - 1), _mixed(bits) >> 8
    at = np.stack([column * SIDE + x, row * SIDE + y], axis=-1).reshape(-1, 2).astype(np.int64)
    when = time.ravel().astype(np.int64)
    r2 = math.ceil(((RADIUS + math.sqrt(2)) * SIDE / side) ** 2)
    pairs = cKDTree(at.astype(float)).query_pairs(math.sqrt(r2) + 1, output_type="ndarray")
    near = np.sum((at[pairs[:, 0]] - at[pairs[:, 1]]) ** 2, axis=1) < min(r2, 2 * SIDE**2)
    first, second = pairs[near].T
    beaten = np.zeros(len(at), bool)
    # Indices run in the order of cells, which decides between darts of one time.
    later = np.where(when[first] <= when[second], np.maximum(first, second), first)
    later = np.where(when[first] < when[second], second, later)
    later = np.where(when[first] == when[second], np.maximum(first, second), later)
    beaten[later] = True
    inner = (column.ravel() >= 0) & (column.ravel() < count) & (row.ravel() >= 0) & (row.ravel() < count)
    corner = np.stack([column, row], axis=-1).reshape(-1, 2) * side
    offset = (np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.int64) * side) >> 12
    np.testing.assert_array_equal(points, (corner + offset)[inner & ~beaten])


def _mixed(h: np.ndarray) -> np.ndarray:
    h = h.astype(np.uint32)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        h = (h ^ (h >> np.uint32(shift))) * np.uint32(factor)
    return h ^ (h >> np.uint32(16))


def _cell_hash(column: np.ndarray, row: np.ndarray, salt: np.uint32) -> np.ndarray:
    low, high = ((each.astype(np.int64) & 0xFFFFFFFF).astype(np.uint32) for each in (column, column >> 32))
    h = _mixed(low + salt)
    h = _mixed(h ^ (high + np.uint32(0x9E3779B9)))
    low, high = ((each.astype(np.int64) & 0xFFFFFFFF).astype(np.uint32) for each in (row, row >> 32))
    return _mixed(_mixed(h ^ low) ^ high)


def test_a_schedule_throws_all_its_darts_once() -> None:
    for trials in range(1, 80):
        rounds = schedule(trials)
        assert sum(tries for _, tries in rounds) == trials
        assert [start for start, _ in rounds] == [sum(t for _, t in rounds[:i]) for i in range(len(rounds))]
        assert all(tries in (1, 2) or tries % 4 == 0 for _, tries in rounds), trials


def test_degenerate_areas_and_refused_options(context: ComputeContext) -> None:
    for radius in (0, -5, 1, math.nan, math.inf):
        with pytest.raises(InputError, match=r"distance between points must be .* lattice units, not"):
            poisson_disk(context, (0, 0, 10, 10), radius, seed=1)  # type: ignore[arg-type]
    for option in ({"trials": 0}, {"trials": 256}, {"levels": -1}, {"levels": 13}):
        with pytest.raises(InputError, match="must be"):
            poisson_disk(context, (0, 0, 10, 10), 900, seed=1, **option)
    assert poisson_disk(context, (5, 5, 5, 9), 900, seed=1).shape == (0, 2)
    assert poisson_disk(context, (9, 9, 5, 5), 900, seed=1).shape == (0, 2)
    assert len(poisson_disk(context, (0, 0, 10, 10), 900, seed=1)) <= 1
    # A distance of more than the whole area.
    assert len(poisson_disk(context, (0, 0, 5000, 5000), 1 << 40, seed=1)) <= 1
    side = math.isqrt(round(1e8 / GREATEST_DENSITY)) * RADIUS
    with pytest.raises(InputError, match=r"about 1e\+08 points \(3\.\d GiB\); at most 40000000 fit"):
        poisson_disk(context, (0, 0, side, side), RADIUS, seed=1)


def test_two_runs_may_be_under_way_at_once(context: ComputeContext) -> None:
    disk = PoissonDisk(context, RADIUS, seed=6)
    areas = [(0, 0, 50 * RADIUS, 50 * RADIUS), (FAR, 0, FAR + 70 * RADIUS, 60 * RADIUS)]
    alone = [disk.within(area).position for area in areas]
    runs = [disk.steps(area) for area in areas]
    for run in runs:
        next(run)
    for run, expected in zip(runs, alone, strict=True):
        with pytest.raises(StopIteration) as end:
            next(run)
        np.testing.assert_array_equal(end.value.value.position, expected)
