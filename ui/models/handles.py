"""Handles of the selection: what is at a place, what can be dragged, and a drag as one step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.hydrology.lakes import distance_inside
from sketchterrain.placement.feature_types import (
    FEATURE_TYPES,
    Lake,
    River,
    area_profile,
    hill_profile,
    mountain_profile,
)
from sketchterrain.ui.commands.placed_edits import (
    drag_title,
    dragged,
    find_parent_river,
    find_point,
    find_river,
)
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Selection

_TREES = 20.0  # m that a full forest stands out, beside a mountain's metres


@dataclass(frozen=True)
class Handle:
    """Something to drag.

    Attributes
    ----------
    role : {'move', 'radius', 'point', 'width'}
        What dragging it changes: where a feature stands, how far it reaches, where a river's control point
        lies, how wide the river is.
    chosen : Chosen
        Whose it is; of a control point with its index.
    x, y : float
        Where it lies (m).
    base_x, base_y : float
        What a radius and a width are counted from (m): the feature's middle, the river's centreline. Of the
        others where they lie.
    """

    role: str
    selection: Selection
    x: float
    y: float
    base_x: float
    base_y: float


def select_at(placed: Placement, x: float, y: float, *, reach: float) -> Selection | None:
    """Return what is meant by a click.

    A feature's middle goes before a river, that before a lake; anywhere else it is the feature that makes
    most of the ground there.
    """
    points = placed.points
    away = np.hypot(points["x"] - x, points["y"] - y)
    if len(points) and away.min() <= reach:
        return Selection("feature", int(points["id"][int(np.argmin(away))]))
    rivers = [(_past_bank(river, x, y), river.id) for river in placed.rivers]
    if rivers and min(rivers)[0] <= reach:
        return Selection("river", min(rivers)[1])
    lake = next((each for each in placed.lakes if _is_in(each, x, y)), None)
    if lake is not None:
        return Selection("lake", lake.id)
    makes = _makes(points, away)
    if not len(makes) or makes.max() <= 0.0:
        return None
    return Selection("feature", int(points["id"][int(np.argmax(makes))]))


def handles_of(placed: Placement, selection: Selection | None) -> tuple[Handle, ...]:
    """Return the handles of what is chosen; none of a lake, or of what is gone.

    A river's last control point has none where it joins another one: it follows that one.
    """
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
    points = [Handle("point", Selection("river", river.id, i), x, y, x, y) for i, (x, y) in enumerate(places)]
    return (*points, _width_handle(river, whole))


def _width_handle(river: River, selection: Selection) -> Handle:
    """Put it on the left bank, amid two control points and so clear of theirs, halfway down the river."""
    line = river.centreline[:, :2]
    half = len(river.points) // 2
    ends = [
        int(np.argmin(((line - point) ** 2).sum(axis=1))) for point in river.points[half - 1 : half + 1, :2]
    ]
    at = min(max(sum(ends) // 2, 1), len(line) - 2) if len(line) > 2 else 0
    east, north = line[min(at + 1, len(line) - 1)] - line[max(at - 1, 0)]
    across = 0.5 * float(river.centreline_width[at]) / max(float(np.hypot(east, north)), 1e-9)
    x, y = (float(each) for each in line[at])
    return Handle("width", selection, x - across * float(north), y + across * float(east), x, y)


def _past_bank(river: River, x: float, y: float) -> float:
    """Return how far (m) a place lies beyond a river's banks; 0 in its water."""
    start, way = river.centreline[:-1, :2], np.diff(river.centreline[:, :2], axis=0)
    off = np.array([x, y]) - start
    along = np.clip((off * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-12), 0.0, 1.0)
    away = np.hypot(*(off - along[:, None] * way).T) - 0.5 * river.centreline_width[:-1]
    return max(float(away.min()), 0.0)


def _is_in(lake: Lake, x: float, y: float) -> bool:
    return float(distance_inside(lake.shape, np.array([[x, y]]))[0]) > 0.0


def _makes(points: npt.NDArray[np.void], away: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """How much (m) each feature adds at distances (m) from its middle, roughly; trees count as ground."""
    t = away / np.maximum(points["radius"], 1e-6)
    kinds = points["type"]
    shares = {
        "mountain": mountain_profile(t, points["peakiness"].astype(np.float64), 1.0),
        "hill": hill_profile(t, 1.0),
        "dune": area_profile(t),
        "forest": _TREES * area_profile(t),
    }
    profile = np.select([kinds == FEATURE_TYPES.index(name) for name in shares], list(shares.values()), 0.0)
    return np.asarray(np.where(t < 1.0, points["strength"] * profile, 0.0))


class FeatureDrag:
    """Changes a document as a handle is dragged."""

    def __init__(
        self,
        document: Document,
        placed: Placement,
        handle: Handle,
        *,
        grab: tuple[float, float] | None = None,
    ) -> None:
        self._document = document
        self._placed = placed
        self._before = document.sketch
        self._last: Sketch | None = document.sketch
        self._title = drag_title(placed, handle)
        self._off = (0.0, 0.0) if grab is None else (handle.x - grab[0], handle.y - grab[1])
        self._merge = object()
        self.handle = handle
        self.x, self.y = handle.x, handle.y
        self.problem = ""

    @property
    def is_alive(self) -> bool:
        """Whether nothing else changed the document meanwhile; if something did, dragging has no effect."""
        return self._document.sketch is self._last

    def to(self, x: float, y: float) -> None:
        """Drag it on: the mouse is at a place (m) now."""
        if not self.is_alive:
            return
        x, y = x + self._off[0], y + self._off[1]
        self.problem = ""
        try:
            self._do(dragged(self._before, self._placed, self.handle, x, y))
            self.x, self.y = x, y
        except InputError as error:
            self.problem = str(error)

    def finish(self) -> None:
        """Let go: what was done is one step of the history."""
        self._last = None

    def cancel(self) -> None:
        """Let go and leave everything as it was."""
        if self.is_alive and self._last is not self._before:
            self._do(self._before)
        self.x, self.y = self.handle.x, self.handle.y
        self.finish()

    def _do(self, sketch: Sketch) -> None:
        self._document.do(self._title, sketch, merge=self._merge)
        self._last = self._document.sketch
