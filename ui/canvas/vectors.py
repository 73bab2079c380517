"""Vectors on the canvas: drawing, and editing of the selected one with the selection tool."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF, QTransform

from sketchterrain.array_types import Float64Array
from sketchterrain.caching import IdentityKey, LRUCache
from sketchterrain.document import vector_edits as edits
from sketchterrain.document.vectors import AREA, LINE, VectorFeature, VectorLayer
from sketchterrain.errors import InputError
from sketchterrain.hydrology.splines import cubics, drop_repeats
from sketchterrain.ui.canvas.marks import SELECTED, OverlayImage, draw_haloed
from sketchterrain.ui.canvas.tool_context import Pointer, ToolContext
from sketchterrain.ui.look.layer_colours import label_colour
from sketchterrain.ui.models import vectors
from sketchterrain.ui.models.selection import Handle
from sketchterrain.ui.models.workspace import Selection

_LEAST_WIDTH = 1.5  # logical px of a line
REACH = 10.0  # logical px in which a vertex is hit, or snapped to
_DRAG = 4.0  # logical px after which a press is a drag
_MAX_HANDLES = 1500
_NEAR = 4.0  # logical px between vertices, below which a curve is drawn straight
_MAX_PATHS = 200_000


def polygon(points: Float64Array) -> QPolygonF:
    """Return points (n, 2) as a polygon."""
    return QPolygonF([QPointF(x, y) for x, y in points.tolist()])


def _add_curve(path: QPainterPath, points: Float64Array) -> None:
    """Add Bézier curves (n, 4, 2), each beginning where the last one ends."""
    path.moveTo(*points[0, 0].tolist())
    for curve in points[:, 1:].reshape(-1, 6).tolist():
        path.cubicTo(*curve)


def path_of(feature: VectorFeature) -> QPainterPath:
    """Return the path of a line or area, m."""
    path = QPainterPath()
    for ring in feature.rings:
        points = drop_repeats(ring)
        if feature.kind == LINE and feature.properties.get("smooth") == 1 and len(points) > 1:
            _add_curve(path, vectors.bezier(cubics(points)))
        elif feature.kind in (LINE, AREA):
            path.addPolygon(polygon(ring))
            if feature.kind == AREA:
                path.closeSubpath()
    return path


class _LayerPaths:
    """The paths of a layer's features, m, each made when it is first drawn."""

    def __init__(self, layer: VectorLayer, known: dict[tuple[bytes, bool], QPainterPath]) -> None:
        self._layer, self._curves, self._known = layer, vectors.curves_of(layer), known
        self._ends = np.searchsorted(self._curves.features, np.arange(len(layer) + 1))
        self._smooth = (layer.kinds == LINE) & (vectors.own_numbers(layer, "smooth") == 1)
        self.boxes = np.repeat([[np.inf, np.inf, -np.inf, -np.inf]], len(layer), axis=0)
        for side, ufunc in enumerate((np.minimum, np.minimum, np.maximum, np.maximum)):
            ufunc.at(self.boxes[:, side], self._curves.features, self._curves.boxes[:, side])

    def path(self, index: int, scale: float) -> QPainterPath:
        """Return the path of a feature, straight between vertices if these are near at a scale, px/m."""
        points = self._curves.points[self._ends[index] : self._ends[index + 1]]
        west, south, east, north = self.boxes[index].tolist()
        is_curved = bool(self._smooth[index]) and max(east - west, north - south) * scale > _NEAR * len(
            points
        )
        key = points.tobytes(), is_curved
        if key not in self._known:  # else it was in another layer, before an edit
            self._known[key] = self._curve(points) if is_curved else self._polygons(index)
        return self._known[key]

    def _curve(self, points: Float64Array) -> QPainterPath:
        path = QPainterPath()
        _add_curve(path, points)
        return path

    def _polygons(self, index: int) -> QPainterPath:
        layer, path = self._layer, QPainterPath()
        for number in range(*layer.parts[index : index + 2].tolist()):
            path.addPolygon(polygon(layer.ring(number)))
            if layer.kinds[index] == AREA:
                path.closeSubpath()
        return path


