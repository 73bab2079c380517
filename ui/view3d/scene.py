"""What the 3-D view paints: the last picture and the marks over it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QFont, QFontMetricsF, QPainter, QPainterPath, QPen, QPolygonF

from sketchterrain.ui.commands.placed_edits import find_point, find_river, is_locked, name_of
from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.look.theme import DARK, theme
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import Handle
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.view3d.marks import Dot, Grip, Line, Marks, marks_of
from sketchterrain.ui.view3d.projection import Ground, Projection, length_text, scale_bar, standing_text

_RIM: Final = QColor(12, 16, 20, 150)
_LIGHT: Final = QColor(255, 255, 255, 235)
_WATER: Final = QColor("#9fd4ff")
_ACCENT: Final = QColor(DARK.accent)  # pictures of ground are as dark as a dark theme
_HIDDEN = 0.28  # opacity of what ground hides
_GRIP, _DOT = 5.0, 3.2  # px, radii
_QUIET = 0.8  # opacity of what is not under the mouse


def draw_marks(painter: QPainter, marks: Marks, *, hovered: Handle | Selection | None) -> None:
    """Draw everything."""
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    _draw_lines(painter, marks.rivers, _WATER, 1.4)
    for dot in marks.dots:
        _draw_dot(painter, dot, larger=dot.selection == hovered)
    _draw_lines(painter, marks.outline, _ACCENT, 2.0)
    for grip in marks.grips:
        _draw_grip(painter, grip, larger=grip.handle == hovered)


def draw_tag(painter: QPainter, text: str, x: float, y: float, font: QFont, within: QRectF) -> None:
    """Write a line on a dark plate, above a place (px) and inside a rectangle."""
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


def _draw_lines(painter: QPainter, lines: Iterable[Line], colour: QColor, width: float) -> None:
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for hidden in (True, False):
        painter.setOpacity(_HIDDEN if hidden else 1.0)
        path = QPainterPath()
        for line in lines:
            _add_pieces(path, line, hidden=hidden)
        for pen_colour, pen_width in ((_RIM, width + 2.2), (colour, width)):
            pen = QPen(pen_colour, pen_width)
            pen.setCapStyle(Qt.PenCapStyle.RoundCap)
            pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
            painter.setPen(pen)
            painter.drawPath(path)
    painter.setOpacity(1.0)


def _add_pieces(path: QPainterPath, line: Line, *, hidden: bool) -> None:
    last = None
    for (x, y, to_x, to_y), off in zip(line.pieces.tolist(), line.hidden.tolist(), strict=True):
        if off == hidden:
            if last != (x, y):
                path.moveTo(x, y)
            path.lineTo(to_x, to_y)
            last = to_x, to_y


def _draw_dot(painter: QPainter, dot: Dot, *, larger: bool) -> None:
    painter.setOpacity(_HIDDEN if dot.hidden else 1.0 if larger else _QUIET)
    painter.setPen(QPen(_RIM, 1.4))
    painter.setBrush(_ACCENT if larger else _LIGHT)
    shape = _shape(dot.kind, _DOT * (1.7 if larger else 1.0))
    painter.drawPath(shape.translated(dot.x, dot.y))
    painter.setOpacity(1.0)


def _shape(kind: str, size: float) -> QPainterPath:
    """Return the mark of a type around the origin: told apart without colour."""
    path = QPainterPath()
    if kind == "mountain":
        corners = [
            QPointF(0.0, -1.3 * size),
            QPointF(1.25 * size, 0.9 * size),
            QPointF(-1.25 * size, 0.9 * size),
        ]
        path.addPolygon(QPolygonF(corners))
        path.closeSubpath()
    elif kind == "hill":
        path.moveTo(-1.3 * size, 0.8 * size)
        path.arcTo(QRectF(-1.3 * size, -1.0 * size, 2.6 * size, 3.6 * size), 180.0, -180.0)
        path.closeSubpath()
    elif kind == "dune":
        path.moveTo(-1.4 * size, 0.8 * size)
        path.quadTo(0.3 * size, 0.6 * size, 0.5 * size, -1.0 * size)
        path.quadTo(0.7 * size, 0.5 * size, 1.4 * size, 0.8 * size)
        path.closeSubpath()
    else:
        path.addEllipse(QPointF(0.0, 0.0), size, size)
    return path


def _draw_grip(painter: QPainter, grip: Grip, *, larger: bool) -> None:
    painter.setOpacity(_HIDDEN + 0.2 if grip.hidden else 1.0)
    at = QPointF(grip.x, grip.y)
    size = _GRIP * (1.4 if larger else 1.0)
    if grip.handle.role in ("radius", "width"):
        for colour, width in ((_RIM, 3.2), (_ACCENT, 1.2)):
            painter.setPen(QPen(colour, width))
            painter.drawLine(QPointF(grip.base_x, grip.base_y), at)
    painter.setPen(QPen(_RIM, 2.0))
    painter.setBrush(_ACCENT if larger else _LIGHT)
    if grip.handle.role == "point":
        painter.drawEllipse(at, 0.8 * size, 0.8 * size)
    elif grip.handle.role == "move":
        painter.drawEllipse(at, 1.2 * size, 1.2 * size)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(_LIGHT if larger else _ACCENT)
        painter.drawEllipse(at, 0.55 * size, 0.55 * size)
    else:
        painter.drawRoundedRect(QRectF(grip.x - size, grip.y - size, 2.0 * size, 2.0 * size), 2.0, 2.0)
    painter.setOpacity(1.0)


_TEXT_LIGHT, _TEXT_RIM = QColor(255, 255, 255, 225), QColor(12, 16, 20, 140)
_BAR = 110.0  # px, the longest scale bar
_REFINES = "refining …"
_EDGE = 12.0  # px, from the widget's edge


class Scene:
    """Looks after what is drawn; remembers marks until something that they depend on is another one."""

    def __init__(self, document: Document | None, workspace: Workspace, link: ViewSource) -> None:
        self._document, self._workspace, self._link = document, workspace, link
        self.dragged: tuple[Handle, float, float] | None = None
        self._marks = Marks()
        self._marks_of: tuple[object, ...] = ()
        self._ground: tuple[object, Ground] | None = None

    def place(self, width: int, height: int) -> QRectF:
        """Return where the picture lies in a widget of a size (px): it covers it all and is not stretched."""
        picture = self._link.picture
        if picture is None or picture.isNull():
            return QRectF(0.0, 0.0, width, height)
        scale = max(width / picture.width(), height / picture.height())
        shown = QRectF(0.0, 0.0, picture.width() * scale, picture.height() * scale)
        shown.moveCenter(QPointF(0.5 * width, 0.5 * height))
        return shown

    def projection(self, width: int, height: int) -> Projection | None:
        """Return the camera of the picture that is shown; None while there is none."""
        frame = self._link.frame
        if frame is None or self._link.picture is None or width < 1 or height < 1:
            return None
        at = self.place(width, height)
        return Projection(frame, (at.left(), at.top(), at.width(), at.height()))

    def ground(self) -> Ground | None:
        """Return the heights of the sketch's ground; None until they are known."""
        relief = self._link.relief
        if relief is None or self._document is None:
            return None
        if self._ground is None or self._ground[0] is not relief:
            sketch = self._document.sketch
            self._ground = relief, Ground(relief, sketch.pixel_size * relief.step)
        return self._ground[1]

    def marks(self, width: int, height: int) -> Marks:
        """Return what is laid over the picture."""
        link, workspace = self._link, self._workspace
        all_features = "features" in workspace.overlays and workspace.tool == "select"
        key = (
            link.frame,
            link.placed,
            link.relief,
            workspace.selection,
            all_features,
            self.dragged,
            width,
            height,
        )
        if key == self._marks_of:
            return self._marks
        self._marks_of = key
        projection, ground = self.projection(width, height), self.ground()
        if projection is None or ground is None or link.placed is None:
            self._marks = Marks()
        else:
            self._marks = marks_of(
                projection,
                ground,
                link.placed,
                workspace.selection,
                all_features=all_features,
                dragged=self.dragged,
            )
        return self._marks

    def paint(
        self,
        painter: QPainter,
        size: QRectF,
        ratio: float,
        *,
        hovered: Handle | Selection | None,
        dim: bool,
        refines: bool,
    ) -> None:
        """Draw everything."""
        picture = self._link.picture
        painter.fillRect(size, theme().canvas)
        if picture is None or picture.isNull():
            return
        width, height = round(size.width()), round(size.height())
        at = self.place(width, height)
        sharp = abs(at.width() * ratio - picture.width()) < 1.0
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, not sharp)
        painter.drawImage(at, picture)
        if dim:
            veil = QColor(theme().canvas)
            veil.setAlpha(190)
            painter.fillRect(size, veil)
            return
        marks = self.marks(width, height)
        draw_marks(painter, marks, hovered=hovered)
        self._paint_tag(painter, marks, size)
        self._paint_readout(painter, size)
        if refines:
            wide = QFontMetricsF(painter.font()).horizontalAdvance(_REFINES)
            _write_text(painter, _REFINES, size.right() - _EDGE - wide, size.bottom() - _EDGE)

    def paint_focus(self, painter: QPainter, size: QRectF) -> None:
        """Show that keys go to the view."""
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(QPen(theme().accent, 2.0))
        painter.drawRect(size.adjusted(1.0, 1.0, -1.0, -1.0))

    def _paint_tag(self, painter: QPainter, marks: Marks, size: QRectF) -> None:
        """Name what is selected, beside its first handle or amid a river."""
        placed, selection = self._link.placed, self._workspace.selection
        if placed is None or selection is None:
            return
        if selection.kind == "lake" and marks.outline and len(marks.outline[0].pieces):
            shore = marks.outline[0].pieces
            top = shore[shore[:, 1].argmin()]
            text = name_of(placed, selection).capitalize()
            draw_tag(painter, text, float(top[0]), float(top[1]), painter.font(), size)
            return
        index = selection.index
        river = find_river(placed, selection)
        role = "move" if river is None else "width" if index is None else "point"
        own = [each for each in marks.grips if each.handle.role == role]
        own = [each for each in own if index is None or each.handle.selection.index == index]
        if not own:
            return
        text = name_of(placed, selection).capitalize()
        point = find_point(placed, selection)
        if river is not None and index is None:
            text += f" · {length_text(float(river.centreline_width[len(river.centreline_width) // 2]))} wide"
        elif point is not None and self.dragged is not None and self.dragged[0].role == "radius":
            x, y = self.dragged[1] - self.dragged[0].base_x, self.dragged[2] - self.dragged[0].base_y
            text += f" · radius {length_text((x * x + y * y) ** 0.5)}"
        elif point is not None and text != "Forest":
            text += f" · {length_text(float(point['strength']))}"
        if self._document is not None and is_locked(self._document.sketch, selection):
            text += " · locked"
        draw_tag(painter, text, own[0].x, own[0].y, painter.font(), size)

    def _paint_readout(self, painter: QPainter, size: QRectF) -> None:
        """Draw a scale bar, or say how high the eye is, in the lower left corner."""
        frame = self._link.frame
        projection = self.projection(round(size.width()), round(size.height()))
        if frame is None or projection is None:
            return
        left, below = size.left() + _EDGE, size.bottom() - _EDGE
        font = QFont(painter.font())
        font.setPointSizeF(max(font.pointSizeF() * 0.88, 7.0))
        painter.setFont(font)
        if self._link.view.mode != "orbit":
            _write_text(painter, standing_text(frame.pose, self.ground()), left, below)
            return
        bar = scale_bar(projection, frame.pose, most=_BAR)
        if bar is None:
            return
        length, wide = bar
        ticks = [
            (QPointF(left, below - 5.0), QPointF(left, below)),
            (QPointF(left, below), QPointF(left + wide, below)),
            (QPointF(left + wide, below), QPointF(left + wide, below - 5.0)),
        ]
        for colour, thick in ((_TEXT_RIM, 3.4), (_TEXT_LIGHT, 1.4)):
            pen = QPen(colour, thick)
            pen.setCapStyle(Qt.PenCapStyle.SquareCap)
            painter.setPen(pen)
            for start, end in ticks:
                painter.drawLine(start, end)
        _write_text(painter, length_text(length), left + 1.0, below - 9.0)


def _write_text(painter: QPainter, text: str, x: float, y: float) -> None:
    """Write light text with a dark rim, its base line's start at a place (px)."""
    painter.setPen(_TEXT_RIM)
    for right, down in ((-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)):
        painter.drawText(QPointF(x + right, y + down), text)
    painter.setPen(_TEXT_LIGHT)
    painter.drawText(QPointF(x, y), text)
