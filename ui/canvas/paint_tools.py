"""Paint tools: brush and eraser, flood fill, label picker, lines and outlines."""

import math
from dataclasses import replace
from functools import partial

from PyQt6.QtCore import QPointF, QRectF, QSizeF, Qt
from PyQt6.QtGui import QColor, QPainter, QPen, QPolygonF

from sketchterrain.features.table import AREA, KINDS, LINE, POINT
from sketchterrain.landforms.placement.heights import ShapeHeight, shape_height
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.canvas.compositing import visible_layers
from sketchterrain.ui.canvas.decorations import write_beside
from sketchterrain.ui.canvas.tool_context import Pointer, Tool, ToolContext
from sketchterrain.ui.commands import reported
from sketchterrain.ui.look.layer_colours import label_colour
from sketchterrain.ui.models import features
from sketchterrain.ui.models.document import Draft
from sketchterrain.ui.models.painting import (
    Stroke,
    draw_line,
    flood_fill,
    line_path,
    line_width,
    painted_height,
    pick,
)
from sketchterrain.ui.models.selection import REACH
from sketchterrain.ui.models.workspace import Selection

_LEAST_PRESSURE = 0.2  # fraction of the radius at the lightest touch
_TEXT = QSizeF(260.0, 40.0)  # logical px around the text beside the ring


def _draw_ring(painter: QPainter, centre: QPointF, radius: float) -> None:
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for colour, width in ((QColor(255, 255, 255, 190), 3.0), (QColor(20, 20, 20, 220), 1.2)):
        painter.setPen(QPen(colour, width))
        painter.drawEllipse(centre, radius, radius)


def _beside(radius: float) -> QPointF:
    """Return where a text begins beside a ring (logical px)."""
    return QPointF(radius + 10.0, -radius - 8.0)


def height_text(height: ShapeHeight) -> str:
    """Return the height of a shape, with the one asked for if it is too small for that."""
    built = f"{height.built:,.0f} m".replace(",", "\u202f")
    asked = f"{height.asked:,.0f} m".replace(",", "\u202f")
    return f"{asked} asked, {built} built" if height.is_limited else f"{built} high"


class BrushTool(Tool):
    """Paints strokes with the active label, or erases."""

    cursor = Qt.CursorShape.CrossCursor

    def __init__(self, context: ToolContext, *, erases: bool = False) -> None:
        super().__init__(context)
        self._always_erases = erases
        self._draft: Draft | None = None
        self._stroke: Stroke | None = None
        self._title = ""
        self._place: tuple[float, float] | None = None
        self._radius = 0.0
        self._first: tuple[float, float] | None = None  # position of a stroke that paints
        self._height: ShapeHeight | None = None  # of the shape that is painted

    @property
    def is_busy(self) -> bool:
        return self._draft is not None

    def press(self, pointer: Pointer) -> None:
        self._move_ring(pointer)
        if self._draft is not None or not self.context.may_paint():
            return
        workspace = self.context.workspace
        erases = self._always_erases or pointer.erases
        self._title = f"{'Erase' if erases else 'Paint'} {LAYERS[workspace.layer].title.lower()}"
        self._draft = self.context.document.begin_draft(workspace.layer)
        grain = 1.0 / max(self.context.scale, 1e-6)
        self._stroke = Stroke(self._draft.image, 0 if erases else workspace.label, grain=grain)
        self._first = None if erases else (pointer.x, pointer.y)
        self._extend(pointer)

    def move(self, pointer: Pointer) -> None:
        self._move_ring(pointer)
        self._extend(pointer)

    def release(self, pointer: Pointer) -> None:
        self._extend(pointer)
        self.finish()

    def takes_key(self, key: int) -> bool:
        return self.is_busy and key == Qt.Key.Key_Escape

    def press_key(self, key: int) -> None:
        self.cancel()

    def finish(self) -> None:
        """Record the stroke as a history step."""
        draft, stroke = self._draft, self._stroke
        self._end()
        if draft is None or stroke is None or draft is not self.context.document.draft:
            return
        draft.commit(self._title, stroke.finish())

    def cancel(self) -> None:
        draft = self._draft
        self._end()
        if draft is not None and draft is self.context.document.draft:
            draft.cancel()

    def _end(self) -> None:
        self._redraw_ring()
        self._draft = self._stroke = self._height = None

    def leave(self) -> None:
        self._redraw_ring()
        self._place = None

    def draw(self, painter: QPainter) -> None:
        if self._place is not None:
            centre = self.context.screen_from_sketch(*self._place)
            radius = max(self._radius * self.context.scale, 1.0)
            _draw_ring(painter, centre, radius)
            if self._height is not None:
                write_beside(painter, centre + _beside(radius), height_text(self._height))

    def show_size(self, place: QPointF | None) -> None:
        """Resize the ring to the brush, at the mouse (logical px)."""
        self._redraw_ring()
        if place is not None:
            self._place = self.context.sketch_from_screen(place)
        self._radius = self.context.workspace.brush
        self._redraw_ring()

    def _move_ring(self, pointer: Pointer) -> None:
        self._redraw_ring()
        self._place = (pointer.x, pointer.y)
        self._radius = self._brush_radius(pointer)
        self._redraw_ring()

    def _redraw_ring(self) -> None:
        area = QRectF()
        if self._place is not None:
            radius = self._radius * self.context.scale + 3.0
            centre = self.context.screen_from_sketch(*self._place)
            area = QRectF(centre.x() - radius, centre.y() - radius, 2.0 * radius, 2.0 * radius)
            if self._height is not None:
                corner = centre + _beside(radius)
                area = area.united(
                    QRectF(corner.x(), corner.y() - _TEXT.height(), _TEXT.width(), _TEXT.height())
                )
        self.context.redraw(area)

    def _brush_radius(self, pointer: Pointer) -> float:
        share = _LEAST_PRESSURE + (1.0 - _LEAST_PRESSURE) * pointer.pressure
        return self.context.workspace.brush * share

    def _extend(self, pointer: Pointer) -> None:
        if self._draft is None or self._stroke is None:
            return
        if self._draft is not self.context.document.draft:  # cancelled by an undo or another document
            self._end()
            return
        radius = self._brush_radius(pointer)
        box = self._stroke.to(pointer.x, pointer.y, radius)
        if box is None:
            return
        self._draft.touch(box)
        if self._first is not None:
            sketch, workspace = self.context.document.sketch, self.context.workspace
            target = workspace.layer, workspace.label
            self._redraw_ring()
            self._height = painted_height(sketch, *target, self._draft.image, (*self._first, radius))
            self._redraw_ring()


