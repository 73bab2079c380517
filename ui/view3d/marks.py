"""Marks over the 3-D view: features, rivers and handles in pixels, and hit tests."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES, River
from sketchterrain.schema.layers import LAYERS, id_of_vector
from sketchterrain.ui.canvas.marks import shore_lines
from sketchterrain.ui.commands import find_lake, find_point, find_river
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.selection import OFFSET_ROLES, FeatureDrag, handles_of
from sketchterrain.ui.models.workspace import Handle, Selection
from sketchterrain.ui.view3d.camera import Projection, TerrainHeights, circle

_MAX_DOTS = 300
_MAX_RIVER_SEGMENTS = 200
_MAX_SHORE_SEGMENTS = 1500
_MIN_RADIUS = 5.0  # px; smaller features have no mark
_DOT_SPACING = 13.0  # px; side of a square with one mark, that of the largest feature
_POINT_SPACING = 13.0  # px between a river's visible control points
_NEAR_AXIS = 20.0  # m from a station of a way's axis that is beside a place
_WIDTH_ARM = 14.0  # px from a river's bank to the handle of its width, for rivers are thin


@dataclass(frozen=True)
class Dot:
    """The centre of a feature, px."""

    selection: Selection
    kind: str
    x: float
    y: float
    hidden: bool  # By the terrain


@dataclass(frozen=True)
class HandleMark:
    """A handle, px."""

    handle: Handle
    x: float
    y: float
    base_x: float  # px, of what its distance is measured from
    base_y: float
    z: float  # m, height of the level on which it is dragged
    hidden: bool  # By the terrain


@dataclass(frozen=True, eq=False)
class Segments:
    """Line segments."""

    pixels: Float64Array  # (n, 4): x, y to x, y
    hidden: BoolArray  # By the terrain


@dataclass(frozen=True, eq=False)
class Marks:
    """All marks over a picture."""

    dots: tuple[Dot, ...] = ()
    rivers: tuple[Segments, ...] = ()  # Without the selected one
    outline: tuple[Segments, ...] = ()  # Of the selection
    handles: tuple[HandleMark, ...] = ()

    def dot_at(self, x: float, y: float, *, reach: float) -> Dot | None:
        """Return the nearest visible dot within `reach` px."""
        near = [each for each in self.dots if not each.hidden and np.hypot(each.x - x, each.y - y) <= reach]
        return min(near, key=lambda dot: np.hypot(dot.x - x, dot.y - y), default=None)

    def handle_at(self, x: float, y: float, *, reach: float) -> HandleMark | None:
        """Return the nearest handle within `reach` px, a visible one if possible."""
        near = [each for each in self.handles if np.hypot(each.x - x, each.y - y) <= reach]
        return min(near, key=lambda mark: (mark.hidden, np.hypot(mark.x - x, mark.y - y)), default=None)


@dataclass(frozen=True, eq=False)
class MarkBuilder:
    """Projects the marks of a placement and a selection."""

    projection: Projection
    terrain: TerrainHeights
    placed: Placement
    selection: Selection | None
    drag: FeatureDrag | None = None
    lines: Sequence[Float64Array] = ()  # of the selected feature, (n, 2) m
    handles: tuple[Handle, ...] = ()  # of it

    def marks(self, *, all_features: bool) -> Marks:
        """Return the marks of all features, or of the selection only."""
        if not all_features:
            return Marks(outline=self._outline(), handles=self._handles())
        selected = None if self.selection is None else self.selection.id
        others = [river for river in self.placed.rivers if river.id != selected]
        rivers = tuple(self._segments(self._course(river)) for river in others)
        return Marks(self._dots(), rivers, self._outline(), self._handles())

    def _dots(self) -> tuple[Dot, ...]:
        points = self.placed.points[self.placed.points["painted"]]
        if not len(points):
            return ()
        places = self.terrain.drape(np.column_stack([points["x"], points["y"]]))
        projected = self.projection.project(places)
        size = points["radius"] / np.maximum(projected.depth, 1e-3)
        visible = projected.in_front & (size * self.projection.rectangle[3] > _MIN_RADIUS)
        if self.selection is not None and self.selection.kind == "feature":
            visible &= points["id"] != np.uint64(self.selection.id)
        order = np.flatnonzero(visible)
        order = _thinned(order[np.argsort(-size[order], kind="stable")], projected.pixels)[:_MAX_DOTS]
        hidden = self.terrain.occludes(self.projection.eye, places[order])
        return tuple(
            Dot(
                Selection("feature", int(points["id"][index])),
                FEATURE_TYPES[int(points["type"][index])],
                float(projected.pixels[index, 0]),
                float(projected.pixels[index, 1]),
                bool(is_hidden),
            )
            for index, is_hidden in zip(order, hidden, strict=True)
        )

    def _course(self, river: River) -> Float64Array:
        """Return a river's simplified line (n, 3), within the sketch at least as high as the terrain."""
        line: Float64Array = river.centreline[_thin(len(river.centreline), _MAX_RIVER_SEGMENTS)]
        inside = self.terrain.contains(line[:, 0], line[:, 1])
        line[inside, 2] = np.maximum(line[inside, 2], self.terrain.height(line[inside, 0], line[inside, 1]))
        return line

    def _outline(self) -> tuple[Segments, ...]:
        if self.selection is None:
            return ()
        if self.lines:
            thinned = (line[_thin(len(line), _MAX_SHORE_SEGMENTS)] for line in self.lines)
            return tuple(self._segments(self._drape(line)) for line in thinned)
        find = (self.placed, self.selection)
        river, point, lake = find_river(*find), find_point(*find), find_lake(*find)
        if lake is not None:
            shore = (line[_thin(len(line), _MAX_SHORE_SEGMENTS)] for line in shore_lines(lake.shape))
            return tuple(self._segments(np.insert(line, 2, lake.level, axis=1)) for line in shore)
        if river is not None:
            return (self._segments(self._course(river)),)
        if point is None:
            return ()
        x, y, radius = float(point["x"]), float(point["y"]), float(point["radius"])
        if self.drag is not None and self.drag.handle.role == "move":
            x, y = self.drag.x, self.drag.y
        elif self.drag is not None and self.drag.handle.role == "radius":
            radius = float(np.hypot(self.drag.x - x, self.drag.y - y))
        return (self._segments(self.terrain.drape(circle(x, y, radius))),)

    def _drape(self, places: Float64Array) -> Float64Array:
        """Return places (n, 2) on the terrain, (n, 3), or above it on bridges of the selected way."""
        draped, kind = self.terrain.drape(places), "" if self.selection is None else self.selection.kind
        name = id_of_vector(kind, self.selection.id) if self.selection is not None and kind in LAYERS else 0
        axes = [road.axis for road in self.placed.roads if road.id == name]
        if axes:
            stations = np.concatenate(axes)
            found = cKDTree(stations[:, :2]).query(places, distance_upper_bound=_NEAR_AXIS)
            distance, near = map(np.asarray, found)
            on_axis = np.isfinite(distance)
            draped[on_axis, 2] = np.maximum(draped[on_axis, 2], stations[near[on_axis], 2])
        return draped

    def _segments(self, line: Float64Array) -> Segments:
        """Return the visible segments of a line (n, 3), hidden where the terrain hides both ends."""
        pixels, visible = self.projection.project_segments(line[:-1], line[1:])
        hidden = self.terrain.occludes(self.projection.eye, line)
        return Segments(pixels, (hidden[:-1] & hidden[1:])[visible])

    def _handles(self) -> tuple[HandleMark, ...]:
        handles = self.handles or handles_of(self.placed, self.selection)
        if not handles:
            return ()
        places, bases = self._handle_places(handles)
        projected, base = self.projection.project(places), self.projection.project(bases)
        hidden = self.terrain.occludes(self.projection.eye, places)
        marks = []
        last = np.full(2, -np.inf)
        for i, handle in enumerate(handles):
            if not projected.in_front[i]:
                continue
            pixel = projected.pixels[i]
            if handle.role == "point":
                is_dragged = self.drag is not None and self.drag.handle == handle
                is_active = handle.selection == self.selection or is_dragged
                if np.hypot(*(pixel - last)) < _POINT_SPACING and not is_active:
                    continue
                last = pixel
            base_pixel = base.pixels[i] if base.in_front[i] else pixel
            if handle.role in OFFSET_ROLES:
                arm = pixel - base_pixel
                pixel = pixel + arm * _WIDTH_ARM / max(float(np.hypot(*arm)), 1e-6)
            (x, y), (base_x, base_y), z = pixel.tolist(), base_pixel.tolist(), float(places[i, 2])
            marks.append(HandleMark(handle, x, y, base_x, base_y, z, bool(hidden[i])))
        return tuple(marks)

    def _handle_places(self, handles: tuple[Handle, ...]) -> tuple[Float64Array, Float64Array]:
        """Return handles and their bases on the terrain, (n, 3); a moved centre moves all of them."""
        places = np.array([(each.x, each.y) for each in handles])
        bases = np.array([(each.base_x, each.base_y) for each in handles])
        if self.drag is not None and self.drag.handle.selection.is_placed:
            handle, x, y = self.drag.handle, self.drag.x, self.drag.y
            if handle.role == "move":
                shift = np.array([x - handle.x, y - handle.y])
                places, bases = places + shift, bases + shift
            dragged = [each == handle for each in handles]
            places[dragged] = x, y
        return self._drape(places), self._drape(bases)


def _thin(count: int, most: int) -> list[int]:
    """Return the indices of about `most` of a line's points, the last one among them."""
    return [*range(0, count - 1, max((count - 1) // most, 1)), count - 1]


def _thinned(order: npt.NDArray[np.intp], pixels: Float64Array) -> npt.NDArray[np.intp]:
    """Return the first of the points that share a square of the picture."""
    squares = np.floor(pixels[order] / _DOT_SPACING).astype(np.int64)
    _, first = np.unique(squares, axis=0, return_index=True)
    return order[np.sort(first)]
