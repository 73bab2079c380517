"""Changed areas contain all changes; updated terrains are bit-equal to new ones; recipes pickle."""

import pickle
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sketchterrain.array_types import Bounds
from sketchterrain.document.edits import Edit
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build, make_recipe, rebuild
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.differences import merge_boxes, row_difference
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.landforms.placement.feature_types import FEATURE, FEATURE_TYPES, FILL_BIT, lock_edit
from sketchterrain.stages.runner import Results
from sketchterrain.terrain.centrelines import TOLERANCE_CELLS
from sketchterrain.terrain.changes import EVERYWHERE, changed_areas, touches
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.recipe import TerrainRecipe
from tests import terrains

from .conftest import tiers

SIDE, EXTENT = 160, 32_000.0


def _disc(image: np.ndarray, row: float, column: float, radius: float, label: int = 1) -> None:
    rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
    image[(rows - row) ** 2 + (columns - column) ** 2 <= radius**2] = label


def _sketch() -> Sketch:
    """Small shapes far from each other, and two rivers, with a fill between."""
    layers = {
        name: np.zeros((SIDE, SIDE), np.uint8) for name in (*FEATURE_TYPES, "river", "lake", "material")
    }
    for row, column in ((25, 25), (25, 125), (80, 70), (130, 30), (135, 130)):
        _disc(layers["mountain"], row, column, 7)
        _disc(layers["hill"], row + 14, column - 4, 4)
        _disc(layers["forest"], row - 10, column + 10, 4)
    _disc(layers["dune"], 60, 110, 8)
    _disc(layers["lake"], 110, 60, 4)
    _disc(layers["material"], 60, 20, 6)
    for step in range(40):
        _disc(layers["river"], 50 + 8 * np.sin(step / 7), 10 + step, 1.0)
        _disc(layers["river"], 100 + step, 100 + 6 * np.sin(step / 9), 1.0)
    return Sketch(
        extent=EXTENT,
        seed=4,
        layers=layers,
        density={"mountain": 0.004, "hill": 0.05, "forest": 0.1, "dune": 0.004},
        labels={("mountain", 1): {"height": 900.0, "multitude": 3}, ("river", 1): {"width": 40.0}},
    )


@pytest.fixture(scope="module")
def plain(context) -> Terrain:
    return build(_sketch(), device=context)


def _edited(sketch: Sketch, terrain: Terrain, seed: int) -> Sketch:
    """Return the sketch with one edit of a kind selected by the seed."""
    rng = np.random.default_rng(seed)
    x, y = (float(v) for v in rng.uniform(1000, 31_000, 2))
    points, rivers = terrain.features.points, terrain.features.rivers
    own = points[points["painted"]]
    point, river = rng.choice(own), rivers[int(rng.integers(len(rivers)))]
    fill = points[points["id"] >= FILL_BIT]
    name = int(point["id"])
    edits = [
        Edit("move", name, x=float(point["x"]) + 900, y=float(point["y"]) - 500),
        Edit("resize", name, radius=1.4 * float(point["radius"])),
        Edit("strength", name, strength=0.5 * float(point["strength"])),
        Edit("delete", name),
        Edit("add", type="mountain", x=x, y=y, radius=900.0, strength=400.0),
        Edit("add", type="dune", x=x, y=y, radius=900.0, strength=20.0, wavelength=60.0, wind=10.0),
        Edit("move_point", river.id, index=3, x=float(river.points[3, 0]) + 300, y=float(river.points[3, 1])),
        Edit("width", river.id, width=90.0),
        Edit("delete", river.id),
        Edit("delete", int(rng.choice(fill)["id"])),
        Edit("move", int(rng.choice(fill)["id"]), x=x, y=y),
    ]
    kind = seed % (len(edits) + 5)
    if kind < len(edits):
        return sketch.with_edit(edits[kind])
    layer = ("mountain", "river", "hill", "lake", "material")[kind - len(edits)]
    image = np.array(sketch.layers[layer])
    _disc(image, SIDE - y / EXTENT * SIDE, x / EXTENT * SIDE, 4)
    return sketch.replace(layers={**sketch.layers, layer: image})


def _samples() -> tuple[np.ndarray, ...]:
    line = np.linspace(-6000, EXTENT + 6000, 150)
    return tuple(each.ravel() for each in np.meshgrid(line, line))


def _inside(areas: list[Bounds], x: np.ndarray, y: np.ndarray, *, wider: float = 0.0) -> np.ndarray:
    inside = np.zeros(x.shape, dtype=bool)
    for west, south, east, north in areas:
        inside |= (west - wider <= x) & (x <= east + wider) & (south - wider <= y) & (y <= north + wider)
    return inside


@pytest.fixture(scope="module")
def heights_before(plain) -> dict[float, np.ndarray]:
    return {cell: plain.heights(*_samples(), cell_size=cell) for cell in (0.0, 40.0)}


