"""Painting of the 3-D view: the last picture and the marks over it."""

from collections.abc import Iterable
from typing import Final

from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QFont, QFontMetricsF, QPainter, QPainterPath, QPen, QPolygonF, QTransform

from sketchterrain.array_types import Float64Array
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.commands import find_point, find_river, is_locked, name_of
from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.look.layer_colours import layer_glyph
from sketchterrain.ui.look.theme import DARK, theme
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.features import SelectedFeature
from sketchterrain.ui.models.selection import FeatureDrag
from sketchterrain.ui.models.workspace import Handle, Selection, Workspace
from sketchterrain.ui.view3d.camera import Projection, TerrainHeights, eye_height_text, length_text, scale_bar
from sketchterrain.ui.view3d.marks import Dot, HandleMark, MarkBuilder, Marks, Segments

_RIM: Final = QColor(12, 16, 20, 150)
_LIGHT: Final = QColor(255, 255, 255, 235)
_WATER: Final = QColor("#9fd4ff")
_ACCENT: Final = QColor(DARK.accent)  # pictures of terrain are as dark as a dark theme
_HIDDEN = 0.28  # opacity of marks behind the terrain
_HANDLE, _DOT = 5.0, 0.8  # radius, px; size of a glyph
_IDLE = 0.8  # opacity of dots that are not hovered


def draw_marks(painter: QPainter, marks: Marks, *, hovered: Handle | Selection | None) -> None:
    """Draw all marks."""
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    _draw_segments(painter, marks.rivers, _WATER, 1.4)
    for dot in marks.dots:
        _draw_dot(painter, dot, larger=dot.selection == hovered)
    _draw_segments(painter, marks.outline, _ACCENT, 2.0)
    for mark in marks.handles:
        _draw_handle(painter, mark, larger=mark.handle == hovered)


def draw_label(painter: QPainter, text: str, x: float, y: float, font: QFont, within: QRectF) -> None:
    """Draw a label on a dark plate above a pixel, inside a rectangle."""
    metrics = QFontMetricsF(font)
    plate = QRectF(0.0, 0.0, metrics.horizontalAdvance(text) + 14.0, metrics.height() + 6.0)
    plate.moveCenter(QPointF(x, y - 0.5 * plate.height() - 12.0))
    plate.moveLeft(min(max(plate.left(), within.left() + 4.0), within.right() - plate.width() - 4.0))
    if plate.top() < within.top() + 4.0:
        plate.moveTop(y + 12.0)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(18, 21, 24, 205))
    painter.drawRoundedRect(plate, 5.0, 5.0)
    painter.setPen(_LIGHT)
    painter.setFont(font)
    painter.drawText(plate, Qt.AlignmentFlag.AlignCenter, text)


def _draw_segments(painter: QPainter, lines: Iterable[Segments], colour: QColor, width: float) -> None:
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for hidden in (True, False):
        painter.setOpacity(_HIDDEN if hidden else 1.0)
        path = QPainterPath()
        for line in lines:
            for x, y, to_x, to_y in line.pixels[line.hidden == hidden].tolist():
                if path.currentPosition() != QPointF(x, y):
                    path.moveTo(x, y)
                path.lineTo(to_x, to_y)
        for pen_colour, pen_width in ((_RIM, width + 2.2), (colour, width)):
            cap, join = Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin
            painter.setPen(QPen(pen_colour, pen_width, cap=cap, join=join))
            painter.drawPath(path)
    painter.setOpacity(1.0)


def _draw_dot(painter: QPainter, dot: Dot, *, larger: bool) -> None:
    painter.setOpacity(_HIDDEN if dot.hidden else 1.0 if larger else _IDLE)
    painter.setPen(QPen(_RIM, 1.4))
    painter.setBrush(_ACCENT if larger else _LIGHT)
    size = _DOT * (1.7 if larger else 1.0)
    shape = QTransform.fromScale(size, size).map(layer_glyph(dot.kind))
    painter.drawPath(shape.translated(dot.x, dot.y))
    painter.setOpacity(1.0)


