"""Vectors on the canvas: all of them, and the selected one with its vertices."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF, QTransform

from sketchterrain.document.vector_edits import vertices_of
from sketchterrain.document.vectors import AREA, LINE
from sketchterrain.ui.canvas.marks import SELECTED, OverlayImage, draw_haloed
from sketchterrain.ui.canvas.tool_context import ToolContext
from sketchterrain.ui.look.layer_colours import label_colour
from sketchterrain.ui.models import vectors
from sketchterrain.ui.models.selection import FeatureDrag
from sketchterrain.ui.models.workspace import Selection

_LEAST_WIDTH = 1.5  # logical px of a line
_MAX_HANDLES = 1500
_TOLERANCE = 0.3  # logical px of drawn lines


class VectorMarks:
    """A cached image of the vectors of visible layers, above the paint."""

    def __init__(self, context: ToolContext) -> None:
        self._context = context
        self._image = OverlayImage(context, self._draw)

    def image(self) -> QImage | None:
        """Return the image of the whole canvas, device pixels; None if there is nothing to draw."""
        sketch = self._context.document.sketch
        layers = vectors.visible_vectors(sketch, self._context.workspace)
        return self._image.updated(*layers, sketch.labels, sketch.pixel_size) if layers else None

    def draw_outline(self, painter: QPainter, selection: Selection, colour: QColor) -> None:
        """Highlight a vector, with an arrow if it has a direction."""
        sketch = self._context.document.sketch
        feature = vectors.find_vector(sketch, selection)
        if feature is not None:
            layer = sketch.vectors[selection.kind]
            shape = vectors.curves_of(layer).shapes[layer.index(selection.id)]
            (path,) = self._paths(np.array([shape]), self._canvas())
            draw_haloed(painter, path, colour, 2.0)
            if feature.properties.get("directed") == 1:
                _draw_arrow(painter, path)

    def draw_selection(self, painter: QPainter, selection: Selection, drag: FeatureDrag | None) -> None:
        """Draw the selected vector with its vertices, and while one is dragged all that share the node."""
        context, sketch = self._context, self._context.document.sketch
        feature = vectors.find_vector(sketch, selection)
        if feature is None:
            return
        places = np.concatenate(feature.rings)
        if drag is None:
            self.draw_outline(painter, selection, SELECTED)
        else:
            start, end = (drag.handle.x, drag.handle.y), (drag.x, drag.y)
            places[(places == start).all(axis=1)] = end
            moved = vectors.shapes_with_moved_node(sketch.vectors[selection.kind], start, end)
            for path in self._paths(moved, self._canvas()):
                draw_haloed(painter, path, SELECTED, 2.0)
        numbers = vertices_of(sketch.vectors[selection.kind], selection.id)
        shared = vectors.curves_of(sketch.vectors[selection.kind]).shared[numbers.start : numbers.stop]
        x, y = context.screens_from_world(*places.T)
        left, top, right, bottom = self._canvas().getCoords()
        visible = np.flatnonzero((x > left) & (x < right) & (y > top) & (y < bottom))
        painter.setPen(QPen(SELECTED, 1.8))
        for index in visible.tolist() if len(visible) <= _MAX_HANDLES else []:
            painter.setBrush(SELECTED if index == selection.index else QColor(255, 255, 255))
            square = QRectF(float(x[index]) - 3.5, float(y[index]) - 3.5, 7.0, 7.0)
            painter.drawEllipse(square.adjusted(-1, -1, 1, 1)) if shared[index] else painter.drawRect(square)

    def _canvas(self) -> QRectF:
        """Return the visible area, with room for lines."""
        viewport, ratio = self._context.viewport, self._context.ratio
        return QRectF(0.0, 0.0, viewport.width / ratio, viewport.height / ratio).adjusted(
            -9.0, -9.0, 9.0, 9.0
        )

    def _paths(self, shapes: Any, area: QRectF) -> list[QPainterPath]:
        """Return the path of each shape within an area, logical px."""
        import shapely

        context = self._context
        west, north = context.world_from_sketch(*context.sketch_from_screen(area.topLeft()))
        east, south = context.world_from_sketch(*context.sketch_from_screen(area.bottomRight()))
        clipped = shapely.clip_by_rect(shapes, west, south, east, north)
        lines = vectors.outlines(
            shapely.simplify(clipped, _TOLERANCE / context.px_per_metre, preserve_topology=False)
        )
        parts, of = shapely.get_parts(lines, return_index=True)
        points, part = shapely.get_coordinates(parts, return_index=True)
        points = np.stack(context.screens_from_world(*points.T))
        ends = np.searchsorted(part, np.arange(1, len(parts)))
        paths = [QPainterPath() for _ in shapes]
        for path, line in zip(of.tolist(), np.split(points, ends, axis=1), strict=True):
            paths[path].addPolygon(QPolygonF(list(map(QPointF, *line.tolist()))))
        return paths

    def _draw(self, painter: QPainter, area: QRectF) -> None:
        context = self._context
        for layer in vectors.visible_vectors(context.document.sketch, context.workspace):
            widths = vectors.widths_of(context.document.sketch, layer) * context.px_per_metre
            margin = 0.5 * float(widths.max()) + 2.0 * _LEAST_WIDTH
            order = np.argsort(layer.kinds == LINE, kind="stable")
            paths = self._paths(
                vectors.curves_of(layer).shapes[order], area.adjusted(-margin, -margin, margin, margin)
            )
            for index, path in zip(order.tolist(), paths, strict=True):
                if path.isEmpty():
                    continue
                colour = label_colour(layer.layer, int(layer.labels[index]))
                self._set_pen(painter, colour, float(widths[index]))
                fill = QColor(colour.red(), colour.green(), colour.blue(), 128)
                painter.setBrush(fill if layer.kinds[index] == AREA else Qt.BrushStyle.NoBrush)
                painter.drawPath(path)

    def _set_pen(self, painter: QPainter, colour: QColor, width: float) -> None:
        pen = QPen(colour, width, cap=Qt.PenCapStyle.RoundCap, join=Qt.PenJoinStyle.RoundJoin)
        if width <= _LEAST_WIDTH:  # round ones would take three times the time
            pen = QPen(colour, _LEAST_WIDTH, cap=Qt.PenCapStyle.FlatCap, join=Qt.PenJoinStyle.BevelJoin)
        painter.setPen(pen)


def _draw_arrow(painter: QPainter, path: QPainterPath) -> None:
    """Draw the direction of a line, halfway along it."""
    at, angle = path.pointAtPercent(0.5), math.radians(-path.angleAtPercent(0.5))
    corners = ((9.0, 0.0), (-6.0, 6.0), (-6.0, -6.0))
    arrow = QPolygonF([QPointF(*corner) for corner in corners])
    painter.setPen(QPen(QColor(255, 255, 255), 1.5))
    painter.setBrush(SELECTED)
    painter.drawPolygon(QTransform.fromTranslate(at.x(), at.y()).rotateRadians(angle).map(arrow))
