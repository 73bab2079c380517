"""Decorations of the canvas: scale bar, 3-D camera, contradiction warnings, adherence legend."""

import math
from collections.abc import Callable
from functools import cache, partial

from PyQt6.QtCore import QLineF, QPointF, QRect, QRectF, Qt
from PyQt6.QtGui import QColor, QFontMetricsF, QPainter, QPainterPath, QPen, QPolygonF

from sketchterrain.geometry.camera import Camera
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.canvas.marks import DARK, SELECTED, draw_features
from sketchterrain.ui.canvas.sketch_image import AGREEMENT, FAULT_COLOURS
from sketchterrain.ui.canvas.tool_context import CanvasImage, Tool, ToolContext
from sketchterrain.ui.canvas.vectors import draw_vectors
from sketchterrain.ui.engine.protocol import FrameFacts
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, tabular, theme
from sketchterrain.ui.models.features import visible_vectors

_PAD = 5.0
_BAR = 120.0  # px, approximate length of the scale bar
_CONE = 34.0  # px, length of the camera's cone
_EDGE = 14.0  # px, least distance of the camera from the canvas border
_WARNING = 10.0  # px, radius in which a warning has a tool tip


def write_beside(painter: QPainter, at: QPointF, text: str) -> QRectF:
    """Write a text label whose lower left corner is at a position; return its rectangle."""
    painter.save()
    painter.setFont(tabular(painter.font()))
    metrics = QFontMetricsF(painter.font())
    size = (metrics.horizontalAdvance(text) + 2.0 * _PAD, metrics.height() + _PAD)
    place = QRectF(at.x(), at.y() - size[1], *size)
    _draw_label(painter, place)
    painter.setPen(theme().text)
    painter.drawText(place, Qt.AlignmentFlag.AlignCenter, text)
    painter.restore()
    return place


def _draw_label(painter: QPainter, place: QRectF) -> None:
    """Draw a label's background in the theme's colours."""
    background = QColor(theme().window)
    background.setAlpha(228)
    painter.setPen(QColor(theme().line))
    painter.setBrush(background)
    painter.drawRoundedRect(place.adjusted(0.5, 0.5, -0.5, -0.5), 4.0, 4.0)


