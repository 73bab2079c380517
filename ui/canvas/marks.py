"""Placed features over the sketch: glyphs and rings, rivers with banks, lake shores."""

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np
from contourpy import LineType, contour_generator
from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF
from scipy.spatial import cKDTree

from sketchterrain.array_types import Bounds, Float64Array
from sketchterrain.features.picking import outlines_of
from sketchterrain.features.table import Shapes
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES, Lake, River, ShapeField
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.canvas.tool_context import ToolContext
from sketchterrain.ui.commands import find_lake, find_point, find_river
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.look.layer_colours import FILLED_GLYPHS, layer_glyph
from sketchterrain.ui.models.workspace import Selection

LIGHT = QColor(255, 255, 255, 205)  # halo of lines
DARK = QColor(24, 26, 30)  # lines
SELECTED = QColor(112, 38, 200)  # a hue of no layer, equally dark on paper in either theme
_RIVER = QColor(12, 52, 110)
_SHORE = QColor(8, 70, 110)
_TOLERANCE = 0.25  # logical px of drawn lines
_MARGIN = 4.0  # logical px, of thin lines with their halo
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


def world_box(context: ToolContext, area: QRectF, margin: float) -> Bounds:
    """Return the box (m) of an area (logical px) and a margin around it, and of lines' halos."""
    margin += _MARGIN
    area = area.adjusted(-margin, -margin, margin, margin)
    west, north = context.world_from_sketch(*context.sketch_from_screen(area.topLeft()))
    east, south = context.world_from_sketch(*context.sketch_from_screen(area.bottomRight()))
    return west, south, east, north


def screen_paths(
    context: ToolContext, shapes: Shapes, area: QRectF, *, margin: float = 0.0
) -> list[QPainterPath]:
    """Return the path (logical px) of each shape (m) within an area and a margin around it."""
    import shapely

    clipped = shapely.clip_by_rect(shapes, *world_box(context, area, margin))
    tolerance = _TOLERANCE / context.px_per_metre
    lines = outlines_of(shapely.simplify(clipped, tolerance, preserve_topology=False))
    parts, of = shapely.get_parts(lines, return_index=True)
    points, part = shapely.get_coordinates(parts, return_index=True)
    x, y = context.screens_from_world(*points.T)
    starts = np.searchsorted(part, np.arange(len(parts) + 1)).tolist()
    paths = [QPainterPath() for _ in shapes]
    for path, (first, end) in zip(of.tolist(), pairwise(starts), strict=True):
        paths[path].addPolygon(QPolygonF(list(map(QPointF, x[first:end].tolist(), y[first:end].tolist()))))
    return paths


@lru_cache(maxsize=64)
def shore_lines(field: ShapeField) -> list[Float64Array]:
    """Return a shape's border as lines, (n, 2) m."""
    step = max(-(-max(field.inside.shape) // _MAX_SAMPLES), 1)
    inside = np.asarray(field.inside[::step, ::step], np.float64)
    lines = contour_generator(z=inside, line_type=LineType.Separate).lines(0.0)
    origin = np.array([field.west, field.south])
    return [line * (field.spacing * step) + origin for line in lines]


@lru_cache(maxsize=1)
def _neighbour_distances(placed: Placement) -> Float64Array:
    """Return each feature's distance (m) from its nearest neighbour."""
    places = np.stack([placed.points["x"], placed.points["y"]], axis=-1)
    return np.asarray(cKDTree(places).query(places, k=2)[0])[:, 1] if len(places) else np.empty(0)


def draw_placed(painter: QPainter, context: ToolContext, selection: Selection, colour: QColor) -> None:
    """Highlight a placed object."""
    placed, canvas = context.link.placed, context.area
    point = find_point(placed, selection)
    river, lake = find_river(placed, selection), find_lake(placed, selection)
    if point is not None:
        radius = float(point["radius"]) * context.px_per_metre
        path = QPainterPath()
        centre = context.screen_from_world(float(point["x"]), float(point["y"]))
        path.addEllipse(centre, radius, radius)
        draw_haloed(painter, path, colour, 2.0)
    elif river is not None:
        _draw_river(painter, context, river, colour, canvas, selected=True)
    elif lake is not None:
        _draw_shore(painter, context, lake, colour, 2.4, canvas)


def draw_features(painter: QPainter, context: ToolContext, visible: QRectF) -> None:
    """Draw the placed features in an area; rings of influence with the selection tool only."""
    placed, rings = context.link.placed, context.workspace.tool == "select"
    if not rings:
        corner = context.screen_from_sketch(context.viewport.columns, context.viewport.rows)
        sketch = QRectF(context.screen_from_sketch(0, 0), corner)
        painter.setClipRect(sketch, Qt.ClipOperation.IntersectClip)
    for lake in placed.lakes:
        _draw_shore(painter, context, lake, QColor(_SHORE), 1.2, visible)
    for river in placed.rivers:
        _draw_river(painter, context, river, QColor(_RIVER), visible)
    _draw_points(painter, context, visible, rings=rings)


def _draw_points(painter: QPainter, context: ToolContext, area: QRectF, *, rings: bool) -> None:
    placed, points = context.link.placed, context.link.placed.points
    # Glyphs shrink where they would overlap, and while painting.
    largest = 1.0 if rings else _SIZE_WHILE_PAINTING
    free = _neighbour_distances(placed) * context.px_per_metre / _SPACING
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
    painter: QPainter,
    context: ToolContext,
    river: River,
    colour: QColor,
    area: QRectF,
    *,
    selected: bool = False,
) -> None:
    """Draw the part of a river in an area: centreline and, where wide enough, banks."""
    import shapely

    line, half = river.centreline[:, :2], 0.5 * river.centreline_width[:, None].astype(np.float64)
    tangent = np.gradient(line, axis=0)
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-9)[:, None]
    offset = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1) * half
    lines = shapely.linestrings([line, line + offset, line - offset])
    centre, *banks = screen_paths(context, lines, area)
    if 2.0 * float(half.max()) * context.px_per_metre > 5.0:
        faint = QColor(colour)
        faint.setAlphaF(colour.alphaF() * 0.75)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(QPen(faint, 1.6 if selected else 0.9))
        for bank in banks:
            painter.drawPath(bank)
    draw_haloed(painter, centre, colour, 2.4 if selected else 1.4)


def _draw_shore(
    painter: QPainter, context: ToolContext, lake: Lake, colour: QColor, width: float, area: QRectF
) -> None:
    """Draw the part of a lake's shore in an area."""
    import shapely

    shapes = np.array([shapely.LineString(line) for line in shore_lines(lake.shape)], object)
    for path in screen_paths(context, shapes, area):
        draw_haloed(painter, path, colour, width)