class VectorMarks:
    """A cached image of the vectors of visible layers, above the paint."""

    def __init__(self, context: ToolContext) -> None:
        self._context = context
        self._image = OverlayImage(context, self._draw)
        self._layers = LRUCache(4)
        self._paths: dict[tuple[bytes, bool], QPainterPath] = {}  # by their segments
        self.hidden: tuple[str, tuple[int, ...]] = ("", ())  # layer and features that are dragged

    def image(self) -> QImage | None:
        """Return the image of the whole canvas, device pixels; None if there is nothing to draw."""
        sketch = self._context.document.sketch
        layers = vectors.visible_vectors(sketch, self._context.workspace)
        return self._image.updated(*layers, sketch.labels, sketch.pixel_size, self.hidden) if layers else None

    def to_screen(self) -> QTransform:
        """Return the transform from m to logical px."""
        scale, at = self._context.px_per_metre, self._context.screen_from_world(0.0, 0.0)
        return QTransform(scale, 0.0, 0.0, -scale, at.x(), at.y())

    def set_pen(self, painter: QPainter, kind: int, colour: QColor, width: float) -> None:
        """Set pen and brush for features of a kind and width (m), for a painter whose units are m."""
        pen = QPen(colour, _LEAST_WIDTH, cap=Qt.PenCapStyle.FlatCap, join=Qt.PenJoinStyle.BevelJoin)
        if width * self._context.px_per_metre > _LEAST_WIDTH:
            cap, join = Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin
            pen = QPen(colour, width, cap=cap, join=join)
        else:  # round caps and joins would take three times the time
            pen.setCosmetic(True)
        painter.setPen(pen)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        if kind == AREA:
            fill = QColor(colour)
            fill.setAlpha(128)
            painter.setBrush(fill)

    def _draw(self, painter: QPainter, area: QRectF) -> None:
        context = self._context
        west, north = context.world_from_sketch(*context.sketch_from_screen(area.topLeft()))
        east, south = context.world_from_sketch(*context.sketch_from_screen(area.bottomRight()))
        painter.setTransform(self.to_screen(), True)
        if len(self._paths) > _MAX_PATHS:
            self._paths.clear()
        for layer in vectors.visible_vectors(context.document.sketch, context.workspace):
            make = partial(_LayerPaths, layer, self._paths)
            paths = self._layers.get_or_compute(IdentityKey(layer), make)
            widths = vectors.widths_of(context.document.sketch, layer)
            margin = 0.5 * widths + 2.0 * _LEAST_WIDTH / context.px_per_metre
            boxes = paths.boxes.T
            visible = (boxes[0] - margin < east) & (boxes[2] + margin > west)
            visible &= (boxes[1] - margin < north) & (boxes[3] + margin > south)
            if self.hidden[0] == layer.layer:
                visible &= ~np.isin(layer.ids, self.hidden[1])
            rows = np.flatnonzero(visible)
            last: tuple[int, int, float] | None = None
            for index in rows[np.argsort(layer.kinds[rows] == LINE, kind="stable")].tolist():
                kind, label, width = int(layer.kinds[index]), int(layer.labels[index]), float(widths[index])
                if last != (kind, label, width):
                    self.set_pen(painter, kind, label_colour(layer.layer, label), width)
                    last = kind, label, width
                painter.drawPath(paths.path(index, context.px_per_metre))


