"""Random sketches: no shape lost, no exception, no warning, no feature outside the bounds of the rules."""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, StructuredArray
from sketchterrain.document.sketch import Sketch
from sketchterrain.features.table import FeatureTable
from sketchterrain.generation.building import build, make_recipe
from sketchterrain.generation.terrain import Terrain
from sketchterrain.landforms.placement.feature_types import (
    FEATURE_TYPES,
    LAYER_CODES,
    TYPES,
    River,
    visible_radius,
)
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.landforms.placement.heights import shape_height
from sketchterrain.landforms.placement.placement import MAX_DISPLACEMENT, place
from sketchterrain.landforms.placement.shapes import Shape, label_shapes
from sketchterrain.schema.layers import DENSITY, LAYERS, PAINTED_LAYERS
from sketchterrain.schema.parameters import Parameter
from sketchterrain.stages.runner import Results
from sketchterrain.terrain.host_heights import host_heights
from sketchterrain.terrain.layers.covers import CoversLayer
from sketchterrain.terrain.recipe import TerrainRecipe
from tests import terrains
from tests.traced import trace_hydrology

COUNT = 300

Rng = np.random.Generator
Image = npt.NDArray[np.uint8]
Path = list[tuple[float, float]]

AREAS = tuple(name for name in PAINTED_LAYERS if name != "river")


def distances(size, row, column) -> tuple[np.ndarray, np.ndarray]:
    down, across = np.ogrid[: size[0], : size[1]]
    return down - row, across - column


def random_position(rng: Rng, size: tuple[int, int]) -> tuple[float, float]:
    """Return a position, possibly just beyond the edges."""
    return tuple(rng.uniform(-0.1, 1.1, 2) * size)


def blob(rng: Rng, size: tuple[int, int]) -> BoolArray:
    down, across = distances(size, *random_position(rng, size))
    angle = np.arctan2(down, across)
    radius = rng.uniform(0.05, 0.35) * min(size)
    outline = 1.0 + sum(0.3 / k * np.cos(k * angle + rng.uniform(0, 6.3)) for k in range(2, 6))
    return np.hypot(down, across) <= np.maximum(radius * outline, 0.5)


def ring(rng: Rng, size: tuple[int, int]) -> BoolArray:
    distance = np.hypot(*distances(size, *(rng.uniform(0.3, 0.7, 2) * size)))
    radius = rng.uniform(0.15, 0.4) * min(size)
    return np.abs(distance - radius) <= rng.uniform(0.5, 0.2 * radius + 0.5)


def cross(rng: Rng, size: tuple[int, int]) -> BoolArray:
    down, across = distances(size, *(rng.uniform(0.2, 0.8, 2) * size))
    turn, arm = rng.uniform(0, math.pi), rng.uniform(0.1, 0.5) * min(size)
    u = down * math.cos(turn) + across * math.sin(turn)
    v = across * math.cos(turn) - down * math.sin(turn)
    thick = rng.uniform(0.5, 0.3 * arm + 0.5)
    return ((np.abs(u) <= thick) & (np.abs(v) <= arm)) | ((np.abs(v) <= thick) & (np.abs(u) <= arm))


def sliver(rng: Rng, size: tuple[int, int]) -> BoolArray:
    mask = np.zeros(size, np.bool_)
    stroke(mask, [random_position(rng, size), random_position(rng, size)], rng.choice([0.5, 0.7, 1.0, 1.6]))
    return mask


def pixels(rng: Rng, size: tuple[int, int]) -> BoolArray:
    mask = np.zeros(size, np.bool_)
    mask.flat[rng.integers(0, mask.size, int(rng.integers(1, 12)))] = True
    return mask


def corners(rng: Rng, size: tuple[int, int]) -> BoolArray:
    """Single pixels in the corners and along the edge."""
    mask = np.zeros(size, np.bool_)
    for row in (0, -1):
        mask[row, [0, -1, int(rng.integers(size[1]))]] = True
    return mask


def canvas(rng: Rng, size: tuple[int, int]) -> BoolArray:
    mask = np.ones(size, np.bool_)
    if rng.random() < 0.5:  # but for some pinholes
        mask.flat[rng.integers(0, mask.size, 5)] = False
    return mask


