"""Placed features over the sketch: glyphs and rings, rivers with their banks, shores of lakes."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
import numpy.typing as npt
from PyQt6.QtCore import QLineF, QPointF, QRect, QRectF, Qt
from PyQt6.QtGui import QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF
from scipy.spatial import cKDTree

from sketchterrain.placement.feature_types import FEATURE_TYPES, Lake, River, ShapeField
from sketchterrain.ui.canvas.sketch_image import scrolled
from sketchterrain.ui.canvas.tool_context import ToolContext, Viewport
from sketchterrain.ui.commands.placed_edits import find_lake, find_point, find_river
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.workspace import Selection

LIGHT = QColor(255, 255, 255, 205)
"""Around lines."""
DARK = QColor(24, 26, 30)
"""Lines."""
SELECTED = QColor(112, 38, 200)
"""What is chosen: a hue that no layer has, as dark on paper in either theme."""


def draw_glyph(
    painter: QPainter, kind: str, at: QPointF, *, colour: QColor = DARK, size: float = 1.0
) -> None:
    """Draw the sign of a type of feature around a place."""
    painter.save()
    painter.translate(at)
    painter.scale(size, size)
    draw_haloed(painter, _glyph(kind), colour, 1.5, fill=kind in ("mountain", "forest"))
    painter.restore()


def stamp_glyph(painter: QPainter, kind: str, at: QPointF, *, alpha: int, size: float, ratio: float) -> None:
    """Draw the sign of a type of feature as `draw_glyph` does, from a picture that is kept."""
    picture = _picture(kind, alpha, round(size, 2), ratio)
    half = 0.5 * picture.width()
    x, y = round(at.x() * ratio - half), round(at.y() * ratio - half)
    painter.drawImage(QPointF(x / ratio, y / ratio), picture)


@lru_cache(maxsize=64)
def _picture(kind: str, alpha: int, size: float, ratio: float) -> QImage:
    side = 2 * math.ceil(9.0 * size * ratio)
    picture = QImage(side, side, QImage.Format.Format_ARGB32_Premultiplied)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    colour = QColor(DARK)
    colour.setAlpha(alpha)
    draw_glyph(painter, kind, QPointF(0.5 * side, 0.5 * side), colour=colour, size=size * ratio)
    painter.end()
    picture.setDevicePixelRatio(ratio)
    return picture


def draw_haloed(
    painter: QPainter, path: QPainterPath, colour: QColor, width: float, *, fill: bool = False
) -> None:
    """Draw a path in a colour, with a light border around it."""
    join, cap = Qt.PenJoinStyle.RoundJoin, Qt.PenCapStyle.RoundCap
    halo = QColor(LIGHT)
    halo.setAlphaF(LIGHT.alphaF() * colour.alphaF())
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.setPen(QPen(halo, width + 2.2, Qt.PenStyle.SolidLine, cap, join))
    painter.drawPath(path)
    painter.setPen(QPen(colour, width, Qt.PenStyle.SolidLine, cap, join))
    if fill:
        painter.setBrush(colour)
    painter.drawPath(path)


@cache
def _glyph(kind: str) -> QPainterPath:
    path = QPainterPath()
    if kind == "mountain":
        path.addPolygon(QPolygonF([QPointF(-5.0, 4.0), QPointF(0.0, -5.0), QPointF(5.0, 4.0)]))
        path.closeSubpath()
    elif kind == "hill":
        path.moveTo(-5.5, 3.0)
        path.cubicTo(-3.5, -5.0, 3.5, -5.0, 5.5, 3.0)
    elif kind == "dune":
        path.moveTo(-6.0, 2.5)
        path.cubicTo(-3.0, 1.5, -1.5, -1.0, 0.5, -3.5)
        path.cubicTo(0.5, -0.5, 2.5, 2.0, 6.0, 2.5)
    else:
        path.addEllipse(QRectF(-3.2, -5.5, 6.4, 6.4))
        path.moveTo(0.0, 1.0)
        path.lineTo(0.0, 5.0)
    return path


_MOST = 768  # samples along a side of a field that are looked at


def shore_lines(field: ShapeField) -> npt.NDArray[np.float64]:
    """Return the border of a shape."""
    step = max(-(-max(field.inside.shape) // _MOST), 1)
    inside = np.asarray(field.inside[::step, ::step], np.float64)
    inside = np.where(inside == 0.0, 1e-9, inside)
    south, north = inside[:-1], inside[1:]
    corners = np.stack([south[:, :-1], south[:, 1:], north[:, :-1], north[:, 1:]])
    rows, columns = np.nonzero(np.any((corners > 0.0) != (corners[0] > 0.0), axis=0))
    a, b, c, d = corners[:, rows, columns]
    zero, one = np.zeros_like(a), np.ones_like(a)
    # Where each of a square's sides is crossed, from its south-west corner: south, north, west, east.
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.stack(
            [
                np.stack([a / (a - b), zero], -1),
                np.stack([c / (c - d), one], -1),
                np.stack([zero, a / (a - c)], -1),
                np.stack([one, b / (b - d)], -1),
            ],
            axis=1,
        )
    crossed = np.stack([a * b < 0.0, c * d < 0.0, a * c < 0.0, b * d < 0.0], axis=1)
    at += np.stack([columns, rows], axis=-1)[:, None, :]
    twice = crossed.sum(axis=1) == 2
    once = at[twice][crossed[twice]].reshape(-1, 4)
    saddles = at[~twice][:, [[0, 2], [1, 3]]].reshape(-1, 4)
    pieces = np.concatenate([once, saddles]) * (field.spacing * step)
    return np.asarray(pieces + np.array([field.west, field.south, field.west, field.south]))


_RIVER = QColor(12, 52, 110)
_SHORE = QColor(8, 70, 110)
_STEP = 3.0  # px between points of a line that is drawn
_CROWDED = 13.0  # px between features below which their signs would hide one another
_SMALLEST = 0.4  # size of a sign
_WHILE_PAINTING = 0.8


class FeatureMarks:
    """A picture of what was placed, kept while neither it nor the viewport changes.

    Rings, how far features reach, are drawn while one chooses; while one paints they would be in the way.
    """

    def __init__(self, context: ToolContext) -> None:
        self._desk = context
        self._image = QImage()
        self._of: tuple[Placement | None, Viewport | None, bool] = (None, None, False)
        self._rooms: tuple[object, npt.NDArray[np.float64]] = (None, np.empty(0))
        self._shores: dict[int, tuple[Lake, npt.NDArray[np.float64]]] = {}

    def image(self, placed: Placement) -> QImage:
        """Return the picture for the whole canvas, of device pixels, premultiplied."""
        viewport, rings = self._desk.viewport, self._desk.workspace.tool == "select"
        before, self._of = self._of, (placed, viewport, rings)
        whole = QRect(0, 0, viewport.width, viewport.height)
        if self._of == before:
            return self._image
        if (
            before[1] is not None
            and (before[0] is placed, before[2]) == (True, rings)
            and replace(before[1], left=viewport.left, top=viewport.top) == viewport
        ):
            for area in scrolled(self._image, viewport.left - before[1].left, viewport.top - before[1].top):
                self._draw(placed, area)
            return self._image
        if self._image.size() != whole.size():
            self._image = QImage(whole.size(), QImage.Format.Format_ARGB32_Premultiplied)
        self._draw(placed, whole)
        return self._image

    def _draw(self, placed: Placement, area: QRect) -> None:
        """Draw all that shows in an area of device pixels."""
        context, ratio = self._desk, self._desk.ratio
        painter = QPainter(self._image)
        painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Source)
        painter.fillRect(area, Qt.GlobalColor.transparent)
        painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_SourceOver)
        painter.setClipRect(area)
        painter.scale(ratio, ratio)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if not self._of[2]:
            sheet = QRectF(context.at(0, 0), context.at(context.viewport.columns, context.viewport.rows))
            painter.setClipRect(sheet, Qt.ClipOperation.IntersectClip)
        shown = QRectF(area.x() / ratio, area.y() / ratio, area.width() / ratio, area.height() / ratio)
        for lake in placed.lakes:
            draw_pieces(painter, context, self.shore(lake), QColor(_SHORE), 1.2, shown)
        for river in placed.rivers:
            draw_river(painter, context, river, QColor(_RIVER), shown)
        self._draw_points(painter, placed, shown)
        painter.end()

    def shore(self, lake: Lake) -> npt.NDArray[np.float64]:
        """Return the shore of a lake, (n, 4) m."""
        kept = self._shores.get(lake.id)
        if kept is None or kept[0].shape is not lake.shape:
            kept = self._shores[lake.id] = (lake, shore_lines(lake.shape))
        return kept[1]

    def _room(self, placed: Placement) -> npt.NDArray[np.float64]:
        """Distance (m) of each feature from its nearest neighbour."""
        if self._rooms[0] is not placed.points:
            places = np.stack([placed.points["x"], placed.points["y"]], axis=-1)
            away = np.asarray(cKDTree(places).query(places, k=2)[0])[:, 1] if len(places) else np.empty(0)
            self._rooms = (placed.points, away)
        return self._rooms[1]

    def _draw_points(self, painter: QPainter, placed: Placement, area: QRectF) -> None:
        context, points = self._desk, placed.points
        # A sign shrinks before it hides its neighbours, and while one paints.
        most = 1.0 if self._of[2] else _WHILE_PAINTING
        sizes = np.clip(self._room(placed) * context.px_per_metre / _CROWDED, _SMALLEST, most)
        sizes = np.round(sizes, 1)
        x, y = context.screens_from_world(points["x"], points["y"])
        reach = points["radius"].astype(np.float64) * context.px_per_metre
        near = np.maximum(reach if self._of[2] else 0.0, _CROWDED)
        seen = (np.abs(x - area.center().x()) < near + 0.5 * area.width()) & (
            np.abs(y - area.center().y()) < near + 0.5 * area.height()
        )
        for at in np.flatnonzero(seen).tolist():
            painted = bool(points["painted"][at])
            place = QPointF(float(x[at]), float(y[at]))
            if self._of[2]:
                ring = QColor(DARK)
                ring.setAlpha(90 if painted else 45)
                painter.setBrush(Qt.BrushStyle.NoBrush)
                painter.setPen(QPen(ring, 1.0))
                painter.drawEllipse(place, float(reach[at]), float(reach[at]))
            kind = FEATURE_TYPES[int(points["type"][at])]
            stamp_glyph(
                painter,
                kind,
                place,
                alpha=235 if painted else 115,
                size=float(sizes[at]),
                ratio=context.ratio,
            )


def draw_selection(
    painter: QPainter,
    marks: FeatureMarks,
    context: ToolContext,
    placed: Placement,
    selection: Selection,
    colour: QColor,
) -> None:
    """Draw what is chosen, or what the mouse is over, in a colour that stands out."""
    everywhere = QRectF(
        0.0, 0.0, context.viewport.width / context.ratio, context.viewport.height / context.ratio
    )
    point, river, lake = (
        find_point(placed, selection),
        find_river(placed, selection),
        find_lake(placed, selection),
    )
    if point is not None:
        reach = float(point["radius"]) * context.px_per_metre
        path = QPainterPath()
        path.addEllipse(context.screen_from_world(float(point["x"]), float(point["y"])), reach, reach)
        draw_haloed(painter, path, colour, 2.0)
    elif river is not None:
        draw_river(painter, context, river, colour, everywhere, strong=True)
    elif lake is not None:
        draw_pieces(painter, context, marks.shore(lake), colour, 2.4, everywhere)


def draw_river(
    painter: QPainter,
    context: ToolContext,
    river: River,
    colour: QColor,
    area: QRectF,
    *,
    strong: bool = False,
) -> None:
    """Draw a river's course and, where there is room, its banks, as far as they show in an area."""
    line = river.centreline[:, :2]
    half = 0.5 * river.centreline_width.astype(np.float64)
    scale = context.px_per_metre
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))]) * scale
    kept = np.unique(np.searchsorted(way, np.arange(0.0, way[-1] + _STEP, _STEP)).clip(max=len(line) - 1))
    x, y = (np.array(each) for each in context.pixels(*line[kept].T))
    corner, far = context.on_sketch(area.topLeft()), context.on_sketch(area.bottomRight())
    room = float(half.max()) / context.document.sketch.pixel_size + 2.0 * _STEP / context.scale
    seen = (x > corner[0] - room) & (x < far[0] + room) & (y > corner[1] - room) & (y < far[1] + room)
    runs = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]])))
    for first, last in runs.reshape(-1, 2).tolist():
        run = kept[max(first - 1, 0) : last + 1]
        if len(run) > 1:
            _draw_reach(painter, context, line, half, run, colour, strong)


