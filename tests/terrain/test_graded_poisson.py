"""Poisson-disk points whose distance varies: apart, nested, dense, and a function of the world."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sketchterrain.errors import InputError
from sketchterrain.terrain.graded_poisson import GradedPoisson
from sketchterrain.terrain.poisson import GREATEST_DENSITY
from sketchterrain.terrain.spacing_raster import SpacingRaster

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.compute import ComputeContext

    Area = tuple[int, int, int, int]
    Field = Callable[[np.ndarray, np.ndarray], np.ndarray]

METRE = 1000
STEP = 1 << 13
LEAST, MOST = 4 * METRE, 60 * METRE
FAR = 1 << 41
PLACES = (0, -77 * METRE - 7, FAR, -FAR - 1)


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return distances from 4 to 68 m, smooth: where it is over 60 m nothing stands."""
    return 4.0 * 17.0 ** (0.5 + 0.5 * np.sin(x / 61.0) * np.cos(y / 47.0))


def patches(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return distances that leap from place to place, over the whole range."""
    draw = np.sin(np.floor(x / 37.0) * 12.9898 + np.floor(y / 53.0) * 78.233) * 43758.5453
    return 4.0 * 15.0 ** (draw - np.floor(draw))


def raster_of(field: Field) -> Callable[[int, int, int, int], SpacingRaster]:
    def asked(west: int, south: int, east: int, north: int) -> SpacingRaster:
        first, last = (west // STEP, south // STEP), (-(-east // STEP) + 1, -(-north // STEP) + 1)
        x, y = (STEP / METRE * np.arange(first[k], last[k]) for k in range(2))
        spacing = METRE * field(x[None, :] % 4e5, y[:, None] % 4e5) + np.zeros((len(y), len(x)))
        return SpacingRaster(first[0] * STEP, first[1] * STEP, STEP, spacing.astype(np.float32))

    return asked


def sampler(
    context: ComputeContext, field: Field, *, levels: int = 3, seed: int = 1, least: int = LEAST
) -> GradedPoisson:
    return GradedPoisson(context, raster_of(field), least=least, most=MOST, levels=levels, seed=seed)


def square(origin: int, metres: int) -> Area:
    return (origin, -origin, origin + metres * METRE, metres * METRE - origin)


def slack(points: np.ndarray, level: int) -> float:
    """Return the smallest distance of two points over what they have to keep, for those from a level on."""
    chosen = points[points["level"] >= level]
    place = np.stack([chosen["x"] - points["x"].min(), chosen["y"] - points["y"].min()], axis=1).astype(float)
    spacing = chosen["spacing"].astype(np.float64)
    pairs = cKDTree(place).query_pairs(spacing.max() * 2.0**level, output_type="ndarray")
    if not len(pairs):
        return math.inf
    first, second = pairs.T
    apart = np.hypot(*(place[first] - place[second]).T)
    return float((apart / (2.0**level * (spacing[first] + spacing[second]) / 2)).min())


@pytest.mark.parametrize(
    "cases",
    [
        [(waves, FAR, 3), (patches, -77 * METRE - 7, 1)],
        pytest.param(
            [
                (field, origin, levels)
                for field in (waves, patches)
                for origin in PLACES
                for levels in (0, 1, 3)
            ],
            marks=pytest.mark.slow,
        ),
    ],
    ids=["two", "all"],
)
def test_points_keep_the_mean_of_their_distances(
    context: ComputeContext, cases: list[tuple[Field, int, int]]
) -> None:
    for field, origin, levels in cases:
        points = sampler(context, field, levels=levels).within(square(origin, 700))
        assert len(points) > 2000
        for level in range(levels + 1):
            assert (points["level"] >= level).sum() > 10
            assert slack(points, level) >= 1.0, (field.__name__, origin, level)


@pytest.mark.parametrize(
    "cases",
    [
        [(FAR, 4, 1), (-77 * METRE - 7, 4, 2)],
        pytest.param(
            [(origin, *case) for origin in PLACES for case in ((4, 0), (4, 1), (16, 2))],
            marks=pytest.mark.slow,
        ),
    ],
    ids=["two", "all"],
)
def test_points_are_a_function_of_the_world(
    context: ComputeContext, cases: list[tuple[int, int, int]]
) -> None:
    """One rectangle, or 16 and 256 tiles in shuffled order: the same points, to the bit."""
    for origin, cuts, levels in cases:
        own = sampler(context, waves, levels=levels)
        side = 320 * METRE + 13
        whole = own.within((origin, origin, origin + side, origin + side))
        edges = [origin + side * i // cuts for i in range(cuts + 1)]
        tiles = [(i, j) for i in range(cuts) for j in range(cuts)]
        np.random.default_rng(0).shuffle(tiles)
        parts = [own.within((edges[i], edges[j], edges[i + 1], edges[j + 1])) for i, j in tiles]
        together = np.concatenate(parts)
        np.testing.assert_array_equal(together[np.lexsort((together["x"], together["y"]))], whole)


def test_windows_join_without_a_seam(context: ComputeContext, monkeypatch: pytest.MonkeyPatch) -> None:
    own, area = sampler(context, waves), square(5, 300)
    whole = own.within(area)
    monkeypatch.setattr("sketchterrain.terrain.graded_poisson._WINDOW", 29)
    np.testing.assert_array_equal(own.within(area), whole)


def test_a_points_distance_is_that_of_its_place(context: ComputeContext) -> None:
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


def test_even_ground_is_as_full_as_with_one_distance(context: ComputeContext) -> None:
    for metres in (4.0, 7.9, 8.1, 20.0):
        side = 90 * round(metres)
        even = sampler(context, lambda x, y, metres=metres: metres + 0 * x * y, levels=2).within(
            square(0, side)
        )
        fill = len(even) * metres**2 / side**2 / GREATEST_DENSITY
        assert 0.88 < fill < 1.0, metres


def test_a_place_with_room_is_taken(context: ComputeContext) -> None:
    """Share of the ground where another point of the finest level would still fit."""
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


def test_the_greatest_distance_has_its_grid(context: ComputeContext) -> None:
    for least, most in ((2, 5), (3500, 7001), (4000, 32_003), (4000, 60_000)):

        def far(west: int, south: int, east: int, north: int, most: int = most) -> SpacingRaster:
            first, last = (west // STEP, south // STEP), (-(-east // STEP) + 1, -(-north // STEP) + 1)
            shape = (last[1] - first[1], last[0] - first[0])
            return SpacingRaster(first[0] * STEP, first[1] * STEP, STEP, np.full(shape, most, np.float32))

        own = GradedPoisson(context, far, least=least, most=most, levels=0, seed=1)
        found = own.within((0, 0, 60 * most, 60 * most))
        # Rounding to lattice units takes its share of distances of a few of them.
        assert len(found) > (0.85 if least > 100 else 0.4) * GREATEST_DENSITY * 60**2, (least, most)


def test_the_content_of_new_buffers_changes_nothing(
    context: ComputeContext, monkeypatch: pytest.MonkeyPatch
) -> None:
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


def test_thin_places_have_fewer_levels_and_beyond_the_greatest_distance_none(context: ComputeContext) -> None:
    def shore(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.where(x < 200.0, 5.0, 61.0) + 0 * y

    points = sampler(context, shore).within(square(0, 400))
    assert 0 < points["x"].max() < (200 + STEP / METRE) * METRE
    assert len(sampler(context, lambda x, y: 1e6 + x * y).within(square(0, 400))) == 0
    # The coarsest of four grids has distances of 32 to 64 m: 2^3 times 4 to 8 m, 2^0 times more than 32 m.
    points = sampler(context, waves).within(square(0, 1500))
    assert points["level"][points["spacing"] < 7.9 * METRE].max() == 3
    assert points["level"][points["spacing"] > 32.1 * METRE].max() == 0


def test_degenerate_areas_and_refused_ranges(context: ComputeContext) -> None:
    own = sampler(context, waves)
    assert len(own.within((5, 5, 5, 9))) == 0
    assert len(own.within((9, 9, 5, 5))) == 0
    assert len(own.within((0, 0, 10, 10))) <= 1
    for least, most, levels in (
        (0, 10, 1),
        (-5, 10, 1),
        (20, 10, 1),
        (4, 4 << 20, 1),
        (4, 8, 40),
        (4, 8, -1),
        (math.nan, MOST, 1),
        (math.inf, MOST, 1),
    ):
        with pytest.raises(InputError, match="distances"):
            GradedPoisson(context, raster_of(waves), least=least, most=most, levels=levels, seed=1)  # type: ignore[arg-type]


def test_the_raster_is_queried_no_farther_than_the_reach(context: ComputeContext) -> None:
    for metres, levels in ((0, 0), (1, 3), (90, 1), (3000, 3)):
        asked = []

        def recorded(
            west: int, south: int, east: int, north: int, asked: list[tuple[int, ...]] = asked
        ) -> SpacingRaster:
            asked.append((west, south, east, north))
            return raster_of(waves)(west, south, east, north)

        own = GradedPoisson(context, recorded, least=LEAST, most=MOST, levels=levels, seed=1)
        area = (-7, 11, metres * METRE + 1, metres * METRE + 12)
        own.within(area)
        low, high = np.min(asked, axis=0)[:2], np.max(asked, axis=0)[2:]
        far = max(*(np.array(area[:2]) - low), *(high - np.array(area[2:])))
        assert 0.9 * own.reach < far <= own.reach, (metres, levels)


def test_two_runs_may_be_under_way_at_once(context: ComputeContext) -> None:
    own = sampler(context, waves)
    areas = [square(0, 200), square(FAR, 300)]
    alone = [own.within(area) for area in areas]
    runs = [own.steps(area) for area in areas]
    found: dict[int, np.ndarray] = {}
    while len(found) < 2:
        for number, run in enumerate(runs):
            if number in found:
                continue
            try:
                next(run)
            except StopIteration as end:
                found[number] = end.value
    for number, expected in enumerate(alone):
        np.testing.assert_array_equal(found[number], expected)
