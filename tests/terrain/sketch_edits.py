"""Random sketches and random changes of them, one function a kind; every layer and parameter has its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from sketchterrain.document.edits import Edit
from sketchterrain.document.material_rules import DEFAULT_RULES, Factor, RuleChange
from sketchterrain.document.sketch import TABLES, LabelImage, Sketch
from sketchterrain.errors import InputError
from sketchterrain.features.table import AREA, LINE, Feature, FeatureTable
from sketchterrain.generation.terrain import TerrainFeatures
from sketchterrain.landforms.placement.feature_types import FILL_BIT, lock_edit, move_edit
from sketchterrain.schema.layers import DENSITY, LAYERS, PAINTED_LAYERS, POINT_LAYERS, VECTOR_LAYERS
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.schema.parameters import LOOK, SKETCH, WEATHER, Parameter, Value

Rng = np.random.Generator

SIDE = 64  # px
EXTENTS = (2500.0, 4000.0, 6000.0)  # m
_LABELS = (1, 2, 7)
_SYSTEMS = {"crs": ("", "EPSG:25832", "EPSG:3857"), "vertical": ("", "EPSG:5773")}
_FILL = 6  # features of each type in an unpainted sketch, at most


@dataclass(frozen=True, eq=False)
class State:
    """A sketch, the features placed from it, and the sketches before it."""

    sketch: Sketch
    features: TerrainFeatures
    earlier: Sequence[Sketch]


Change = Callable[[Rng, State], Sketch]


def random_sketch(rng: Rng, *, share: float = 0.8) -> Sketch:
    """Return a small sketch with shapes of two labels in a share of the layers, features elsewhere or not."""
    extent, width = float(rng.choice(EXTENTS)), SIDE - int(rng.choice([0, 12]))
    sketch = Sketch(
        extent=extent,
        seed=int(rng.integers(2**63)),
        fidelity=float(rng.choice([0.3, 0.8, 1.0])),
        layers={name: np.zeros((SIDE, width), np.uint8) for name in PAINTED_LAYERS},
    )
    often = rng.choice([0.0, 0.7])
    density = {key: _random_value(rng, DENSITY[key], sketch) for key in DENSITY if rng.random() < often}
    for name in PAINTED_LAYERS:
        for label in (1, 2) if rng.random() < share else ():
            sketch = _painted(sketch, name, _brush_stroke(rng, sketch, name), label)
    return sketch.replace(density=density)


def _painted(sketch: Sketch, name: str, mask: LabelImage, label: int) -> Sketch:
    image = np.array(sketch.layers[name])
    image[mask] = label
    return sketch.replace(layers={**sketch.layers, name: image})


def _brush_stroke(rng: Rng, sketch: Sketch, name: str) -> LabelImage:
    """Return the pixels of a dab, of a stroke, or of a river's course."""
    rows, columns = np.ogrid[: sketch.height_px, : sketch.width_px]
    size = np.array([sketch.height_px, sketch.width_px])
    is_course = LAYERS[name].kind == "course"
    steps = 14 if is_course else int(rng.choice([1, 1, 4]))
    radius = 1.0 if is_course else rng.uniform(1.5, 4.5)
    at, heading = rng.uniform(-0.05, 1.05, 2) * size, rng.uniform(0, 2 * np.pi)
    mask = np.zeros(size, np.bool_)
    for _ in range(steps):
        heading += rng.uniform(-0.5, 0.5)
        for _ in range(3):
            mask |= (rows - at[0]) ** 2 + (columns - at[1]) ** 2 <= radius**2
            at = at + 1.4 * np.array([np.sin(heading), np.cos(heading)])
    return mask


def _paint(name: str) -> Change:
    def paint(rng: Rng, state: State) -> Sketch:
        mask = _brush_stroke(rng, state.sketch, name)
        return _painted(state.sketch, name, mask, int(rng.choice(_LABELS)))

    return paint


