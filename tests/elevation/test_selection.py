"""Covers against brute force, and their independence of the order of grids."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely

from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.patches import GridPatches
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.errors import InputError

MakeGrid = Callable[..., ElevationGrid]


@pytest.fixture(scope="module")
def four(make_grid: MakeGrid) -> list[GridPatches]:
    """Overlapping grids: rotated, coarse, with a void, and two of the same step and accuracy."""
    holed = make_grid(30.0, 90, 90, degrees=21.0, accuracy=0.5)
    samples = holed.samples.copy()
    samples[30:55, 60:80] = np.nan
    grids = [
        replace(holed, samples=samples),
        make_grid(30.0, 80, 100, middle=(5600.0, 5300.0), accuracy=0.5, offset=3.0),
        make_grid(90.0, 60, 70, degrees=-8.0, accuracy=4.0, offset=-2.0),
        make_grid(50.0, 70, 60, middle=(4300.0, 5100.0), degrees=45.0, accuracy=1.0),
    ]
    return [build_patches(each) for each in grids]


def together(parts: list[GridPatches]) -> Patchwork:
    work = Patchwork()
    for each in parts:
        work = Patchwork({**work.grids, each.id: each})
    return work


def state(work: Patchwork) -> tuple[bytes, ...]:
    """Return the bits of tops, and of surfaces at several errors."""
    x, y = np.random.default_rng(5).uniform(2500.0, 8500.0, (2, 400))
    found = [work.tops.top, work.tops.is_best]
    for error in (0.0, 1.0, 10.0):
        found += work.surface(work.cover(error)).evaluate(x, y)
    found += work.surface(work.cover_for_cells(240.0)).evaluate(x, y)
    return tuple(each.tobytes() for each in found)


def test_all_orders_of_four_grids_give_the_same_bits(four: list[GridPatches]) -> None:
    expected = state(Patchwork({each.id: each for each in four}))
    for first in range(4):
        for order in (four[first:] + four[:first], four[first::-1] + four[:first:-1])[: 1 + first % 2]:
            assert state(together(order)) == expected


def is_covered(kernel: shapely.Geometry, others: list[shapely.Geometry]) -> bool:
    union = shapely.union_all([each for each in others if each.intersects(kernel)])
    return bool(kernel.difference(union).area < 1e-3 * kernel.area / 28**2)


def test_covers_equal_brute_force(four: list[GridPatches]) -> None:
    for parts in (four[:1], four[1:3], four):
        work = together(parts)
        patches, corners = work.rows(np.arange(len(work)))
        ends = np.cumsum(patches.rectangles)
        kernels = [
            shapely.polygons(corners[end - n : end]) for end, n in zip(ends, patches.rectangles, strict=True)
        ]
        grown = [
            shapely.union_all(shapely.buffer(each, growth, join_style="mitre"))
            for each, growth in zip(kernels, patches.growth, strict=True)
        ]
        kernels = [shapely.union_all(each) for each in kernels]
        order = [
            (-int(r), float(e), i) for i, (r, e) in enumerate(zip(patches.rank, patches.error, strict=True))
        ]

        everything = shapely.union_all(kernels)
        for error in (0.0, 0.5, 1.0, 4.5, 8.0, 15.0, 30.0, 100.0):
            expected = []
            for p in range(len(patches)):
                greater = [
                    q for q in range(len(patches)) if order[q] < order[p] and patches.error[q] <= error
                ]
                better = [
                    q
                    for q in range(len(patches))
                    if patches.finest[q]
                    and work.grid[q] != work.grid[p]
                    and (patches.error[q], order[q]) < (patches.error[p], order[p])
                ]
                asked = patches.error[p] <= error or (
                    patches.finest[p] and not is_covered(kernels[p], [grown[q] for q in better])
                )
                if asked and not is_covered(kernels[p], [grown[q] for q in greater]):
                    expected.append(p)
            found = work.cover(error).tolist()
            assert found == expected, error
            rest = everything.difference(shapely.union_all([grown[p] for p in found]))
            assert rest.area < 1e-6 * everything.area


def test_covers_for_cells_are_limited_in_band(four: list[GridPatches]) -> None:
    work = together(four)
    patches, _ = work.rows(np.arange(len(work)))
    finest = work.cover_for_cells(1.0)
    assert finest.tolist() == work.cover(1.0 / 64.0).tolist()
    x, y = np.random.default_rng(2).uniform(3800.0, 6200.0, (2, 500))
    last = len(finest)
    for cell in (120.0, 300.0, 900.0):
        which = work.cover_for_cells(cell)
        coarsest = np.array([each.levels - 1 for each in work.grids.values()])
        step = np.sqrt(patches.step_area[which])
        ends = patches.level[which] == coarsest[work.grid[which]]
        assert ((step >= 0.499 * cell) | ends).all()
        assert (work.surface(which).evaluate(x, y).weight > 0.9).all()
        assert len(which) <= last
        last = len(which)
    with pytest.raises(InputError, match="cell size"):
        work.cover_for_cells(0.0)


def test_same_grid_at_another_accuracy_is_redundant(make_grid: MakeGrid) -> None:
    one = build_patches(make_grid(accuracy=0.5))
    other = build_patches(make_grid(accuracy=2.0))
    work = together([other, one])
    assert set(work.grid[work.cover(0.0)]) == {list(work.grids).index(one.id)}
    assert len(work.cover(0.0)) == len(together([one]).cover(0.0))


def test_patches_of_an_area_give_the_same_bits(four: list[GridPatches]) -> None:
    work = together(four)
    which = work.cover(1.0)
    near = work.within(which, (4800.0, 4900.0, 5100.0, 5200.0))
    assert len(near) < len(which) // 2
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(4800, 5100, 40), np.linspace(4900, 5200, 40)))
    for one, other in zip(work.surface(which).evaluate(x, y), work.surface(near).evaluate(x, y), strict=True):
        assert one.tobytes() == other.tobytes()
    for grids, error, message in ((work, -1.0, "expected metres"), (Patchwork(), 1.0, "at least one")):
        with pytest.raises(InputError, match=message):
            grids.cover(error)


@pytest.mark.parametrize("side", [8, 30, 60])
def test_rim_fade_is_0_beyond_grids_of_few_samples_and_1_inside(make_grid: MakeGrid, side: int) -> None:
    width = 30.0 * (side - 1)
    part = build_patches(make_grid(30.0, side, side))
    fade = Patchwork({part.id: part}).rim_fade(0.04 * width)
    along = np.linspace(-0.4, 0.4, 50) * width
    half = 0.5 * width
    assert fade.weight(5000.0 + along, np.full(50, 5000.0)).min() > 1.0 - 1e-9
    for beyond in (half + 45.0, -half - 45.0):
        assert not fade.weight(5000.0 + along, np.full(50, 5000.0 + beyond)).any()
        assert not fade.weight(np.full(50, 5000.0 + beyond), 5000.0 + along).any()
