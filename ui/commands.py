"""Commands: pure functions from a sketch to a changed one, for placed features, labels and settings.

Edits of one kind of one feature replace one another, so that a drag adds only one. A feature's lock follows
its other edits and is updated with their values.
"""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Final, cast

import numpy as np

from sketchterrain.document.edits import ACTIONS, Edit
from sketchterrain.document.label_layers import MAX_LABELS, freeze_image, labels_in
from sketchterrain.document.rasters import RasterSource
from sketchterrain.document.sketch import TABLES, Sketch
from sketchterrain.errors import InputError
from sketchterrain.features.table import FeatureTable
from sketchterrain.landforms.placement.feature_types import (
    FEATURE_TYPES,
    TYPES,
    Lake,
    River,
    lock_edit,
    move_edit,
)
from sketchterrain.landforms.placement.heights import UNSET_HEIGHT
from sketchterrain.schema.layers import LAYERS, layer_of
from sketchterrain.schema.parameters import SKETCH, Parameter, Value
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.workspace import Handle, Selection

_DIGITS = 3  # of a metre, resolution of dragged values
_SAME_PLACE = 0.01  # m; tolerance of a control point's position in an edit
_TITLES = {
    "move": "Move {}",
    "radius": "Resize {}",
    "point": "Move a point of {}",
    "width": "Set the width of {}",
}


@contextmanager
def reported(report: Callable[[str], object], refresh: Callable[[], object] | None = None) -> Iterator[None]:
    """Report why a change is refused, one line, and show the present values again."""
    try:
        yield
    except InputError as error:
        report(str(error))
        if refresh is not None:
            refresh()


def find_point(placed: Placement, selection: Selection) -> np.void | None:
    """Return the selected point feature, a row of FEATURE; None if missing or of another kind."""
    if selection.kind != "feature":
        return None
    at = int(np.searchsorted(placed.points["id"], np.uint64(selection.id)))
    found = at < len(placed.points) and int(placed.points["id"][at]) == selection.id
    return placed.points[at] if found else None


def find_river(placed: Placement, selection: Selection) -> River | None:
    """Return the selected river; None if missing or of another kind."""
    rivers = placed.rivers if selection.kind == "course" else ()
    return next((river for river in rivers if river.id == selection.id), None)


def find_lake(placed: Placement, selection: Selection) -> Lake | None:
    """Return the selected lake; None if missing or of another kind."""
    lakes = placed.lakes if selection.kind == "water" else ()
    return next((lake for lake in lakes if lake.id == selection.id), None)


def exists(placed: Placement, selection: Selection) -> bool:
    """Return whether the selection was placed."""
    return any(find(placed, selection) is not None for find in (find_point, find_river, find_lake))


def find_parent_river(placed: Placement, river: River) -> River | None:
    """Return the river that a river joins."""
    end = river.centreline[-1]
    others = (each for each in placed.rivers if each.id != river.id)
    return next((each for each in others if (each.centreline == end).all(axis=1).any()), None)


def name_of(placed: Placement, selection: Selection) -> str:
    """Return the selection's display name: ``mountain``, ``river 2``, numbered as contradictions are."""
    if selection.kind == "feature":
        point = find_point(placed, selection)
        return "feature" if point is None else FEATURE_TYPES[int(point["type"])]
    ids = [each.id for each in (placed.rivers if selection.kind == "course" else placed.lakes)]
    layer = layer_of(selection.id)
    return f"{layer} {ids.index(selection.id) + 1}" if selection.id in ids else layer


def dragged(sketch: Sketch, placed: Placement, handle: Handle, x: float, y: float) -> Sketch:
    """Return the sketch with a handle of a placed feature dragged to a position (m)."""
    selection = handle.selection
    if handle.role == "move":
        return with_values(sketch, placed, selection, "move", x=x, y=y)
    if handle.role == "point":
        return point_moved(sketch, placed, selection, x, y)
    distance = math.hypot(x - handle.base_x, y - handle.base_y)
    if handle.role == "radius":
        return with_values(sketch, placed, selection, "resize", radius=distance)
    visible = 2.0 * math.hypot(handle.x - handle.base_x, handle.y - handle.base_y)
    river = find_river(placed, selection)
    if river is None or visible <= 0.0:
        return sketch
    # A river widens below its spring and at confluences: scale the declared width by the same factor.
    return widened(sketch, selection, (_declared_width(sketch, river) or visible) * 2.0 * distance / visible)