def _erase(name: str) -> Change:
    def erase(rng: Rng, state: State) -> Sketch:
        """Erase all, a whole shape or a dab of one."""
        sketch, part = state.sketch, rng.random()
        shape = sketch.layers[name] > 0 if part < 0.2 else _random_shape(rng, sketch.layers[name])
        rows, columns = np.ogrid[: sketch.height_px, : sketch.width_px]
        if part > 0.6 and shape.any():
            row, column = rng.choice(np.argwhere(shape))
            shape = (rows - row) ** 2 + (columns - column) ** 2 <= rng.uniform(0.5, 4.0) ** 2
        return _painted(sketch, name, shape, 0)

    return erase


def _relabel(name: str) -> Change:
    def relabel(rng: Rng, state: State) -> Sketch:
        shape = _random_shape(rng, state.sketch.layers[name])
        return _painted(state.sketch, name, shape, int(rng.choice(_LABELS)))

    return relabel


def _random_shape(rng: Rng, image: LabelImage) -> LabelImage:
    """Return the pixels of one painted shape; none if the layer is empty."""
    regions, count = ndimage.label(image > 0, structure=np.ones((3, 3)))
    return np.asarray(regions == rng.integers(1, count + 1)) if count else np.zeros(image.shape, np.bool_)


def _random_value(rng: Rng, parameter: Parameter, sketch: Sketch) -> Value:
    """Return a valid value for terrains of a few kilometres, seldom the default or a sentinel."""
    name, default = parameter.name, parameter.default
    if parameter.choices:
        return str(rng.choice(parameter.choices))
    if name in _SYSTEMS:
        return str(rng.choice(_SYSTEMS[name]))
    if parameter.kind is str:
        return f"Untitled {rng.integers(1000)}"
    if name == "seed":
        return int(rng.integers(2**63))
    if name == "extent":
        return float(rng.choice([each for each in EXTENTS if each != sketch.extent]))
    if parameter in DENSITY.values():
        east, north = sketch.size
        return float(rng.uniform(0, _FILL * 1e6 / (east * north)))
    if parameter.sentinel is not None:
        low, high = parameter.soft_range or (parameter.low, parameter.high)
        return float(rng.choice([parameter.sentinel.value, *rng.uniform(max(low, 0), min(high, 400), 3)]))
    span = (0.3 * float(default), 2.0 * float(default))
    if not default or name == "aridity":  # ground differs from 0.5 on
        span = parameter.low, parameter.high
    value = float(np.clip(rng.uniform(*span), parameter.low, parameter.high))
    return round(value) if parameter.kind is int else value


def _set_label(name: str, parameter: Parameter) -> Change:
    def set_label(rng: Rng, state: State) -> Sketch:
        sketch = state.sketch
        painted = np.unique(sketch.layers[name])[1:] if name in sketch.layers else ()
        present = painted if rng.random() < 0.9 else _LABELS
        key = name, int(rng.choice(present)) if len(present) else 1
        values = {
            **sketch.labels.get(key, {}),
            parameter.name: _random_value(rng, parameter, sketch),
        }
        return sketch.replace(labels={**sketch.labels, key: values})

    return set_label


def _set_top(parameter: Parameter) -> Change:
    return lambda rng, state: state.sketch.replace(
        **{parameter.name: _random_value(rng, parameter, state.sketch)}
    )


def _set_table(table: str, parameter: Parameter) -> Change:
    def set_value(rng: Rng, state: State) -> Sketch:
        values = {parameter.name: _random_value(rng, parameter, state.sketch)}
        return state.sketch.replace(**{table: {**getattr(state.sketch, table), **values}})

    return set_value


def _set_look(rng: Rng, state: State) -> Sketch:
    bump = _random_value(rng, LOOK["bump"], state.sketch)
    return state.sketch.replace(look={**state.sketch.look, str(rng.choice(MATERIALS)): {"bump": bump}})


def _widen_canvas(rng: Rng, state: State) -> Sketch:
    """Add columns in the east: the extent stays, so pixels shrink."""
    layers = {name: np.pad(image, ((0, 0), (0, 3))) for name, image in state.sketch.layers.items()}
    return state.sketch.replace(layers=layers)


