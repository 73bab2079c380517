"""Vectors on the canvas: drawing, and editing of the selected one with the selection tool."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF, QTransform

from sketchterrain.array_types import Float64Array
from sketchterrain.document import vector_edits as edits
from sketchterrain.document.vectors import AREA, LINE, VectorFeature, VectorLayer
from sketchterrain.errors import InputError
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


def path_of(feature: VectorFeature) -> QPainterPath:
    """Return the path of a feature, m, for previews."""
    path = QPainterPath()
    for line in vectors.lines_of(feature):
        path.addPolygon(polygon(line))
    return path


class VectorMarks:
    """A cached image of the vectors of visible layers, above the paint."""

    def __init__(self, context: ToolContext) -> None:
        self._context = context
        self._image = OverlayImage(context, self._draw)
        self._paths: dict[tuple[bytes, bool], QPainterPath] = {}  # by their segments: edits keep the others

    def image(self) -> QImage | None:
        """Return the image of the whole canvas, device pixels; None if there is nothing to draw."""
        sketch = self._context.document.sketch
        layers = vectors.visible_vectors(sketch, self._context.workspace)
        return self._image.updated(*layers, sketch.labels, sketch.pixel_size) if layers else None

    def to_screen(self) -> QTransform:
        """Return the transform from m to logical px."""
        scale, at = self._context.px_per_metre, self._context.screen_from_world(0.0, 0.0)
        return QTransform(scale, 0.0, 0.0, -scale, at.x(), at.y())

    def path(self, layer: VectorLayer, index: int) -> QPainterPath:
        """Return the path of a feature, m; straight between vertices if these are near on the screen."""
        curves = vectors.curves_of(layer)
        points = curves.points[curves.ends[index] : curves.ends[index + 1]]
        west, south, east, north = curves.bounds[index].tolist()
        size = max(east - west, north - south) * self._context.px_per_metre
        is_curved = bool(curves.smooth[index]) and size > _NEAR * len(points)
        key = points.tobytes(), is_curved
        if key not in self._paths:
            path = self._paths[key] = QPainterPath()
            if is_curved:
                path.moveTo(*points[0, 0].tolist())
                for curve in points[:, 1:].reshape(-1, 6).tolist():
                    path.cubicTo(*curve)
            for number in () if is_curved else range(*layer.parts[index : index + 2].tolist()):
                path.addPolygon(polygon(layer.ring(number)))
                if layer.kinds[index] == AREA:
                    path.closeSubpath()
        return self._paths[key]

    def _draw(self, painter: QPainter, area: QRectF) -> None:
        context = self._context
        west, north = context.world_from_sketch(*context.sketch_from_screen(area.topLeft()))
        east, south = context.world_from_sketch(*context.sketch_from_screen(area.bottomRight()))
        painter.setTransform(self.to_screen(), True)
        if len(self._paths) > _MAX_PATHS:
            self._paths.clear()
        for layer in vectors.visible_vectors(context.document.sketch, context.workspace):
            widths = vectors.widths_of(context.document.sketch, layer)
            margin = 0.5 * widths + 2.0 * _LEAST_WIDTH / context.px_per_metre
            left, below, right, above = vectors.curves_of(layer).bounds.T
            visible = (left - margin < east) & (right + margin > west)
            rows = np.flatnonzero(visible & (below - margin < north) & (above + margin > south))
            last: tuple[int, int, float] | None = None
            for index in rows[np.argsort(layer.kinds[rows] == LINE, kind="stable")].tolist():
                look = int(layer.kinds[index]), int(layer.labels[index]), float(widths[index])
                if look != last:
                    self._set_pen(painter, label_colour(layer.layer, look[1]), look[0], look[2])
                    last = look
                painter.drawPath(self.path(layer, index))

    def _set_pen(self, painter: QPainter, colour: QColor, kind: int, width: float) -> None:
        pen = QPen(colour, width, cap=Qt.PenCapStyle.RoundCap, join=Qt.PenJoinStyle.RoundJoin)
        if width * self._context.px_per_metre <= _LEAST_WIDTH:  # round ones would take three times the time
            pen = QPen(colour, _LEAST_WIDTH, cap=Qt.PenCapStyle.FlatCap, join=Qt.PenJoinStyle.BevelJoin)
            pen.setCosmetic(True)
        painter.setPen(pen)
        fill = QColor(colour.red(), colour.green(), colour.blue(), 128)
        painter.setBrush(fill if kind == AREA else Qt.BrushStyle.NoBrush)


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
        if self._pressed is not None:
            handle, start = self._pressed
            if math.dist(at, start) * context.px_per_metre > _DRAG:
                self._pressed = None
                refusal = context.workspace.refusal(handle.selection.kind)
                if refusal:
                    context.signals.message.emit(refusal)
                else:
                    self._drag = vectors.VectorDrag(context.document, handle, grab=start, reach=self._reach)
        if self._drag is not None:
            self._drag.to(*at)
            context.signals.redraw()
        if self._drag is not None or self._pressed is not None:
            return True
        is_vertex = self.vertex_at(at) is not None
        hovered = None if is_vertex else self.selection_at(at)
        if hovered != self.hovered:
            self.hovered = hovered
            context.signals.redraw()
        return is_vertex or hovered is not None

    def double(self, pointer: Pointer) -> bool:
        """Insert a vertex in the selected vector; return whether it is under the mouse."""
        at, context = self._world(pointer), self._context
        if self.vertex_at(at) is not None:
            return False
        try:
            return vectors.insert_vertex(context.document, context.workspace, *at, reach=self._reach)
        except InputError as error:
            context.signals.message.emit(str(error))
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
        self._context.signals.redraw()

    def delete(self) -> None:
        """Delete the active vertex or the vector."""
        try:
            vectors.delete_vector(self._context.document, self._context.workspace)
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
        """Draw the hovered and the selected vector, and while it is dragged all that share the node."""
        context, drag, to_screen = self._context, self._drag, self._marks.to_screen()
        sketch, selection, hovered = context.document.sketch, context.workspace.selection, self.hovered
        if hovered is not None and drag is None and vectors.find_vector(sketch, hovered) is not None:
            layer = sketch.vectors[hovered.kind]
            path = self._marks.path(layer, layer.index(hovered.id))
            colour = QColor(SELECTED)
            colour.setAlpha(150)
            draw_haloed(painter, to_screen.map(path), colour, 2.0)
        feature = vectors.find_vector(sketch, selection)
        if feature is None or selection is None:
            return
        layer = sketch.vectors[selection.kind]
        paths = [] if drag is None else [path_of(each) for each in drag.features]
        numbers = edits.vertices_of(layer, selection.id)
        shared = vectors.curves_of(layer).shared[numbers.start : numbers.stop]
        for path in paths or [self._marks.path(layer, layer.index(selection.id))]:
            draw_haloed(painter, to_screen.map(path), SELECTED, 2.0)
            if feature.properties.get("directed") == 1 and not paths:
                _draw_arrow(painter, to_screen.map(path))
        places = np.concatenate(feature.rings)
        if drag is not None:
            places[(places == (drag.handle.x, drag.handle.y)).all(axis=1)] = drag.x, drag.y
        x, y = context.screens_from_world(*places.T)
        width, height = context.viewport.width / context.ratio, context.viewport.height / context.ratio
        visible = np.flatnonzero((x > -REACH) & (x < width + REACH) & (y > -REACH) & (y < height + REACH))
        painter.setPen(QPen(SELECTED, 1.8))
        for index in visible.tolist() if len(visible) <= _MAX_HANDLES else []:
            painter.setBrush(SELECTED if index == selection.index else QColor(255, 255, 255))
            square = QRectF(float(x[index]) - 3.5, float(y[index]) - 3.5, 7.0, 7.0)
            painter.drawEllipse(square.adjusted(-1, -1, 1, 1)) if shared[index] else painter.drawRect(square)

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