class VectorEditor:
    """Selects vectors and edits the vertices of the selected one; part of the selection tool."""

    def __init__(self, context: ToolContext, marks: VectorMarks) -> None:
        self._context, self._marks = context, marks
        self._pressed: tuple[Handle, tuple[float, float]] | None = None  # a vertex, and where it was pressed
        self._drag: vectors.VectorDrag | None = None
        self.hovered: Selection | None = None

    @property
    def is_busy(self) -> bool:
        return self._drag is not None

    def press(self, pointer: Pointer) -> bool:
        """Activate a vertex or select a vector; return whether there was one."""
        at = self._world(pointer)
        handle = self.vertex_at(at)
        selection = self.selection_at(at) if handle is None else handle.selection
        self._pressed = None if handle is None else (handle, at)
        if selection is not None:
            self._context.workspace.selection = selection
            self._context.signals.redraw()
        return selection is not None

    def move(self, pointer: Pointer) -> bool:
        """Drag the pressed vertex, or find what is under the mouse; return whether there is something."""
        at, context = self._world(pointer), self._context
        if self._pressed is not None and self._drag is None:
            handle, start = self._pressed
            refusal = context.workspace.refusal(handle.selection.kind)
            if math.dist(at, start) * context.px_per_metre <= _DRAG:
                return True
            if refusal:
                self._pressed = None
                context.signals.message.emit(refusal)
                return True
            self._drag = vectors.VectorDrag(context.document, handle, grab=start, reach=self._reach)
            self._marks.hidden = (handle.selection.kind, self._drag.ids)
        if self._drag is not None:
            self._drag.to(*at)
            context.signals.redraw()
            return True
        hovered = None if self.vertex_at(at) else self.selection_at(at)
        if hovered != self.hovered:
            self.hovered = hovered
            context.signals.redraw()
        return hovered is not None

    def double(self, pointer: Pointer) -> bool:
        """Insert a vertex where the selected vector is; return whether it is there."""
        context, (x, y) = self._context, self._world(pointer)
        selection = context.workspace.selection
        feature = vectors.find_vector(context.document.sketch, selection)
        if selection is None or feature is None:
            return False
        layer = context.document.sketch.vectors[selection.kind]
        curves, first = vectors.curves_of(layer), edits.vertices_of(layer, selection.id)[0]
        own = curves.features == layer.index(selection.id)
        found = curves.nearest(x, y, np.where(own, self._reach, -np.inf))
        if found is None or self.vertex_at((x, y)) is not None:
            return False
        after = int(curves.start[found[0]])
        title = "Insert a vertex in"
        self.attempt(
            lambda: vectors.change_vector(
                context.document,
                context.workspace,
                selection,
                title,
                lambda layer, _: edits.insert_vertex(layer, after, *found[1]),
            )
        )
        if layer is not context.document.sketch.vectors[selection.kind]:
            context.workspace.selection = replace(selection, index=after + 1 - first)
        return True

    def finish(self) -> None:
        """Record the drag as a history step."""
        drag = self._drag
        self.cancel()
        if drag is not None:
            drag.finish()
            if drag.problem:
                self._context.signals.message.emit(drag.problem)

    def cancel(self) -> None:
        self._drag = self._pressed = None
        self._marks.hidden = ("", ())
        self._context.signals.redraw()

    def delete(self) -> None:
        """Delete the active vertex or the vector."""
        self.attempt(lambda: vectors.delete_vector(self._context.document, self._context.workspace))

    def attempt(self, change: Callable[[], None]) -> None:
        """Make a change, or report why it is not possible."""
        try:
            change()
        except InputError as error:
            self._context.signals.message.emit(str(error))

    def selection_at(self, at: tuple[float, float]) -> Selection | None:
        """Return the vector at a position, m."""
        context = self._context
        return vectors.vector_at(context.document.sketch, context.workspace, *at, reach=self._reach)

    def vertex_at(self, at: tuple[float, float]) -> Handle | None:
        """Return the vertex of the selected vector at a position, m; the active one first."""
        selection = self._context.workspace.selection
        feature = vectors.find_vector(self._context.document.sketch, selection)
        if feature is None or selection is None:
            return None
        places = np.concatenate(feature.rings)
        distance = np.hypot(*(places - at).T)
        if selection.index is not None and selection.index < len(places):
            distance[selection.index] -= 1e-6
        index = int(np.argmin(distance))
        if distance[index] > self._reach:
            return None
        x, y = places[index].tolist()
        return Handle("point", replace(selection, index=index), x, y, x, y)

    def draw(self, painter: QPainter) -> None:
        """Draw the selected and the hovered vector, and what is dragged."""
        context = self._context
        sketch, selection = context.document.sketch, context.workspace.selection
        if self._drag is not None:
            self._draw_drag(painter, self._drag)
        hovered = vectors.find_vector(sketch, self.hovered) if self._drag is None else None
        if hovered is not None and self.hovered != selection:
            colour = QColor(SELECTED)
            colour.setAlpha(150)
            draw_haloed(painter, self._marks.to_screen().map(path_of(hovered)), colour, 2.0)
        feature = vectors.find_vector(sketch, selection)
        if feature is None or selection is None:
            return
        layer = sketch.vectors[selection.kind]
        numbers = edits.vertices_of(layer, selection.id)
        shared = vectors.curves_of(layer).shared[numbers.start : numbers.stop]
        if self._drag is not None:
            feature = next(each for each in self._drag.features if each.id == feature.id)
        path = self._marks.to_screen().map(path_of(feature))
        draw_haloed(painter, path, SELECTED, 2.0)
        if feature.properties.get("directed") == 1:
            _draw_arrow(painter, path)
        x, y = context.screens_from_world(*np.concatenate(feature.rings).T)
        width, height = context.viewport.width / context.ratio, context.viewport.height / context.ratio
        visible = np.flatnonzero((x > -REACH) & (x < width + REACH) & (y > -REACH) & (y < height + REACH))
        painter.setPen(QPen(SELECTED, 1.8))
        for index in visible.tolist() if len(visible) <= _MAX_HANDLES else []:
            painter.setBrush(SELECTED if index == selection.index else QColor(255, 255, 255))
            square = QRectF(float(x[index]) - 3.5, float(y[index]) - 3.5, 7.0, 7.0)
            painter.drawEllipse(square.adjusted(-1, -1, 1, 1)) if shared[index] else painter.drawRect(square)

    def _draw_drag(self, painter: QPainter, drag: vectors.VectorDrag) -> None:
        """Draw the dragged features, which the image lacks."""
        sketch, name = self._context.document.sketch, drag.handle.selection.kind
        layer = sketch.vectors[name]
        widths = vectors.widths_of(sketch, layer)
        painter.save()
        painter.setTransform(self._marks.to_screen(), True)
        for feature in drag.features:
            colour, width = label_colour(name, feature.label), float(widths[layer.index(feature.id)])
            self._marks.set_pen(painter, feature.kind, colour, width)
            painter.drawPath(path_of(feature))
        painter.restore()

    @property
    def _reach(self) -> float:
        return REACH / self._context.px_per_metre

    def _world(self, pointer: Pointer) -> tuple[float, float]:
        return self._context.world_from_sketch(pointer.x, pointer.y)


def _draw_arrow(painter: QPainter, path: QPainterPath) -> None:
    """Draw the direction of a line, halfway along it."""
    at, angle = path.pointAtPercent(0.5), math.radians(-path.angleAtPercent(0.5))
    corners = ((9.0, 0.0), (-6.0, 6.0), (-6.0, -6.0))
    arrow = QPolygonF([QPointF(*corner) for corner in corners])
    painter.setPen(QPen(QColor(255, 255, 255), 1.5))
    painter.setBrush(SELECTED)
    painter.drawPolygon(QTransform.fromTranslate(at.x(), at.y()).rotateRadians(angle).map(arrow))
