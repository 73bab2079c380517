"""Drawing of new features of a draped layer, and highlights of its features."""

from PyQt6.QtCore import QPointF
from PyQt6.QtGui import QColor, QPainter

from sketchterrain.document.vectors import AREA, LINE
from sketchterrain.errors import InputError
from sketchterrain.ui.canvas.drapes import PictureWindow, draw_items, path_of
from sketchterrain.ui.canvas.marks import draw_haloed
from sketchterrain.ui.canvas.paint_tools import LineTool
from sketchterrain.ui.canvas.tool_context import Pointer, ToolContext
from sketchterrain.ui.models.drapes import draw_draped, refusal
from sketchterrain.ui.models.workspace import Selection


class DrapeLineTool(LineTool):
    """Draws points, lines or areas, by `Workspace.drape_kind`, of the chosen draped layer."""

    is_painted = False

    @property
    def _layer(self) -> int:
        selection = self.context.workspace.selection
        return -1 if selection is None else selection.layer

    @property
    def _kind(self) -> int | None:
        return AREA if self.context.workspace.drape_kind == "area" else LINE

    @property
    def _is_smooth(self) -> bool:
        return False

    @property
    def width(self) -> float:
        return 2.0 / self.context.scale

    @property
    def _active(self) -> tuple[str, int]:
        return self.context.workspace.drape_kind, self._layer

    @property
    def _colour(self) -> QColor:
        style = self.context.document.sketch.drapes[self._layer].style
        return QColor(style["colour"] or style["fill"])

    def press(self, pointer: Pointer) -> None:
        super().press(pointer)
        if self._points and self.context.workspace.drape_kind == "point":
            self.finish()

    def _may_draw(self) -> bool:
        context = self.context
        problem = refusal(context.document, context.workspace, self._layer)
        if problem:
            context.signals.message.emit(problem)
        return not problem

    def _add_vector(self, kind: int, points: list[tuple[float, float]]) -> None:
        context = self.context
        places = [context.world_from_sketch(*point) for point in points]
        try:
            draw_draped(context.document, context.workspace, self._layer, places)
        except InputError as error:
            context.signals.message.emit(str(error))
            self._points = points

    def _snapped(self, pointer: Pointer) -> tuple[float, float]:
        return pointer.x, pointer.y


def draw_feature(painter: QPainter, context: ToolContext, held: tuple[int, int], colour: QColor) -> None:
    """Draw one feature as its layer does, and highlight it."""
    from sketchterrain.drape.items import POINT

    drapes = context.document.drapes.current
    if drapes is None or context.document.drapes.feature(Selection("drape", held[1], layer=held[0])) is None:
        return
    corner = context.world_from_sketch(*context.sketch_from_screen(QPointF(0.0, 0.0)))
    window = PictureWindow(*corner, 1.0 / context.px_per_metre, 0, 0)
    items = drapes.only(held, window.texel)
    painter.save()
    if context.document.drapes.held == held:
        draw_items(painter, drapes, items, window)
    painter.restore()
    points, single = window.pixels(items.points), items.kind == POINT
    path = path_of(points, items.first[:-1])
    for at in items.first[:-1][single].tolist():
        path.addEllipse(QPointF(*points[at].tolist()), 6.0, 6.0)
    draw_haloed(painter, path, colour, 2.0)