def _draw_reach(
    painter: QPainter,
    context: ToolContext,
    line: npt.NDArray[np.float64],
    half: npt.NDArray[np.float64],
    kept: npt.NDArray[np.intp],
    colour: QColor,
    strong: bool,
) -> None:
    line, half = line[kept], half[kept]
    course = _path(context, line)
    if 2.0 * float(half.max()) * context.px_per_metre > 5.0:
        ahead = np.gradient(line, axis=0)
        ahead /= np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
        aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1) * half[:, None]
        faint = QColor(colour)
        faint.setAlphaF(colour.alphaF() * 0.75)
        for bank in (line + aside, line - aside):
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.setPen(QPen(faint, 1.6 if strong else 0.9))
            painter.drawPath(_path(context, bank))
    draw_haloed(painter, course, colour, 2.4 if strong else 1.4)


def draw_pieces(
    painter: QPainter,
    context: ToolContext,
    pieces: npt.NDArray[np.float64],
    colour: QColor,
    width: float,
    area: QRectF,
) -> None:
    """Draw straight pieces, (n, 4) m, with a light border, as far as they show in an area."""
    margin = 4.0 / context.px_per_metre
    west, north = context.metres(*context.on_sketch(area.topLeft()))
    east, south = context.metres(*context.on_sketch(area.bottomRight()))
    x, y = pieces[:, 0], pieces[:, 1]
    seen = (x > west - margin) & (x < east + margin) & (y > south - margin) & (y < north + margin)
    pieces = pieces[seen]
    if not len(pieces):
        return
    ends = (*context.screens_from_world(*pieces[:, :2].T), *context.screens_from_world(*pieces[:, 2:].T))
    lines = [QLineF(*each) for each in np.stack(ends, axis=-1).tolist()]
    for shade, wide in ((QColor(255, 255, 255, 130), width + 2.0), (colour, width)):
        painter.setPen(QPen(shade, wide, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
        painter.drawLines(*lines)


def _path(context: ToolContext, line: npt.NDArray[np.float64]) -> QPainterPath:
    path = QPainterPath()
    x, y = context.screens_from_world(line[:, 0], line[:, 1])
    path.addPolygon(QPolygonF([QPointF(*each) for each in zip(x.tolist(), y.tolist(), strict=True)]))
    return path
