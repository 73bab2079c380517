"""Pictures of draped layers for the canvas, drawn in the background."""

from __future__ import annotations

import math
import time
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np
from PyQt6.QtCore import QLineF, QObject, QPointF, QRectF, Qt, pyqtSignal
from PyQt6.QtGui import QBrush, QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF, QTransform

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.ui.canvas.underlay import Pictures
from sketchterrain.ui.models.background import BackgroundReader

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.features.items import Items
    from sketchterrain.schema.parameters import Properties
    from sketchterrain.ui.canvas.tool_context import ToolContext

_SHORT: Final = 0.016  # s; pictures that took longer are drawn on a thread
_MANY: Final = 128  # lines of a style that are drawn together
_MODES: Final = {
    "normal": QPainter.CompositionMode.CompositionMode_SourceOver,
    "multiply": QPainter.CompositionMode.CompositionMode_Multiply,
    "screen": QPainter.CompositionMode.CompositionMode_Screen,
    "add": QPainter.CompositionMode.CompositionMode_Plus,
}
_CAPS: Final = {
    "butt": Qt.PenCapStyle.FlatCap,
    "round": Qt.PenCapStyle.RoundCap,
    "square": Qt.PenCapStyle.SquareCap,
}
_JOINS: Final = {
    "bevel": Qt.PenJoinStyle.BevelJoin,
    "mitre": Qt.PenJoinStyle.MiterJoin,
    "round": Qt.PenJoinStyle.RoundJoin,
}


_Images: TypeAlias = tuple[QImage | None, QImage | None]  # beneath and above the paint


class PictureWindow(NamedTuple):
    """The ground in a picture: its north-west corner (m), and a pixel's side (m)."""

    west: float
    north: float
    texel: float
    columns: int
    rows: int

    def pixels(self, points: Float64Array) -> Float64Array:
        return (points - (self.west, self.north)) * (1.0 / self.texel, -1.0 / self.texel)

    @property
    def box(self) -> tuple[float, float, float, float]:
        """West, south, east and north (m)."""
        width, height = self.columns * self.texel, self.rows * self.texel
        return self.west, self.north - height, self.west + width, self.north


class DrapePictures(QObject):
    """Pictures of the visible draped layers: those up to the highest raster lie beneath the paint.

    Until new ones are drawn, on a thread if that takes long, the previous ones are shown in their place.
    """

    changed = pyqtSignal(bool)  # whether those beneath the paint

    def __init__(self, context: ToolContext, parent: QObject) -> None:
        super().__init__(parent)
        self._context = context
        self.beneath: Pictures = ()  # at most one
        self.above: Pictures = ()  # at most one
        self._key: tuple[object, ...] = ()
        self._base: tuple[object, Drapes] | None = None  # without the feature that is held
        self._seconds, self._texel = 0.0, 0.0  # that the last picture took, and its scale
        self._reader = BackgroundReader(self)
        self._reader.failed.connect(context.document.message)
        context.document.drapes.changed.connect(self.update)

    @property
    def is_busy(self) -> bool:
        return self._reader.is_busy

    def update(self) -> None:
        """Draw the pictures again if the layers or the viewport have changed."""
        drapes, window = self._drapes(), self._window()
        key, is_zoomed = (drapes, window), window.texel != self._texel
        if key == self._key or self.is_busy:
            return
        self._key, self._texel = key, window.texel
        if drapes is None or drapes.is_empty:
            self._show(window, ((None, None), 0.0))
        elif self._seconds < _SHORT and not is_zoomed and (self.beneath or self.above):
            self._show(window, _draw(drapes, window))
        else:
            self._reader.read(partial(_draw, drapes, window), partial(self._show, window))

    def _drapes(self) -> Drapes | None:
        """Return the layers without the feature that is held, the same ones while only that changes."""
        sources = self._context.document.drapes
        current, held = sources.current, sources.held
        if current is None or held is None:
            self._base = None
            return current
        if self._base is None or self._base[0] != held:
            self._base = held, current.without(held)
        return self._base[1]

    def _window(self) -> PictureWindow:
        """Return the part of the sketch's surroundings that the canvas shows, in device pixels."""
        context, viewport = self._context, self._context.viewport
        west, north = context.world_from_sketch(*viewport.to_sketch(0.0, 0.0))
        texel = context.document.sketch.pixel_size / viewport.scale
        return PictureWindow(west, north, texel, viewport.width, viewport.height)

    def _show(self, window: PictureWindow, found: tuple[_Images, float]) -> None:
        images, self._seconds = found
        (east, north), (west, south, right, top) = self._context.document.sketch.size, window.box
        place = QRectF(west / east, 1.0 - top / north, (right - west) / east, (top - south) / north)
        before = self.beneath, self.above
        self.beneath, self.above = (() if image is None else ((image, place),) for image in images)
        if before != (self.beneath, self.above):
            self.changed.emit(before[0] != self.beneath)
        self.update()  # what has changed meanwhile


