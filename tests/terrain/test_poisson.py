"""Poisson-disk sets of constant and varying distance: separated, dense, nested, functions of the world."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sketchterrain.benchmarks.poisson_disk import PoissonDisk
from sketchterrain.errors import InputError
from sketchterrain.geometry.hashing import hash_keys
from sketchterrain.vegetation.graded_poisson import GradedPoisson, SpacingRaster
from sketchterrain.vegetation.poisson_grids import GREATEST_DENSITY, SIDE, schedule

from .conftest import tiers

RADIUS = 9000
FAR = 1 << 42  # lattice units: over 1,000 km in any preset
PLACES = (0, -RADIUS * 777 - 7, FAR, -FAR - 1)
Area = tuple[int, int, int, int]
Field = Callable[[np.ndarray, np.ndarray], np.ndarray]

METRE = 1000
STEP = 1 << 13
LEAST, MOST = 4 * METRE, 60 * METRE
FAR_OFF = 1 << 41
CORNERS = (0, -77 * METRE - 7, FAR_OFF, -FAR_OFF - 1)


def poisson_disk(context, area, radius, **options):
    return PoissonDisk(context, radius, **options).within(area).position


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return smooth distances from 4 to 68 m; above 60 m there are no points."""
    return 4.0 * 17.0 ** (0.5 + 0.5 * np.sin(x / 61.0) * np.cos(y / 47.0))


