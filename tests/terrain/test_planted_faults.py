"""Planted faults: each part of a recipe is left out of what its changes are found by, and that is noticed.

A part is a field of the world, of a layer's key, or of its items. A recipe with another value of this part
alone must be updated right, and wrong as soon as the part is left out. Parts without any effect are named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from itertools import chain, pairwise
from typing import Any

import numpy as np
import pytest

from sketchterrain.features.table import AREA, LINE, Feature, FeatureTable
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry import box_index as row_differences
from sketchterrain.landforms.placement.feature_types import FEATURE, FEATURE_TYPES
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.landuse.areas import LandUse
from sketchterrain.schema.layers import CROPS, DENSITY
from sketchterrain.terrain.centrelines import PreparedCentreline
from sketchterrain.terrain.layers import corridors, relief
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.layers.dunes import DunesLayer
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.layer import TerrainLayer, WorldSettings
from sketchterrain.terrain.layers.points import PointsLayer
from sketchterrain.terrain.layers.relief import ReliefLayer, UnpaintedNodes
from sketchterrain.terrain.recipe import EVERYWHERE, TerrainRecipe

from .conftest import tiers
from .sketch_edits import random_sketch
from .terrain_samples import Samples, differences, samples_of
from .test_updates import SEQUENCES, random_sequence, sequence, walk

Path = tuple[str, ...]
Plant = Callable[[pytest.MonkeyPatch], None]
Sampled = dict[str, Samples]
CourseChange = Callable[[np.ndarray, PreparedCentreline], tuple[np.ndarray, PreparedCentreline]]


@dataclass(frozen=True, eq=False)
class Part:
    """A part of recipes: how to change it alone, and how to leave it out of the comparison of recipes."""

    name: str
    changed: Callable[[TerrainRecipe], TerrainRecipe]
    left_out: Plant
    has_effect: bool = True  # on any height, normal or weight
    value: Callable[[TerrainRecipe], Any] | None = None  # unless it is found from other parts


_WITHOUT_EFFECT = ("id", "label", "area", "layer", "leg", "part", "trees", "ends", "building", "deepest")
"""Fields of items that name them, that are only drawn or exported, or only bound what is omitted."""

_DERIVED = ("extent", "size", "near", "conifers")
"""Fields of the fill that say what is kept in memory, or that its rules have, too."""


def other_value(value: Any) -> Any:
    """Return another value of the same type."""
    if isinstance(value, bool | np.bool_):
        return not value
    if isinstance(value, int | np.integer):
        return value - 1 if value > 0 else 1
    if isinstance(value, float | np.floating):
        return 0.8 * value if value else 0.5
    if isinstance(value, np.ndarray):
        return ~value if value.dtype == bool else (0.8 * value).astype(value.dtype)
    if isinstance(value, str):
        return "rock" if value != "rock" else "sand"
    if isinstance(value, tuple) and isinstance(value[0], str):
        return value[::-1]
    if isinstance(value, tuple):
        return value[:-1] if is_dataclass(value[0]) else tuple(other_value(each) for each in value)
    raise TypeError(type(value))


def constant(value: Any) -> Any:
    """Return a value that depends on the type, and on the size of an array, only."""
    if isinstance(value, np.ndarray):
        return np.zeros_like(value)
    return None if value is None else type(value)()


def _is_named_tuple(value: Any) -> bool:
    return isinstance(value, tuple) and hasattr(value, "_fields")


def mapped(value: Any, path: Path, function: Callable[[Any], Any]) -> Any:
    """Return a value with a function applied to the part at a path of fields and keys, of all items."""
    if not path:
        return function(value)
    if _is_named_tuple(value):
        return value._replace(**{path[0]: mapped(getattr(value, path[0]), path[1:], function)})
    if isinstance(value, tuple):
        return tuple(mapped(each, path, function) for each in value)
    if value is None:
        return None
    if is_dataclass(value):
        return replace(value, **{path[0]: mapped(getattr(value, path[0]), path[1:], function)})
    return {**value, path[0]: mapped(value[path[0]], path[1:], function)}


def at_path(value: Any, path: Path) -> Any:
    """Return the part of a value at a path, a list of those of all items."""
    if path and isinstance(value, tuple) and not _is_named_tuple(value):
        return [at_path(each, path) for each in value]
    if not path or value is None:
        return value
    has_fields = is_dataclass(value) or _is_named_tuple(value)
    return at_path(getattr(value, path[0]) if has_fields else value[path[0]], path[1:])


def are_equal(one: Any, other: Any) -> bool:
    """Return whether two values that may hold arrays are equal."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(are_equal(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(are_equal, one, other))
    return bool(one == other)


