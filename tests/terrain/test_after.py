"""A terrain updated to a changed recipe has the bits of one built from that recipe; recipes pickle."""

import pickle
from typing import Any

import numpy as np
import pytest

from sketchterrain.features.edits import EditedFill
from sketchterrain.sketch import Edit, Sketch
from sketchterrain.terrain import Terrain, build, changed_areas, rebuild
from sketchterrain.terrain.changes import EVERYWHERE

from .conftest import tiers

SIDE, EXTENT = 96, 12_000.0
QUADS = 32
LAYERS = ("mountain", "hill", "dune", "forest", "river", "lake", "material")


def _disc(image: np.ndarray, row: float, column: float, radius: float, label: int = 1) -> None:
    rows, columns = np.ogrid[:SIDE, :SIDE]
    image[(rows - row) ** 2 + (columns - column) ** 2 <= radius**2] = label


@pytest.fixture(scope="module")
def first(context) -> Terrain:
    layers = {name: np.zeros((SIDE, SIDE), np.uint8) for name in LAYERS}
    for row, column in ((20, 20), (22, 70), (60, 44)):
        _disc(layers["mountain"], row, column, 6)
        _disc(layers["forest"], row + 10, column + 8, 4)
    _disc(layers["dune"], 80, 80, 7)
    _disc(layers["lake"], 84, 30, 5)
    for step in range(50):
        _disc(layers["river"], 40 + 6 * np.sin(step / 7), 10 + step, 0.8)
    density = {"mountain": 0.01, "hill": 0.1, "forest": 0.2}
    return build(Sketch(extent=EXTENT, seed=11, layers=layers, density=density), device=context)


def _changed(sketch: Sketch, terrain: Terrain, rng: np.random.Generator) -> Sketch:
    """A stroke on some layer, or an edit, or another setting."""
    kind = rng.integers(10)
    points = terrain.features.points
    if kind == 0:
        return sketch.replace(ground={**sketch.ground, "relief": float(rng.uniform(50, 300))})
    if kind == 1:
        return sketch.replace(seed=int(rng.integers(100)))
    if kind == 2:
        point = rng.choice(points)
        x, y = float(point["x"]) + 700.0, float(point["y"]) - 400.0
        return sketch.replace(edits=(*sketch.edits, Edit("move", int(point["id"]), x=x, y=y)))
    if kind == 3 and terrain.features.rivers:
        river = terrain.features.rivers[0]
        return sketch.replace(
            edits=(*sketch.edits, Edit("width", river.id, width=float(rng.uniform(10, 90))))
        )
    layers = {name: layer.copy() for name, layer in sketch.layers.items()}
    name = str(rng.choice(LAYERS))
    row, column = rng.uniform(5, SIDE - 5, 2)
    label = int(rng.random() < 0.7)
    _disc(layers[name], row, column, float(rng.uniform(1, 8)), label)
    return sketch.replace(layers=layers)