class FillTool(Tool):
    """Fills a connected region with the active label, or clears it."""

    cursor = Qt.CursorShape.CrossCursor

    def press(self, pointer: Pointer) -> None:
        if not self.context.may_paint():
            return
        workspace = self.context.workspace
        draft = self.context.document.begin_draft(workspace.layer)
        label = 0 if pointer.erases else workspace.label
        box = flood_fill(draft.image, math.floor(pointer.y), math.floor(pointer.x), label)
        verb = "Clear a shape of" if pointer.erases else "Fill"
        draft.commit(f"{verb} {LAYERS[workspace.layer].title.lower()}", box)


class PickTool(Tool):
    """Activates the layer and label under the mouse."""

    cursor = Qt.CursorShape.PointingHandCursor

    def press(self, pointer: Pointer) -> None:
        pick_label(self.context, pointer)


def pick_label(context: ToolContext, pointer: Pointer) -> None:
    """Activate layer and label of the vector, else of the topmost visible paint at a position; report it."""
    sketch, at = context.document.sketch, context.world_from_sketch(pointer.x, pointer.y)
    picks = features.vector_picks(sketch, context.workspace, *at, 1.0 / context.px_per_metre)
    _, selection = min(picks, key=lambda pick: pick[0], default=(0.0, None))
    vector = features.SelectedFeature.find(context.document, selection)
    if vector is not None:
        found: tuple[str, int] | None = (vector.selection.kind, vector.feature.label)
    else:
        layers = [
            (name, context.document.layer(name)) for name in reversed(visible_layers(context.workspace))
        ]
        found = pick(layers, math.floor(pointer.y), math.floor(pointer.x))
    if found is None:
        context.document.message.emit("Nothing is painted or drawn here.")
    else:
        context.workspace.use_label(*found)
        verb = "Paints" if LAYERS[found[0]].is_painted else "Draws"
        context.document.message.emit(f"{verb} {LAYERS[found[0]].title.lower()}, label {found[1]}.")


_DRAG = 6.0  # logical px after which a press draws freehand
_NODE_DISTANCE = 5.0  # logical px between the points of a freehand line
_TOLERANCE = 1.5  # logical px that a freehand vector may be off the pen
_FINISH_KEYS = (Qt.Key.Key_Return, Qt.Key.Key_Enter)


