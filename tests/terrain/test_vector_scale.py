"""Many vectors and few: the index, edits, tiles that others do not reach."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from sketchterrain.benchmarks.synthetic_land import EXTENT as COUNTRY
from sketchterrain.benchmarks.synthetic_land import synthetic_land
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features.edits import move_node
from sketchterrain.features.table import FeatureTable
from sketchterrain.generation.building import build, rebuild
from sketchterrain.geometry.box_index import BoxIndex, touch_any
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.landuse.areas import land_use
from sketchterrain.stages.runner import Results
from sketchterrain.terrain.layers.landuse import LandUseLayer

from .conftest import tiers

EXTENT, LEVEL = 4096.0, 4
WIDTH = EXTENT / 2**LEVEL


def test_points_and_boxes_are_found_in_an_edited_index(monkeypatch) -> None:
    monkeypatch.setattr("sketchterrain.geometry.box_index._FEW_ITEMS", 64)
    ends = land_use(synthetic_land(20)).edges.reshape(-1, 2, 2)
    boxes = to_lattice(np.concatenate([ends.min(axis=1), ends.max(axis=1)], axis=1), COUNTRY)
    rng, index = np.random.default_rng(3), BoxIndex(boxes)
    for _ in range(30):
        corner = index.boxes_of(rng.integers(0, len(index), 1))[0, :2]
        _, numbers = index.touching(np.concatenate([corner, corner])[None])
        way = np.tile(to_lattice(rng.uniform(-20.0, 20.0, 2), COUNTRY), 2)
        index = index.updated(numbers, numbers, index.boxes_of(numbers) + way)
    assert index.boxes is not index._boxes
    now = index.boxes
    np.testing.assert_array_equal(index.boxes_of(np.arange(len(boxes))), now)
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    at = rng.integers(low, high, (400, 2))
    wide = np.concatenate([at, at + rng.integers(0, (high - low) // 10, at.shape)], axis=1)
    inside = ((at[:, None] >= now[:, :2]) & (at[:, None] <= now[:, 2:])).all(axis=2)
    near = ((wide[:, None, 2:] >= now[:, :2]) & (wide[:, None, :2] <= now[:, 2:])).all(axis=2)
    monkeypatch.setattr("sketchterrain.geometry.box_index._PAIRS", 3 * len(now))
    np.testing.assert_array_equal(touch_any(wide, now), near.any(axis=1))
    for found, expected in ((index.at_points(*at.T), inside), (index.touching(wide), near)):
        np.testing.assert_array_equal(np.stack(found)[:, np.lexsort(found[::-1])], np.nonzero(expected))


def dry_land(side: int) -> Sketch:
    """Return fields without roads and without streams."""
    sketch = synthetic_land(side)
    return sketch.replace(
        vectors={"landuse": sketch.vectors["landuse"]}, climate={**sketch.climate, "aridity": 1.0}
    )


def assert_same_tiles(one, other, keys) -> None:
    for a, b in zip(one.tiles(keys), other.tiles(keys), strict=True):
        np.testing.assert_array_equal(a.height, b.height)
        np.testing.assert_array_equal(a.materials, b.materials)
    np.testing.assert_array_equal(one.appearance.tiles(keys), other.appearance.tiles(keys))


def sketch_of(shapes, ids=None, **columns) -> Sketch:
    layer = FeatureTable.from_shapes("landuse", np.array(shapes, object), ids=ids, columns=columns)
    return Sketch(extent=EXTENT, seed=3, vectors={"landuse": layer}, climate={"aridity": 1.0})


@tiers("count", [64], [224])
def test_a_tile_of_many_curves_is_that_of_the_fields_near_it(count, context) -> None:
    """224 × 224 fields in one quad have 100,800 curves."""
    corner = np.array([8.0, 8.0]) * WIDTH
    x, y = (each.ravel() for each in np.meshgrid(np.arange(count), np.arange(count)))
    step = WIDTH / count
    fields = shapely.box(
        *(corner[k] + step * (each + more) for more in (0, 1) for k, each in ((0, x), (1, y)))
    )
    uses = tuple(np.array(["field", "meadow", "forest"])[(x + 2 * y) % 3].tolist())
    whole = build(sketch_of(fields, use=uses), device=context)
    near = np.flatnonzero((x < 0.27 * count) & (y < 0.27 * count))
    part = build(sketch_of(fields[near], near + 1, use=tuple(np.array(uses)[near].tolist())), device=context)
    assert_same_tiles(whole, part, [(LEVEL + 3, 64, 64), (LEVEL + 6, 512, 514), (LEVEL + 9, 4096, 4097)])
    (tile,) = whole.appearance.tiles([(LEVEL, 8, 8)])
    assert count < 224 or tile[4:-4, 4:-4, 3].min() > 0  # covered everywhere


def test_an_area_cut_into_many_parts_by_a_quad_is_that_of_its_parts(context) -> None:
    """A comb whose 100 teeth cross a quad, and whose back lies beyond it."""
    west, south = np.array([8.0, 8.0]) * WIDTH
    tooth, count = WIDTH / 256.0, 100
    lefts = west + tooth * (2 + 2 * np.arange(count))
    teeth = shapely.box(lefts, south - 20.0, lefts + tooth, south + WIDTH + 20.0)
    back = shapely.box(lefts[0], south + WIDTH + 20.0, lefts[-1] + tooth, south + WIDTH + 24.0)
    comb = shapely.union_all([*teeth, back])
    assert comb.geom_type == "Polygon"
    one, many = (
        build(sketch_of(shapes, use=("meadow",) * len(shapes)), device=context) for shapes in ([comb], teeth)
    )
    keys = [(LEVEL, 8, 8), (LEVEL + 2, 33, 33), (LEVEL + 5, 257, 300)]
    shares = [each.appearance.tiles(keys)[..., 3].astype(int) for each in (one, many)]
    assert np.abs(shares[0] - shares[1]).max() <= 1
    assert shares[0][0].max() > 0
    assert (np.diff((shares[0][1, 90] > 20).astype(int)) == 1).sum() > 10  # teeth are seen one by one


def test_undoing_thirty_times_leaves_the_terrain_as_it_was(context) -> None:
    memory = Results()
    sketch = dry_land(18)
    layer = sketch.vectors["landuse"]
    node = tuple(layer.vertices[len(layer.vertices) // 2].tolist())
    moved = sketch.replace(vectors={"landuse": move_node(layer, node, (node[0] + 9.0, node[1] - 7.0))})
    first = terrain = build(sketch, device=context, memory=memory)
    key = [(9, *(int(each // (sketch.extent / 2**9)) for each in node))]
    first.tiles(key)
    for turn in range(200):
        terrain, areas = rebuild(terrain, moved if turn % 2 == 0 else sketch)
        assert 0 < len(areas) <= 3
    index = terrain.recipe[LandUseLayer].index(terrain.recipe.world).boxes
    assert index._edits is None or len(index._edits.added) < len(index) // 8
    assert_same_tiles(terrain, build(sketch, device=context), key)
    changed = build(moved, device=context)
    assert (changed.appearance.tiles(key) != terrain.appearance.tiles(key)).any()


def test_land_use_at_the_edge_of_the_world_is_as_near_the_origin(context) -> None:
    """As far as vectors may be; they are refused a million kilometres away."""
    steps = int(9.9e6 // WIDTH)
    rng = np.random.default_rng(8)
    outline = shapely.convex_hull(shapely.MultiPoint(WIDTH * (8.2 + 0.6 * rng.random((12, 2)))))
    outline = shapely.set_precision(outline, 1.0 / 1024.0)
    far = shapely.transform(outline, lambda at: at + np.array([steps * WIDTH, 0.0]))
    keys = np.array([(LEVEL, 8, 8), (LEVEL + 2, 33, 33)])
    shares = []
    for shape, shift in ((outline, 0), (far, steps)):
        terrain = build(sketch_of([shape], use=("meadow",)), device=context)
        moved = keys + np.stack([0 * keys[:, 0], shift << (keys[:, 0] - LEVEL), 0 * keys[:, 0]], axis=1)
        shares.append(terrain.appearance.tiles(moved)[..., 3])
    np.testing.assert_array_equal(*shares)
    assert shares[0].any()
    with pytest.raises(InputError, match="at most 1e\\+07 m away"):
        sketch_of([shapely.transform(outline, lambda at: at + 1e9)])