def paths(value: Any) -> Iterator[Path]:
    """Return the paths of all values in dataclasses, mappings and tuples of these."""
    if isinstance(value, tuple) and value and is_dataclass(value[0]):
        yield from paths(value[0])
    elif _is_named_tuple(value):
        for name in value._fields:
            yield from ((name, *rest) for rest in paths(getattr(value, name)))
    elif is_dataclass(value):
        for each in fields(value):
            yield from ((each.name, *rest) for rest in paths(getattr(value, each.name)))
    elif isinstance(value, dict) or hasattr(value, "items"):
        for key in value:
            yield from ((key, *rest) for rest in paths(value[key]))
    else:
        yield ()


def key_part(kind: type[TerrainLayer], path: Path) -> Part:
    """Return a field of a layer's key, or a part of one."""
    key = kind.key

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setattr(kind, "key", lambda layer: key(mapped(layer, path, lambda _: None)))

    return Part(
        ".".join((kind.name, *path)),
        lambda recipe: recipe.with_layers([mapped(recipe[kind], path, other_value)]),
        plant,
        value=lambda recipe: at_path(recipe[kind], path),
    )


def global_part(path: Path) -> Part:
    """Return a part of a recipe outside of its layers."""
    key = TerrainRecipe.key

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setattr(TerrainRecipe, "key", lambda recipe: key(mapped(recipe, path, constant)))

    return Part(
        ".".join(path),
        lambda recipe: mapped(recipe, path, other_value),
        plant,
        value=lambda recipe: at_path(recipe, path),
    )


def materials_part() -> Part:
    """Return the table of materials, changed by one more."""

    def changed(recipe: TerrainRecipe) -> TerrainRecipe:
        table = recipe.materials.materials
        more = replace(table[-1], name="another")
        return replace(recipe, materials=replace(recipe.materials, materials=(*table, more)))

    return replace(global_part(("materials",)), changed=changed)


def item_part(kind: type[TerrainLayer], names: Sequence[str], path: Path) -> Part:
    """Return a part of items in some fields of a layer."""
    items = kind.items

    def mapped_items(layer: TerrainLayer, function: Callable[[Any], Any]) -> TerrainLayer:
        return replace(layer, **{name: mapped(getattr(layer, name), path, function) for name in names})

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setattr(kind, "items", lambda layer, world: items(mapped_items(layer, constant), world))

    return Part(
        ".".join((kind.name, *names, *path)),
        lambda recipe: recipe.with_layers([mapped_items(recipe[kind], other_value)]),
        plant,
        path[-1] not in _WITHOUT_EFFECT,
        lambda recipe: [at_path(getattr(recipe[kind], name), path) for name in names],
    )


def item_parts(layer: TerrainLayer) -> Iterator[Part]:
    """Return all parts of a layer's items; its fields of one kind share their grid."""
    names = [each.name for each in fields(layer) if each.metadata.get("items")]
    for path in paths(getattr(layer, names[0])) if names else ():
        if path[-1] == "beside":  # elevation data: tests/terrain/test_base_layer.py
            continue
        if path[-1] == "inside":
            yield from (item_part(type(layer), [name], path) for name in names)
        else:
            yield item_part(type(layer), names, path)


def feature_part(column: str) -> Part:
    """Return a column of point features; one feature that has it gets another's value, or another one.

    Mountains and hills have their effect through the painted nodes.
    """
    relief = [FEATURE_TYPES.index(name) for name in ("mountain", "hill")]

    def changed(recipe: TerrainRecipe) -> TerrainRecipe:
        painted = recipe.points.painted.copy()
        has_it = (painted[column] > 0) & ~np.isin(painted["type"], relief)
        has_it = has_it if has_it.any() else painted[column] > 0
        of_one = painted[painted["type"] == painted["type"][np.argmax(has_it)]]
        if column == "id":  # stays unique and sorted
            of_one = of_one[~np.isin(of_one["id"] + 1, painted["id"])]
            others = of_one["id"][:1] + 1
        else:
            others = of_one[column][of_one[column] != of_one[column][0]]
        row = int(np.searchsorted(painted["id"], of_one["id"][0]))
        painted[column][row] = others[0] if len(others) else other_value(of_one[column][0])
        return recipe.with_layers([replace(recipe.points, painted=painted)])

    def plant(patch: pytest.MonkeyPatch) -> None:
        words = row_differences._words

        def without(rows: np.ndarray) -> np.ndarray:
            rows = rows.copy()
            rows[column] = 0
            return words(rows)

        patch.setattr(row_differences, "_words", without)

    has_effect = column not in {"id", "painted", "peakiness", "erosion", "strata"}
    return Part(f"points.{column}", changed, plant, has_effect, lambda recipe: recipe.points.painted[column])