def _draw_handle(painter: QPainter, mark: HandleMark, *, larger: bool) -> None:
    painter.setOpacity(_HIDDEN + 0.2 if mark.hidden else 1.0)
    at = QPointF(mark.x, mark.y)
    size = _HANDLE * (1.4 if larger else 1.0)
    if mark.handle.role in ("radius", "width"):
        for colour, width in ((_RIM, 3.2), (_ACCENT, 1.2)):
            painter.setPen(QPen(colour, width))
            painter.drawLine(QPointF(mark.base_x, mark.base_y), at)
    painter.setPen(QPen(_RIM, 2.0))
    painter.setBrush(_ACCENT if larger else _LIGHT)
    if mark.handle.role == "point":
        painter.drawEllipse(at, 0.8 * size, 0.8 * size)
    elif mark.handle.role == "move":
        painter.drawEllipse(at, 1.2 * size, 1.2 * size)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(_LIGHT if larger else _ACCENT)
        painter.drawEllipse(at, 0.55 * size, 0.55 * size)
    else:
        painter.drawRoundedRect(QRectF(mark.x - size, mark.y - size, 2.0 * size, 2.0 * size), 2.0, 2.0)
    painter.setOpacity(1.0)


_TEXT_LIGHT, _TEXT_RIM = QColor(255, 255, 255, 225), QColor(12, 16, 20, 140)
_MAX_SCALE_BAR = 110.0  # px
_REFINING = "refining …"
_EDGE = 12.0  # px, from the widget's edge


