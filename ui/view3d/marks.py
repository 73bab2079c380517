"""What is laid over a picture: features, rivers and handles where they are seen, and what the mouse hits."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.placement.feature_types import FEATURE_TYPES, Lake, River
from sketchterrain.ui.canvas.marks import shore_lines
from sketchterrain.ui.commands.placed_edits import find_lake, find_point, find_river
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.selection import Handle, handles_of
from sketchterrain.ui.models.workspace import Selection
from sketchterrain.ui.view3d.projection import Ground, Projection, ring

_MOST_DOTS = 300
_MOST_PIECES = 200  # of a river's line
_MOST_SHORE = 1500  # pieces of a shore
_LEAST_RADIUS = 5.0  # px; smaller features are not marked
_SQUARE = 13.0  # px; there is one feature's mark in a square, that of the largest
_STEP = 13.0  # px between the control points of a river that are shown
_WIDTH_ARM = 14.0  # px, between a river's bank and the handle of its width: rivers are thin


@dataclass(frozen=True)
class Dot:
    """The middle of a feature: px, its type, whether ground hides it."""

    selection: Selection
    kind: str
    x: float
    y: float
    hidden: bool


@dataclass(frozen=True)
class Grip:
    """A handle as it is seen."""

    handle: Handle
    x: float  # px
    y: float
    base_x: float  # px, of what it is counted from
    base_y: float
    z: float  # m, the height of the level on which it is dragged
    hidden: bool  # Whether ground hides it


@dataclass(frozen=True, eq=False)
class Line:
    """Straight pieces as they are seen: from x, y to x, y (n, 4) in px, and which ones ground hides."""

    pieces: Float64Array
    hidden: BoolArray


@dataclass(frozen=True, eq=False)
class Marks:
    """All that is laid over a picture."""

    dots: tuple[Dot, ...] = ()  # Features that can be clicked
    rivers: tuple[Line, ...] = ()  # Those that are not selected
    outline: tuple[Line, ...] = ()  # Of what is selected
    grips: tuple[Grip, ...] = field(default=())

    def dot_at(self, x: float, y: float, *, reach: float) -> Dot | None:
        """Return the nearest feature's middle within `reach` px that no ground hides."""
        seen = [each for each in self.dots if not each.hidden]
        near = min(seen, key=lambda dot: np.hypot(dot.x - x, dot.y - y), default=None)
        return near if near is not None and np.hypot(near.x - x, near.y - y) <= reach else None

    def grip_at(self, x: float, y: float, *, reach: float) -> Grip | None:
        """Return the nearest handle within `reach` px; one that ground hides only if no other is there."""
        near = [each for each in self.grips if np.hypot(each.x - x, each.y - y) <= reach]
        return min(near, key=lambda grip: (grip.hidden, np.hypot(grip.x - x, grip.y - y)), default=None)


def marks_of(
    projection: Projection,
    ground: Ground,
    placed: Placement,
    selection: Selection | None,
    *,
    all_features: bool,
    dragged: tuple[Handle, float, float] | None = None,
) -> Marks:
    """Return what is laid over a picture."""
    dots = _dots(projection, ground, placed, selection) if all_features else ()
    others = (
        [each for each in placed.rivers if selection is None or each.id != selection.id]
        if all_features
        else []
    )
    rivers = tuple(line for each in others for line in _lines(projection, ground, _course(ground, each)))
    outline = _outline(projection, ground, placed, selection, dragged)
    grips = _grips(projection, ground, placed, selection, dragged)
    return Marks(dots, rivers, outline, grips)


def _dots(
    projection: Projection, ground: Ground, placed: Placement, selection: Selection | None
) -> tuple[Dot, ...]:
    points = placed.points[placed.points["painted"]]
    if not len(points):
        return ()
    places = ground.on(np.column_stack([points["x"], points["y"]]))
    seen = projection.see(places)
    size = points["radius"] / np.maximum(seen.away, 1e-3)
    _, _, _, height = projection.place
    shown = seen.before & (size * height > _LEAST_RADIUS)
    if selection is not None and selection.kind == "feature":
        shown &= points["id"] != np.uint64(selection.id)
    kept = np.flatnonzero(shown)
    kept = _apart(kept[np.argsort(-size[kept], kind="stable")], seen.at)[:_MOST_DOTS]
    hidden = ground.hides(projection.eye, places[kept])
    return tuple(
        Dot(
            Selection("feature", int(points["id"][at])),
            FEATURE_TYPES[int(points["type"][at])],
            float(seen.at[at, 0]),
            float(seen.at[at, 1]),
            bool(off),
        )
        for at, off in zip(kept, hidden, strict=True)
    )


def _apart(order: npt.NDArray[np.intp], at: Float64Array) -> npt.NDArray[np.intp]:
    """Return the first of those that share a square of the picture, so that marks can be told apart."""
    squares = np.floor(at[order] / _SQUARE).astype(np.int64)
    _, first = np.unique(squares, axis=0, return_index=True)
    return order[np.sort(first)]