def moved(painted: np.ndarray, unpainted: np.ndarray) -> np.ndarray:
    """Return painted features on top of unpainted ones, which these keep their distance from."""
    painted = painted.copy()
    number = np.arange(len(painted)) % len(unpainted)
    painted["x"], painted["y"] = unpainted["x"][number], unpainted["y"][number]
    return painted


def fill_part(name: str) -> Part:
    """Return a field of the features of unpainted areas."""
    difference = Fill.difference

    def changed(recipe: TerrainRecipe) -> TerrainRecipe:
        fill = recipe.points.fill
        values = {
            "rules": {key: replace(rule, high=0.8 * rule.high) for key, rule in fill.rules.items()},
            "painted": moved(fill.painted, fill.within(0.0, 0.0, *fill.size)),
            "images": {},
            "replaced": fill.within(0.0, 0.0, *fill.size)[::2],
            "near": None,
        }
        value = values[name] if name in values else other_value(getattr(fill, name))
        return recipe.with_layers([replace(recipe.points, fill=replace(fill, **{"near": None, name: value}))])

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setattr(
            Fill, "difference", lambda old, new: difference(old, replace(new, **{name: getattr(old, name)}))
        )

    return Part(
        f"fill.{name}", changed, plant, name not in _DERIVED, lambda recipe: getattr(recipe.points.fill, name)
    )


def land_part(name: str) -> Part:
    """Return a column of areas of land use."""
    difference = LandUse.difference

    def changed(recipe: TerrainRecipe) -> TerrainRecipe:
        layer = recipe[LandUseLayer]
        value = getattr(layer.areas, name)
        ploughed = CROPS.index("ploughed")
        other = {"use": (value + 1) % 4, "crop": np.where(value == ploughed, 1, ploughed)}.get(
            name, 0.8 * value
        )
        moved = value + 3.0 if name == "edges" else other
        areas = replace(layer.areas, **{name: moved.astype(value.dtype)})
        return recipe.with_layers([replace(layer, areas=areas)])

    def without(new: LandUse, old: LandUse) -> Any:
        return difference(replace(new, **{name: getattr(old, name)}), old)

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setattr(LandUse, "difference", without)

    has_effect = name not in ("direction", "conifers", "parcels")  # only on plants and colours
    value = lambda recipe: getattr(recipe[LandUseLayer].areas, name)  # noqa: E731
    return Part(f"land use.{name}", changed, plant, has_effect, value)


def style_part() -> Part:
    """Return the styles of dunes, changed with those of the features that have them."""

    def changed(recipe: TerrainRecipe) -> TerrainRecipe:
        painted = recipe.points.painted.copy()
        painted["wavelength"][painted["wavelength"] == painted["wavelength"].max()] *= 0.8
        points = replace(recipe.points, painted=painted)
        return recipe.with_layers([points, DunesLayer(points.dune_styles)])

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setattr(DunesLayer, "items", TerrainLayer.items)

    return Part("dunes.styles", changed, plant, value=lambda recipe: recipe[DunesLayer].styles)


def course_change(change: CourseChange) -> Callable[[TerrainRecipe], TerrainRecipe]:
    return lambda recipe: recipe.with_layers(
        [with_courses(recipe[CorridorsLayer], change, recipe.world.unit)]
    )


def with_courses(layer: CorridorsLayer, change: CourseChange, unit: float) -> CorridorsLayer:
    """Return a layer with changed rivers, whose pieces are found again."""
    courses = []
    for course in layer.courses:
        anchor, line = change(course.anchor, course.line)
        pieces = corridors._pieces(anchor, line, unit)
        courses.append(replace(course, anchor=anchor, line=line, pieces=pieces))
    return replace(layer, courses=tuple(courses))