@tiers("seed", [6], [0, 3, 5, 8, 9, 12, 14], [1, 2, 4, 7, 10, 11, 13, 15])
def test_all_changes_are_inside_the_changed_areas(plain, heights_before, seed) -> None:
    """Deleting is 3, moving a river's point 6, painting from 11 on; `rebuild` has the recipes of `build`."""
    after, areas = rebuild(plain, _edited(plain.sketch, plain, seed))
    after = Terrain(after.sketch, after.recipe, plain.context)  # without anything cached
    assert areas
    assert EVERYWHERE not in areas
    x, y = _samples()
    inside = _inside(areas, x, y)
    for cell, before in heights_before.items():
        changed = before != after.heights(x, y, cell_size=cell)
        assert not (changed & ~inside).any()
    surfaces = plain.raster(257), after.raster(257)
    line = np.linspace(0, EXTENT, 257)
    inside = _inside(areas, *np.meshgrid(line, line[::-1]), wider=surfaces[0].spacing[0])
    for part in ("height", "normal", "materials"):
        changed = getattr(surfaces[0], part) != getattr(surfaces[1], part)
        assert not (changed.reshape(*inside.shape, -1).any(axis=-1) & ~inside).any(), part
    if relief_items(plain.recipe) == relief_items(after.recipe):
        assert inside.mean() < 0.35  # most of the world is not built again
    # Nothing beyond the region that is drained with the sketch, and what its rivers reach.
    assert np.min(areas) > -1.2 * EXTENT
    assert np.max(areas) < 2.2 * EXTENT


def relief_items(recipe: TerrainRecipe) -> bytes:
    return recipe[ReliefLayer].items(recipe.world).tobytes()


def test_global_settings_change_everything() -> None:
    plain = terrains.plain()
    for change in (
        *({"seed": 6}, {"fidelity": 0.5}, {"ground": {"relief": 41.0}}, {"climate": {"aridity": 0.3}}),
        *({"extent": 900.0}, {"density": {"hill": 0.4}}),
    ):
        assert rebuild(plain, plain.sketch.replace(**change))[1] == [EVERYWHERE], change


def test_a_name_and_locks_change_nothing() -> None:
    plain = terrains.painted()
    assert rebuild(plain, plain.sketch.replace(name="Another name"))[1] == []
    locked = plain.sketch
    for point in plain.features.points[::3]:
        locked = locked.with_edit(lock_edit(point))
    after, areas = rebuild(plain, locked)
    assert len(locked.edits) > 3
    assert areas == []
    x, y = np.random.default_rng(1).uniform(0.0, plain.extent, (2, 500))
    after = Terrain(locked, after.recipe, plain.context)
    np.testing.assert_array_equal(plain.heights(x, y), after.heights(x, y))


def test_merged_rectangles_cover_all_and_neighbours_are_one() -> None:
    rng = np.random.default_rng(0)
    for count in (0, 1, 2, 40, 300):
        low = rng.uniform(0.0, 1000.0, (count, 2))
        boxes = np.concatenate([low, low + rng.uniform(0.0, 90.0, (count, 2))], axis=1)
        merged = np.array(merge_boxes(map(tuple, boxes.tolist()))).reshape(-1, 4)
        inside = (boxes[:, None, :2] >= merged[:, :2]) & (boxes[:, None, 2:] <= merged[:, 2:])
        assert inside.all(axis=2).any(axis=1).all()
        assert len(merged) <= count
    row = [(10.0 * k, 0.0, 10.0 * k + 25.0, 8.0) for k in range(50)]
    merged = merge_boxes([*row, (3.0, 2.0, 4.0, 3.0), (900.0, 0.0, 950.0, 8.0)])
    assert set(merged) == {(0.0, 0.0, 515.0, 8.0), (900.0, 0.0, 950.0, 8.0)}


def test_touches_includes_borders_and_the_margin() -> None:
    areas = [(0.0, 0.0, 10.0, 10.0)]
    assert touches(areas, (10.0, 10.0, 20.0, 20.0))
    assert touches(areas, (2.0, 2.0, 3.0, 3.0))
    assert not touches(areas, (11.0, 0.0, 20.0, 10.0))
    assert touches(areas, (11.0, 0.0, 20.0, 10.0), margin=1.0)
    assert touches([EVERYWHERE], (1e9, 1e9, 2e9, 2e9))
    assert not touches([], (0.0, 0.0, 1.0, 1.0))


PRESETS = ("valley_river", "alpine_range", "rolling_hills")


