"""The selection: hit testing of placed features, drag handles and drags, commands; one history step each."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features.picking import snapped
from sketchterrain.features.table import FeatureTable
from sketchterrain.landforms.placement.feature_types import (
    FEATURE_TYPES,
    River,
    distance_inside,
    height_profile,
)
from sketchterrain.schema.layers import LAYERS, layer_of, vector_of
from sketchterrain.ui import commands
from sketchterrain.ui.commands import find_parent_river, find_point, find_river, name_of
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models import features
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Handle, Selection, Workspace

_TITLES = {
    "point": "Move a vertex of",
    "corner": "Resize a feature of",
    "rotate": "Rotate a feature of",
    "move": "Move a feature of",
    "width": "Set the width of",
}
_TREE_HEIGHT = 20.0  # m that a dense forest counts when compared with mountains


REACH: Final = 10.0
"""Logical px in which a handle, vertex or placed object is hit, or snapped to."""

OFFSET_ROLES = ("width", "corner", "rotate")
"""Roles of handles that are shown some px farther from their base."""


def selections_at(
    document: Document,
    workspace: Workspace,
    placed: Placement,
    x: float,
    y: float,
    texel: float,
    *,
    styled: bool = True,
) -> list[Selection]:
    """Return what is at a position (m): what is drawn there, the topmost first, then what is within 3 px.

    Draped features lie over vectors, and these over placed objects. A pixel is `texel` m; `styled` is as for
    `vector_picks`.
    """
    drapes = document.drapes.current
    draped = () if drapes is None else drapes.picks(x, y, texel)
    found = [(each.distance, Selection("drape", each.feature, layer=each.layer)) for each in draped]
    found += features.vector_picks(document.sketch, workspace, x, y, texel, styled=styled)
    found.sort(key=lambda pair: pair[0])
    selections = [selection for _, selection in found if not (selection.is_draped and selection.id < 0)]
    if not selections and (object_there := select_at(placed, x, y, reach=REACH * texel)):
        selections = [object_there]
    return selections


def next_below(stack: list[Selection], selection: Selection | None) -> Selection | None:
    """Return what a click on a stack selects: the first of it, or what follows the selected one."""
    whole = selection and replace(selection, index=None)
    return stack[(stack.index(whole) + 1) % len(stack) if whole in stack else 0] if stack else None


def kept(stack: list[Selection], selection: Selection | None) -> Selection | None:
    """Return what a menu on a stack is for: the selected one, else the first of it."""
    whole = selection and replace(selection, index=None)
    return whole if whole in stack else next(iter(stack), None)


def select_at(placed: Placement, x: float, y: float, *, reach: float) -> Selection | None:
    """Return the object at a position (m), within a tolerance (m).

    A feature's centre goes before a river, a river before a lake; elsewhere it is the highest feature.
    For a river or lake that a vector made it is the vector.
    """
    points = placed.points
    distance = np.hypot(points["x"] - x, points["y"] - y)
    if len(points) and distance.min() <= reach:
        return Selection("feature", int(points["id"][int(np.argmin(distance))]))
    rivers = [(_bank_distance(river, x, y), river.id) for river in placed.rivers]
    if rivers and min(rivers)[0] <= reach:
        return _of_water("course", min(rivers)[1])
    at = np.array([[x, y]])
    lake = next((each for each in placed.lakes if distance_inside(each.shape, at)[0] > 0.0), None)
    if lake is not None:
        return _of_water("water", lake.id)
    heights = _heights(points, distance)
    if not len(heights) or heights.max() <= 0.0:
        return None
    return Selection("feature", int(points["id"][int(np.argmax(heights))]))


def _of_water(kind: str, name: int) -> Selection:
    vector = vector_of(name)
    return Selection(kind, name) if vector is None else Selection(layer_of(name), vector)


def handles_of(placed: Placement, selection: Selection | None) -> tuple[Handle, ...]:
    """Return a selection's handles: none for lakes and missing objects, none where a river joins another."""
    if selection is None:
        return ()
    whole = Selection(selection.kind, selection.id)
    point = find_point(placed, selection)
    if point is not None:
        x, y, radius = (float(point[key]) for key in ("x", "y", "radius"))
        return Handle("move", whole, x, y, x, y), Handle("radius", whole, x + radius, y, x, y)
    river = find_river(placed, selection)
    if river is None:
        return ()
    free = len(river.points) - (find_parent_river(placed, river) is not None)
    places = river.points[:free, :2].tolist()
    points = [
        Handle("point", Selection("course", river.id, i), x, y, x, y) for i, (x, y) in enumerate(places)
    ]
    return (*points, _width_handle(river, whole))