def course_part(name: str, changed: CourseChange, without: CourseChange) -> Part:
    """Return an input of the arcs of rivers."""
    items = CorridorsLayer.items

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setattr(
            CorridorsLayer,
            "items",
            lambda layer, world: items(with_courses(layer, without, world.unit), world),
        )

    return Part(f"corridors.{name}", course_change(changed), plant)


def line_part(path: Path, changed: Callable[[Any], Any], constant: Callable[[Any], Any]) -> Part:
    """Return a field of prepared centrelines."""

    def on_line(function: Callable[[Any], Any]) -> CourseChange:
        return lambda anchor, line: (anchor, mapped(line, path, function))

    return course_part(path[-1], on_line(changed), on_line(constant))


def column_part(column: int) -> Part:
    """Return a column of the samples of prepared centrelines."""

    def with_column(function: Callable[[np.ndarray], Any]) -> CourseChange:
        def change(anchor: np.ndarray, line: PreparedCentreline) -> tuple[np.ndarray, PreparedCentreline]:
            samples = line.line.copy()
            samples[:, column] = function(samples[:, column])
            return anchor, replace(line, line=samples)

        return change

    # Positions stay next to the curve.
    changed = (lambda position: position + 0.2) if column < 2 else other_value
    return course_part(f"column {column}", with_column(changed), with_column(np.zeros_like))


def parts_of(recipe: TerrainRecipe) -> list[Part]:
    """Return all parts that the terrain of a recipe depends on."""
    found = [global_part(("world", each.name)) for each in fields(WorldSettings)]
    found += [global_part(("climate", key)) for key in recipe.climate]
    found += [global_part(("material_rules",)), materials_part()]
    for layer in recipe.layers:
        own = [each.name for each in fields(layer) if not each.metadata.get("items")]
        for name in own:
            if getattr(layer, name) is None:  # elevation data: tests/terrain/test_base_layer.py
                continue
            if (layer.name, name) == ("roads", "materials"):  # its items hold their numbers
                continue
            parts = paths(getattr(layer, name)) if isinstance(layer, ReliefLayer) else [()]
            found += [key_part(type(layer), (name, *part)) for part in parts]
        if not isinstance(layer, PointsLayer | CorridorsLayer | DunesLayer | LandUseLayer):
            found += item_parts(layer)
    found += [style_part()]
    found += [
        land_part(name) for name in ("use", "crop", "direction", "density", "conifers", "parcels", "edges")
    ]
    found += [feature_part(column) for column in FEATURE.names]
    found += [fill_part(each.name) for each in fields(Fill)]
    found += [
        course_part(
            "anchor", lambda anchor, line: (anchor + 40_000, line), lambda anchor, line: (0 * anchor, line)
        ),
        line_part(("curve",), lambda curve: curve + np.array([0, 20.0, -20.0, 0]), np.zeros_like),
        line_part(
            ("along",),
            lambda along: along[-1] * (along / along[-1]) ** 1.01,
            lambda along: np.linspace(0, along[-1], len(along)),
        ),
        line_part(("anchors",), np.ones_like, np.zeros_like),
        line_part(("steep",), np.zeros_like, np.zeros_like),
        line_part(("river", "centreline_width"), lambda width: 0.01 * width, np.zeros_like),
        *(column_part(column) for column in range(6)),
    ]
    return found


