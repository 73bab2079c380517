"""Placed features over the sketch: glyphs and rings, rivers with banks, lake shores."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from contourpy import LineType, contour_generator
from PyQt6.QtCore import QLineF, QPointF, QRect, QRectF, Qt
from PyQt6.QtGui import QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.caching import IdentityKey, LRUCache
from sketchterrain.document.layers import LAYERS
from sketchterrain.placement.feature_types import FEATURE_TYPES, Lake, River, ShapeField
from sketchterrain.ui.canvas.sketch_image import scroll_image
from sketchterrain.ui.canvas.tool_context import ToolContext, Viewport
from sketchterrain.ui.commands import find_lake, find_point, find_river
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.look.layer_colours import FILLED_GLYPHS, layer_glyph
from sketchterrain.ui.models.workspace import Selection

LIGHT = QColor(255, 255, 255, 205)  # halo of lines
DARK = QColor(24, 26, 30)  # lines
SELECTED = QColor(112, 38, 200)  # a hue of no layer, equally dark on paper in either theme
_RIVER = QColor(12, 52, 110)
_SHORE = QColor(8, 70, 110)
_STEP = 3.0  # px between points of a drawn line
_SPACING = 13.0  # px between features below which glyphs would overlap
_LEAST_SIZE = 0.4  # of a glyph
_SIZE_WHILE_PAINTING = 0.8
_MAX_SAMPLES = 768  # along a side of a lake's field


@lru_cache(maxsize=64)
def _glyph_image(kind: str, alpha: int, size: float, ratio: float) -> QImage:
    side = 2 * math.ceil(9.0 * size * ratio)
    image = QImage(side, side, QImage.Format.Format_ARGB32_Premultiplied)
    image.fill(Qt.GlobalColor.transparent)
    painter = QPainter(image)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    colour = QColor(DARK)
    colour.setAlpha(alpha)
    painter.translate(0.5 * side, 0.5 * side)
    painter.scale(size * ratio, size * ratio)
    draw_haloed(painter, layer_glyph(kind), colour, 1.5, fill=LAYERS[kind].glyph in FILLED_GLYPHS)
    painter.end()
    image.setDevicePixelRatio(ratio)
    return image


def draw_haloed(
    painter: QPainter, path: QPainterPath, colour: QColor, width: float, *, fill: bool = False
) -> None:
    """Draw a path with a light halo."""
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


@lru_cache(maxsize=64)
def shore_lines(field: ShapeField) -> Float64Array:
    """Return a shape's border as line segments, (n, 4) m."""
    step = max(-(-max(field.inside.shape) // _MAX_SAMPLES), 1)
    inside = np.asarray(field.inside[::step, ::step], np.float64)
    lines = contour_generator(z=inside, line_type=LineType.Separate).lines(0.0)
    segments = np.concatenate([np.empty((0, 4)), *(np.hstack([line[:-1], line[1:]]) for line in lines)])
    origin = np.array([field.west, field.south, field.west, field.south])
    return np.asarray(segments * (field.spacing * step) + origin)


class OverlayImage:
    """A cached image of the whole canvas: when it is scrolled, only what is new is drawn.

    `draw` draws a rectangle (logical px) with a painter in logical pixels.
    """

    def __init__(self, context: ToolContext, draw: Callable[[QPainter, QRectF], None]) -> None:
        self._context, self._draw_area = context, draw
        self._image = QImage()
        self._key: tuple[object, ...] = ()
        self._viewport: Viewport | None = None

    def updated(self, *key: object) -> QImage:
        """Return the image, device pixels, premultiplied, of what a key stands for."""
        viewport, last = self._context.viewport, self._viewport
        is_same, self._key, self._viewport = key == self._key, key, viewport
        if is_same and viewport == last:
            return self._image
        if is_same and last is not None and replace(last, left=viewport.left, top=viewport.top) == viewport:
            for area in scroll_image(self._image, viewport.left - last.left, viewport.top - last.top):
                self._draw(area)
            return self._image
        whole = QRect(0, 0, viewport.width, viewport.height)
        if self._image.size() != whole.size():
            self._image = QImage(whole.size(), QImage.Format.Format_ARGB32_Premultiplied)
        self._draw(whole)
        return self._image

    def _draw(self, area: QRect) -> None:
        """Draw an area, device pixels."""
        painter, ratio = QPainter(self._image), self._context.ratio
        painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Source)
        painter.fillRect(area, Qt.GlobalColor.transparent)
        painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_SourceOver)
        painter.setClipRect(area)
        painter.scale(ratio, ratio)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        size = (area.width() / ratio, area.height() / ratio)
        self._draw_area(painter, QRectF(area.x() / ratio, area.y() / ratio, *size))
        painter.end()


