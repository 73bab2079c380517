"""Cached results are bit-equal to fresh ones, and a stroke recomputes only its neighbourhood."""

from unittest.mock import Mock

import numpy as np
import pytest

from sketchterrain.caching import LRUCache
from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.landforms.placement import user_features as user_features_module
from sketchterrain.landforms.placement.placement import place
from sketchterrain.stages.runner import Results, Runner
from sketchterrain.terrain.layers.corridors import CorridorsLayer


def test_lru_cache_evicts_the_least_recent_and_does_not_cache_failures():
    cache, compute = LRUCache(2), Mock(side_effect=[1, 2, 3, 4])
    assert [cache.get_or_compute(key, compute) for key in (1, 2, 1, 3, 1, 2)] == [1, 2, 1, 3, 1, 4]
    with pytest.raises(KeyError):
        cache.get_or_compute("a", Mock(side_effect=KeyError))
    assert cache.get_or_compute("a", lambda: 5) == 5
    cache = LRUCache(max_bytes=1000)
    for number in range(5):
        cache.store(number, (np.zeros(50), [np.zeros(0)]))
    assert cache.keys() == [3, 4]
    assert cache.store("large", np.zeros(1000)).nbytes == 8000
    assert cache.keys() == ["large"]
    cache.store("large", 1)
    cache.store("small", np.zeros(100))
    assert cache.keys() == ["large", "small"]
    cache = LRUCache(0)
    assert [cache.get_or_compute("one", lambda value=value: value) for value in (1, 2)] == [1, 2]


def squares():
    layers = {name: np.zeros((64, 96), np.uint8) for name in ("mountain", "hill")}
    for number in range(4):
        layers["mountain"][4:20, 4 + 22 * number : 18 + 22 * number] = 1
    layers["hill"][40:60, 10:80] = 2
    return Sketch(layers=layers)


def dabbed(sketch, row, column):
    mountain = sketch.layers["mountain"].copy()
    mountain[row : row + 3, column : column + 3] = 1
    return sketch.replace(layers={**sketch.layers, "mountain": mountain})


def test_only_shapes_of_a_stroke_are_broken_up_and_the_oldest_are_evicted(monkeypatch):
    broken_up = Mock(side_effect=user_features_module.user_features)
    monkeypatch.setattr(user_features_module, "user_features", broken_up)
    sketch, run = squares(), Runner()
    for _ in range(2):
        place(sketch, seed=1, run=run)
        assert broken_up.call_count == 5
    place(dabbed(sketch, 19, 30), seed=1, run=run)  # at the edge of the second square
    place(dabbed(sketch, 30, 30), seed=1, run=run)  # a shape of its own
    assert [call.args[0].id for call in broken_up.call_args_list[5:]] == [4 * 96 + 26, 30 * 96 + 30]


def painted(sketch, rng):
    """Paint or erase a dab, or a short line of a river, on any layer."""
    name = str(rng.choice(["mountain", "hill", "dune", "forest", "river", "lake", "material"]))
    image = np.array(sketch.layers[name])
    rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
    at, radius = rng.uniform(0, image.shape), 1.5 if name == "river" else rng.uniform(0.6, 7)
    ahead, label = rng.normal(0, 1, 2), rng.integers(0, 3)
    for step in range(20 if name == "river" else 1):
        row, column = at + step * ahead
        image[(rows - row) ** 2 + (columns - column) ** 2 <= radius**2] = label
    return sketch.replace(layers={**sketch.layers, name: image})


def painted_often(rng, strokes, **changes):
    density = {"mountain": 0.01, "hill": 0.2, "forest": 0.1, "dune": 0.01}
    labels = {("mountain", 1): {"multitude": 4}, ("river", 2): {"width": 0.0}, ("hill", 1): {"multitude": 5}}
    layers = {"hill": np.zeros((32, 80), np.uint8)}
    sketches = [Sketch(layers=layers, extent=1600.0, density=density, labels=labels).replace(**changes)]
    for _ in range(strokes):
        sketches.append(painted(sketches[-1], rng))
    return sketches


def recipe_bits(recipe):
    """Every number of a recipe but the world's settings."""
    bits = [recipe.points.painted.tobytes(), recipe.points.fill.within(-2000, -2000, 10_000, 9000).tobytes()]
    for river in recipe.rivers:
        bits += [each.tobytes() for each in vars(river).values() if isinstance(each, np.ndarray)]
    bits += [course.valley_radius.tobytes() for course in recipe[CorridorsLayer].courses]
    bits += [lake.shape.inside.tobytes() + repr((lake.level, lake.depth)).encode() for lake in recipe.lakes]
    return [*bits, repr((recipe.resolutions, recipe.orphans)).encode()]


@pytest.mark.parametrize(
    ("seed", "fidelity", "turns"),
    [
        (0, 0.8, 2),
        pytest.param(5, 1.0, 6, marks=pytest.mark.slow),
        *(pytest.param(*case, 12, marks=pytest.mark.soak) for case in ((1, 0.0), (2, 0.4), (3, 0.8))),
    ],
)
def test_random_strokes_give_the_bits_of_fresh_placements_and_recipes(seed, fidelity, turns):
    rng, cache, run = np.random.default_rng(seed), Results(), Runner()
    sketch = painted_often(rng, 16, fidelity=fidelity)[-1]
    seen = [sketch]
    for turn in range(turns):
        if turn % 5 == 2:
            sketch = seen[int(rng.integers(len(seen)))]  # an undo
        elif turn == 3:
            sketch = sketch.replace(fidelity=0.3)
        else:
            sketch = painted(sketch, rng)
        seen.append(sketch)
        assert place(sketch, seed=1, run=run).tobytes() == place(sketch, seed=1).tobytes(), turn
        assert recipe_bits(make_recipe(sketch, memory=cache)) == recipe_bits(make_recipe(sketch)), turn