@pytest.fixture(scope="module")
def terrain(context) -> Terrain:
    """Return a terrain with shapes in every layer, features elsewhere, dunes of two styles, and vectors."""
    sketch = random_sketch(np.random.default_rng(12), share=1.0)
    labels, dunes = {}, np.array(sketch.layers["dune"])
    for number, label in enumerate((1, 2, 3, 4)):
        dunes[16 * number : 16 * number + 8, :8] = label
        labels["dune", label] = {"wavelength": (90.0, 50.0)[number // 2], "wind": (20.0, 250.0)[number % 2]}
    density = dict.fromkeys(DENSITY, 8000000.0 / sketch.extent**2)
    climate = {"snow_line": 150.0, "tree_line": 80.0, "aridity": 0.5}
    tile = 0.5 * sketch.extent
    way = tile + np.array([[-90.0, -70.0], [15.0, 10.0], [30.0, 120.0]])
    outline = tile + np.array([[38.0, 40.0], [52.0, 40.0], [52.0, 52.0], [38.0, 52.0]])
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    field, woods = tile + 2.0 + 34.0 * square, 0.1 * tile + 0.8 * tile * square
    features = {
        "road": [Feature(LINE, (way,), 1, {"structure": "ground", "grade": 1.0})],
        "pad": [Feature(AREA, (outline,), 1, {})],
        "landuse": [
            Feature(AREA, (woods,), 1, {"use": "forest", "direction": 30.0, "conifers": 0.5}),
            Feature(AREA, (field,), 1, {"crop": "maize", "direction": 30.0, "conifers": 0.5}),
        ],
    }
    sketch = sketch.replace(
        labels=labels,
        density=density,
        climate=climate,
        layers={**sketch.layers, "dune": dunes},
        vectors={name: FeatureTable(name).edited(add=each) for name, each in features.items()},
    )
    built = build(sketch, device=context)
    # Rivers are so steep that arcs depend on it.
    steep = course_change(lambda anchor, line: (anchor, replace(line, steep=np.ones_like(line.steep))))
    return Terrain(sketch, steep(built.recipe), context)


def missed(old: Terrain, recipe: TerrainRecipe, before: Sampled, expected: Sampled) -> str:
    """Return what differs outside of the areas that an update to a recipe reports; "" if nothing."""
    areas = old.updated(old.sketch, recipe)[1]
    if recipe.extent != old.extent and areas != [EVERYWHERE]:
        return "another extent does not change everything"
    return differences(before, expected, areas)


def stale(old: Terrain, recipe: TerrainRecipe, expected: Sampled) -> str:
    """Return what an updated terrain has of the old one, whose caches are full; "" if nothing."""
    return differences(samples_of(old.updated(old.sketch, recipe)[0]), expected)


@tiers("share", [slice(13, None, 46)], [slice(0, None, 6)], [slice(each, None, 6) for each in range(1, 6)])
def test_a_part_that_is_left_out_is_noticed(terrain, share, monkeypatch) -> None:
    # Nodes of the painted region are not left out of unpainted ground, also not in its cache on disk: a moved
    # region has gaps.
    window = UnpaintedNodes.window
    monkeypatch.setattr(UnpaintedNodes, "window", lambda nodes, *at, painted: window(nodes, *at))
    monkeypatch.setattr(relief, "_disk_cache", lambda settings: None)
    lines = []

    def new(recipe: TerrainRecipe) -> Terrain:
        return Terrain(terrain.sketch, recipe, terrain.context)

    # All parts are changes of one terrain, which stays as it is.
    old = new(terrain.recipe)
    before = samples_of(old)
    for part in parts_of(old.recipe)[share]:
        recipe = part.changed(old.recipe)
        expected = samples_of(new(recipe))
        effect = bool(differences(before, expected))
        if effect != part.has_effect:
            lines.append(f"{part.name} has {'an' if effect else 'no'} effect")
        if found := missed(old, recipe, before, expected) or stale(old, recipe, expected):
            lines.append(f"{part.name} is not updated: {found}")
        if effect:
            with pytest.MonkeyPatch.context() as patch:
                part.left_out(patch)
                for layer in (*old.recipe.layers, *recipe.layers):
                    layer.cache.clear()  # of what was found without the fault
                other = new(old.recipe)
                with suppress(ValueError, IndexError, KeyError):  # which would be noticed, too
                    if not missed(other, recipe, before, expected):
                        samples_of(other)  # fills its caches
                        if not stale(other, recipe, expected):
                            lines.append(f"{part.name} can be left out")
    assert not lines, "\n".join(lines)
    assert not differences(before, samples_of(old))


@pytest.mark.soak
def test_changes_of_sketches_reach_every_part(terrain) -> None:
    sequences = chain(
        (sequence(number, terrain.context) for number in range(SEQUENCES)),
        # Of label 1, on which unpainted ground depends; and what sequences may lack.
        (
            walk([23, 0], [[name]] * 8, terrain.context)
            for name in ("hill.height", "mountain.height", "own material", "climate.snow_line")
        ),
        (random_sequence(number, terrain.context) for number in range(100)),
    )
    missing = {part.name: part.value for part in parts_of(terrain.recipe) if part.value and part.has_effect}
    while missing and (steps := next(sequences, None)):
        for before, step in pairwise(each.new.recipe for each in steps):
            for name, value in list(missing.items()):
                if not are_equal(value(before), value(step)):
                    del missing[name]
    assert not missing