def _course(ground: Ground, river: River) -> Float64Array:
    """Return a river's line (n, 3) in few pieces; in the sketch it lies on the ground that is shown."""
    last = len(river.centreline) - 1
    step = max(last // _MOST_PIECES, 1)
    line: Float64Array = river.centreline[[*range(0, last, step), last]]
    inside = ground.covers(line[:, 0], line[:, 1])
    line[inside, 2] = np.maximum(line[inside, 2], ground.height(line[inside, 0], line[inside, 1]))
    return line


def _outline(
    projection: Projection,
    ground: Ground,
    placed: Placement,
    selection: Selection | None,
    dragged: tuple[Handle, float, float] | None,
) -> tuple[Line, ...]:
    if selection is None:
        return ()
    river, point, lake = (
        find_river(placed, selection),
        find_point(placed, selection),
        find_lake(placed, selection),
    )
    if lake is not None:
        return (_shore(projection, ground, lake),)
    if river is not None:
        return tuple(_lines(projection, ground, _course(ground, river)))
    if point is None:
        return ()
    x, y, radius = float(point["x"]), float(point["y"]), float(point["radius"])
    if dragged is not None and dragged[0].role == "move":
        x, y = dragged[1:]
    elif dragged is not None and dragged[0].role == "radius":
        radius = float(np.hypot(dragged[1] - x, dragged[2] - y))
    return tuple(_lines(projection, ground, ground.on(ring(x, y, radius))))


def _lines(projection: Projection, ground: Ground, places: Float64Array) -> list[Line]:
    """Return the parts of a line (n, 3) that are seen; a piece is hidden if both of its ends are."""
    found = []
    for first, at in projection.runs(places):
        own = places[np.clip(np.arange(first, first + len(at)), 0, len(places) - 1)]
        off = ground.hides(projection.eye, own)
        found.append(Line(np.concatenate([at[:-1], at[1:]], axis=1), off[1:] & off[:-1]))
    return found


def _shore(projection: Projection, ground: Ground, lake: Lake) -> Line:
    """Return a lake's shore, as far as it lies before the eye."""
    pieces = _shore_of(lake)
    level = np.full((len(pieces), 1), lake.level)
    starts, ends = np.hstack([pieces[:, :2], level]), np.hstack([pieces[:, 2:], level])
    one, other = projection.see(starts), projection.see(ends)
    shown = one.before & other.before
    at = np.concatenate([one.at, other.at], axis=1)[shown]
    return Line(at, ground.hides(projection.eye, starts[shown]))


@lru_cache(maxsize=4)
def _shore_of(lake: Lake) -> Float64Array:
    pieces = shore_lines(lake.shape)
    return pieces[:: max(len(pieces) // _MOST_SHORE, 1)] if len(pieces) > 2 * _MOST_SHORE else pieces


def _grips(
    projection: Projection,
    ground: Ground,
    placed: Placement,
    selection: Selection | None,
    dragged: tuple[Handle, float, float] | None,
) -> tuple[Grip, ...]:
    handles = handles_of(placed, selection)
    if not handles:
        return ()
    now = [
        (dragged[1], dragged[2]) if dragged is not None and dragged[0] == each else (each.x, each.y)
        for each in handles
    ]
    shift = np.zeros(2)
    if dragged is not None and dragged[0].role == "move":  # what hangs on the middle comes along
        shift = np.array(dragged[1:]) - [dragged[0].x, dragged[0].y]
        now = [
            at if each.role == "move" else (each.x + shift[0], each.y + shift[1])
            for each, at in zip(handles, now, strict=True)
        ]
    places = ground.on(now)
    bases = ground.on(np.array([(each.base_x, each.base_y) for each in handles]) + shift)
    seen, below = projection.see(places), projection.see(bases)
    hidden = ground.hides(projection.eye, places)
    found = []
    last = np.full(2, -np.inf)
    for i, handle in enumerate(handles):
        if not seen.before[i]:
            continue
        if handle.role == "point":
            is_taken = handle.selection == selection or (dragged is not None and dragged[0] == handle)
            if np.hypot(*(seen.at[i] - last)) < _STEP and not is_taken:
                continue
            last = seen.at[i]
        (x, y), (base_x, base_y) = seen.at[i], below.at[i] if below.before[i] else seen.at[i]
        if handle.role == "width":
            away = max(float(np.hypot(x - base_x, y - base_y)), 1e-6)
            x, y = x + (x - base_x) * _WIDTH_ARM / away, y + (y - base_y) * _WIDTH_ARM / away
        found.append(
            Grip(
                handle, float(x), float(y), float(base_x), float(base_y), float(places[i, 2]), bool(hidden[i])
            )
        )
    return tuple(found)