def _override(action: str, *, fill: bool = False) -> Change:
    def override(rng: Rng, state: State) -> Sketch:
        points, sketch = state.features.points, state.sketch
        points = points[(points["id"] >= FILL_BIT) == fill]
        if not len(points):
            return _add(rng, state)
        point = rng.choice(points)
        given = {
            "move": {key: float(point[key] + rng.normal(0, 0.05 * sketch.extent)) for key in ("x", "y")},
            "resize": {"radius": float(point["radius"] * rng.uniform(0.4, 2.0))},
            "strength": {"strength": float(point["strength"] * rng.uniform(0.3, 1.5))},
            "delete": {},
        }
        if action == "lock":
            return sketch.with_edit(lock_edit(point))
        return sketch.with_edit(Edit(action, int(point["id"]), **given[action]))

    return override


def _add(rng: Rng, state: State) -> Sketch:
    sketch, kind = state.sketch, LAYERS[str(rng.choice(POINT_LAYERS))]
    style = {each.name: _random_value(rng, each, sketch) for each in kind.style}
    x, y = (float(each) for each in rng.uniform(-0.1, 1.1, 2) * sketch.size)
    radius, strength = float(rng.uniform(0.03, 0.15) * sketch.extent), _random_value(rng, kind.main, sketch)
    return sketch.with_edit(Edit("add", type=kind.name, x=x, y=y, radius=radius, strength=strength, **style))


def _edit_water(action: str) -> Change:
    def edit_water(rng: Rng, state: State) -> Sketch:
        waters = state.features.lakes if action == "delete lake" else state.features.rivers
        if not waters:
            return _paint("lake" if action == "delete lake" else "river")(rng, state)
        water = waters[int(rng.integers(len(waters)))]
        if action == "move_point":
            index = int(rng.integers(len(water.points)))
            x, y = water.points[index, :2] + rng.normal(0, 0.03 * state.sketch.extent, 2)
            return state.sketch.with_edit(move_edit(water, index, x=float(x), y=float(y)))
        if action == "width":
            return state.sketch.with_edit(Edit("width", water.id, width=float(rng.uniform(2, 60))))
        return state.sketch.with_edit(Edit("delete", water.id))

    return edit_water


def _draw(name: str) -> Change:
    def draw(rng: Rng, state: State) -> Sketch:
        """Add a vector, move one of its vertices or erase it."""
        sketch = state.sketch
        layer, part = sketch.vectors[name], rng.random()
        if part < 0.6 or not len(layer):
            is_line = "line" in LAYERS[name].vectors
            added = _random_line(rng, layer, sketch) if is_line else _random_area(rng, sketch)
            layer = layer.edited(add=[added])
        elif part < 0.85:
            vertices = layer.vertices.copy()
            at = vertices[rng.integers(len(vertices))]
            moved = at + rng.normal(0, 0.01 * sketch.extent, 2)
            vertices[(vertices == at).all(axis=1)] = moved
            with suppress(InputError):  # the area would cross itself
                layer = replace(layer, vertices=vertices)
        else:
            layer = layer.edited([int(rng.choice(layer.ids))])
        return sketch.replace(vectors={**sketch.vectors, name: layer})

    return draw


def _random_line(rng: Rng, layer: FeatureTable, sketch: Sketch) -> Feature:
    steps = rng.normal(0, 0.08 * sketch.extent, (int(rng.integers(2, 8)), 2))
    path = rng.uniform(-0.05, 1.05, 2) * sketch.size + np.cumsum(steps, axis=0)
    if len(layer) and rng.random() < 0.5:
        path[-1] = layer.vertices[rng.integers(len(layer.vertices))]
    flags = {key: 1 for key in ("smooth", "directed") if rng.random() < 0.5}
    declared = LAYERS[layer.layer].parameters
    key = "width" if "width" in declared else "height"
    size = {key: float(rng.uniform(4, min(declared[key].high, 60.0)))} if rng.random() < 0.5 else {}
    return Feature(LINE, (path,), int(rng.choice(_LABELS)), {**flags, **size})