def drag_title(placed: Placement, handle: Handle) -> str:
    """Return the history title of a drag of a placed object's handle."""
    return _TITLES[handle.role].format(name_of(placed, handle.selection))


def with_values(
    sketch: Sketch, placed: Placement, selection: Selection, action: str, **values: float
) -> Sketch:
    """Return the sketch with a feature moved (x and y), resized (radius) or with another strength (m).

    The strength of a forest is its density. The edit replaces an earlier one and comes before the lock,
    which takes over its values.
    """
    values = {name: _clamp(action, name, value) for name, value in values.items()}
    point = find_point(placed, selection)
    if point is None:
        return sketch
    if "strength" in values and LAYERS[FEATURE_TYPES[point["type"]]].is_share:
        values["strength"] = min(values["strength"], 1.0)
    edit = Edit(action, selection.id, **values)  # type: ignore[arg-type] # its own values
    edits: list[Edit] = []
    for each in sketch.edits:
        if each.target == edit.target:
            continue
        if each.action == "lock" and each.feature == edit.feature:
            edits += [edit, dataclasses.replace(each, **values)]  # type: ignore[arg-type] # as above
        else:
            edits.append(each)
    return sketch.replace(edits=tuple(edits)) if edit in edits else sketch.with_edit(edit)


def values_of(sketch: Sketch, point: np.void) -> dict[str, float]:
    """Return position, radius and strength of a feature with its edits, which are placed a moment later."""
    values = {name: float(point[name]) for name in ("x", "y", "radius", "strength")}
    for edit in sketch.edits:
        if edit.feature == int(point["id"]):
            values |= {name: float(value) for name, value in edit.values.items() if name in values}
    return values


def point_moved(sketch: Sketch, placed: Placement, selection: Selection, x: float, y: float) -> Sketch:
    """Return the sketch with the selected control point of a river moved to a position (m).

    A confluence cannot be moved: it follows the other river.
    """
    river = find_river(placed, selection)
    index = selection.index
    if river is None or index is None or not 0 <= index < len(river.points):
        return sketch
    if index == len(river.points) - 1 and find_parent_river(placed, river) is not None:
        return sketch
    x, y = _clamp("move_point", "x", x), _clamp("move_point", "y", y)
    earlier = _edit_of_point(sketch, river, index)
    if earlier is None:
        return sketch.with_edit(move_edit(river, index, x=x, y=y))
    # The order stays: later edits may identify points by the position that this one gave them.
    edits = list(sketch.edits)
    edits[earlier] = dataclasses.replace(edits[earlier], x=x, y=y)
    return sketch.replace(edits=tuple(edits))


def widened(sketch: Sketch, selection: Selection, width: float) -> Sketch:
    """Return the sketch with another width (m) of a river."""
    if selection.kind != "course":
        return sketch
    return sketch.with_edit(Edit("width", selection.id, width=_clamp("width", "width", width)))


def width_of(sketch: Sketch, placed: Placement, selection: Selection) -> float | None:
    """Return a river's edited, declared or painted width (m); None if missing."""
    river = find_river(placed, selection)
    if river is None:
        return None
    return _declared_width(sketch, river) or float(np.median(river.width))


def deleted(sketch: Sketch, selection: Selection) -> Sketch:
    """Return the sketch without an object; an added one leaves no edit behind."""
    return sketch.with_edit(Edit("delete", selection.id))


def locked(sketch: Sketch, placed: Placement, selection: Selection) -> Sketch:
    """Return the sketch with a feature locked: it keeps its values whatever is painted."""
    point = find_point(placed, selection)
    if point is None or is_locked(sketch, selection):
        return sketch
    return sketch.with_edit(lock_edit(point))


def unlocked(sketch: Sketch, selection: Selection) -> Sketch:
    """Return the sketch without a feature's lock; its other edits stay."""
    return _without(sketch, selection, lambda edit: edit.action == "lock")


def is_locked(sketch: Sketch, selection: Selection) -> bool:
    """Return whether a feature is locked."""
    return any(edit.action == "lock" and edit.feature == selection.id for edit in sketch.edits)


