"""What was placed, drawn over the sketch: features with their rings, rivers with their banks, shores."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from PyQt6.QtCore import QLineF, QRectF, Qt
from PyQt6.QtGui import QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF

from sketchterrain.features.catalogue import FEATURE_TYPES
from sketchterrain.ui.canvas.glyphs import DARK, draw_glyph, draw_haloed
from sketchterrain.ui.canvas.shores import shore_lines
from sketchterrain.ui.commands.chosen_parts import lake_of, point_of, river_of

if TYPE_CHECKING:
    from sketchterrain.features import Lake, River
    from sketchterrain.ui.canvas.desk import Desk
    from sketchterrain.ui.canvas.viewport import Viewport
    from sketchterrain.ui.engine.messages import Placed
    from sketchterrain.ui.models.workspace import Chosen

__all__ = ["Marks", "draw_chosen"]

_RIVER = QColor(12, 52, 110)
_SHORE = QColor(8, 70, 110)
_STEP = 2.0  # px between points of a line that is drawn
_CROWDED = 14.0  # px between features below which their glyphs would hide one another


class Marks:
    """A picture of what was placed, kept while neither it nor the viewport changes.

    Parameters
    ----------
    desk : Desk
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._image = QImage()
        self._of: tuple[Placed | None, Viewport | None] = (None, None)
        self._shores: dict[int, tuple[Lake, npt.NDArray[np.float64]]] = {}

    def image(self, placed: Placed) -> QImage:
        """Return the picture for the whole canvas, of device pixels, premultiplied."""
        viewport = self._desk.viewport
        if self._of[0] is placed and self._of[1] == viewport:
            return self._image
        self._of = (placed, viewport)
        if (self._image.width(), self._image.height()) != (viewport.width, viewport.height):
            form = QImage.Format.Format_ARGB32_Premultiplied
            self._image = QImage(viewport.width, viewport.height, form)
        self._image.setDevicePixelRatio(1.0)
        self._image.fill(Qt.GlobalColor.transparent)
        painter = QPainter(self._image)
        painter.scale(self._desk.ratio, self._desk.ratio)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for lake in placed.lakes:
            self._draw_shore(painter, lake)
        for river in placed.rivers:
            draw_river(painter, self._desk, river, QColor(_RIVER))
        self._draw_points(painter, placed)
        painter.end()
        return self._image

    def shore(self, lake: Lake) -> npt.NDArray[np.float64]:
        """Return the shore of a lake, (n, 4) m."""
        kept = self._shores.get(lake.id)
        if kept is None or kept[0].shape is not lake.shape:
            kept = self._shores[lake.id] = (lake, shore_lines(lake.shape))
        return kept[1]

    def _draw_shore(self, painter: QPainter, lake: Lake) -> None:
        draw_pieces(painter, self._desk, self.shore(lake), QColor(_SHORE), 1.2)

    def _draw_points(self, painter: QPainter, placed: Placed) -> None:
        desk, points = self._desk, placed.points
        width, height = desk.viewport.width / desk.ratio, desk.viewport.height / desk.ratio
        at = [desk.of_world(float(x), float(y)) for x, y in zip(points["x"], points["y"], strict=True)]
        # A glyph shrinks before it hides its neighbours.
        spread = float(np.sqrt(max(desk.document.sketch.size) ** 2 / max(len(points), 1))) * desk.per_metre
        size = min(max(spread / (2.0 * _CROWDED), 0.45), 1.0)
        for place, point in zip(at, points, strict=True):
            reach = float(point["radius"]) * desk.per_metre
            if not QRectF(-reach, -reach, width + 2 * reach, height + 2 * reach).contains(place):
                continue
            ring = QColor(DARK)
            ring.setAlpha(95 if point["painted"] else 45)
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.setPen(QPen(ring, 1.0))
            painter.drawEllipse(place, reach, reach)
            shade = QColor(DARK)
            shade.setAlpha(235 if point["painted"] else 115)
            draw_glyph(painter, FEATURE_TYPES[int(point["type"])], place, colour=shade, size=size)


def draw_chosen(
    painter: QPainter, marks: Marks, desk: Desk, placed: Placed, chosen: Chosen, colour: QColor
) -> None:
    """Draw what is chosen, or what the mouse is over, in a colour that stands out."""
    point, river, lake = point_of(placed, chosen), river_of(placed, chosen), lake_of(placed, chosen)
    if point is not None:
        reach = float(point["radius"]) * desk.per_metre
        path = QPainterPath()
        path.addEllipse(desk.of_world(float(point["x"]), float(point["y"])), reach, reach)
        draw_haloed(painter, path, colour, 2.0)
    elif river is not None:
        draw_river(painter, desk, river, colour, strong=True)
    elif lake is not None:
        draw_pieces(painter, desk, marks.shore(lake), colour, 2.4)


def draw_river(painter: QPainter, desk: Desk, river: River, colour: QColor, *, strong: bool = False) -> None:
    """Draw a river's course and, where there is room, its banks."""
    line = river.centreline[:, :2]
    half = 0.5 * river.centreline_width.astype(np.float64)
    scale = desk.per_metre
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))]) * scale
    kept = np.unique(np.searchsorted(way, np.arange(0.0, way[-1] + _STEP, _STEP)).clip(max=len(line) - 1))
    if len(kept) < 2:
        return
    line, half = line[kept], half[kept]
    course = _path(desk, line)
    if 2.0 * float(half.max()) * scale > 5.0:
        ahead = np.gradient(line, axis=0)
        ahead /= np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
        aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1) * half[:, None]
        faint = QColor(colour)
        faint.setAlphaF(colour.alphaF() * 0.75)
        for bank in (line + aside, line - aside):
            draw_haloed(painter, _path(desk, bank), faint, 1.6 if strong else 0.9)
    draw_haloed(painter, course, colour, 2.4 if strong else 1.4)


def draw_pieces(
    painter: QPainter, desk: Desk, pieces: npt.NDArray[np.float64], colour: QColor, width: float
) -> None:
    """Draw straight pieces, (n, 4) m, with a light border."""
    if not len(pieces):
        return
    lines = [QLineF(desk.of_world(a, b), desk.of_world(c, d)) for a, b, c, d in pieces.tolist()]
    for shade, wide in ((QColor(255, 255, 255, 120), width + 2.0), (colour, width)):
        painter.setPen(QPen(shade, wide, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
        painter.drawLines(*lines)


def _path(desk: Desk, line: npt.NDArray[np.float64]) -> QPainterPath:
    path = QPainterPath()
    path.addPolygon(QPolygonF([desk.of_world(x, y) for x, y in line.tolist()]))
    return path