def _draw(drapes: Drapes, window: PictureWindow) -> tuple[_Images, float]:
    """Return the pictures of the layers beneath and above the paint, and the time that they took (s)."""
    started = time.perf_counter()
    rasters, items = dict(drapes.rasters(window.texel)), drapes.items(window.box, window.texel)
    drawn = sorted({*rasters, *np.unique(items.layer).tolist()})
    highest = max(rasters, default=-1)
    images: list[QImage | None] = []
    for numbers in ([each for each in drawn if each <= highest], [each for each in drawn if each > highest]):
        if not numbers:
            images.append(None)
            continue
        image = QImage(window.columns, window.rows, QImage.Format.Format_ARGB32_Premultiplied)
        image.fill(Qt.GlobalColor.transparent)
        painter = QPainter(image)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for number in numbers:
            if number in rasters:
                pixels = rasters[number].pixels(window.west, window.north, *window[2:])
                layer = drapes.layers[number]
                _use(painter, layer["opacity"], layer["blend"])
                shape = window.columns, window.rows, 4 * window.columns
                painter.drawImage(0, 0, QImage(pixels.tobytes(), *shape, QImage.Format.Format_RGBA8888))
            draw_items(painter, drapes, items.taken(items.layer == number), window)
        painter.end()
        images.append(image)
    return (images[0], images[1]), time.perf_counter() - started


def _use(painter: QPainter, opacity: float, blend: str) -> None:
    painter.setOpacity(opacity)
    painter.setCompositionMode(_MODES[blend])


def draw_items(painter: QPainter, drapes: Drapes, items: Items, window: PictureWindow) -> None:
    """Draw vectors: areas feature by feature, lines of a style many at a time unless they are dashed."""
    from sketchterrain.features.items import AFTER, BEFORE, FILL, POINT

    if not len(items.kind):
        return
    own = np.ones(len(items.points), np.bool_)  # without the points before and after parts of lines
    own[items.first[:-1][(items.ends & BEFORE) > 0]] = False
    own[items.first[1:][(items.ends & AFTER) > 0] - 1] = False
    first, points = np.append(0, np.cumsum(own))[items.first], window.pixels(items.points[own])
    number = np.arange(len(items.kind))
    dashed = np.array([len(each.dashes) > 0 for each in drapes.styles])[items.style]
    group = np.where(items.kind == FILL, items.feature, np.where(dashed, number, number // _MANY))
    keys = np.stack([items.style, items.kind, group])
    starts = np.flatnonzero(np.append(True, (keys[:, 1:] != keys[:, :-1]).any(axis=0))).tolist()
    for start, end in pairwise([*starts, len(number)]):
        look = drapes.styles[int(items.style[start])]
        _use(painter, look.opacity, look.blend)
        values, places = look.style, points[first[start] : first[end]]
        unit = 1.0 if values["unit"] == "px" else 1.0 / window.texel
        width = max(values["width"] * unit, 1.0)
        pen = QPen(QColor(values["colour"]), width, cap=_CAPS[values["cap"]], join=_JOINS[values["join"]])
        if items.kind[start] == POINT:
            pen.setCapStyle(Qt.PenCapStyle.RoundCap)
            painter.setPen(pen)
            painter.drawPoints(QPolygonF(list(map(QPointF, *places.T.tolist()))))
            continue
        path = path_of(places, first[start:end] - first[start])
        if items.kind[start] == FILL:
            _fill(painter, path, values, unit, QPointF(*window.pixels(np.zeros(2)).tolist()))
            continue
        if len(look.dashes):
            pen.setDashPattern((look.dashes * unit / width).tolist())
            pen.setDashOffset(float(items.along[start]) / (window.texel * width))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(pen)
        painter.drawPath(path)


def path_of(points: Float64Array, starts: Int64Array) -> QPainterPath:
    """Return lines through points (n, 2), each from one of the starts on."""
    path = QPainterPath()
    path.setFillRule(Qt.FillRule.WindingFill)
    for start, end in pairwise([*starts.tolist(), len(points)]):
        path.addPolygon(QPolygonF(list(map(QPointF, *points[start:end].T.tolist()))))
    return path


def _fill(painter: QPainter, path: QPainterPath, values: Properties, unit: float, origin: QPointF) -> None:
    """Fill areas, or hatch them with lines that pass through the sketch's corner."""
    colour = QColor(values["fill"])
    colour.setAlphaF(values["fill_opacity"])
    if values["hatch"] == "none":
        painter.fillPath(path, QBrush(colour))
        return
    painter.save()
    painter.setClipPath(path)
    painter.setPen(QPen(colour, max(values["width"] * unit, 1.0)))
    shown, spacing = path.boundingRect() & QRectF(painter.window()), max(values["hatch_spacing"] * unit, 2.0)
    for turn in (0.0, 90.0) if values["hatch"] == "cross" else (0.0,):
        lines = QTransform.fromTranslate(origin.x(), origin.y()).rotate(-values["hatch_angle"] - turn)
        box = lines.inverted()[0].mapRect(shown)
        for step in range(math.ceil(box.top() / spacing), math.floor(box.bottom() / spacing) + 1):
            y = step * spacing
            painter.drawLine(lines.map(QLineF(box.left(), y, box.right(), y)))
    painter.restore()