class Scene:
    """Paints the view; marks are cached until their inputs change."""

    def __init__(self, document: Document, workspace: Workspace, link: ViewSource) -> None:
        self.document, self.workspace, self.link = document, workspace, link
        self.drag: FeatureDrag | None = None
        self.hovered: Handle | Selection | None = None
        self._marks = Marks()
        self._marks_key: tuple[object, ...] = ()
        self._terrain: tuple[object, TerrainHeights] | None = None

    def picture_rectangle(self, width: int, height: int) -> QRectF:
        """Return the rectangle of the picture, which covers a widget of a size (px) undistorted."""
        picture = self.link.picture
        if picture is None or picture.isNull():
            return QRectF(0.0, 0.0, width, height)
        scale = max(width / picture.width(), height / picture.height())
        rectangle = QRectF(0.0, 0.0, picture.width() * scale, picture.height() * scale)
        rectangle.moveCenter(QPointF(0.5 * width, 0.5 * height))
        return rectangle

    def projection(self, width: int, height: int) -> Projection | None:
        """Return the camera of the current picture; None without one."""
        frame = self.link.frame
        if frame is None or self.link.picture is None or width < 1 or height < 1:
            return None
        at = self.picture_rectangle(width, height)
        return Projection(frame, (at.left(), at.top(), at.width(), at.height()))

    def terrain(self) -> TerrainHeights | None:
        """Return the heights of the sketch's terrain; None until they are known."""
        relief = self.link.relief
        if relief is None:
            return None
        if self._terrain is None or self._terrain[0] is not relief:
            sketch = self.document.sketch
            self._terrain = relief, TerrainHeights(relief, sketch.pixel_size * relief.step)
        return self._terrain[1]

    def marks(self, width: int, height: int) -> Marks:
        link, workspace = self.link, self.workspace
        all_features = "features" in workspace.overlays and workspace.tool == "select"
        place = None if self.drag is None else (self.drag, self.drag.x, self.drag.y)
        inputs = (link.frame, link.placed, link.relief, workspace.selection, place)
        vectors, drapes = self.document.sketch.vectors.values(), self.document.drapes.current
        key = (*inputs, *vectors, drapes, all_features, width, height)
        if key != self._marks_key:
            self._marks_key = key
            projection, terrain = self.projection(width, height), self.terrain()
            self._marks = Marks()
            if projection and terrain is not None:
                selection = workspace.selection
                builder = MarkBuilder(
                    projection, terrain, link.placed, selection, self.drag, *self._selected_feature()
                )
                self._marks = builder.marks(all_features=all_features)
        return self._marks

    def _selected_feature(self) -> tuple[list[Float64Array], tuple[Handle, ...]]:
        """Return lines and handles of the selected feature, and lines of all at a node that is dragged."""
        document, drag = self.document, self.drag
        sketch = None if drag is None or drag.handle.selection.is_placed else drag.sketch
        selected = SelectedFeature.find(document, self.workspace.selection, sketch)
        if selected is None:
            return [], ()
        shown = [selected]
        if drag is not None and drag.handle.is_vertex:
            shown += selected.others_at(drag.x, drag.y)
        lines = [line for each in shown for line in each.lines(step=2.0 * document.sketch.pixel_size)]
        return lines, (*selected.vertex_handles, *selected.box_handles)

    def paint(self, painter: QPainter, size: QRectF, ratio: float, *, dim: bool, is_refining: bool) -> None:
        """Paint picture, marks, label and scale bar."""
        picture = self.link.picture
        painter.fillRect(size, theme().canvas)
        if picture is None or picture.isNull():
            return
        width, height = round(size.width()), round(size.height())
        at = self.picture_rectangle(width, height)
        sharp = abs(at.width() * ratio - picture.width()) < 1.0
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, not sharp)
        painter.drawImage(at, picture)
        if dim:
            veil = QColor(theme().canvas)
            veil.setAlpha(190)
            painter.fillRect(size, veil)
            return
        marks = self.marks(width, height)
        draw_marks(painter, marks, hovered=self.hovered)
        self._paint_label(painter, marks, size)
        self._paint_readout(painter, size)
        if is_refining:
            width_px = QFontMetricsF(painter.font()).horizontalAdvance(_REFINING)
            _draw_text(painter, _REFINING, size.right() - _EDGE - width_px, size.bottom() - _EDGE)

    def _paint_label(self, painter: QPainter, marks: Marks, size: QRectF) -> None:
        """Label the selection at its first handle, a lake at its northern shore."""
        placed, selection = self.link.placed, self.workspace.selection
        if selection is None:
            return
        if selection.kind == "water" and marks.outline and len(marks.outline[0].pixels):
            shore = marks.outline[0].pixels
            top = shore[shore[:, 1].argmin()]
            text = name_of(placed, selection).capitalize()
            draw_label(painter, text, float(top[0]), float(top[1]), painter.font(), size)
            return
        index = selection.index
        river = find_river(placed, selection)
        role = "move" if river is None else "width" if index is None else "point"
        own = [each for each in marks.handles if each.handle.role == role]
        own = [each for each in own if index is None or each.handle.selection.index == index]
        if not own:
            return
        text = name_of(placed, selection).capitalize()
        point = find_point(placed, selection)
        if river is not None and index is None:
            text += f" · {length_text(float(river.centreline_width[len(river.centreline_width) // 2]))} wide"
        elif point is not None and self.drag is not None and self.drag.handle.role == "radius":
            x, y = self.drag.x - self.drag.handle.base_x, self.drag.y - self.drag.handle.base_y
            text += f" · radius {length_text((x * x + y * y) ** 0.5)}"
        elif point is not None and not LAYERS[FEATURE_TYPES[point["type"]]].is_share:
            text += f" · {length_text(float(point['strength']))}"
        if is_locked(self.document.sketch, selection):
            text += " · locked"
        draw_label(painter, text, own[0].x, own[0].y, painter.font(), size)

    def _paint_readout(self, painter: QPainter, size: QRectF) -> None:
        """Draw a scale bar in orbit mode, else the eye's height, in the lower left corner."""
        frame = self.link.frame
        projection = self.projection(round(size.width()), round(size.height()))
        if frame is None or projection is None:
            return
        left, below = size.left() + _EDGE, size.bottom() - _EDGE
        font = QFont(painter.font())
        font.setPointSizeF(max(font.pointSizeF() * 0.88, 7.0))
        painter.setFont(font)
        if self.link.view.mode != "orbit":
            _draw_text(painter, eye_height_text(frame.pose, self.terrain()), left, below)
            return
        bar = scale_bar(projection, frame.pose, most=_MAX_SCALE_BAR)
        if bar is None:
            return
        length, wide = bar
        ends = (left, below - 5.0), (left, below), (left + wide, below), (left + wide, below - 5.0)
        for colour, thick in ((_TEXT_RIM, 3.4), (_TEXT_LIGHT, 1.4)):
            painter.setPen(QPen(colour, thick, cap=Qt.PenCapStyle.SquareCap))
            painter.drawPolyline(QPolygonF([QPointF(x, y) for x, y in ends]))
        _draw_text(painter, length_text(length), left + 1.0, below - 9.0)


def _draw_text(painter: QPainter, text: str, x: float, y: float) -> None:
    """Draw light text with a dark rim, its baseline starting at a pixel."""
    painter.setPen(_TEXT_RIM)
    for right, down in ((-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)):
        painter.drawText(QPointF(x + right, y + down), text)
    painter.setPen(_TEXT_LIGHT)
    painter.drawText(QPointF(x, y), text)