def paint_disc(sketch: Sketch, seed: int) -> Sketch:
    rng = np.random.default_rng(seed)
    name = ("river", "mountain", "hill", "lake")[seed % 4]
    image = np.array(sketch.layers[name])
    at = rng.choice(np.argwhere(sketch.layers["river"] > 0)) + rng.normal(0, 25, 2)
    radius = 3.0 if name == "river" else rng.uniform(5, 25)
    _disc(image, *at, radius, rng.integers(0, 2))
    return sketch.replace(layers={**sketch.layers, name: image})


def pieces(recipe: TerrainRecipe, cell: float) -> dict[bytes, np.ndarray]:
    """Return everything that kernels read of each arc, and the box of its effect."""
    packed, unit = recipe[CorridorsLayer].arcs(recipe.extent, cell), metres_per_unit(recipe.extent)
    rows = np.column_stack([packed.start, packed.arc, packed.up, packed.down])
    start = packed.start * unit
    ends = np.stack([start, start + packed.chord])
    radius = np.maximum(*packed.ends("valley_radius"))[:, None]
    boxes = np.column_stack([ends.min(axis=0) - radius, ends.max(axis=0) + radius])
    return {row.tobytes(): box for row, box in zip(rows, boxes, strict=True)}


def river_areas(old: TerrainRecipe, new: TerrainRecipe) -> np.ndarray:
    """Return the areas (n, 4), m, outside which rivers are the same."""
    change = new[CorridorsLayer].change(old[CorridorsLayer], new.world)
    assert change is not None
    return change.boxes * new.world.unit


@tiers("preset", [], PRESETS[:1], PRESETS[1:])
def test_every_changed_arc_is_inside_the_river_areas(preset) -> None:
    sketch, memory = load_sketch(preset), Results()
    old = make_recipe(sketch, memory=memory)
    assert not len(river_areas(old, make_recipe(sketch)))
    changed = 0
    for seed in range(4 if preset == PRESETS[0] else 8):
        sketch = paint_disc(sketch, seed)
        new = make_recipe(sketch, memory=memory)
        areas = river_areas(old, new)
        for cell in TOLERANCE_CELLS:
            before, after = pieces(old, cell), pieces(new, cell)
            for row in before.keys() ^ after.keys():
                box = before[row] if row in before else after[row]
                inside = (areas[:, :2] <= box[:2]) & (areas[:, 2:] >= box[2:])
                assert inside.all(axis=1).any()
                changed += 1
        old = new
    assert changed > 100


def test_a_river_far_from_the_change_has_the_same_course_and_nearly_its_bed(valley) -> None:
    sketch, old = valley.sketch, valley.recipe
    river = np.array(sketch.layers["river"])
    river[5:8, 5:9] = 1
    new = make_recipe(sketch.replace(layers={**sketch.layers, "river": river}))
    assert len(river_areas(old, new))
    painted = [each for each in old.rivers if each.label]
    after = {each.id: each for each in new.rivers if each.label}
    assert len(after) == len(painted) + 1
    for each in painted:
        line = after[each.id].centreline
        np.testing.assert_array_equal(line[:, :2], each.centreline[:, :2])
        # The ground is drained anew, which moves its height a little.
        assert np.percentile(np.abs(line[:, 2] - each.centreline[:, 2]), 90) < 1.0


