"""Drawing of new features of a draped layer, and highlights of its features."""

import numpy as np
from PyQt6.QtCore import QPointF
from PyQt6.QtGui import QColor, QPainter

from sketchterrain.document.vectors import AREA, LINE
from sketchterrain.errors import InputError
from sketchterrain.ui.canvas.drapes import PictureWindow, draw_items
from sketchterrain.ui.canvas.marks import draw_haloed, screen_paths
from sketchterrain.ui.canvas.paint_tools import LineTool
from sketchterrain.ui.canvas.tool_context import Pointer, ToolContext
from sketchterrain.ui.models.drapes import draw_draped, refusal
from sketchterrain.ui.models.vectors import outlines
from sketchterrain.ui.models.workspace import Selection


class DrapeLineTool(LineTool):
    """Draws points, lines or areas, by `Workspace.drape_kind`, of the chosen draped layer."""

    is_painted = _is_smooth = False

    @property
    def _layer(self) -> int:
        selection = self.context.workspace.selection
        return -1 if selection is None else selection.layer

    @property
    def _kind(self) -> int | None:
        return AREA if self.context.workspace.drape_kind == "area" else LINE

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
            context.document.message.emit(problem)
        return not problem

    def _add_vector(self, kind: int, points: list[tuple[float, float]]) -> None:
        context = self.context
        places = [context.world_from_sketch(*point) for point in points]
        try:
            draw_draped(context.document, context.workspace, self._layer, places)
        except InputError as error:
            context.document.message.emit(str(error))
            self._points = points

    def _snapped(self, pointer: Pointer) -> tuple[float, float]:
        return pointer.x, pointer.y


def draw_feature(
    painter: QPainter, context: ToolContext, selection: Selection | None, colour: QColor
) -> None:
    """Highlight a draped feature, if one is selected; while it is edited draw it as its layer does, too."""
    import shapely

    drapes, feature = context.document.drapes, context.document.drapes.feature(selection)
    if feature is None or selection is None or drapes.current is None:
        return
    if drapes.held == (selection.layer, selection.id):
        corner = context.world_from_sketch(*context.sketch_from_screen(QPointF(0.0, 0.0)))
        window = PictureWindow(*corner, 1.0 / context.px_per_metre, 0, 0)
        painter.save()
        draw_items(painter, drapes.current, drapes.current.only(drapes.held, window.texel), window)
        painter.restore()
    lines = outlines(np.array([feature.geometry]))  # areas may be invalid
    (path,) = screen_paths(context, lines, context.area)
    if feature.geometry.length == 0.0:
        for place in shapely.get_coordinates(feature.geometry).tolist():
            path.addEllipse(context.screen_from_world(*place), 6.0, 6.0)
    draw_haloed(painter, path, colour, 2.0)