def patches(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return piecewise constant distances over the whole range."""
    draw = np.sin(np.floor(x / 37.0) * 12.9898 + np.floor(y / 53.0) * 78.233) * 43758.5453
    return 4.0 * 15.0 ** (draw - np.floor(draw))


def raster_of(field: Field) -> Callable[[int, int, int, int], SpacingRaster]:
    def raster(west: int, south: int, east: int, north: int) -> SpacingRaster:
        first, last = (west // STEP, south // STEP), (-(-east // STEP) + 1, -(-north // STEP) + 1)
        x, y = (STEP / METRE * np.arange(first[k], last[k]) for k in range(2))
        spacing = METRE * field(x[None, :] % 4e5, y[:, None] % 4e5) + np.zeros((len(y), len(x)))
        return SpacingRaster(first[0] * STEP, first[1] * STEP, STEP, spacing.astype(np.float32))

    return raster


def sampler(context, field, *, levels=3, seed=1, least=LEAST) -> GradedPoisson:
    return GradedPoisson(context, raster_of(field), least=least, most=MOST, levels=levels, seed=seed)


def square(origin: int, metres: int) -> Area:
    return (origin, -origin, origin + metres * METRE, metres * METRE - origin)


def least_ratio(points: np.ndarray, level: int) -> float:
    """Return the least distance of two points of a level and above over the required one."""
    selected = points[points["level"] >= level]
    place = np.stack([selected["x"] - points["x"].min(), selected["y"] - points["y"].min()], axis=1).astype(
        float
    )
    spacing = selected["spacing"].astype(np.float64)
    pairs = cKDTree(place).query_pairs(spacing.max() * 2.0**level, output_type="ndarray")
    if not len(pairs):
        return math.inf
    first, second = pairs.T
    apart = np.hypot(*(place[first] - place[second]).T)
    return float((apart / (2.0**level * (spacing[first] + spacing[second]) / 2)).min())


def nearest(points: np.ndarray) -> float:
    """Return the least distance of two points, in float64 relative to their corner."""
    at = (points - points.min(axis=0)).astype(np.float64)
    return float(cKDTree(at).query(at, k=2)[0][:, 1].min())


def test_points_keep_their_distance_and_fill_the_area(context) -> None:
    side = 100 * RADIUS
    for origin in PLACES:
        points = poisson_disk(context, (origin, -origin, origin + side, side - origin), RADIUS, seed=1)
        assert nearest(points) >= RADIUS, origin
        assert len(points) / 100**2 > 0.9 * GREATEST_DENSITY, origin
    points = poisson_disk(context, (-200, -200, 200, 200), 2, seed=1)
    assert len(points) > 1000
    assert nearest(points) >= 2
    side = 200 * RADIUS
    points = PoissonDisk(context, RADIUS, seed=2, levels=3).within((0, 0, side, side))
    for level in range(4):
        selected = points.position[points.level >= level]
        assert nearest(selected) >= RADIUS * 2**level
        fill = len(selected) * 4**level / 200**2 / GREATEST_DENSITY
        assert fill > (0.9 if level < 3 else 0.85)  # few points at the coarsest, and a border
    side = 100 * RADIUS
    many = [len(poisson_disk(context, (0, 0, side, side), RADIUS, seed=4, trials=k)) for k in (1, 4, 8, 16)]
    assert many == sorted(many)
    assert many[-1] / 100**2 > 0.88 * GREATEST_DENSITY


@pytest.mark.soak
def test_ten_million_points_keep_their_distance(context) -> None:
    """Piece by piece, with the borders between the pieces."""
    side = math.ceil(math.sqrt(1e7 / (0.92 * GREATEST_DENSITY))) * RADIUS
    west = FAR - 3 * RADIUS
    pieces = PoissonDisk(context, RADIUS, seed=5).pieces((west, 5, west + side, 5 + side))
    points = np.concatenate([piece.position for piece in pieces])
    assert len(points) >= 10_000_000
    assert nearest(points) >= RADIUS


def shuffled_tiles(origin: int, side: int, cuts: int) -> list[Area]:
    """Return a square's tiles, in shuffled order."""
    edges = [origin + side * i // cuts for i in range(cuts + 1)]
    tiles = [(edges[i], edges[j], edges[i + 1], edges[j + 1]) for i in range(cuts) for j in range(cuts)]
    np.random.default_rng(0).shuffle(tiles)
    return tiles


def test_windows_join_without_a_seam_and_in_order(context, monkeypatch) -> None:
    graded, area = sampler(context, waves), square(5, 300)
    disk, wide = PoissonDisk(context, RADIUS, seed=1, levels=2), (-7, 5, 90 * RADIUS, 70 * RADIUS)
    whole, disks = graded.within(area), disk.within(wide)
    monkeypatch.setattr("sketchterrain.vegetation.graded_poisson._WINDOW", 61)
    monkeypatch.setattr("sketchterrain.benchmarks.poisson_disk.WINDOW", 53)
    np.testing.assert_array_equal(graded.within(area), whole)
    pieces = list(disk.pieces(wide))
    assert len(pieces) > 1
    for found in (disk.within(wide), *[type(disks)(*map(np.concatenate, zip(*pieces, strict=True)))]):
        np.testing.assert_array_equal(found.position, disks.position)
        np.testing.assert_array_equal(found.level, disks.level)


def test_darts_follow_their_hash(context) -> None:
    """The first round against NumPy: a dart a cell, accepted if the earliest of its conflicts."""
    side = math.ceil((RADIUS + math.sqrt(2)) / math.sqrt(2))
    count = 40
    points = poisson_disk(context, (0, 0, count * side, count * side), RADIUS, seed=9, trials=1)
    rim = 3
    index = np.arange(-rim, count + rim)
    column, row = np.meshgrid(index, index)
    salt = np.uint32(hash_keys(9, "poisson disk", 0) & np.uint64(0xFFFFFFFF))
    bits = _mixed(_cell_hash(column, row, salt))
    x, y, time = bits & (SIDE - 1), (bits >> 12) & (SIDE - 1), _mixed(bits) >> 8
    at = np.stack([column * SIDE + x, row * SIDE + y], axis=-1).reshape(-1, 2).astype(np.int64)
    when = time.ravel().astype(np.int64)
    r2 = math.ceil(((RADIUS + math.sqrt(2)) * SIDE / side) ** 2)
    pairs = cKDTree(at.astype(float)).query_pairs(math.sqrt(r2) + 1, output_type="ndarray")
    near = np.sum((at[pairs[:, 0]] - at[pairs[:, 1]]) ** 2, axis=1) < min(r2, 2 * SIDE**2)
    first, second = pairs[near].T
    rejected = np.zeros(len(at), bool)
    # Indices run in the order of cells, which decides between darts of one time.
    later = np.where(when[first] < when[second], second, first)
    rejected[np.where(when[first] == when[second], np.maximum(first, second), later)] = True
    inner = (column.ravel() >= 0) & (column.ravel() < count) & (row.ravel() >= 0) & (row.ravel() < count)
    corner = np.stack([column, row], axis=-1).reshape(-1, 2) * side
    offset = (np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.int64) * side) >> 12
    np.testing.assert_array_equal(points, (corner + offset)[inner & ~rejected])


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


def test_degenerate_areas_and_invalid_options(context) -> None:
    for radius in (0, -5, 1, math.nan, math.inf):
        with pytest.raises(InputError, match=r"expected a distance of .* lattice units, got"):
            poisson_disk(context, (0, 0, 10, 10), radius, seed=1)  # type: ignore[arg-type]
    for option in ({"trials": 0}, {"trials": 256}, {"levels": -1}, {"levels": 13}):
        with pytest.raises(InputError, match="expected"):
            poisson_disk(context, (0, 0, 10, 10), 900, seed=1, **option)
    assert poisson_disk(context, (5, 5, 5, 9), 900, seed=1).shape == (0, 2)
    assert poisson_disk(context, (9, 9, 5, 5), 900, seed=1).shape == (0, 2)
    assert len(poisson_disk(context, (0, 0, 10, 10), 900, seed=1)) <= 1
    # A distance of more than the whole area.
    assert len(poisson_disk(context, (0, 0, 5000, 5000), 1 << 40, seed=1)) <= 1
    side = math.isqrt(round(1e8 / GREATEST_DENSITY)) * RADIUS
    with pytest.raises(InputError, match=r"about 1e\+08 points \(3\.\d GiB\); at most 40000000 fit"):
        poisson_disk(context, (0, 0, side, side), RADIUS, seed=1)

    own = sampler(context, waves)
    assert len(own.within((5, 5, 5, 9))) == 0
    assert len(own.within((9, 9, 5, 5))) == 0
    assert len(own.within((0, 0, 10, 10))) <= 1
    for least, most, levels in (
        *((0, 10, 1), (-5, 10, 1), (20, 10, 1), (4, 4 << 20, 1), (4, 8, 40), (4, 8, -1)),
        *((math.nan, MOST, 1), (math.inf, MOST, 1)),
    ):
        with pytest.raises(InputError, match="expected"):
            GradedPoisson(context, raster_of(waves), least=least, most=most, levels=levels, seed=1)  # type: ignore[arg-type]


@tiers(
    ("field", "origin", "levels"),
    [(waves, FAR_OFF, 3), (patches, CORNERS[1], 1)],
    itertools.product((waves, patches), CORNERS, (0, 1, 3)),
)
def test_graded_points_keep_the_mean_of_their_distances(field, origin, levels, context) -> None:
    points = sampler(context, field, levels=levels).within(square(origin, 700))
    assert len(points) > 2000
    for level in range(levels + 1):
        assert (points["level"] >= level).sum() > 10
        assert least_ratio(points, level) >= 1.0, level


@tiers(
    ("origin", "cuts", "levels"),
    [(FAR_OFF, 4, 2)],
    [(CORNERS[1], 4, 0), (CORNERS[3], 16, 2)],
)
def test_graded_points_are_a_function_of_the_world(origin, cuts, levels, context) -> None:
    """One rectangle, or 16 and 256 tiles in shuffled order: the same points, to the bit."""
    own, side = sampler(context, waves, levels=levels), 320 * METRE + 13
    whole, *parts = (
        own.within(area) for area in shuffled_tiles(origin, side, 1) + shuffled_tiles(origin, side, cuts)
    )
    together = np.concatenate(parts)
    np.testing.assert_array_equal(together[np.lexsort((together["x"], together["y"]))], whole)


def test_a_points_distance_is_that_of_the_raster(context) -> None:
    """Bilinear between vertices, in float64; float32 rounds each of four steps."""
    points = sampler(context, waves).within(square(0, 500))
    raster = raster_of(waves)(0, 0, 500 * METRE, 500 * METRE)
    u, v = points["x"] / STEP, points["y"] / STEP
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    u, v = u - i, v - j
    corner = [raster.spacing[j + up, i + right].astype(float) for up in (0, 1) for right in (0, 1)]
    expected = (1 - v) * ((1 - u) * corner[0] + u * corner[1]) + v * ((1 - u) * corner[2] + u * corner[3])
    np.testing.assert_allclose(points["spacing"], expected, rtol=6 * 2.0**-24)
    assert points["spacing"].max() <= MOST


def test_graded_sets_are_nearly_maximal(context) -> None:
    """Share of the area where another point of the finest level would fit."""
    points = sampler(context, waves).within(square(0, 900))
    place = np.stack([points["x"], points["y"]], axis=1) / METRE
    rng = np.random.default_rng(3)
    at = rng.uniform(100, 800, (10_000, 2))
    spacing = waves(at[:, 0], at[:, 1])
    at, spacing = at[spacing < 58], spacing[spacing < 58]
    tree, free = cKDTree(place), np.ones(len(at), bool)
    for i, near in enumerate(tree.query_ball_point(at, 62.0)):
        apart = np.hypot(*(place[near] - at[i]).T)
        free[i] = np.all(apart >= (points["spacing"][near] / METRE + spacing[i]) / 2)
    assert free.mean() < 0.01


def test_the_greatest_distance_has_its_grid(context) -> None:
    for least, most in ((2, 5), (3500, 7001), (4000, 32_003), (4000, 60_000)):
        even = raster_of(lambda x, y, most=most: most / METRE + 0 * x * y)
        own = GradedPoisson(context, even, least=least, most=most, levels=0, seed=1)
        found = own.within((0, 0, 60 * most, 60 * most))
        # Rounding to lattice units takes its share of distances of a few of them.
        assert len(found) > (0.85 if least > 100 else 0.4) * GREATEST_DENSITY * 60**2, (least, most)


def test_the_content_of_new_buffers_changes_nothing(context, monkeypatch) -> None:
    area = square(0, 300)
    expected = sampler(context, waves).within(area)
    for byte in (0x00, 0x60, 0x7E, 0xFF):

        def dirty(shape: tuple[int, ...] | int, dtype: object, byte: int = byte) -> object:
            size = int(np.prod(shape)) * np.dtype(dtype).itemsize
            return context.upload(np.full(size, byte, np.uint8), writable=True)

        with monkeypatch.context() as patch:
            patch.setattr(context, "empty", dirty)
            found = sampler(context, waves).within(area)
        np.testing.assert_array_equal(found, expected, err_msg=hex(byte))


def test_sparse_areas_have_fewer_levels_and_beyond_the_range_no_points(context) -> None:
    def shore(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.where(x < 200.0, 5.0, 61.0) + 0 * y

    points = sampler(context, shore).within(square(0, 400))
    assert 0 < points["x"].max() < (200 + STEP / METRE) * METRE
    assert len(sampler(context, lambda x, y: 1e6 + x * y).within(square(0, 400))) == 0
    # The coarsest of four grids has distances of 32 to 64 m: 2^3 times 4 to 8 m, 2^0 times more than 32 m.
    points = sampler(context, waves).within(square(0, 1500))
    assert points["level"][points["spacing"] < 7.9 * METRE].max() == 3
    assert points["level"][points["spacing"] > 32.1 * METRE].max() == 0


def test_the_raster_is_read_no_farther_than_the_halo(context) -> None:
    for metres, levels in ((0, 0), (1, 3), (90, 1), (900, 3)):
        queried = []

        def recorded(west, south, east, north, queried=queried) -> SpacingRaster:
            queried.append((west, south, east, north))
            return raster_of(waves)(west, south, east, north)

        own = GradedPoisson(context, recorded, least=LEAST, most=MOST, levels=levels, seed=1)
        area = (-7, 11, metres * METRE + 1, metres * METRE + 12)
        own.within(area)
        low, high = np.min(queried, axis=0)[:2], np.max(queried, axis=0)[2:]
        far = max(*(np.array(area[:2]) - low), *(high - np.array(area[2:])))
        assert 0.9 * own.halo < far <= own.halo, (metres, levels)


def test_two_runs_may_be_interleaved(context) -> None:
    graded, areas, found = sampler(context, waves), [square(0, 200), square(FAR_OFF, 300)], {}
    runs = dict(enumerate(map(graded.steps, areas)))
    while len(found) < len(runs):
        for number in runs.keys() - found.keys():
            try:
                next(runs[number])
            except StopIteration as end:
                found[number] = end.value
    for number, area in enumerate(areas):
        np.testing.assert_array_equal(found[number], graded.within(area))