def _tiles(terrain: Terrain) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and facts of tiles of many levels, each with its parent."""
    keys: list[tuple[int, int, int]] = [(-4, 0, 0)]
    for level in range(-3, 7):
        for x, y in ((0.23, 0.77), (0.52, 0.31)):
            key = (level, int(np.floor(x * 2.0**level)), int(np.floor(y * 2.0**level)))
            if key not in keys:
                keys.append(key)
    place = {key: slot for slot, key in enumerate(keys)}
    parents = [place.get((level - 1, column >> 1, row >> 1), -1) for level, column, row in keys]
    store = terrain.vertex_store(len(keys), quads=32)
    facts = terrain.write_tiles(keys, range(len(keys)), parents, store)
    return store.download(), facts


def _heights(terrain: Terrain, seed: int) -> np.ndarray:
    rng, found = np.random.default_rng(seed), []
    for cell, wide in ((0.0, 0.2), (12.0, 1.0), (300.0, 6.0), (3000.0, 60.0)):
        # In a few places: each one far from the others is drained for itself.
        place = rng.uniform(-wide, 1 + wide, (2, 2)).repeat(80, axis=1)
        x, y = (place + rng.uniform(0, 0.1, (2, 160))) * terrain.extent
        found.append(terrain.heights(x, y, cell_size=cell))
    return np.stack(found)


@tiers("seed", [0], [1], [2])
def test_a_chain_of_changes_is_bit_equal_to_new_terrains(plain, seed) -> None:
    rng, terrain, first = np.random.default_rng(seed), plain, _heights(plain, 2)
    _tiles(terrain)  # fill the caches
    for step in range(2 if seed == 0 else 6):
        kind, at = (int(each) for each in rng.integers([20, 1 << 30]))
        sketch = terrain.sketch
        if kind == 16:
            sketch = sketch.replace(ground={**sketch.ground, "relief": float(rng.uniform(50, 300))})
        elif kind == 17:
            sketch = sketch.replace(seed=step)
        else:
            sketch = paint_disc(sketch, at) if kind > 17 else _edited(sketch, terrain, kind + 16 * step)
        terrain, _ = rebuild(terrain, sketch)
        fresh = Terrain(sketch, terrain.recipe, terrain.context)
        for one, other in zip(_tiles(terrain), _tiles(fresh), strict=True):
            assert one.tobytes() == other.tobytes(), step
        np.testing.assert_array_equal(_heights(terrain, at), _heights(fresh, at))
    plants = [each.foliage(3000.0, 3000.0, 3600.0, 3500.0) for each in (terrain, fresh)]
    assert plants[0].tobytes() == plants[1].tobytes()
    np.testing.assert_array_equal(_heights(plain, 2), first)  # the original is unchanged
    assert (_heights(terrain, 2) != first).any()


def test_a_terrain_of_another_extent_is_built_from_scratch(plain, valley) -> None:
    after, areas = plain.updated(valley.sketch, valley.recipe)
    assert areas == [EVERYWHERE]
    assert after.extent == valley.extent
    x, y = np.random.default_rng(3).uniform(0, valley.extent, (2, 300))
    np.testing.assert_array_equal(after.heights(x, y), valley.heights(x, y))


def test_unchanged_buffers_are_not_uploaded_again(plain, monkeypatch) -> None:
    """A small stroke leaves most feature batches, and all of rivers, lakes and octaves."""
    _tiles(plain)
    forest = np.array(plain.sketch.layers["forest"])
    _disc(forest, 30, 80, 3)
    sketch = plain.sketch.replace(layers={**plain.sketch.layers, "forest": forest})
    recipe = make_recipe(sketch, memory=plain.memory)
    uploads: list[int] = []
    upload = plain.context.upload
    monkeypatch.setattr(
        plain.context,
        "upload",
        lambda array, **more: (uploads.append(array.nbytes), upload(array, **more))[1],
    )
    after, _ = plain.updated(sketch, recipe)
    uploads.clear()  # of material rules
    _tiles(after)
    updated = len(uploads)
    _tiles(Terrain(sketch, recipe, plain.context))
    assert updated < 0.5 * (len(uploads) - updated)


def _pickled(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))  # noqa: S301


def test_a_pickled_recipe_gives_the_same_heights(valley, context) -> None:
    fill = valley.recipe.points.fill.within(0.0, 0.0, *valley.size)
    edited, _ = rebuild(valley, valley.sketch.with_edit(Edit("delete", int(fill["id"][0]))))
    assert len(edited.recipe.points.fill.replaced) == 1
    for terrain in (valley, edited):
        recipe = _pickled(terrain.recipe)
        other = Terrain(terrain.sketch, recipe, context)
        np.testing.assert_array_equal(_heights(terrain, 4), _heights(other, 4))
        assert changed_areas(terrain.recipe, recipe) == []
        with pytest.raises(TypeError):
            recipe.climate["aridity"] = 1.0
    relief = valley.recipe[ReliefLayer]
    bare = valley.recipe.with_layers([replace(relief, painted=None)])
    painted = [course for course in bare[CorridorsLayer].courses if course.river.label]
    assert len(zlib.compress(pickle.dumps(bare.with_layers([CorridorsLayer(tuple(painted))])), 1)) < 400_000
    assert len(zlib.compress(pickle.dumps(bare), 1)) < 1_200_000  # with streams, and outlets of lakes
    assert len(zlib.compress(pickle.dumps(relief), 1)) < 800_000  # the nodes of the painted region
    features, other = valley.features, _pickled(valley.features)
    assert other.points.tobytes() == features.points.tobytes()
    for one, two in zip(features.rivers, other.rivers, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(vars(one).values(), vars(two).values(), strict=True))


@pytest.mark.parametrize("block", [1, 3, 8, 4096])
def test_row_difference_equals_that_of_sets(monkeypatch, block) -> None:
    monkeypatch.setattr("sketchterrain.geometry.differences._BLOCK", block)
    rng = np.random.default_rng(block)
    for _ in range(100):
        arrays = []
        for _ in range(2):
            rows = np.zeros(40, FEATURE)
            rows["id"], rows["x"] = np.arange(40), rng.random(40) < rng.choice([0.0, 0.1, 0.5])
            arrays.append(rows[rng.random(40) < rng.choice([0.3, 0.9, 1.0])])
        sets = [{row.tobytes() for row in rows} for rows in arrays]
        for rows, others, found in zip(arrays, sets[::-1], row_difference(*arrays), strict=True):
            assert found.tolist() == [i for i, row in enumerate(rows) if row.tobytes() not in others]