def reset(sketch: Sketch, placed: Placement, selection: Selection) -> Sketch:
    """Return the sketch without an object's edits, except its addition; of a control point only its own."""
    river = find_river(placed, selection)
    if river is None or selection.index is None:
        return _without(sketch, selection, lambda edit: edit.action != "add")
    at = _edit_of_point(sketch, river, selection.index)
    if at is None:
        return sketch
    return sketch.replace(edits=sketch.edits[:at] + sketch.edits[at + 1 :])


def is_edited(sketch: Sketch, placed: Placement, selection: Selection) -> bool:
    """Return whether `reset` would change the sketch."""
    return reset(sketch, placed, selection) is not sketch


def added(sketch: Sketch, kind: str, x: float, y: float, radius: float, strength: float) -> Sketch:
    """Return the sketch with another feature."""
    if kind in LAYERS and LAYERS[kind].is_share:
        strength = min(strength, 1.0)
    edit = Edit(
        "add",
        type=kind,
        x=_clamp("add", "x", x),
        y=_clamp("add", "y", y),
        radius=_clamp("add", "radius", radius),
        strength=_clamp("add", "strength", strength),
    )
    return sketch.with_edit(edit)


def added_at(sketch: Sketch, kind: str, x: float, y: float) -> Sketch:
    """Return the sketch with another feature at a position (m), of its type's default size and strength."""
    layer = LAYERS[kind]
    radius = layer.added_radius * sketch.extent
    strength = sketch.properties(kind, 1)[layer.main.name]
    if layer.kind == "summits" and strength == 0.0:  # automatic
        strength = UNSET_HEIGHT * radius
    return added(sketch, kind, x, y, radius, min(strength, TYPES[kind].fill_slope * radius))


def _without(sketch: Sketch, selection: Selection, matches: Callable[[Edit], bool]) -> Sketch:
    """Remove the object's matching edits; return the same sketch if there are none."""
    edits = tuple(edit for edit in sketch.edits if edit.feature != selection.id or not matches(edit))
    return sketch if len(edits) == len(sketch.edits) else sketch.replace(edits=edits)


def _edit_of_point(sketch: Sketch, river: River, index: int) -> int | None:
    """Return the index of the edit that moved a control point here, or identifies it by its position."""
    if not 0 <= index < len(river.points):
        return None  # the river has become shorter meanwhile
    x, y = river.points[index, :2]
    best, nearest = None, _SAME_PLACE
    for at, edit in enumerate(sketch.edits):
        if edit.action != "move_point" or edit.feature != river.id:
            continue
        for px, py in ((edit.x, edit.y), (edit.from_x, edit.from_y)):
            if px is not None and py is not None and math.hypot(px - x, py - y) <= nearest:
                best, nearest = at, math.hypot(px - x, py - y)
    return best


def _declared_width(sketch: Sketch, river: River) -> float:
    """Return a river's edited width (m) or its label's; 0 if neither is declared, as for streams."""
    edited = [edit.width for edit in sketch.edits if edit.action == "width" and edit.feature == river.id]
    if edited and edited[-1] is not None:
        return edited[-1]
    if river.label == 0:
        return 0.0
    return cast(float, sketch.properties(layer_of(river.id), river.label)["width"])


def _clamp(action: str, name: str, value: float) -> float:
    """Round and clamp a value to the range that its edit declares."""
    if not math.isfinite(value):
        raise InputError(f"{name}: expected a number, got {value}")
    parameter = ACTIONS[action].values[name]
    return min(max(round(float(value), _DIGITS), float(parameter.low)), float(parameter.high))


def labels_of(sketch: Sketch, layer: str) -> tuple[int, ...]:
    """Return the declared labels of a layer and those of its paint and vectors, ascending."""
    declared = {label for name, label in sketch.labels if name == layer}
    painted = set(labels_in(sketch.layers[layer])) if LAYERS[layer].is_painted else set()
    return tuple(sorted(declared | set(vector_counts(sketch, layer)) | painted))


def vector_counts(sketch: Sketch, layer: str) -> dict[int, int]:
    """Return how many vectors each label of a layer has."""
    counts = sketch.vectors[layer].label_counts if layer in sketch.vectors else np.zeros(0, np.int64)
    return {int(label): int(counts[label]) for label in np.flatnonzero(counts)}