def _width_handle(river: River, selection: Selection) -> Handle:
    """Return the width handle: on the left, halfway down the river between two control points."""
    line = river.centreline[:, :2]
    half = len(river.points) // 2
    near = river.points[half - 1 : half + 1, :2]
    ends = [int(np.argmin(((line - point) ** 2).sum(axis=1))) for point in near]
    at = min(max(sum(ends) // 2, 1), len(line) - 2) if len(line) > 2 else 0
    east, north = line[min(at + 1, len(line) - 1)] - line[max(at - 1, 0)]
    mean = river.mean_width
    width = float(river.centreline_width[at] if mean is None else mean[half - 1 : half + 1].mean())
    across = 0.5 * width / max(float(np.hypot(east, north)), 1e-9)
    x, y = (float(each) for each in line[at])
    return Handle("width", selection, x - across * float(north), y + across * float(east), x, y)


def _bank_distance(river: River, x: float, y: float) -> float:
    """Return the distance (m) of a position from a river's banks; 0 in its water."""
    start, segment = river.centreline[:-1, :2], np.diff(river.centreline[:, :2], axis=0)
    offset = np.array([x, y]) - start
    along = np.clip((offset * segment).sum(axis=1) / np.maximum((segment**2).sum(axis=1), 1e-12), 0.0, 1.0)
    distance = np.hypot(*(offset - along[:, None] * segment).T) - 0.5 * river.centreline_width[:-1]
    return max(float(distance.min()), 0.0)


def _heights(points: StructuredArray, distance: Float64Array) -> Float64Array:
    """Return each feature's approximate height (m) at a distance (m) from its centre; trees count."""
    t = distance / np.maximum(points["radius"], 1e-6)
    profile = np.zeros(len(points))
    for code, name in enumerate(FEATURE_TYPES):
        own = points["type"] == code
        height = height_profile(name, t[own], points["peakiness"][own].astype(np.float64), 1.0)
        profile[own] = height * (_TREE_HEIGHT if LAYERS[name].is_share else 1.0)
    return np.asarray(np.where(t < 1.0, points["strength"] * profile, 0.0))


class FeatureDrag:
    """A drag of a handle: edits the document, as one history step.

    Vertices snap to others and to lines within `reach` (m). The vertices of rivers and lakes move when the
    drag is finished; `sketch` has them moved before.
    """

    def __init__(
        self,
        document: Document,
        placed: Placement,
        handle: Handle,
        *,
        grab: tuple[float, float] | None = None,
        reach: float = 0.0,
    ) -> None:
        self._document, self._placed = document, placed
        self._before = self.sketch = document.sketch
        self._last: Sketch | None = document.sketch
        self._reach = reach
        is_angle = handle.role == "rotate"
        self._offset = (0.0, 0.0) if grab is None or is_angle else (handle.x - grab[0], handle.y - grab[1])
        self._merge = object()
        self._feature = features.SelectedFeature.find(document, handle.selection)
        document.drapes.hold(handle.selection)
        self.handle = handle
        self.x, self.y = handle.x, handle.y
        self.problem = ""

    @property
    def is_alive(self) -> bool:
        """Whether only this drag has changed the document; otherwise it has no further effect."""
        return self._document.sketch is self._last

    def to(self, x: float, y: float) -> None:
        """Drag to a position (m)."""
        if not self.is_alive:
            return
        x, y = x + self._offset[0], y + self._offset[1]
        handle, self.problem = self.handle, ""
        if handle.is_vertex:
            tables = self._tables
            x, y = snapped(tables, x, y, self._reach, other_than=(handle.x, handle.y)) or (x, y)
        try:
            if self._feature is None:
                self.sketch = commands.dragged(self._before, self._placed, handle, x, y)
            else:
                self.sketch = self._feature.dragged(handle, x, y)
            if handle.is_live:
                self._do(self.sketch)
            self.x, self.y = x, y
        except InputError as error:
            self.problem = str(error)

    @cached_property
    def _tables(self) -> Sequence[FeatureTable]:
        return features.tables_near(self._document, self.handle.selection)

    def finish(self) -> None:
        """End the drag; `problem` tells why the last motion was not possible."""
        if self.is_alive and self.sketch is not self._last:
            self._do(self.sketch)
        self._last = None
        self._document.drapes.hold(None)

    def cancel(self) -> None:
        """Revert and end the drag."""
        if self.is_alive and self._last is not self._before:
            self._do(self._before)
        self.sketch, self._last = self._before, None
        self.x, self.y = self.handle.x, self.handle.y
        self._document.drapes.hold(None)

    def _do(self, sketch: Sketch) -> None:
        selection, role = self.handle.selection, self.handle.role
        if selection.is_placed:
            title = commands.drag_title(self._placed, self.handle)
        else:
            title = f"{_TITLES[role]} {features.title_of(self._document, selection)}"
        self._document.do(title, sketch, merge=self._merge)
        self._last = self.sketch = self._document.sketch


def add(document: Document, workspace: Workspace, kind: str, x: float, y: float) -> None:
    """Add a feature at a position (m) and select it."""
    sketch = commands.added_at(document.sketch, kind, x, y)
    document.do(f"Add {kind}", sketch)
    workspace.selection = Selection("feature", sketch.edits[-1].feature or 0)


def _command(
    verb: str, change: Callable[[Sketch, Placement, Selection], Sketch]
) -> Callable[[Document, Workspace, Placement, Selection], None]:
    def command(document: Document, _: Workspace, placed: Placement, selection: Selection) -> None:
        document.do(f"{verb} {name_of(placed, selection)}", change(document.sketch, placed, selection))

    return command


lock = _command("Lock", commands.locked)
unlock = _command("Unlock", lambda sketch, _, selection: commands.unlocked(sketch, selection))
reset = _command("Reset", commands.reset)
"""Remove the edits of an object."""


def delete(document: Document, workspace: Workspace, placed: Placement, selection: Selection) -> None:
    """Delete an object and deselect it; of a vector its active vertex if there is one."""
    if not selection.is_placed:
        features.delete_feature(document, workspace)
    else:
        document.do(f"Delete {name_of(placed, selection)}", commands.deleted(document.sketch, selection))
        workspace.selection = None


def delete_or_reset(document: Document, workspace: Workspace, placed: Placement, selection: Selection) -> str:
    """Delete the selection, or reset a river's control point; return why not, or nothing."""
    if selection.index is None or not selection.is_placed:
        delete(document, workspace, placed, selection)
    elif commands.is_edited(document.sketch, placed, selection):
        document.do("Reset a point of a river", commands.reset(document.sketch, placed, selection))
    else:
        return "A river's control point cannot be deleted; click the river to delete all of it"
    return ""
