"""User edits of point features: move, resize, strengthen, delete, add, lock."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import StructuredArray
from sketchterrain.document.edits import ACTIONS, Edit
from sketchterrain.landforms.hydrology.rivers import targets_lake, targets_river
from sketchterrain.landforms.placement.feature_types import (
    FEATURE,
    FEATURE_TYPES,
    FILL_BIT,
    stored_style,
)
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.schema.layers import LAYERS


@dataclass(frozen=True, eq=False)
class EditedPoints:
    """Point features after the user's edits."""

    points: StructuredArray  # sorted by id
    replaced: StructuredArray  # original features that were removed or changed
    orphans: tuple[str, ...]  # one line for each edit whose feature is missing


def apply_painted_edits(painted: StructuredArray, edits: Iterable[Edit]) -> EditedPoints:
    """Apply the user's edits, in order, to painted features; those of waters and of the fill are ignored."""
    return _edited(painted, [edit for edit in edits if _targets_points(edit) and not _targets_fill(edit)])


def apply_fill_edits(fill: Fill, edits: Iterable[Edit], *, size: tuple[float, float]) -> EditedPoints:
    """Apply the user's edits, in order, to fill features within the sketch's `size` (m); others are ignored.

    Returns only the changed features; the `replaced` ones are to be left out of the fill.
    """
    own = [edit for edit in edits if _targets_points(edit) and _targets_fill(edit)]
    edited = np.zeros(0, dtype=FEATURE)
    if own:
        edited = fill.within(0.0, 0.0, *size)
        edited = edited[_has_id(edited, [edit.feature or 0 for edit in own])]
    return _edited(edited, own)


def _targets_points(edit: Edit) -> bool:
    return not targets_river(edit) and not targets_lake(edit)


def _targets_fill(edit: Edit) -> bool:
    return (edit.feature or 0) >= int(FILL_BIT)


def _edited(before: StructuredArray, edits: list[Edit]) -> EditedPoints:
    changed: dict[int, StructuredArray | None] = {}
    locks = {edit.feature for edit in edits if edit.action == "lock"}
    orphans = []
    for edit in edits:
        name = cast("int", edit.feature)
        row = changed[name] if name in changed else _row(before, name)
        if edit.action in ("lock", "add"):
            changed[name] = _stored(edit)
        elif row is None and name not in locks:
            orphans.append(f"{edit.action} of feature {name}: no such feature")
        elif row is not None:
            changed[name] = None if edit.action == "delete" else _with_values(row, edit)
    hidden = before[_has_id(before, changed)]
    rows = [before[~_has_id(before, changed)], *(row for row in changed.values() if row is not None)]
    points = np.concatenate(rows)
    points = points[np.argsort(points["id"], kind="stable")]
    return EditedPoints(points, hidden, tuple(orphans))


def _has_id(points: StructuredArray, ids: Iterable[int]) -> npt.NDArray[np.bool_]:
    return np.isin(points["id"], np.array(list(ids), dtype=np.uint64))


def _row(points: StructuredArray, name: int) -> StructuredArray | None:
    at = int(np.searchsorted(points["id"], np.uint64(name)))
    found = at < len(points) and int(points["id"][at]) == name
    return points[at : at + 1].copy() if found else None


def _stored(edit: Edit) -> StructuredArray:
    """Return the feature stored in a lock or an addition."""
    row = np.zeros(1, dtype=FEATURE)
    row["id"], row["painted"] = edit.feature, not _targets_fill(edit)
    name = cast("str", edit.type)
    row["type"] = FEATURE_TYPES.index(name)
    # Missing values are the defaults of the type's labels.
    table = {**ACTIONS[edit.action].values, **LAYERS[name].parameters}
    values = {key: edit.values.get(key, parameter.default) for key, parameter in table.items()}
    fields = {key: values[key] for key in ("x", "y", "radius", "strength")} | stored_style(name, values)
    for key, value in fields.items():
        row[key] = value
    return row


def _with_values(row: StructuredArray, edit: Edit) -> StructuredArray:
    row = row.copy()
    for key in ("x", "y", "radius", "strength"):
        if key in edit.values:
            row[key] = edit.values[key]
    if LAYERS[FEATURE_TYPES[int(row["type"][0])]].is_share:
        row["strength"] = np.minimum(row["strength"], 1.0)
    return row