def free_label(sketch: Sketch, layer: str) -> int:
    """Return the smallest label of a layer that is neither painted nor declared."""
    used = labels_of(sketch, layer)
    if len(used) >= MAX_LABELS:
        raise InputError(f"{LAYERS[layer].title}: a layer has at most {MAX_LABELS} labels")
    return next(label for label in range(1, 256) if label not in used)


def new_label(sketch: Sketch, layer: str, label: int, *, source: int | None = None) -> Sketch:
    """Declare a label with default properties, or with those of another label of its layer."""
    if source is None and (layer, label) in sketch.labels:
        return sketch
    properties = {} if source is None else dict(sketch.labels.get((layer, source), {}))
    return sketch.replace(labels={**sketch.labels, (layer, label): properties})


def delete_label(sketch: Sketch, layer: str, label: int) -> Sketch:
    """Remove a label: its properties, its paint and its vectors."""
    sketch = _without_vectors(sketch, layer, label)
    labels = {key: value for key, value in sketch.labels.items() if key != (layer, label)}
    if len(labels) < len(sketch.labels):
        sketch = sketch.replace(labels=labels)
    return _without_paint(sketch, layer, label)


def clear_layer(sketch: Sketch, layer: str) -> Sketch:
    """Erase a layer's paint and vectors; its labels keep their properties."""
    return _without_paint(_without_vectors(sketch, layer), layer)


def _without_paint(sketch: Sketch, layer: str, label: int | None = None) -> Sketch:
    """Erase the paint of a layer, or of a label of it."""
    image = sketch.layers[layer] if LAYERS[layer].is_painted else np.zeros(0, np.uint8)
    painted = image > 0 if label is None else image == label
    if not painted.any():
        return sketch
    erased = freeze_image(np.where(painted, np.uint8(0), image))
    return sketch.replace(layers={**sketch.layers, layer: erased})


def _without_vectors(sketch: Sketch, layer: str, label: int | None = None) -> Sketch:
    """Remove the vectors of a layer, or of a label of it."""
    if layer not in sketch.vectors:
        return sketch
    vectors = sketch.vectors[layer]
    gone = vectors.ids if label is None else vectors.ids[vectors.labels == label]
    if not len(gone):
        return sketch
    return with_vectors(sketch, vectors.edited(remove=gone.tolist()))


def with_vectors(sketch: Sketch, *layers: FeatureTable) -> Sketch:
    """Return the sketch with other vector layers in place of those of their names."""
    return sketch.replace(vectors={**sketch.vectors, **{layer.layer: layer for layer in layers}})


def with_raster(sketch: Sketch, source: RasterSource, *changed: RasterSource) -> Sketch:
    """Return the sketch with another raster source, or none, in place of one."""
    rasters = (part for each in sketch.rasters for part in (changed if each is source else (each,)))
    return sketch.replace(rasters=tuple(rasters))


def set_property(sketch: Sketch, layer: str, label: int, name: str, value: Value | None) -> Sketch:
    """Set a property of a label; None resets it to its default."""
    declared = sketch.labels.get((layer, label), {})
    is_same = name not in declared if value is None else sketch.properties(layer, label).get(name) == value
    if is_same:
        return sketch
    properties = {key: each for key, each in {**declared, name: value}.items() if each is not None}
    return sketch.replace(labels={**sketch.labels, (layer, label): properties})


WORLD = "sketch"  # name of the table of top-level keys
DECLARED: Final[Mapping[str, Mapping[str, Parameter]]] = {WORLD: SKETCH, **TABLES}
"""The parameters of each table."""


def settings(sketch: Sketch, table: str) -> dict[str, Value]:
    """Return all values of a table, in the order of their declaration."""
    values = vars(sketch) if table == WORLD else getattr(sketch, table)
    return {name: values[name] for name in DECLARED[table]}


def set_setting(sketch: Sketch, table: str, name: str, value: Value | None) -> Sketch:
    """Set a value of a table; None resets it to its default."""
    value = DECLARED[table][name].default if value is None else value
    if settings(sketch, table)[name] == value:
        return sketch
    changed = {name: value} if table == WORLD else {table: {**getattr(sketch, table), name: value}}
    return sketch.replace(**changed)


_SEEDS = 1_000_000  # fewer than there are: short enough to remember


def random_seed(current: int | None = None) -> int:
    """Return a short random seed other than the current one."""
    seed = random.randrange(_SEEDS - 1)  # noqa: S311 - not cryptographic
    return seed if current is None else seed + (seed >= current)