class LineTool(Tool):
    """Draws a smooth line through points, finished by Enter or a double click, cancelled by Escape.

    A drag draws freehand. Backspace or the right button removes the last point. The line is a vector on
    layers that take lines, the outline of one where they only take areas, and else it is painted. While a
    draped layer is chosen, it is a point, line or area of that, by `Workspace.drape_kind`. Points of features
    snap to vertices and lines of their layer, those of roads, railways and paths to all of these.
    """

    cursor = Qt.CursorShape.CrossCursor

    def __init__(self, context: ToolContext) -> None:
        super().__init__(context)
        self._points: list[tuple[float, float]] = []
        self._place: tuple[float, float] | None = None
        self._pressed: tuple[float, float] | None = None
        self._freehand = False
        self._first = 0  # index of the point that a drag started from
        self._target: tuple[Selection, int] | None = None  # layer; label, or kind in a draped layer

    @property
    def is_busy(self) -> bool:
        return bool(self._points)

    @property
    def _kind(self) -> int | None:
        """Kind of the vectors that the active layer takes; None: lines are painted."""
        workspace = self.context.workspace
        if self._layer.is_draped:
            return KINDS.index(workspace.drape_kind)
        taken = LAYERS[workspace.layer].vectors
        return LINE if "line" in taken else AREA if "area" in taken else None

    @property
    def _is_smooth(self) -> bool:
        """Whether lines are curves through their points: all but walls are."""
        if self._layer.is_draped:
            return False
        return self._kind is None or LAYERS[self.context.workspace.layer].kind != "standing"

    @property
    def _layer(self) -> Selection:
        """The chosen draped layer, else the active one."""
        selection = self.context.workspace.selection
        if selection is not None and selection.is_draped:
            return replace(selection, id=-1, index=None)
        return Selection(self.context.workspace.layer, 0)

    @property
    def _active(self) -> tuple[Selection, int]:
        """Layer, and label or kind, of the next line."""
        layer = self._layer
        return layer, (self._kind or 0) if layer.is_draped else self.context.workspace.label

    @property
    def _colour(self) -> QColor:
        layer, label = self._active
        if layer.is_draped:
            style = self.context.document.sketch.drapes[layer.layer].style
            return QColor(style["colour"] or style["fill"])
        return label_colour(layer.kind, label)

    def _may_draw(self) -> bool:
        """Return whether the layer can be edited, else report why."""
        problem = features.refusal(self.context.document, self.context.workspace, self._layer)
        if problem:
            self.context.document.message.emit(problem)
        return not problem

    @property
    def width(self) -> float:
        """Width of the line, px of the sketch."""
        workspace = self.context.workspace
        if self._layer.is_draped:
            return 2.0 / self.context.scale
        return line_width(self.context.document.sketch, workspace.layer, workspace.label, workspace.brush)

    def press(self, pointer: Pointer) -> None:
        """Add a point, or remove the last one."""
        if pointer.erases:
            if self.is_busy:
                self.press_key(Qt.Key.Key_Backspace)
            return
        if not self._may_draw():
            self.cancel()
            return
        if self._target != self._active:
            self._points.clear()
        self._target = self._active
        at = self._snapped(pointer)
        closes = self._kind == AREA and len(self._points) > 2
        if closes and math.dist(at, self._points[0]) * self.context.scale < REACH:
            self.finish()
            return
        if not self._points or math.dist(at, self._points[-1]) * self.context.scale > 1.0:
            self._points.append(at)
        self._pressed, self._place = at, at
        self._first = len(self._points) - 1
        self.context.redraw()
        if self._kind == POINT:
            self.finish()

    def move(self, pointer: Pointer) -> None:
        """Move the tip, or draw freehand."""
        at = (pointer.x, pointer.y)
        self._place = at if self._freehand else self._snapped(pointer)
        if self._pressed is not None and self._points:
            self._freehand |= math.dist(at, self._pressed) * self.context.scale > _DRAG
            distance = math.dist(at, self._points[-1]) * self.context.scale
            if self._freehand and distance > _NODE_DISTANCE:
                self._points.append(at)
        self.context.redraw()

    def release(self, pointer: Pointer) -> None:
        self._pressed = None
        if self._freehand:
            self._freehand = False
            at = self._snapped(pointer)
            if self._points and math.dist(self._points[-1], at) > 0.5:
                self._points.append(at)
            if self._kind is not None and len(self._points) > self._first + 1:
                self._simplify()
            self.finish()

    def double(self, pointer: Pointer) -> None:
        self.finish()

    def takes_key(self, key: int) -> bool:
        return self.is_busy and key in (*_FINISH_KEYS, Qt.Key.Key_Escape, Qt.Key.Key_Backspace)

    def press_key(self, key: int) -> None:
        if key in _FINISH_KEYS:
            self.finish()
        elif key == Qt.Key.Key_Escape:
            self.cancel()
        else:
            self._points.pop()
        self.context.redraw()

    def finish(self) -> None:
        """Add or paint the line as a history step."""
        points = self._points
        self.cancel()
        if not points or self._target is None or self._target[0] != self._layer or not self._may_draw():
            return
        (target, label), kind, context = self._target, self._kind, self.context
        if kind is not None:
            places = [context.world_from_sketch(*point) for point in points]
            draw = partial(features.draw, context.document, context.workspace, target, label, kind, places)
            with reported(context.document.message.emit, lambda: self._points.extend(points)):
                draw(smooth=kind == LINE and self._is_smooth)
            return
        layer = target.kind
        width = line_width(context.document.sketch, layer, label, context.workspace.brush)
        draft = context.document.begin_draft(layer)
        box = draw_line(draft.image, points, width, label)
        draft.commit(f"Draw a line of {LAYERS[layer].title.lower()}", box)

    def _snapped(self, pointer: Pointer) -> tuple[float, float]:
        """Return the position, or that of a vertex of the layer or of a line near it."""
        context, place = self.context, None
        if self._kind is not None:
            at = context.world_from_sketch(pointer.x, pointer.y)
            reach = REACH / context.px_per_metre
            place = features.snap(context.document, context.workspace, self._layer, *at, reach)
        return (pointer.x, pointer.y) if place is None else context.sketch_from_world(*place)

    def _simplify(self) -> None:
        """Leave out the points of a drag that are nearly on the line between others."""
        import shapely

        drawn = shapely.LineString(self._points[self._first :])
        self._points[self._first :] = list(drawn.simplify(_TOLERANCE / self.context.scale).coords)

    def cancel(self) -> None:
        self._points = []
        self._pressed, self._freehand = None, False
        self.context.redraw()

    def leave(self) -> None:
        self._place = None
        self.context.redraw()

    def _height(self) -> ShapeHeight | None:
        """Return the height of the line as a shape of its own."""
        sketch, workspace = self.context.document.sketch, self.context.workspace
        if LAYERS[workspace.layer].kind != "summits":
            return None
        properties = sketch.properties(workspace.layer, workspace.label)
        return shape_height(properties, 0.5 * self.width * sketch.pixel_size, sketch.fidelity)

    def draw(self, painter: QPainter) -> None:
        context, points = self.context, list(self._points)
        is_area = self._kind == AREA
        wide = 2.0 if is_area else max(self.width * context.scale, 1.0)
        if points and self._place is not None and not self._freehand and self._place != points[-1]:
            points.append(self._place)
        if len(points) > 1:
            curve = line_path(points) if not is_area and self._is_smooth else points
            path = QPolygonF([context.screen_from_sketch(x, y) for x, y in curve])
            colour = self._colour
            if is_area:
                painter.setPen(Qt.PenStyle.NoPen)
                painter.setBrush(QColor(colour.red(), colour.green(), colour.blue(), 128))
                painter.drawPolygon(path)
            outlines = ((QColor(255, 255, 255, 170), 3.0), (QColor(20, 20, 20, 150), 1.5), (colour, 0.0))
            cap, join = Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin
            for shade, more in outlines:
                painter.setPen(QPen(shade, wide + more, Qt.PenStyle.SolidLine, cap, join))
                painter.drawPolyline(path)
        if self._place is not None:
            tip = context.screen_from_sketch(*self._place)
            _draw_ring(painter, tip, 4.0 if is_area else 0.5 * wide)
        if self._place is not None and not is_area and not self._layer.is_draped:
            metres = self.width * context.document.sketch.pixel_size
            text = f"{metres:.0f} m wide" if metres >= 9.5 else f"{metres:.1f} m wide"
            height = self._height()
            text += "" if height is None else f"; {height_text(height)}"
            write_beside(painter, tip + _beside(0.5 * wide), text)
        for x, y in self._points if not self._freehand else []:
            at = context.screen_from_sketch(x, y)
            painter.setPen(QPen(QColor(20, 20, 20), 1.0))
            painter.setBrush(QColor(255, 255, 255))
            painter.drawRect(QRectF(at.x() - 3.0, at.y() - 3.0, 6.0, 6.0))