def tiny(rng: Rng, size: tuple[int, int], *, count: int = 500) -> BoolArray:
    """Return up to 500 separate shapes of one to six pixels."""
    rows, columns = (np.arange(1, side - 2, 4) for side in size)
    at = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
    mask = np.zeros(size, np.bool_)
    for row, column in at[rng.permutation(len(at))[:count]]:
        mask[row : row + rng.integers(1, 3), column : column + rng.integers(1, 4)] = True
    return mask


def checkers(rng: Rng, size: tuple[int, int]) -> BoolArray:
    """Return squares that touch at their corners, so that they are one shape."""
    side = int(rng.integers(1, 9))
    down, across = distances(size, 0, 0)
    return (down // side + across // side) % 2 == 0


def stroke(mask: BoolArray, path: Path, radius: float) -> None:
    """Draw a polyline with a round brush."""
    for (row, column), (to_row, to_column) in pairwise(path):
        steps = 2 * math.ceil(math.hypot(to_row - row, to_column - column)) + 1
        for t in np.linspace(0, 1, steps):
            r, c = row + t * (to_row - row), column + t * (to_column - column)
            reach = math.ceil(radius)
            top, left = max(round(r) - reach, 0), max(round(c) - reach, 0)
            window = mask[top : round(r) + reach + 1, left : round(c) + reach + 1]
            down, across = np.ogrid[: window.shape[0], : window.shape[1]]
            window |= (down + top - round(r)) ** 2 + (across + left - round(c)) ** 2 <= radius**2


def wander(rng: Rng, size: tuple[int, int], start: tuple[float, float], heading: float, steps: int) -> Path:
    path, stride = [start], 0.06 * max(size)
    for _ in range(steps):
        heading += rng.uniform(-0.6, 0.6)
        row, column = path[-1]
        path.append((row + stride * math.sin(heading), column + stride * math.cos(heading)))
    return path


def brush(rng: Rng) -> float:
    return float(rng.choice([0.5, 1.0, 1.5, 3.0]))


def off_edge(rng: Rng, size: tuple[int, int]) -> BoolArray:
    mask = np.zeros(size, np.bool_)
    stroke(mask, wander(rng, size, (rng.uniform(0, size[0]), 0.0), 0.0, 24), brush(rng))
    return mask


def branching(rng: Rng, size: tuple[int, int]) -> BoolArray:
    mask, radius = np.zeros(size, np.bool_), brush(rng)
    stem = wander(rng, size, (0.5 * size[0], 0.1 * size[1]), 0.0, 14)
    stroke(mask, stem, radius)
    for _ in range(int(rng.integers(1, 5))):
        joint = stem[int(rng.integers(1, len(stem)))]
        side = rng.choice([-1.0, 1.0])
        stroke(mask, wander(rng, size, joint, math.pi + side * rng.uniform(0.5, 1.3), 7), radius)
    return mask


def looping(rng: Rng, size: tuple[int, int]) -> BoolArray:
    """A closed loop, with or without a river into it and out of it."""
    mask, radius = np.zeros(size, np.bool_), brush(rng)
    middle, reach = (0.5 * size[0], 0.5 * size[1]), rng.uniform(0.08, 0.3) * min(size)
    angles = np.linspace(0, 2 * math.pi, 24)
    stroke(mask, [(middle[0] + reach * math.sin(a), middle[1] + reach * math.cos(a)) for a in angles], radius)
    for side in (-1, 1)[: int(rng.integers(0, 3))]:
        edge = (rng.uniform(0, size[0]), 0.0 if side < 0 else size[1])
        stroke(mask, [(middle[0], middle[1] + side * reach), edge], radius)
    return mask


def touching_itself(rng: Rng, size: tuple[int, int]) -> BoolArray:
    """A meander so tight that its bends touch, or a figure of eight."""
    mask, t = np.zeros(size, np.bool_), np.linspace(0, 1, 160)
    if rng.random() < 0.5:
        row, column = 0.5 + 0.3 * np.sin(4 * math.pi * t), 0.5 + 0.4 * np.sin(2 * math.pi * t)
    else:
        row, column = 0.5 + 0.35 * np.sin(18 * math.pi * t), 0.05 + 0.9 * t + 0.04 * np.sin(36 * math.pi * t)
    stroke(mask, list(zip(row * size[0], column * size[1], strict=True)), brush(rng))
    return mask


def dabs(rng: Rng, size: tuple[int, int]) -> BoolArray:
    """Return fewer than 500: every lake is routed on the terrain."""
    return tiny(rng, size, count=60)


def flooded(rng: Rng, size: tuple[int, int]) -> BoolArray:
    """Return the whole canvas or a blob."""
    return canvas(rng, size) if rng.random() < 0.2 else blob(rng, size)


AREA_KINDS = (blob, ring, cross, sliver, pixels, corners, canvas, tiny, checkers)
RIVER_KINDS = (branching, looping, touching_itself, off_edge, flooded, sliver, pixels, dabs)
KINDS = len(AREA_KINDS) + len(RIVER_KINDS) + 1


def random_sketch(number: int) -> Sketch:
    """Return sketch `number`: its main kind cycles through all, the rest is random."""
    rng = np.random.default_rng([20261121, number])
    size = random_size(rng, number)
    layers = {name: np.zeros(size, np.uint8) for name in PAINTED_LAYERS}
    main = number % KINDS
    if main < len(AREA_KINDS):
        for name in rng.choice(AREAS, int(rng.integers(1, 4)), replace=False):
            kind = dabs if name == "lake" and AREA_KINDS[main] is tiny else AREA_KINDS[main]
            paint(rng, layers[name], kind, times=int(kind in (tiny, dabs)))
    elif main < KINDS - 1:
        kind = RIVER_KINDS[main - len(AREA_KINDS)]
        paint(rng, layers["river"], kind, times=int(kind is dabs))
    else:  # a river across mountains
        paint(rng, layers["mountain"], blob, times=3)
        paint(rng, layers["river"], off_edge)
    for _ in range(int(rng.integers(0, 4))):
        name = str(rng.choice(PAINTED_LAYERS))
        kinds = RIVER_KINDS[:4] if name == "river" else AREA_KINDS[:6]
        paint(rng, layers[name], kinds[int(rng.integers(len(kinds)))])
    extent = float(rng.choice([50.0, 1000.0, 4096.0, 12000.0, 3e5]))
    return Sketch(
        # Rivers are drawn in steps of metres, so that hundreds of kilometres of them take minutes.
        extent=min(extent, 4096.0) if layers["river"].any() else extent,
        seed=int(rng.integers(2**63)),
        fidelity=float(rng.choice([0.0, 0.4, 0.8, 0.8, 1.0])),
        density={name: float(rng.choice([0.0, 0.0, 0.3])) for name in DENSITY},
        layers=layers,
        labels={
            (name, int(label)): {
                key: random_value(rng, each) for key, each in LAYERS[name].parameters.items()
            }
            for name, image in layers.items()
            for label in np.unique(image[image > 0])
            if rng.random() < 0.6
        },
    )


def random_size(rng: Rng, number: int) -> tuple[int, int]:
    if number % 50 == 49:
        return 512, 512
    longer = int(rng.integers(64, 193))
    shorter = longer if rng.random() < 0.5 else int(rng.integers(1 + longer // 12, longer + 1))
    return (longer, shorter) if rng.random() < 0.5 else (shorter, longer)


def paint(
    rng: Rng, image: Image, kind: Callable[[Rng, tuple[int, int]], BoolArray], *, times: int = 0
) -> None:
    for _ in range(times or int(rng.integers(1, 4))):
        image[kind(rng, image.shape)] = rng.choice([1, 1, 2, 3, 255])


def random_value(rng: Rng, parameter: Parameter) -> object:
    """Return the default, either bound, or a value between."""
    if parameter.choices:
        return str(rng.choice(parameter.choices))
    low, high = float(parameter.low), float(parameter.high)
    between = low + (high - low) * rng.random() ** 4
    value = rng.choice([float(parameter.default), float(parameter.default), low, high, between])
    return int(value) if parameter.kind is int else float(value)


LEAST_RADIUS = 1.5  # px
LEAST_SHARE = 0.36  # of the label's strength, from which a feature's radius is derived
ROUNDING = 1 + 1e-5  # radii and strengths are float32

DEFAULT = (17,)  # a river across mountains
SAMPLE = range(17, 97, 10)
"""One sketch of each of eight main kinds; hundreds of tiny shapes take too long."""


@pytest.mark.parametrize(
    "number", [n if n in DEFAULT else pytest.param(n, marks=pytest.mark.slow) for n in SAMPLE]
)
def test_shapes_and_features_of_a_sample(number) -> None:
    check(random_sketch(number))


@pytest.mark.soak
@pytest.mark.parametrize("first", range(0, COUNT, 25))
def test_shapes_and_features_of_all_others(first) -> None:
    for number in range(first, first + 25):
        if number not in SAMPLE:
            try:
                check(random_sketch(number))
            except BaseException as error:
                error.add_note(f"random sketch {number}")
                raise


WATERY = 500
OVER_WATER = 0.01  # m, of the ground at points of rivers
STANDING = 0.3  # m, of water in which trees and shrubs stand; reeds do in deeper water
CROSSING, STEEP = 200.0, 0.1  # m; of the fall to the next point


def watery_sketch(number: int) -> Sketch:
    """Return sketch `number` of rivers, lakes, seas and roads on any ground, of 0.3 to 300 km."""
    rng = np.random.default_rng([20261129, number])
    size = int(rng.integers(48, 129)), int(rng.integers(48, 129))
    layers = {name: np.zeros(size, np.uint8) for name in PAINTED_LAYERS}
    shares = {"river": 0.95, "lake": 0.7, "sea": 0.3, "mountain": 0.5, "hill": 0.5, "plateau": 0.3}
    for name, share in {**shares, "dune": 0.2, "forest": 0.4}.items():
        if rng.random() < share:
            kinds = RIVER_KINDS[:4] if name == "river" else AREA_KINDS[:4]
            paint(rng, layers[name], kinds[int(rng.integers(4))], times=int(rng.integers(1, 3)))
    extent = 300.0 * 1000.0 ** rng.random()
    labels = {
        (name, label): {key: random_value(rng, each) for key, each in LAYERS[name].parameters.items()}
        for name in shares
        for label in (1, 2)
        if rng.random() < 0.5
    }
    sketch = Sketch(extent=extent, seed=int(rng.integers(2**63)), layers=layers, labels=labels)
    if rng.random() < 0.5:
        return sketch
    paths = [rng.uniform(0.02, 0.98, (int(rng.integers(2, 6)), 2)) * sketch.size for _ in range(2)]
    roads = FeatureTable.from_shapes("road", np.array([shapely.LineString(each) for each in paths], object))
    return sketch.replace(vectors={"road": roads})


@pytest.mark.parametrize("number", [1, pytest.param(448, marks=pytest.mark.slow)])
def test_water_of_a_sample(number) -> None:
    check_watery(number)


@pytest.mark.soak
@pytest.mark.parametrize("first", range(0, WATERY, 25))
def test_water_of_all_others(first) -> None:
    for number in range(first, first + 25):
        check_watery(number)


def check_watery(number: int) -> None:
    try:
        sketch, memory = watery_sketch(number), Results()
        natural = make_recipe(sketch.replace(vectors={}), memory=memory)
        check_ground_under_rivers(sketch, natural)
        check_recipe(sketch, natural)
        check_plants(build(sketch, device=terrains.context(), memory=memory))
    except BaseException as error:
        error.add_note(f"watery sketch {number}")
        raise


def check_ground_under_rivers(sketch: Sketch, recipe: TerrainRecipe) -> None:
    """The ground of no river is above its water in the sketch, but where courses of other levels cross.

    Where a river as wide as a town falls by metres from one point to the next, the ground is their mean.
    """
    courses = np.array([shapely.LineString(each.centreline[:, :2]) for each in recipe.rivers], object)
    one, other = shapely.STRtree(courses).query(courses, predicate="crosses")
    crossings = shapely.union_all(shapely.intersection(courses[one], courses[other]))
    for each in recipe.rivers:
        line, fall = each.centreline, -np.gradient(each.centreline[:, 2])
        inside = ((line[:, :2] >= 0.0) & (line[:, :2] <= sketch.size)).all(axis=1)
        inside &= ~shapely.dwithin(crossings, shapely.points(line[:, :2]), CROSSING)
        if inside.any():
            over = host_heights(recipe, *line[inside, :2].T) - line[inside, 2] - STEEP * fall[inside]
            assert over.max() <= OVER_WATER, (each.id, line[inside][np.argmax(over)])


def check_plants(terrain: Terrain) -> None:
    """Heights are finite; no tree or shrub stands in deep water, around some rivers, lakes and seas."""
    rng, sketch, recipe = np.random.default_rng(terrain.sketch.seed), terrain.sketch, terrain.recipe
    # Points of waters with their levels, and how far water reaches around them at least: banks sway.
    waters = [(river.centreline, 0.35 * river.centreline_width) for river in recipe.rivers[:3]]
    fields = [
        (lake.shape.inside > 0, lake.shape.west, lake.shape.south, lake.shape.spacing, lake.level)
        for lake in recipe.lakes[:2]
    ]
    if recipe.sea_level is not None:
        half = 0.5 * sketch.pixel_size
        fields.append((sketch.layers["sea"][::-1] > 0, half, half, 2 * half, recipe.sea_level))
    for mask, west, south, spacing, level in fields:
        row, column = np.nonzero(mask)
        points = [west + spacing * column, south + spacing * row, np.full(len(row), level)]
        waters.append((np.column_stack(points), np.full(len(row), 0.5 * spacing)))
    for points, reach in waters:
        x, y, _ = points[rng.integers(len(points))] if len(points) else (0.0, 0.0, 0.0)
        plants = terrain.foliage(x - 60.0, y - 60.0, x + 60.0, y + 60.0)
        assert np.isfinite(plants["z"]).all()
        if len(plants) and len(points):
            away, nearest = cKDTree(points[:, :2]).query(np.column_stack([plants["x"], plants["y"]]))
            depth = (points[nearest, 2] - plants["z"])[away < reach[nearest]]
            assert depth.max(initial=-np.inf) <= STANDING, (x, y)
    assert np.isfinite(terrain.heights(*(rng.uniform(-0.1, 1.1, (500, 2)) * terrain.size).T)).all()


@st.composite
def tiny_sketches(draw: st.DrawFn) -> Sketch:
    size = draw(st.tuples(st.integers(1, 14), st.integers(1, 14)))
    names = draw(st.sets(st.sampled_from(sorted(PAINTED_LAYERS)), min_size=1))
    labels = st.sampled_from([0, 0, 0, 1, 1, 2])
    layers = {name: draw(arrays.arrays(np.uint8, size, elements=labels)) for name in sorted(names)}
    extent = draw(st.sampled_from([1.0, 100.0, 4096.0, 1e6]))
    fidelity, seed = draw(st.sampled_from([0.0, 0.5, 1.0])), draw(st.integers(0, 2**63 - 1))
    return Sketch(extent=extent, seed=seed, fidelity=fidelity, layers=layers, density={"hill": 0.5})


@pytest.mark.parametrize("examples", [6, pytest.param(15, marks=pytest.mark.slow)])
def test_tiny_sketches_keep_their_shapes_and_are_finite(examples) -> None:
    settings(max_examples=examples, derandomize=True)(given(tiny_sketches())(check_tiny))()


def rolling(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 10 * np.sin(x / 30) + 10 * np.cos(y / 40)


def check_tiny(sketch: Sketch) -> None:
    placed = check_placed(sketch)
    check_rivers(sketch, trace_hydrology(sketch, seed=sketch.seed, ground=rolling).rivers)
    check_fill(Fill.from_sketch(sketch, placed, seed=sketch.seed), -2000.0, -2000.0, 6000.0, 6000.0)


def check(sketch: Sketch) -> None:
    check_recipe(sketch, make_recipe(sketch))


def check_recipe(sketch: Sketch, recipe: TerrainRecipe) -> None:
    assert recipe.orphans == ()
    check_strengths(recipe, check_placed(sketch))
    check_rivers(sketch, recipe.rivers)
    check_fields(sketch, recipe)
    (east, north), reach = sketch.size, min(2000.0, sketch.extent)
    check_fill(recipe.points.fill, -reach, -reach, min(east, reach), min(north, reach))
    check_heights(sketch, recipe)


def pixels_of(ids: np.ndarray, sketch: Sketch) -> tuple[np.ndarray, np.ndarray]:
    """Return the row and column of ids."""
    return np.divmod((ids.astype(np.uint64) & np.uint64(2**48 - 1)).astype(np.int64), sketch.width_px)


def number_of_shapes_hit(shapes: tuple[Shape, ...], row: np.ndarray, column: np.ndarray) -> int:
    hit = 0
    for shape in shapes:
        down, across = row - shape.rows.start, column - shape.columns.start
        height, width = shape.mask.shape
        near = (down >= 0) & (down < height) & (across >= 0) & (across < width)
        hit += bool(shape.mask[down[near], across[near]].any())
    return hit


def check_placed(sketch: Sketch) -> StructuredArray:
    placed = place(sketch, seed=sketch.seed)
    for name in TYPES:
        check_points(sketch, name, placed[placed["type"] == FEATURE_TYPES.index(name)])
    return placed


def check_points(sketch: Sketch, name: str, own: StructuredArray) -> None:
    """Every shape has a feature; every feature has a position, radius and strength within the rules."""
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
    # A feature's radius grows the lower and the sharper it is, but is bounded.
    visible = visible_radius(name, np.array([LEAST_SHARE]), np.array([1.0]), sketch.fidelity)
    assert np.all(
        own["radius"] <= np.maximum(rule.radius_ratio * disc / visible, LEAST_RADIUS * pixel) * ROUNDING
    )
    assert np.all(own["radius"] >= LEAST_RADIUS * pixel / ROUNDING)

    displacement = np.hypot(
        own["x"] - (column + 0.5) * pixel, own["y"] - (sketch.height_px - row - 0.5) * pixel
    )
    assert np.all(displacement <= MAX_DISPLACEMENT * (1 - sketch.fidelity) * disc + 1e-9 * sketch.extent)

    requested = np.zeros(image.shape)
    for shape in shapes:
        properties = sketch.properties(name, shape.label)
        if name in ("mountain", "hill"):
            most = shape_height(properties, shape.depth.max() * pixel, sketch.fidelity).built
        else:
            most = properties["density" if name == "forest" else "height"]
        requested[shape.pixels(shape.mask)] = most
    requested = requested[row, column]
    highest = requested if name in ("mountain", "hill") else np.minimum(requested, rule.max_slope * disc)
    assert np.all(own["strength"] <= highest * ROUNDING)
    # A forest may have density 0.
    assert np.all((own["strength"] > 0) | (requested == 0))


def check_strengths(recipe: TerrainRecipe, placed: StructuredArray) -> None:
    """The recipe has exactly the placed features, with solved strengths."""
    assert np.all(np.diff(placed["id"].astype(np.int64)) > 0)
    for field in ("id", "x", "y", "radius"):
        assert np.array_equal(recipe.points.painted[field], placed[field])
    assert np.isfinite(recipe.points.painted["strength"]).all()
    assert np.all(recipe.points.painted["strength"] >= 0)


def check_rivers(sketch: Sketch, rivers: Sequence[River]) -> None:
    """Every network outside the sea has a river; water never rises downstream."""
    painted = sketch.layers["river"] > 0
    shapes = label_shapes("river", painted.astype(np.uint8))
    row, column = pixels_of(np.array([river.id for river in rivers], dtype=np.uint64), sketch)
    assert len({river.id for river in rivers}) == len(rivers)
    found = number_of_shapes_hit(shapes, row, column)
    assert found <= len(shapes) if sketch.layers["sea"].any() else found == len(shapes)
    for river in rivers:
        for values in (river.points, river.centreline, river.centreline_width, river.centreline_depth):
            assert np.isfinite(values).all()
        assert np.all(np.diff(river.centreline[:, 2]) <= 0)
        assert np.all(river.centreline_width > 0)
        assert np.all(river.centreline_depth > 0)


def check_fields(sketch: Sketch, recipe: TerrainRecipe) -> None:
    """Every lake outside the sea exists, and every cover with a strength above 0."""
    for name, fields in (("lake", recipe.lakes), ("material", recipe[CoversLayer].covers)):
        row, column = pixels_of(np.array([each.id for each in fields], dtype=np.uint64), sketch)
        shapes = tuple(
            shape
            for shape in label_shapes(name, sketch.layers[name])
            if name == "lake" or sketch.properties(name, shape.label)["strength"] > 0
        )
        found = number_of_shapes_hit(shapes, row, column)
        may_be_drowned = name == "lake" and sketch.layers["sea"].any()
        assert found <= len(shapes) if may_be_drowned else found == len(shapes)
        for each in fields:
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
    """Heights are finite at random points and at points of rivers."""
    rng = np.random.default_rng(sketch.seed)
    at = rng.uniform(-0.1, 1.1, (40, 2)) * sketch.size
    if recipe.rivers:
        at = np.concatenate([at, recipe.rivers[0].centreline[::50, :2][:20]])
    heights = host_heights(recipe, at[:, 0].copy(), at[:, 1].copy(), cell_size=sketch.extent / 256)
    assert np.isfinite(heights).all()