def nice_length(most: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most `most` (m)."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(step for step in (1.0, 2.0, 5.0) if step * power <= most * (1.0 + 1e-9)) * power


def draw_scale_bar(painter: QPainter, context: ToolContext, height: float) -> None:
    """Draw the scale bar in the lower left corner."""
    metres = nice_length(_BAR / context.px_per_metre)
    length = metres * context.px_per_metre
    text = f"{metres / 1000.0:g} km" if metres >= 1000.0 else f"{metres:g} m"
    painter.setFont(tabular(painter.font()))
    font = QFontMetricsF(painter.font())
    size = (length + 2.0 * SPACING, font.height() + 3.0 * SMALL + 4.0)
    place = QRectF(MARGIN, height - MARGIN - size[1], *size)
    _draw_label(painter, place)
    painter.setPen(theme().text)
    painter.drawText(place.adjusted(0, SMALL / 2, 0, -8.0), Qt.AlignmentFlag.AlignCenter, text)
    left, right, base = place.left() + SPACING, place.left() + SPACING + length, place.bottom() - 6.0
    painter.setPen(QPen(theme().text, 1.6, cap=Qt.PenCapStyle.FlatCap))
    ends = (left, base - 4.0), (left, base), (right, base), (right, base - 4.0)
    painter.drawPolyline(QPolygonF([QPointF(x, y) for x, y in ends]))


def draw_camera(painter: QPainter, context: ToolContext, pose: Camera) -> None:
    """Draw position and direction of the 3-D camera, clamped to the canvas."""
    at = _camera_place(context, pose)
    opening = pose.fov * 1.2
    cone = QPainterPath(at)
    circle = QRectF(at.x() - _CONE, at.y() - _CONE, 2 * _CONE, 2 * _CONE)
    cone.arcTo(circle, 90.0 - pose.heading - 0.5 * opening, opening)
    cone.closeSubpath()
    fill = QColor(SELECTED)
    fill.setAlpha(70)
    painter.setBrush(fill)
    painter.setPen(QPen(QColor(255, 255, 255, 190), 2.4))
    painter.drawPath(cone)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.setPen(QPen(SELECTED, 1.3))
    painter.drawPath(cone)
    painter.setPen(QPen(QColor(255, 255, 255), 1.5))
    painter.setBrush(SELECTED)
    painter.drawEllipse(at, 4.5, 4.5)


def _camera_place(context: ToolContext, pose: Camera) -> QPointF:
    at = context.screen_from_world(pose.eye[0], pose.eye[1])
    x = min(max(at.x(), _EDGE), max(context.area.width() - _EDGE, _EDGE))
    return QPointF(x, min(max(at.y(), _EDGE), max(context.area.height() - _EDGE, _EDGE)))


def draw_warnings(painter: QPainter, context: ToolContext) -> None:
    """Draw a warning sign where layers contradict each other."""
    for _, x, y in context.link.placed.resolutions:
        at = context.screen_from_world(x, y)
        sign = _warning_sign().translated(at)
        painter.setPen(QPen(QColor(255, 255, 255, 220), 4.0, join=Qt.PenJoinStyle.RoundJoin))
        painter.drawPath(sign)
        painter.setBrush(QColor(244, 176, 44))
        painter.setPen(QPen(DARK, 1.4, join=Qt.PenJoinStyle.RoundJoin))
        painter.drawPath(sign)
        painter.setPen(QPen(DARK, 1.9, cap=Qt.PenCapStyle.RoundCap))
        painter.drawLine(at + QPointF(0.0, -3.0), at + QPointF(0.0, 1.2))
        painter.drawPoint(at + QPointF(0.0, 4.4))


@cache
def _warning_sign() -> QPainterPath:
    path = QPainterPath()
    path.addPolygon(QPolygonF([QPointF(-8.5, 7.0), QPointF(0.0, -8.0), QPointF(8.5, 7.0)]))
    path.closeSubpath()
    return path


def warning_at(context: ToolContext, place: QPointF) -> str:
    """Return the resolved contradictions at a screen position, a line each."""
    found = [(line, context.screen_from_world(x, y)) for line, x, y in context.link.placed.resolutions]
    return "\n".join(line for line, at in found if QLineF(place, at).length() <= _WARNING)


def draw_legend(painter: QPainter, context: ToolContext, width: float, *, realism: bool) -> None:
    """Draw the active layer's adherence, or the distance to real land, with its colours, upper right."""
    measured, placed, layer = context.link.adherence, context.link.placed, context.workspace.layer
    title = "Realism" if realism else LAYERS[layer].title
    figures = None if measured is None else measured.figures.get("layers", {}).get(layer)
    rows: list[tuple[QColor | None, str]]
    if measured is not None and realism and measured.realism is not None:
        rows = [(None, f"Realism: {measured.realism['distance']:.2f} from {measured.realism['kind']}")]
        rows += [(colour, text) for text, colour in FAULT_COLOURS.items()]
    elif measured is not None and not realism and figures is not None:
        overlap, spill = figures.get("iou_mean"), figures.get("spill")
        rows = [(None, title if overlap is None else f"{title}: overlap {overlap:.0%}")]
        rows += [(AGREEMENT[name], name) for name in ("as painted", "missing")]
        rows.append((AGREEMENT["spill"], "spill" if spill is None else f"spill {spill:.0%}"))
    else:
        _draw_rows(
            painter, [(None, f"{title}: {'measuring …' if measured is None else 'not measured'}")], width
        )
        return
    if placed.version > measured.version:
        rows.append((None, "before the last change"))
    _draw_rows(painter, rows, width)


def _draw_rows(painter: QPainter, rows: list[tuple[QColor | None, str]], width: float) -> None:
    painter.setFont(tabular(painter.font()))
    font = QFontMetricsF(painter.font())
    wide = max(font.horizontalAdvance(text) + (18.0 if colour else 0.0) for colour, text in rows)
    line = font.height() + 2.0
    place = QRectF(0, MARGIN, wide + 2 * SPACING, len(rows) * line + SPACING)
    place.moveRight(width - MARGIN)
    _draw_label(painter, place)
    for number, (colour, text) in enumerate(rows):
        row = QRectF(place.left() + SPACING, place.top() + SPACING / 2 + number * line, wide, line)
        if colour is not None:
            painter.fillRect(QRectF(row.left(), row.center().y() - 5.0, 10.0, 10.0), colour)
            row.setLeft(row.left() + 18.0)
        painter.setPen(theme().text)
        painter.drawText(row, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, text)


def _overlay(
    context: ToolContext,
    draw: Callable[[QPainter, ToolContext, QRectF], None],
    painter: QPainter,
    area: QRect,
) -> None:
    """Draw an area (device pixels) of a transparent image by what draws one in logical pixels."""
    ratio = context.ratio
    painter.save()
    painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Source)
    painter.fillRect(area, Qt.GlobalColor.transparent)
    painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_SourceOver)
    painter.setClipRect(area)
    painter.scale(ratio, ratio)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    size = (area.width() / ratio, area.height() / ratio)
    draw(painter, context, QRectF(area.x() / ratio, area.y() / ratio, *size))
    painter.restore()


class Decorations:
    """Draws everything over the sketch image."""

    def __init__(self, context: ToolContext) -> None:
        self._context = context
        self._features, self._vectors = (
            CanvasImage(context, partial(_overlay, context, draw)) for draw in (draw_features, draw_vectors)
        )
        self._pose: Camera | None = None

    def reset(self) -> None:
        """Forget the drawn camera: the whole canvas is redrawn."""
        self._pose = None

    def camera_moved(self, facts: FrameFacts) -> tuple[QRectF, ...]:
        """Return the rectangles (logical px) to redraw after the 3-D camera moved."""
        before, pose = self._pose, facts.pose
        if pose == before or "eye" not in self._context.workspace.overlays:
            return ()
        self._pose = pose
        places = [_camera_place(self._context, each) for each in (before, pose) if each is not None]
        size = _CONE + 4
        return tuple(QRectF(at.x() - size, at.y() - size, 2 * size, 2 * size) for at in places)

    def draw(self, painter: QPainter, area: QRect, tool: Tool, width: float, height: float) -> None:
        """Draw an area (logical px) of a canvas of a size."""
        context, overlays = self._context, self._context.workspace.overlays
        ratio = context.ratio
        source = QRectF(area.x() * ratio, area.y() * ratio, area.width() * ratio, area.height() * ratio)
        sketch, workspace = context.document.sketch, context.workspace
        if layers := visible_vectors(sketch, workspace):
            vectors = self._vectors.updated(*layers, sketch.labels, sketch.pixel_size)
            painter.drawPixmap(QRectF(area), vectors, source)
        if "features" in overlays:
            features = self._features.updated(context.link.placed, workspace.tool == "select")
            painter.drawPixmap(QRectF(area), features, source)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if "contradictions" in overlays:
            draw_warnings(painter, context)
        if "eye" in overlays and context.link.frame is not None:
            draw_camera(painter, context, context.link.frame.pose)
        tool.draw(painter)
        draw_scale_bar(painter, context, height)
        if {"realism", "adherence"} & overlays:
            draw_legend(painter, context, width, realism="realism" in overlays)
