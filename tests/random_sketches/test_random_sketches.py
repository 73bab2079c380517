"""Random sketches: no shape lost, no exception, no warning, no feature outside the bounds of the rules.

A few belong to the default tier, 30 to the slow one, 300 to the soak. Warnings are errors here as everywhere.
Hypothesis draws tiny ones besides, down to a single pixel.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from sketchterrain.features import FEATURE_TYPES, Fill, River, label_shapes, place, trace_rivers
from sketchterrain.features.catalogue import Points
from sketchterrain.features.placement import LOOSENESS
from sketchterrain.features.profiles import shown_at
from sketchterrain.features.rules import LAYER_CODES, TYPES
from sketchterrain.features.shapes import Shape
from sketchterrain.sketch.document import Sketch
from sketchterrain.terrain import make_recipe
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.terrain.reference import reference_heights

COUNT = 300

LEAST_RADIUS = 1.5  # px
LEAST_SHARE = 0.36  # of the label's strength, for which a feature's reach is worked out
ROUNDING = 1 + 1e-5  # radii and strengths are float32

SketchOf = Callable[[int], Sketch]


SAMPLE = range(7, COUNT, 10)
DEFAULT = range(17, 97, 10)
"""One sketch of each main kind in the sample, but for many tiny shapes, which take seconds."""


@pytest.mark.parametrize(
    "number", [n if n in DEFAULT else pytest.param(n, marks=pytest.mark.slow) for n in SAMPLE]
)
def test_shapes_and_features_of_a_sample(sketch_of: SketchOf, number: int) -> None:
    check(sketch_of(number))


@pytest.mark.soak
@pytest.mark.parametrize("first", range(0, COUNT, 25))
def test_shapes_and_features_of_all_others(sketch_of: SketchOf, first: int) -> None:
    for number in range(first, first + 25):
        if number not in SAMPLE:
            try:
                check(sketch_of(number))
            except BaseException as error:
                error.add_note(f"random sketch {number}")
                raise


@st.composite
def tiny_sketches(draw: st.DrawFn) -> Sketch:
    size = draw(st.tuples(st.integers(1, 14), st.integers(1, 14)))
    names = draw(st.sets(st.sampled_from(sorted(LAYER_CODES)), min_size=1))
    labels = st.sampled_from([0, 0, 0, 1, 1, 2])
    layers = {name: draw(arrays.arrays(np.uint8, size, elements=labels)) for name in sorted(names)}
    extent, fidelity = (
        draw(st.sampled_from([1.0, 100.0, 4096.0, 1e6])),
        draw(st.sampled_from([0.0, 0.5, 1.0])),
    )
    seed = draw(st.integers(0, 2**63 - 1))
    return Sketch(extent=extent, seed=seed, fidelity=fidelity, layers=layers, density={"hill": 0.5})


@settings(max_examples=25, deadline=None, derandomize=True)
@given(tiny_sketches())
def test_tiny_sketches_keep_their_shapes_and_are_finite(sketch: Sketch) -> None:
    check_tiny(sketch)


@pytest.mark.slow
@settings(max_examples=120, deadline=None, derandomize=True)
@given(tiny_sketches())
def test_many_tiny_sketches_keep_their_shapes_and_are_finite(sketch: Sketch) -> None:
    check_tiny(sketch)


def rolling(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 10 * np.sin(x / 30) + 10 * np.cos(y / 40)


def check_tiny(sketch: Sketch) -> None:
    placed = place(sketch, seed=sketch.seed)
    for name in TYPES:
        check_points(sketch, name, placed[placed["type"] == FEATURE_TYPES.index(name)])
    check_rivers(sketch, trace_rivers(sketch, seed=sketch.seed, ground=rolling))
    check_fill(Fill(sketch, placed, seed=sketch.seed), -2000.0, -2000.0, 6000.0, 6000.0)


def check(sketch: Sketch) -> None:
    recipe = make_recipe(sketch)
    assert recipe.orphans == ()
    placed = place(sketch, seed=sketch.seed)
    for name in TYPES:
        check_points(sketch, name, placed[placed["type"] == FEATURE_TYPES.index(name)])
    check_strengths(recipe, placed)
    check_rivers(sketch, recipe.rivers)
    check_fields(sketch, recipe)
    (east, north), reach = sketch.size, min(2000.0, sketch.extent)
    check_fill(recipe.fill, -reach, -reach, min(east, reach), min(north, reach))
    check_heights(sketch, recipe)


def pixels_of(ids: np.ndarray, sketch: Sketch) -> tuple[np.ndarray, np.ndarray]:
    """Row and column that an id names."""
    row, column = np.divmod((ids.astype(np.uint64) & np.uint64(2**48 - 1)).astype(np.int64), sketch.width_px)
    return row, column


def number_of_shapes_hit(shapes: tuple[Shape, ...], row: np.ndarray, column: np.ndarray) -> int:
    hit = 0
    for shape in shapes:
        down, across = row - shape.rows.start, column - shape.columns.start
        height, width = shape.mask.shape
        near = (down >= 0) & (down < height) & (across >= 0) & (across < width)
        hit += bool(shape.mask[down[near], across[near]].any())
    return hit


def check_points(sketch: Sketch, name: str, own: Points) -> None:
    """Every shape has a feature; every feature stands where, and is as large and high as, the rules say."""
    rule, image, pixel = TYPES[name], sketch.layers[name], sketch.pixel_size
    shapes = label_shapes(name, image)
    row, column = pixels_of(own["id"], sketch)
    assert np.all(own["id"] >> np.uint64(48) == LAYER_CODES[name])
    assert np.all(image[row, column] > 0)
    assert number_of_shapes_hit(shapes, row, column) == len(shapes)

    for field in own.dtype.names:
        assert np.isfinite(own[field]).all()
    depth = np.zeros(image.shape)
    for shape in shapes:
        depth[shape.rows, shape.columns] += shape.depth
    disc = np.maximum(depth[row, column], 1.0) * pixel
    # A feature reaches farther the lower it is, and the sharper, but not without end.
    shown = shown_at(name, np.array([LEAST_SHARE]), np.array([1.0]), sketch.fidelity)
    assert np.all(own["radius"] <= np.maximum(rule.reach * disc / shown, LEAST_RADIUS * pixel) * ROUNDING)
    assert np.all(own["radius"] >= LEAST_RADIUS * pixel / ROUNDING)

    away = np.hypot(own["x"] - (column + 0.5) * pixel, own["y"] - (sketch.height_px - row - 0.5) * pixel)
    assert np.all(away <= LOOSENESS * (1 - sketch.fidelity) * disc + 1e-9 * sketch.extent)

    key = "density" if name == "forest" else "height"
    asked = np.zeros(256)
    for label in np.unique(image[image > 0]):
        asked[label] = sketch.properties(name, int(label))[key]
    asked = asked[image[row, column]]
    highest = np.minimum(asked * (1 + rule.variation), rule.most_slope * disc)
    assert np.all(own["strength"] <= highest * ROUNDING)
    # A forest may be asked to have no trees at all.
    assert np.all((own["strength"] > 0) | (asked == 0))


def check_strengths(recipe: TerrainRecipe, placed: Points) -> None:
    """The recipe has what was placed and nothing else, with strengths that were solved for."""
    assert np.all(np.diff(placed["id"].astype(np.int64)) > 0)
    for field in ("id", "x", "y", "radius"):
        assert np.array_equal(recipe.painted[field], placed[field])
    assert np.isfinite(recipe.painted["strength"]).all()
    assert np.all(recipe.painted["strength"] >= 0)


def check_rivers(sketch: Sketch, rivers: Sequence[River]) -> None:
    """Every network has a river; water never rises on its way."""
    painted = sketch.layers["river"] > 0
    shapes = label_shapes("river", painted.astype(np.uint8))
    row, column = pixels_of(np.array([river.id for river in rivers], dtype=np.uint64), sketch)
    assert len({river.id for river in rivers}) == len(rivers)
    assert number_of_shapes_hit(shapes, row, column) == len(shapes)
    for river in rivers:
        for values in (river.points, river.centreline, river.centreline_width, river.centreline_depth):
            assert np.isfinite(values).all()
        assert np.all(np.diff(river.centreline[:, 2]) <= 0)
        assert np.all(river.centreline_width > 0)
        assert np.all(river.centreline_depth > 0)


def check_fields(sketch: Sketch, recipe: TerrainRecipe) -> None:
    """Every lake is there, and every cover that is not asked to be invisible."""
    for name, made in (("lake", recipe.lakes), ("material", recipe.covers)):
        row, column = pixels_of(np.array([each.id for each in made], dtype=np.uint64), sketch)
        shapes = tuple(
            shape
            for shape in label_shapes(name, sketch.layers[name])
            if name == "lake" or sketch.properties(name, shape.label)["strength"] > 0
        )
        assert number_of_shapes_hit(shapes, row, column) == len(shapes)
        for each in made:
            assert np.isfinite(each.shape.inside).all()
            assert each.shape.spacing > 0
    for lake in recipe.lakes:
        assert np.isfinite(lake.level)
        assert lake.depth > 0


def check_fill(fill: Fill, west: float, south: float, east: float, north: float) -> None:
    found = fill.within(west, south, east, north)
    for field in found.dtype.names:
        assert np.isfinite(found[field]).all()
    assert np.all(found["radius"] <= fill.max_radius)
    assert np.all(found["radius"] > 0)


def check_heights(sketch: Sketch, recipe: TerrainRecipe) -> None:
    """Some places of the terrain, on and off the sketch: rivers' points among them."""
    rng = np.random.default_rng(sketch.seed)
    at = rng.uniform(-0.1, 1.1, (40, 2)) * sketch.size
    if recipe.rivers:
        at = np.concatenate([at, recipe.rivers[0].centreline[::50, :2][:20]])
    heights = reference_heights(recipe, at[:, 0].copy(), at[:, 1].copy(), cell_size=sketch.extent / 256)
    assert np.isfinite(heights).all()
