"""The drained ground as layers read it: kernel and host, windows, levels, changes of the painted raster."""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from sketchterrain.generation.building import build
from sketchterrain.io.disk_cache import RecordCache
from sketchterrain.landforms.node_raster import DrainedRaster, NodeReader, PaintedNodes
from sketchterrain.landforms.relief_fields import UnpaintedSettings
from sketchterrain.landforms.unpainted import Nodes, UnpaintedGround
from sketchterrain.schema.layers import DENSITY
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import HostTerrain
from sketchterrain.terrain.layers.layer import MASKS
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.patches import tile_samples
from sketchterrain.terrain.recipe import difference
from tests import terrains

from .conftest import Waves, tiers
from .sketch_edits import random_sketch

EXTENT = 4096.0


def painted(column: int, row: int, side: int, *, bump: float = 0.0) -> DrainedRaster:
    """Return a round painted region of level nodes on waves, with a bump (m) at one node in its middle."""
    levels = []
    for level in range(4):
        west, south = -(-column >> level), -(-row >> level)
        count = side >> level
        nodes = Waves(90.0).window(level, west, south, count, count)
        step = np.arange(count) - count / 2
        inside = np.hypot(step, step[:, None]) < count / 2
        height = np.where(inside, nodes.height, np.nan).astype(np.float32)
        if level == 0:
            height[side // 2, side // 2] += bump
        rock, wet = (np.rint(each * 255).astype(np.uint8) for each in (nodes.rock, nodes.wetness))
        levels.append(PaintedNodes(west, south, height, rock, wet, nodes.area))
    return DrainedRaster.from_drained(levels)


@pytest.fixture
def recipes(make_recipe):
    plain = make_recipe()
    one, other = (ReliefLayer(Waves(), painted(60, 80, 128, bump=bump)) for bump in (0.0, 30.0))
    return plain.with_layers([one]), plain.with_layers([other])


def test_a_plane_is_read_exactly_and_without_waves_of_its_nodes(make_recipe) -> None:
    class Plane(Waves):
        def window(self, level, column, row, rows, columns, *, painted=True):
            nodes = super().window(level, column, row, rows, columns)
            x = (column + np.arange(columns)) * self.spacing * 2**level
            return nodes._replace(height=np.broadcast_to(0.25 * x, (rows, columns)), rock=0 * nodes.rock)

    recipe = make_recipe(relief=ReliefLayer(Plane()))
    x = np.random.default_rng(1).integers(0, 1 << 24, (2, 2000))
    # At a cell of four nodes nothing is displaced and no detail is left.
    ground = HostTerrain(recipe).samples(*x, cell_size=64.0).height
    np.testing.assert_allclose(ground, 0.25 * x[0] * recipe.world.unit, atol=0.02)


@pytest.mark.parametrize("cell", [0.0, 5.0, 16.0, 40.0, 130.0])
def test_kernel_equals_the_host_on_a_painted_region(recipes, context, cell) -> None:
    x, y = np.random.default_rng(2).integers(-(1 << 22), 3 << 23, (2, 3000))
    height, masks = Evaluator(recipes[0], context).points(x, y, cell_size=cell)
    expected = HostTerrain(recipes[0]).samples(x, y, cell_size=cell)
    np.testing.assert_allclose(height, expected.height, atol=3e-3, rtol=0)
    for name in ("mountain", "wetness"):
        mask = masks[:, MASKS.index(name)]
        np.testing.assert_allclose(mask, getattr(expected, name), atol=2e-5, rtol=0)
        assert mask.min() == 0.0
        assert mask.max() > 0.5


def test_a_change_of_the_painted_raster_equals_a_fresh_terrain(recipes, context) -> None:
    old, new = recipes
    change = difference(old, new)
    assert change is not None
    (area,) = change.areas
    # The bump's block of 32 nodes, the splines' reach, and no more.
    assert 500 < area[2] - area[0] < 700
    updated, areas = Evaluator(old, context).updated(new)
    assert areas == change.areas
    fresh = Evaluator(new, context)
    rng = np.random.default_rng(3)
    x, y = rng.integers(0, 1 << 24, (2, 6000))
    for cell in (0.0, 20.0):
        before, _ = Evaluator(old, context).points(x, y, cell_size=cell)
        now, _ = updated.points(x, y, cell_size=cell)
        np.testing.assert_array_equal(now, fresh.points(x, y, cell_size=cell)[0])
        metres = np.stack([x, y]) * new.world.unit
        outside = (metres < np.array(area[:2])[:, None]) | (metres > np.array(area[2:])[:, None])
        np.testing.assert_array_equal(now[outside.any(axis=0)], before[outside.any(axis=0)])
    assert (now != before).any()


def test_far_positions_have_the_bits_of_near_ones(make_recipe, context) -> None:
    """Ground of period 2^20 nodes is the same 10⁶ m away, but for noise."""

    class Periodic(Waves):
        def window(self, level, column, row, rows, columns, *, painted=True):
            period = (1 << 20) >> level
            return super().window(level, (column + period // 2) % period - period // 2, row, rows, columns)

    recipe = make_recipe(relief=ReliefLayer(Periodic()))
    x, y = np.random.default_rng(5).integers(0, 1 << 20, (2, 500))
    near, far = (Evaluator(recipe, context).points(x + shift, y, cell_size=64.0)[0] for shift in (0, 1 << 36))
    np.testing.assert_array_equal(near, far)


def test_fine_samples_of_coarse_nodes_are_within_32_bits(recipes, context) -> None:
    """Samples close together at a large cell size read nodes far apart."""
    patches = tile_samples(0, [(5, 0)], cell_size=EXTENT * 8)
    evaluator = Evaluator(recipes[0], context)
    surface = evaluator.surface(patches.axis_x, patches.axis_y, cell_size=EXTENT * 8)
    x, y = np.meshgrid(patches.axis_x[0, 1:-1], patches.axis_y[0, 1:-1])
    single, _ = evaluator.points(x.ravel(), y.ravel(), cell_size=EXTENT * 8)
    np.testing.assert_array_equal(surface.height[0], single.reshape(x.shape))


class OwnNodes:
    """Unpainted ground with a small cache of its own."""

    def __init__(self, settings: UnpaintedSettings, max_bytes: int) -> None:
        self.ground = UnpaintedGround(settings, max_bytes=max_bytes)

    def window(self, *at: int, painted: bool = True) -> Nodes:
        return self.ground.window(*at, painted=painted)

    def prepare(self, *at: Any, painted: bool = True) -> None:
        self.ground.prepare(*at, painted=painted)


def overlapping_windows(pairs: int, far: int, seed: int):
    """Return levels and pairs of overlapping windows (column, row, rows, columns), many far away."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(pairs):
        level = int(rng.integers(0, 8))
        column, row = rng.integers(-80, 350, 2) + far * rng.choice([-1, 0, 0, 1], 2)
        one = np.array([column >> level, row >> level, *rng.integers(12, 50, 2)])
        other = one + rng.integers(-11, 12, 4)
        found.append((level, one.tolist(), np.maximum(other, [-far * 9, -far * 9, 1, 1]).tolist()))
    return found


@tiers(("has_paint", "pairs"), [(True, 8)], [(True, 40), (False, 40)], [(True, 1000), (False, 1000)])
def test_overlapping_windows_have_the_same_nodes(has_paint, pairs) -> None:
    """In any order, from any thread, with small caches, 10⁶ m away: of all levels."""
    terrain = terrains.painted()
    sketch = terrain.sketch.replace(density={"mountain": 0.05, "hill": 0.3})
    painted = terrain.recipe[ReliefLayer].painted if has_paint else None
    settings = UnpaintedSettings.from_sketch(sketch)
    readers = [NodeReader(OwnNodes(settings, size), painted) for size in (1 << 24, 1 << 19)]
    asked = overlapping_windows(pairs, round(1e6 / settings.spacing), pairs)
    first = [readers[0].window(level, *one) for level, one, _ in asked]
    with ThreadPoolExecutor(2) as pool:
        second = list(pool.map(lambda each: readers[1].window(each[0], *each[2]), asked[::-1]))[::-1]
    compared = 0
    for (_, one, other), near, again in zip(asked, first, second, strict=True):
        west, south = max(one[0], other[0]), max(one[1], other[1])
        east, north = min(one[0] + one[3], other[0] + other[3]), min(one[1] + one[2], other[1] + other[2])
        if east <= west or north <= south:
            continue
        for a, b in zip(near, again, strict=True):
            assert np.isfinite(a).all()
            np.testing.assert_array_equal(
                a[south - one[1] : north - one[1], west - one[0] : east - one[0]],
                b[south - other[1] : north - other[1], west - other[0] : east - other[0]],
            )
        compared += (east - west) * (north - south)
    assert compared > 100 * pairs


@tiers("seed", [3], [0, 4], [1, 2, *range(5, 16)])
def test_heights_are_finite(seed, context) -> None:
    """Near and 10⁶ m away, in small and large worlds, with the least and greatest densities and relief."""
    rng = np.random.default_rng(seed)
    extent = (100.0, 6000.0, 1e6)[seed % 3]
    most = seed // 2 % 2 == 0 and extent < 1e6  # a world of such features does not fit
    sketch = random_sketch(rng).replace(
        extent=extent,
        density={name: each.high if most else 0.0 for name, each in DENSITY.items()},
        ground={"relief": 0.0 if seed % 4 < 2 else 300.0},
    )
    terrain = build(sketch, device=context)
    for middle in (0.5 * extent, 1e6 + extent, 1e7 + extent, -3e7 - extent):
        x, y = middle + rng.uniform(-0.6, 0.6, (2, 60)) * extent
        for cell in (0.0, extent / 100, extent):
            # Heights and masks that are not finite are errors.
            assert (np.abs(terrain.heights(x, y, cell_size=cell)) < 1e5).all()


def test_scattered_points_ask_for_few_nodes() -> None:
    """Of each place those around it, not of the area between; the same heights as alone."""
    terrain = terrains.plain()
    x, y = np.random.default_rng(2).uniform(-1e7, 1e7, (2, 4))
    together = terrain.heights(x, y)
    alone = [float(terrain.heights(*place)) for place in zip(x, y, strict=True)]
    np.testing.assert_array_equal(together, np.array(alone, np.float32))


def test_chunks_from_disk_have_the_computed_bits(tmp_path) -> None:
    """Also from a damaged file, or from a folder that cannot be written."""
    settings, raster = UnpaintedSettings(extent=6000.0, seed=5), painted(60, 80, 128)

    def read(disk: RecordCache | None) -> list[npt.NDArray[Any]]:
        reader = NodeReader(OwnNodes(settings, 1 << 24), raster, disk=disk)
        windows = [reader.window(level, -40, 70, 150, 90) for level in (0, 7)]
        return [values for window in windows for values in window]

    expected = read(None)
    (tmp_path / "file").touch()
    for change in ("none yet", "whole", "damaged", "truncated", "no folder"):
        disk = RecordCache("ground", "a", folder=tmp_path / "file" if change == "no folder" else tmp_path)
        assert (disk.get((0, -1, 1, 1)) is not None) == (change == "whole"), change
        for a, b in zip(read(disk), expected, strict=True):
            np.testing.assert_array_equal(a, b)
        (path,) = tmp_path.glob("ground-*.sqlite")
        content = path.read_bytes()
        if change == "whole":
            path.write_bytes(b"x" * 9000 + content[9000:])
        elif change == "damaged":
            path.write_bytes(content[: len(content) // 2])


def test_least_recently_opened_files_of_chunks_are_deleted(tmp_path) -> None:
    for number in range(8):
        cache = RecordCache("ground", str(number), max_bytes=200_000, folder=tmp_path)
        for key in range(9):  # of which a file holds a quarter of 200 kB
            cache.add({(key, 0, 0, 0): bytes(10_000)})
        assert cache.get((2, 0, 0, 0)) == bytes(10_000)
        assert cache.get((8, 0, 0, 0)) is None
        for path in tmp_path.glob("ground-*"):
            os.utime(path, (path.stat().st_atime, path.stat().st_mtime - 100.0))
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 250_000
    assert RecordCache("ground", "0", folder=tmp_path).get((0, 0, 0, 0)) is None
    assert RecordCache("ground", "7", folder=tmp_path).get((0, 0, 0, 0)) == bytes(10_000)