class FeatureMarks:
    """A cached image of the placed features; rings of influence are drawn with the selection tool only."""

    def __init__(self, context: ToolContext) -> None:
        self._context = context
        self._image = OverlayImage(context, self._draw)
        self._placed: Placement | None = None
        self._rings = False
        self._spacings = LRUCache(1)

    def image(self, placed: Placement) -> QImage:
        """Return the image of the whole canvas, device pixels, premultiplied."""
        self._placed, self._rings = placed, self._context.workspace.tool == "select"
        return self._image.updated(placed, self._rings)

    def draw_selection(
        self, painter: QPainter, placed: Placement, selection: Selection, colour: QColor
    ) -> None:
        """Highlight the selected or hovered object."""
        viewport, ratio = self._context.viewport, self._context.ratio
        canvas = QRectF(0.0, 0.0, viewport.width / ratio, viewport.height / ratio)
        point = find_point(placed, selection)
        river, lake = find_river(placed, selection), find_lake(placed, selection)
        if point is not None:
            radius = float(point["radius"]) * self._context.px_per_metre
            path = QPainterPath()
            centre = self._context.screen_from_world(float(point["x"]), float(point["y"]))
            path.addEllipse(centre, radius, radius)
            draw_haloed(painter, path, colour, 2.0)
        elif river is not None:
            self._draw_river(painter, river, colour, canvas, selected=True)
        elif lake is not None:
            self._draw_shore(painter, lake, colour, 2.4, canvas)

    def _draw(self, painter: QPainter, visible: QRectF) -> None:
        context, placed = self._context, self._placed
        if placed is None:
            return
        if not self._rings:
            corner = context.screen_from_sketch(context.viewport.columns, context.viewport.rows)
            sketch = QRectF(context.screen_from_sketch(0, 0), corner)
            painter.setClipRect(sketch, Qt.ClipOperation.IntersectClip)
        for lake in placed.lakes:
            self._draw_shore(painter, lake, QColor(_SHORE), 1.2, visible)
        for river in placed.rivers:
            self._draw_river(painter, river, QColor(_RIVER), visible)
        self._draw_points(painter, placed, visible)

    def _neighbour_distances(self, placed: Placement) -> Float64Array:
        """Return each feature's distance (m) from its nearest neighbour."""

        def compute() -> Float64Array:
            places = np.stack([placed.points["x"], placed.points["y"]], axis=-1)
            return np.asarray(cKDTree(places).query(places, k=2)[0])[:, 1] if len(places) else np.empty(0)

        return self._spacings.get_or_compute(IdentityKey(placed.points), compute)

    def _draw_points(self, painter: QPainter, placed: Placement, area: QRectF) -> None:
        context, points, rings = self._context, placed.points, self._rings
        # Glyphs shrink where they would overlap, and while painting.
        largest = 1.0 if rings else _SIZE_WHILE_PAINTING
        free = self._neighbour_distances(placed) * context.px_per_metre / _SPACING
        sizes = np.round(np.clip(free, _LEAST_SIZE, largest), 1)
        x, y = context.screens_from_world(points["x"], points["y"])
        radius = points["radius"].astype(np.float64) * context.px_per_metre
        near = np.maximum(radius if rings else 0.0, _SPACING)
        visible = (np.abs(x - area.center().x()) < near + 0.5 * area.width()) & (
            np.abs(y - area.center().y()) < near + 0.5 * area.height()
        )
        for at in np.flatnonzero(visible).tolist():
            painted = bool(points["painted"][at])
            if rings:
                ring = QColor(DARK)
                ring.setAlpha(90 if painted else 45)
                painter.setBrush(Qt.BrushStyle.NoBrush)
                painter.setPen(QPen(ring, 1.0))
                painter.drawEllipse(QPointF(x[at], y[at]), float(radius[at]), float(radius[at]))
            kind, ratio = FEATURE_TYPES[int(points["type"][at])], context.ratio
            glyph = _glyph_image(kind, 235 if painted else 115, round(float(sizes[at]), 2), ratio)
            half = 0.5 * glyph.width()
            left, top = round(float(x[at]) * ratio - half), round(float(y[at]) * ratio - half)
            painter.drawImage(QPointF(left / ratio, top / ratio), glyph)

    def _draw_river(
        self, painter: QPainter, river: River, colour: QColor, area: QRectF, *, selected: bool = False
    ) -> None:
        """Draw the part of a river in an area: centreline and, where wide enough, banks."""
        context, scale = self._context, self._context.px_per_metre
        line = river.centreline[:, :2]
        half = 0.5 * river.centreline_width.astype(np.float64)
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))]) * scale
        steps = np.arange(0.0, length[-1] + _STEP, _STEP)
        nodes = np.unique(np.searchsorted(length, steps).clip(max=len(line) - 1))
        x, y = (np.array(each) for each in context.sketch_from_world(*line[nodes].T))
        near = context.sketch_from_screen(area.topLeft())
        far = context.sketch_from_screen(area.bottomRight())
        margin = float(half.max()) / context.document.sketch.pixel_size + 2.0 * _STEP / context.scale
        visible = (x > near[0] - margin) & (x < far[0] + margin)
        visible &= (y > near[1] - margin) & (y < far[1] + margin)
        runs = np.flatnonzero(np.diff(np.concatenate([[False], visible, [False]])))
        for first, last in runs.reshape(-1, 2).tolist():
            run = nodes[max(first - 1, 0) : last + 1]
            if len(run) > 1:
                self._draw_reach(painter, line[run], half[run], colour, selected)

    def _draw_reach(
        self,
        painter: QPainter,
        line: Float64Array,
        half: Float64Array,
        colour: QColor,
        selected: bool,
    ) -> None:
        if 2.0 * float(half.max()) * self._context.px_per_metre > 5.0:
            tangent = np.gradient(line, axis=0)
            tangent /= np.maximum(np.hypot(*tangent.T), 1e-9)[:, None]
            offset = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1) * half[:, None]
            faint = QColor(colour)
            faint.setAlphaF(colour.alphaF() * 0.75)
            for bank in (line + offset, line - offset):
                painter.setBrush(Qt.BrushStyle.NoBrush)
                painter.setPen(QPen(faint, 1.6 if selected else 0.9))
                painter.drawPath(self._path(bank))
        draw_haloed(painter, self._path(line), colour, 2.4 if selected else 1.4)

    def _draw_shore(self, painter: QPainter, lake: Lake, colour: QColor, width: float, area: QRectF) -> None:
        """Draw the part of a lake's shore in an area, with a light halo."""
        context, segments = self._context, shore_lines(lake.shape)
        margin = 4.0 / context.px_per_metre
        west, north = context.world_from_sketch(*context.sketch_from_screen(area.topLeft()))
        east, south = context.world_from_sketch(*context.sketch_from_screen(area.bottomRight()))
        x, y = segments[:, 0], segments[:, 1]
        visible = (x > west - margin) & (x < east + margin) & (y > south - margin) & (y < north + margin)
        segments = segments[visible]
        if not len(segments):
            return
        ends = (
            *context.screens_from_world(*segments[:, :2].T),
            *context.screens_from_world(*segments[:, 2:].T),
        )
        lines = [QLineF(*each) for each in np.stack(ends, axis=-1).tolist()]
        for shade, wide in ((QColor(255, 255, 255, 130), width + 2.0), (colour, width)):
            painter.setPen(QPen(shade, wide, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
            painter.drawLines(*lines)

    def _path(self, line: Float64Array) -> QPainterPath:
        path = QPainterPath()
        x, y = self._context.screens_from_world(line[:, 0], line[:, 1])
        path.addPolygon(QPolygonF([QPointF(*each) for each in zip(x.tolist(), y.tolist(), strict=True)]))
        return path