def _random_area(rng: Rng, sketch: Sketch) -> Feature:
    angle = np.linspace(0.0, 2.0 * np.pi, int(rng.integers(4, 12)))[:-1]
    radius = rng.uniform(0.02, 0.08) * sketch.extent * rng.uniform(0.5, 1.0, len(angle))
    ring = rng.uniform(0, 1, 2) * sketch.size + radius[:, None] * np.stack(
        [np.cos(angle), np.sin(angle)], axis=-1
    )
    depth = {"depth": float(rng.uniform(1, 30))} if rng.random() < 0.5 else {}
    return Feature(AREA, (ring,), int(rng.choice(_LABELS)), depth)


def _withdraw_edit(rng: Rng, state: State) -> Sketch:
    edits = list(state.sketch.edits)
    if edits:
        edits.pop(int(rng.integers(len(edits))))
    return state.sketch.replace(edits=tuple(edits))


def _change_rule(rng: Rng, state: State) -> Sketch:
    """Change the cover, the factors, the material or the place of a material rule, or add one."""
    name = str(rng.choice([rule.name for rule in DEFAULT_RULES]))
    factor = Factor(float(rng.uniform(-1, 0.3)), 0.6, steepness=1.0, mottle=float(rng.uniform(0.1, 1)))
    material = str(rng.choice(state.sketch.material_table.names))
    change = (
        RuleChange(name, cover=float(rng.random())),
        RuleChange(name, factors=(factor,)),
        RuleChange(name, material=material),
        RuleChange(name, before=DEFAULT_RULES[0].name if name != DEFAULT_RULES[0].name else ""),
        RuleChange(f"own {rng.integers(5)}", material=material, cover=0.8, factors=(factor,)),
    )[int(rng.integers(5))]
    return state.sketch.replace(material_rules=(*state.sketch.material_rules, change))


def _own_material(rng: Rng, state: State) -> Sketch:
    """Declare a material, or another pattern of it, and paint with it."""
    sketch = state.sketch
    cover = next(name for name, layer in LAYERS.items() if layer.kind == "cover")
    return sketch.replace(
        materials={"lava": {"like": str(rng.choice(MATERIALS))}},
        labels={**sketch.labels, (cover, int(rng.choice(_LABELS))): {"material": "lava"}},
    )


def _undo(rng: Rng, state: State) -> Sketch:
    """Return to an earlier sketch, or to the one before."""
    at = int(rng.integers(len(state.earlier))) if rng.random() < 0.5 else -1
    return state.earlier[at] if state.earlier else state.sketch


COSMETIC = ("name", "weather", "look")
"""Changes that leave the terrain as it is."""

SETTINGS = (*SKETCH, *(f"{table}.{key}" for table, values in TABLES.items() for key in values))
"""Changes of a setting of the whole sketch."""

COMPILED = ("own material",)
"""Changes after which kernels are compiled again, which takes seconds."""

CHANGES: dict[str, Change] = {
    **{f"paint {name}": _paint(name) for name in PAINTED_LAYERS},
    **{f"erase {name}": _erase(name) for name in PAINTED_LAYERS},
    **{f"relabel {name}": _relabel(name) for name in PAINTED_LAYERS},
    **{
        f"{name}.{key}": _set_label(name, each)
        for name, layer in LAYERS.items()
        for key, each in layer.parameters.items()
    },
    **{key: _set_top(each) for key, each in SKETCH.items()},
    **{
        f"{table}.{key}": _set_table(table, each)
        for table, values in TABLES.items()
        for key, each in values.items()
        if table != "weather"
    },
    "weather": _set_table("weather", WEATHER["clouds"]),
    "look": _set_look,
    "widen canvas": _widen_canvas,
    **{action: _override(action) for action in ("move", "resize", "strength", "delete", "lock")},
    **{f"{action} fill": _override(action, fill=True) for action in ("move", "delete", "lock")},
    "add": _add,
    **{f"{action} river": _edit_water(action) for action in ("move_point", "width", "delete")},
    "delete lake": _edit_water("delete lake"),
    **{f"draw {name} {number}": _draw(name) for name in VECTOR_LAYERS for number in range(3)},
    "withdraw edit": _withdraw_edit,
    **{f"material rule {number}": _change_rule for number in range(3)},
    "own material": _own_material,
    **{f"undo {number}": _undo for number in range(3)},
}
"""All kinds of changes by name: of labels ``layer.parameter``, of settings ``table.parameter``."""