def _tiles(terrain: Terrain) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and facts of tiles of many levels, each with its parent."""
    keys: list[tuple[int, int, int]] = [(-4, 0, 0)]
    for level in range(-3, 7):
        across = 2.0**level
        for x, y in ((0.23, 0.77), (0.52, 0.31), (0.9, 0.12)):
            key = (level, int(np.floor(x * across)), int(np.floor(y * across)))
            if key not in keys:
                keys.append(key)
    place = {key: slot for slot, key in enumerate(keys)}
    parents = [place.get((level - 1, column >> 1, row >> 1), -1) for level, column, row in keys]
    store = terrain.vertex_store(len(keys), quads=QUADS)
    facts = terrain.write_tiles(keys, range(len(keys)), parents, store)
    return store.download(), facts


def _heights(terrain: Terrain, rng: np.random.Generator) -> list[np.ndarray]:
    found = []
    for cell, wide in ((0.0, 0.2), (12.0, 1.0), (300.0, 6.0), (3000.0, 60.0)):
        x, y = rng.uniform(-wide * EXTENT, (1 + wide) * EXTENT, (2, 400))
        found.append(terrain.heights(x, y, cell_size=cell))
    return found


@tiers("seed", [0], range(4))
def test_a_chain_of_changes_has_the_bits_of_fresh_terrains(first, seed) -> None:
    rng = np.random.default_rng(seed)
    terrain = first
    _tiles(terrain)  # what it keeps is there
    for step in range(4 if seed == 0 else 8):
        sketch = _changed(terrain.sketch, terrain, rng)
        built, areas = rebuild(terrain, sketch)
        terrain = terrain.after(sketch, built.recipe, areas)
        fresh = Terrain(sketch, built.recipe, terrain.context)
        for one, other in zip(_tiles(terrain), _tiles(fresh), strict=True):
            assert one.tobytes() == other.tobytes(), step
        at = int(rng.integers(1 << 30))
        for one, other in zip(
            _heights(terrain, np.random.default_rng(at)),
            _heights(fresh, np.random.default_rng(at)),
            strict=True,
        ):
            np.testing.assert_array_equal(one, other)
    plants = [each.foliage(3000.0, 3000.0, 3600.0, 3500.0) for each in (terrain, fresh)]
    assert plants[0].tobytes() == plants[1].tobytes()


def test_the_previous_terrain_is_unchanged(first) -> None:
    before = _heights(first, np.random.default_rng(2))
    layers = {name: layer.copy() for name, layer in first.sketch.layers.items()}
    _disc(layers["mountain"], 50, 50, 7)
    sketch = first.sketch.replace(layers=layers)
    built, areas = rebuild(first, sketch)
    other = first.after(sketch, built.recipe, areas)
    changed = _heights(other, np.random.default_rng(2))
    assert any((one != two).any() for one, two in zip(before, changed, strict=True))
    for one, two in zip(before, _heights(first, np.random.default_rng(2)), strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_terrain_of_another_extent_is_built_anew(first, valley) -> None:
    areas = changed_areas(first.recipe, valley.recipe)
    assert areas == [EVERYWHERE]
    after = first.after(valley.sketch, valley.recipe, areas)
    assert after.extent == valley.extent
    x, y = np.random.default_rng(3).uniform(0, valley.extent, (2, 300))
    np.testing.assert_array_equal(after.heights(x, y), valley.heights(x, y))


def test_unchanged_buffers_are_not_uploaded_again(first) -> None:
    """A small stroke leaves most of what was gathered, and all of rivers, lakes and octaves."""
    _tiles(first)
    layers = {name: layer.copy() for name, layer in first.sketch.layers.items()}
    _disc(layers["forest"], 30, 80, 3)
    sketch = first.sketch.replace(layers=layers)
    built, areas = rebuild(first, sketch)
    uploads: list[int] = []
    upload = first.context.upload
    first.context.upload = lambda array, **more: (uploads.append(array.nbytes), upload(array, **more))[1]
    try:
        after = first.after(sketch, built.recipe, areas)
        assert not uploads
        _tiles(after)
        few = len(uploads)
        _tiles(Terrain(sketch, built.recipe, first.context))
    finally:
        first.context.upload = upload
    assert few < 0.5 * (len(uploads) - few)


def _copied(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))  # noqa: S301


def test_a_pickled_recipe_gives_the_same_heights(valley, context) -> None:
    fill = valley.recipe.fill.within(0.0, 0.0, *valley.size)
    edited, _ = rebuild(valley, valley.sketch.with_edit(Edit("delete", int(fill["id"][0]))))
    assert isinstance(edited.recipe.fill, EditedFill)
    for terrain in (valley, edited):
        recipe = _copied(terrain.recipe)
        other = Terrain(terrain.sketch, recipe, context)
        x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(-3000.0, 9000.0, 90)]))
        for cell in (0.0, 24.0):
            one, two = (each.heights(x, y, cell_size=cell) for each in (terrain, other))
            assert one.tobytes() == two.tobytes()
        assert changed_areas(terrain.recipe, recipe) == []
        with pytest.raises(TypeError):
            recipe.ground["relief"] = 1.0
    assert len(pickle.dumps(valley.recipe)) < 400_000


def test_placed_features_pickle(valley) -> None:
    features = valley.features
    other = _copied(features)
    assert other.points.tobytes() == features.points.tobytes()
    for one, two in zip(features.rivers, other.rivers, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(vars(one).values(), vars(two).values(), strict=True))
