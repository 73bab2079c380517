"""Vectors on the canvas: all of them, and the selected one with its vertices."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF, QTransform

from sketchterrain.array_types import Int64Array
from sketchterrain.features.edits import shared_nodes
from sketchterrain.features.picking import outlines_of
from sketchterrain.features.table import AREA, LINE, POINT, FeatureTable
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.canvas.drapes import PictureWindow, draw_items
from sketchterrain.ui.canvas.marks import SELECTED, draw_haloed, screen_paths, world_box
from sketchterrain.ui.canvas.tool_context import ToolContext
from sketchterrain.ui.look.layer_colours import label_colour
from sketchterrain.ui.models import features
from sketchterrain.ui.models.features import SelectedFeature
from sketchterrain.ui.models.selection import FeatureDrag

_WIDEST = 6.0  # logical px of a style's line with its casing
_OVER_PAINT = 0.625  # of the opacity of areas, through which paint is seen
_HANDLE_ROOM = 9.0  # logical px between vertices that are drawn
_MANY, _SMALL = 1000, 8.0  # areas, if there are more, with sides of fewer logical px are drawn as squares


def draw_feature(
    painter: QPainter, context: ToolContext, own: SelectedFeature | None, colour: QColor
) -> None:
    """Highlight a feature, with an arrow if it has a direction.

    A draped one that is edited is drawn as its layer does, too.
    """
    drapes = context.document.drapes
    if own is None:
        return
    if drapes.held is not None and drapes.current is not None and drapes.held == own.selection.draped:
        corner = context.world_from_sketch(*context.sketch_from_screen(QPointF(0.0, 0.0)))
        window = PictureWindow(*corner, 1.0 / context.px_per_metre, 0, 0)
        painter.save()
        draw_items(painter, drapes.current, drapes.current.only(drapes.held, window.texel), window)
        painter.restore()
    (path,) = screen_paths(context, outlines_of(np.array([own.shape])), context.area)  # areas may be invalid
    for x, y in own.places.tolist() if own.feature.kind == POINT else []:
        path.addEllipse(context.screen_from_world(x, y), 6.0, 6.0)
    draw_haloed(painter, path, colour, 2.0)
    if own.feature.properties.get("directed") == 1 and not path.isEmpty():
        _draw_arrow(painter, path)


def draw_selected_feature(
    painter: QPainter, context: ToolContext, own: SelectedFeature, drag: FeatureDrag | None
) -> None:
    """Draw the selected feature with its vertices, and while one is dragged all that share the node."""
    shared = np.zeros(len(own.places), np.bool_)
    if own.selection.is_vector:
        shared = shared_nodes(features.network_of(own.sketch, own.selection.kind), own.places)
    others = own.others_at(drag.x, drag.y) if drag is not None and drag.handle.is_vertex else []
    for each in (*others, own):
        draw_feature(painter, context, each, SELECTED)
    x, y = context.screens_from_world(*own.places.T)
    left, top, right, bottom = context.area.adjusted(-5.0, -5.0, 5.0, 5.0).getCoords()
    visible = np.flatnonzero((x > left) & (x < right) & (y > top) & (y < bottom))
    # One in a square where they are close: the active one, else a shared one.
    rank = np.where(np.arange(len(x)) == own.selection.index, 0, np.where(shared, 1, 2))
    visible = visible[np.argsort(rank[visible], kind="stable")]
    squares = np.stack([x, y], axis=1)[visible] // _HANDLE_ROOM
    visible = visible[np.unique(squares, axis=0, return_index=True)[1]]
    painter.setPen(QPen(SELECTED, 1.8))
    for index in visible.tolist():
        painter.setBrush(SELECTED if index == own.selection.index else QColor(255, 255, 255))
        square = QRectF(float(x[index]) - 3.5, float(y[index]) - 3.5, 7.0, 7.0)
        painter.drawEllipse(square.adjusted(-1, -1, 1, 1)) if shared[index] else painter.drawRect(square)


def draw_vectors(painter: QPainter, context: ToolContext, area: QRectF) -> None:
    """Draw the vectors of visible layers in an area, in the styles of their classes."""
    sketch = context.document.sketch
    for layer in features.visible_vectors(sketch, context.workspace):
        widths, classes = features.looks_of(sketch, layer)
        widths, curves = widths * context.px_per_metre, layer.curves
        margin = 0.5 * max(float(widths.max()), _WIDEST)
        order = curves.touching(world_box(context, area, margin))
        order = order[np.argsort(layer.kinds[order] == LINE, kind="stable")]
        if LAYERS[layer.layer].kind == "land" and len(classes) > _MANY:
            order = np.intersect1d(order, _draw_small(context, painter, area, layer, classes))
        paths = screen_paths(context, curves.shapes[order], area, margin=margin)
        visible = [
            (path, *_tools(layer.layer, int(layer.labels[at]), int(classes[at]), float(widths[at])), at)
            for at, path in zip(order.tolist(), paths, strict=True)
            if not path.isEmpty()
        ]
        # Casings of all lines before the lines, so that they do not cross junctions.
        for number in range(2):
            for path, brush, pens, at in visible:
                if number >= 2 - len(pens):
                    painter.setPen(pens[number - 2])
                    painter.setBrush(brush if layer.kinds[at] == AREA else Qt.BrushStyle.NoBrush)
                    painter.drawPath(path)


def _draw_small(
    context: ToolContext, painter: QPainter, area: QRectF, layer: FeatureTable, classes: Int64Array
) -> Int64Array:
    """Draw small areas as squares in the colours of their classes; return the indices of the others."""
    import shapely

    shapes = layer.curves.shapes
    side = np.sqrt(shapely.area(shapes)) * context.px_per_metre
    west, south, east, north = shapely.bounds(shapes).T
    x, y = context.screens_from_world(0.5 * (west + east), 0.5 * (south + north))
    small, margin = side < _SMALL, int(_SMALL)
    width, height = int(area.width()) + 2 * margin, int(area.height()) + 2 * margin
    column, row = (np.rint(each - 0.5 * side).astype(int) for each in (x - area.x(), y - area.y()))
    small_here = (
        (column > -margin) & (column < width - 2 * margin) & (row > -margin) & (row < height - 2 * margin)
    )
    numbers = np.zeros((height, width), np.uint8)
    for size in range(margin + 1):
        own = np.flatnonzero(small & small_here & (np.rint(side) == size))
        for each in np.ndindex(max(size, 1), max(size, 1)):
            numbers[row[own] + margin + each[0], column[own] + margin + each[1]] = 1 + classes[own]
    brushes = (_tools(layer.layer, 1, each, 0.0)[0] for each in range(len(LAYERS[layer.layer].classes)))
    colours = np.array([[0, 0, 0, 0], *(brush.getRgb() for brush in brushes)], np.uint8)
    image = QImage(colours[numbers].tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888)
    painter.drawImage(QPointF(area.x() - margin, area.y() - margin), image)
    return np.flatnonzero(~small)


@lru_cache(maxsize=256)
def _tools(layer: str, label: int, number: int, width: float) -> tuple[QColor, tuple[QPen, ...]]:
    """Return the colour of areas, and the pens of a class's lines of a width (px): any casing, and a line.

    Vectors of painted layers have the colour of their label.
    """
    style, is_painted = LAYERS[layer].classes[number].style, LAYERS[layer].is_painted
    colour = label_colour(layer, label) if is_painted else QColor(style["colour"])
    inside = QColor(colour if is_painted else style["fill"])
    inside.setAlphaF(_OVER_PAINT * style["fill_opacity"])
    least = max(style["width"], features.LEAST_WIDTH)
    # Round caps would take three times the time.
    is_thin = width <= least
    cap = Qt.PenCapStyle.FlatCap if is_thin or style["dash"] else Qt.PenCapStyle.RoundCap
    join, wide = Qt.PenJoinStyle.BevelJoin if is_thin else Qt.PenJoinStyle.RoundJoin, max(width, least)
    pen = QPen(colour, wide, cap=cap, join=join)
    if style["dash"]:
        pen.setDashPattern([max(float(each), 0.5 * least) / wide for each in style["dash"].split()])
    if is_painted or not style["casing"]:
        return inside, (pen,)
    edges = QPen(QColor(style["casing"]), wide + 2.0 * style["casing_width"], cap=cap, join=join)
    return inside, (edges, pen)


def _draw_arrow(painter: QPainter, path: QPainterPath) -> None:
    """Draw the direction of a line, halfway along it."""
    at, angle = path.pointAtPercent(0.5), math.radians(-path.angleAtPercent(0.5))
    corners = ((9.0, 0.0), (-6.0, 6.0), (-6.0, -6.0))
    arrow = QPolygonF([QPointF(*corner) for corner in corners])
    painter.setPen(QPen(QColor(255, 255, 255), 1.5))
    painter.setBrush(SELECTED)
    painter.drawPolygon(QTransform.fromTranslate(at.x(), at.y()).rotateRadians(angle).map(arrow))
