"""Changing what was generated: what is selected, and a sketch with other edits of it.

All that is said of one feature by one kind of edit is one edit, so that dragging it ever so often adds none.
A lock goes with what is said of a locked feature: the edit is done before it, and its values follow.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import numpy as np

from sketchterrain.document.edits import ACTIONS, Edit
from sketchterrain.document.parameter_types import Parameter
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.hydrology.rivers import move_edit
from sketchterrain.placement.feature_types import FEATURE_TYPES, TYPES, Lake, River
from sketchterrain.terrain.edits import lock_edit
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.workspace import Selection

if TYPE_CHECKING:  # it imports this module
    from sketchterrain.ui.models.handles import Handle


def find_point(placed: Placement, selection: Selection) -> np.void | None:
    """Return the point feature that is chosen, a row of FEATURE; None if it is none, or gone."""
    if selection.kind != "feature":
        return None
    at = int(np.searchsorted(placed.points["id"], np.uint64(selection.id)))
    found = at < len(placed.points) and int(placed.points["id"][at]) == selection.id
    return placed.points[at] if found else None


def find_river(placed: Placement, selection: Selection) -> River | None:
    """Return the river that is chosen; None if it is none, or gone."""
    if selection.kind != "river":
        return None
    return next((river for river in placed.rivers if river.id == selection.id), None)


def find_lake(placed: Placement, selection: Selection) -> Lake | None:
    """Return the lake that is chosen; None if it is none, or gone."""
    if selection.kind != "lake":
        return None
    return next((lake for lake in placed.lakes if lake.id == selection.id), None)


def exists(placed: Placement, selection: Selection) -> bool:
    """Whether what is chosen was placed."""
    return any(find(placed, selection) is not None for find in (find_point, find_river, find_lake))


def find_parent_river(placed: Placement, river: River) -> River | None:
    """Return the river that another one joins; None if it runs on its own."""
    end = river.centreline[-1]
    others = (each for each in placed.rivers if each.id != river.id)
    return next((each for each in others if (each.centreline == end).all(axis=1).any()), None)


def name_of(placed: Placement, selection: Selection) -> str:
    """Return what a person calls what is chosen: ``mountain``, ``river 2``, as contradictions count them."""
    point = find_point(placed, selection)
    if point is not None:
        return FEATURE_TYPES[int(point["type"])]
    ids = [each.id for each in (placed.rivers if selection.kind == "river" else placed.lakes)]
    return f"{selection.kind} {ids.index(selection.id) + 1}" if selection.id in ids else selection.kind


_DIGITS = 3  # of a metre: what a person drags is no finer
_SAME_PLACE = 0.01  # m; a control point that lies so near an edit's place was put there by it
_ADDED_EXTENT = {"mountain": 0.12, "hill": 0.05, "dune": 0.06, "forest": 0.05}  # radius over the extent
_TITLES = {
    "move": "Move {}",
    "radius": "Resize {}",
    "point": "Move a point of {}",
    "width": "Set the width of {}",
}


def dragged(sketch: Sketch, placed: Placement, handle: Handle, x: float, y: float) -> Sketch:
    """Return a sketch in which a handle was dragged to a place (m); the same one if what it moved is gone."""
    selection = handle.selection
    if handle.role == "move":
        return moved(sketch, placed, selection, x, y)
    if handle.role == "point":
        return point_moved(sketch, placed, selection, x, y)
    away = math.hypot(x - handle.base_x, y - handle.base_y)
    if handle.role == "radius":
        return resized(sketch, placed, selection, away)
    shown = 2.0 * math.hypot(handle.x - handle.base_x, handle.y - handle.base_y)
    river = find_river(placed, selection)
    if river is None or shown <= 0.0:
        return sketch
    # A river is narrower at its spring and wider below confluences: what is set is scaled as what is shown.
    return widened(sketch, selection, (_said_width(sketch, river) or shown) * 2.0 * away / shown)


def drag_title(placed: Placement, handle: Handle) -> str:
    """Return what dragging a handle is called in the history."""
    return _TITLES[handle.role].format(name_of(placed, handle.selection))


def moved(sketch: Sketch, placed: Placement, selection: Selection, x: float, y: float) -> Sketch:
    """Return a sketch in which a feature stands at a place (m)."""
    if find_point(placed, selection) is None:
        return sketch
    at_x, at_y = _within("move", "x", x), _within("move", "y", y)
    return _with(sketch, Edit("move", selection.id, x=at_x, y=at_y))


def resized(sketch: Sketch, placed: Placement, selection: Selection, radius: float) -> Sketch:
    """Return a sketch in which a feature has a radius (m)."""
    if find_point(placed, selection) is None:
        return sketch
    return _with(sketch, Edit("resize", selection.id, radius=_within("resize", "radius", radius)))


def strengthened(sketch: Sketch, placed: Placement, selection: Selection, strength: float) -> Sketch:
    """Return a sketch in which a feature has a strength: a height in m, of a forest the share of trees."""
    point = find_point(placed, selection)
    if point is None:
        return sketch
    strength = _within("strength", "strength", strength)
    if name_of(placed, selection) == "forest":
        strength = min(strength, 1.0)
    return _with(sketch, Edit("strength", selection.id, strength=strength))


def strength_of(sketch: Sketch, placed: Placement, selection: Selection) -> float | None:
    """Return the strength that a feature was given, or else the one that it was placed with; None if gone."""
    point = find_point(placed, selection)
    if point is None:
        return None
    given = [
        edit.strength for edit in sketch.edits if edit.feature == selection.id and edit.strength is not None
    ]
    return given[-1] if given else float(point["strength"])


def point_moved(sketch: Sketch, placed: Placement, selection: Selection, x: float, y: float) -> Sketch:
    """Return a sketch in which the chosen control point of a river lies at a place (m).

    Where a river joins another one there is nothing to move: it follows that one.
    """
    river = find_river(placed, selection)
    index = selection.index
    if river is None or index is None or not 0 <= index < len(river.points):
        return sketch
    if index == len(river.points) - 1 and find_parent_river(placed, river) is not None:
        return sketch
    x, y = _within("move_point", "x", x), _within("move_point", "y", y)
    earlier = _edit_of_point(sketch, river, index)
    if earlier is None:
        return sketch.with_edit(move_edit(river, index, x=x, y=y))
    # It keeps its turn: edits after it may name points by where this one put them.
    edits = list(sketch.edits)
    edits[earlier] = dataclasses.replace(edits[earlier], x=x, y=y)
    return sketch.replace(edits=tuple(edits))


def widened(sketch: Sketch, selection: Selection, width: float) -> Sketch:
    """Return a sketch in which a river has a width (m) from bank to bank."""
    if selection.kind != "river":
        return sketch
    return sketch.with_edit(Edit("width", selection.id, width=_within("width", "width", width)))


def width_of(sketch: Sketch, placed: Placement, selection: Selection) -> float | None:
    """Return the width (m) that a river was given, its label says, or it was painted with; None if gone."""
    river = find_river(placed, selection)
    if river is None:
        return None
    return _said_width(sketch, river) or float(np.median(river.width))


def deleted(sketch: Sketch, selection: Selection) -> Sketch:
    """Return a sketch without a feature, a river or a lake; what was added is as if it never had been."""
    return sketch.with_edit(Edit("delete", selection.id))


def locked(sketch: Sketch, placed: Placement, selection: Selection) -> Sketch:
    """Return a sketch in which a feature keeps every value that it has, whatever is painted."""
    point = find_point(placed, selection)
    if point is None or is_locked(sketch, selection):
        return sketch
    return sketch.with_edit(lock_edit(point))


def unlocked(sketch: Sketch, selection: Selection) -> Sketch:
    """Return a sketch without the lock of a feature; what else was said of it stays."""
    return _without(sketch, selection, lambda edit: edit.action == "lock")


def is_locked(sketch: Sketch, selection: Selection) -> bool:
    """Whether a feature keeps every value that it has."""
    return any(edit.action == "lock" and edit.feature == selection.id for edit in sketch.edits)


def reset(sketch: Sketch, placed: Placement, selection: Selection) -> Sketch:
    """Return a sketch in which something is again as it was generated, or as it was when it was added.

    Of a river's control point only what was said of that point is taken back.
    """
    river = find_river(placed, selection)
    if river is None or selection.index is None:
        return _without(sketch, selection, lambda edit: edit.action != "add")
    at = _edit_of_point(sketch, river, selection.index)
    if at is None:
        return sketch
    return sketch.replace(edits=sketch.edits[:at] + sketch.edits[at + 1 :])


def is_edited(sketch: Sketch, placed: Placement, selection: Selection) -> bool:
    """Whether `reset` would change anything."""
    return reset(sketch, placed, selection) is not sketch


def added(sketch: Sketch, kind: str, x: float, y: float, radius: float, strength: float) -> Sketch:
    """Return a sketch with one more feature."""
    if kind == "forest":
        strength = min(strength, 1.0)
    return sketch.with_edit(
        Edit(
            "add",
            type=kind,
            x=_within("add", "x", x),
            y=_within("add", "y", y),
            radius=_within("add", "radius", radius),
            strength=_within("add", "strength", strength),
        )
    )


def added_at(sketch: Sketch, kind: str, x: float, y: float) -> Sketch:
    """Return a sketch with one more feature at a place (m), as large and strong as suits its type there."""
    radius = _ADDED_EXTENT[kind] * sketch.extent
    properties = sketch.properties(kind, 1)
    if kind == "forest":
        return added(sketch, kind, x, y, radius, properties["density"])
    return added(sketch, kind, x, y, radius, min(properties["height"], TYPES[kind].fill_slope * radius))


def _with(sketch: Sketch, edit: Edit) -> Sketch:
    """Add an edit of a point feature in place of an earlier one; a lock comes after it and has its values."""
    edits: list[Edit] = []
    for each in sketch.edits:
        if each.target == edit.target:
            continue
        if each.action == "lock" and each.feature == edit.feature:
            edits += [edit, dataclasses.replace(each, **edit.values)]  # type: ignore[arg-type] # its own values
        else:
            edits.append(each)
    return sketch.replace(edits=tuple(edits)) if edit in edits else sketch.with_edit(edit)


def _without(sketch: Sketch, selection: Selection, taken: Callable[[Edit], bool]) -> Sketch:
    """Take those edits of what is chosen away that a test says; the same sketch if there are none."""
    kept = tuple(edit for edit in sketch.edits if edit.feature != selection.id or not taken(edit))
    return sketch if len(kept) == len(sketch.edits) else sketch.replace(edits=kept)


def _edit_of_point(sketch: Sketch, river: River, index: int) -> int | None:
    """Find which edit put a control point where it is, or names it by where it still is."""
    if not 0 <= index < len(river.points):
        return None  # the river has become shorter meanwhile
    x, y = river.points[index, :2]
    best, nearest = None, _SAME_PLACE
    for at, edit in enumerate(sketch.edits):
        if (
            edit.action == "move_point"
            and edit.feature == river.id
            and edit.x is not None
            and edit.y is not None
        ):
            places = [(edit.x, edit.y)]
            if edit.from_x is not None and edit.from_y is not None:
                places.append((edit.from_x, edit.from_y))
            away = min(math.hypot(px - x, py - y) for px, py in places)
            if away <= nearest:
                best, nearest = at, away
    return best


def _said_width(sketch: Sketch, river: River) -> float:
    """Return the width (m) that a river was given or that its label says; 0 if it is as it was painted."""
    given = [edit.width for edit in sketch.edits if edit.action == "width" and edit.feature == river.id]
    if given and given[-1] is not None:
        return given[-1]
    return cast("float", sketch.properties("river", river.label)["width"])


def _within(action: str, name: str, value: float) -> float:
    """Bring a value that was dragged into the range that its edit declares."""
    if not math.isfinite(value):
        raise InputError(f"{name}: expected a number, got {value}")
    parameter: Parameter = ACTIONS[action].values[name]
    return min(max(round(float(value), _DIGITS), float(parameter.low)), float(parameter.high))
