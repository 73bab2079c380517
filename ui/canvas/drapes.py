"""Pictures of draped layers for the canvas, drawn in the background."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Final, NamedTuple, cast

import numpy as np
from PyQt6.QtCore import QLineF, QObject, QPointF, QRectF, Qt, pyqtSignal
from PyQt6.QtGui import QBrush, QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF

from sketchterrain.array_types import Float64Array
from sketchterrain.ui.canvas.underlay import Pictures
from sketchterrain.ui.models.background import BackgroundReader

if TYPE_CHECKING:
    from sketchterrain.document.parameters import Properties
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.drape.items import Items
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


class PictureWindow(NamedTuple):
    """What a picture shows: its north-west corner, pixels, and their side (m)."""

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

    They are drawn anew, on a thread if that takes long, while the last ones are shown in their place.
    """

    changed = pyqtSignal()

    def __init__(self, context: ToolContext, parent: QObject) -> None:
        super().__init__(parent)
        self._context = context
        self.beneath: Pictures = ()  # at most one
        self.above: Pictures = ()  # at most one
        self._key: tuple[object, ...] = ()
        self._base: tuple[object, Drapes] | None = None  # without the feature that is held
        self._seconds = 0.0
        self._reader = BackgroundReader(self)
        context.document.drapes.changed.connect(self.update)

    @property
    def is_busy(self) -> bool:
        return self._reader.is_busy

    def update(self) -> None:
        """Draw what has changed: the layers or the viewport."""
        drapes, window = self._drapes(), self._window()
        key = drapes, window
        if key == self._key or self.is_busy:
            return
        self._key = key
        if drapes is None or drapes.is_empty:
            self._show(window, ((None, None), 0.0))
        elif self._seconds < _SHORT and (self.beneath or self.above):
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

    def _show(self, window: PictureWindow, found: object) -> None:
        images, self._seconds = cast("tuple[tuple[QImage | None, QImage | None], float]", found)
        (east, north), (west, south, right, top) = self._context.document.sketch.size, window.box
        place = QRectF(west / east, 1.0 - top / north, (right - west) / east, (top - south) / north)
        before = self.beneath, self.above
        self.beneath, self.above = (() if image is None else ((image, place),) for image in images)
        if before != (self.beneath, self.above):
            self.changed.emit()
        self.update()  # what has changed meanwhile


def _draw(drapes: Drapes, window: PictureWindow) -> tuple[tuple[QImage | None, QImage | None], float]:
    """Return the pictures of the layers beneath and above the paint, and the time that they took (s)."""
    started = time.perf_counter()
    rasters, items = dict(drapes.rasters(window.texel)), drapes.items(window.box, window.texel)
    highest = max(rasters, default=-1)
    images: list[QImage | None] = []
    for low, high in ((-1, highest), (highest, len(drapes.layers))):
        vectors = items.taken((items.layer > low) & (items.layer <= high))
        if not (len(vectors.kind) or any(low < number <= high for number in rasters)):
            images.append(None)
            continue
        image = QImage(window.columns, window.rows, QImage.Format.Format_ARGB32_Premultiplied)
        image.fill(Qt.GlobalColor.transparent)
        painter = QPainter(image)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for number in range(low + 1, high + 1):
            if number in rasters:
                pixels = rasters[number].pixels(window.west, window.north, *window[2:])
                layer = drapes.layers[number]
                _use(painter, layer["opacity"], layer["blend"])
                shape = window.columns, window.rows, 4 * window.columns
                painter.drawImage(0, 0, QImage(pixels.tobytes(), *shape, QImage.Format.Format_RGBA8888))
            draw_items(painter, drapes, vectors.taken(vectors.layer == number), window)
        painter.end()
        images.append(image)
    return (images[0], images[1]), time.perf_counter() - started


def _use(painter: QPainter, opacity: float, blend: str) -> None:
    painter.setOpacity(opacity)
    painter.setCompositionMode(_MODES[blend])


def draw_items(painter: QPainter, drapes: Drapes, items: Items, window: PictureWindow) -> None:
    """Draw vectors: runs of one style and kind together."""
    from sketchterrain.drape.items import FILL, POINT

    points, first = window.pixels(items.points), items.first.tolist()
    columns = zip(items.style.tolist(), items.kind.tolist(), items.feature.tolist(), strict=True)
    for (style, kind), run in groupby(enumerate(columns), key=lambda pair: pair[1][:2]):
        numbers = [(number, feature) for number, (_, _, feature) in run]
        own = drapes.styles[style]
        _use(painter, own.opacity, own.blend)
        values = own.style
        unit = 1.0 if values["unit"] == "px" else 1.0 / window.texel
        lines = ((number, points[first[number] : first[number + 1]]) for number, _ in numbers)
        if kind == POINT:
            pen = QPen(QColor(values["colour"]), max(values["width"] * unit, 1.0))
            pen.setCapStyle(Qt.PenCapStyle.RoundCap)
            painter.setPen(pen)
            painter.drawPoints(polygon(np.concatenate([line for _, line in lines])))
        elif kind == FILL:
            for _, parts in groupby(numbers, key=lambda pair: pair[1]):
                path = QPainterPath()
                path.setFillRule(Qt.FillRule.WindingFill)
                for number, _ in parts:
                    path.addPolygon(polygon(points[first[number] : first[number + 1]]))
                _fill(painter, path, values, unit)
        else:
            _stroke(painter, items, lines, values, window.texel)


def polygon(points: Float64Array) -> QPolygonF:
    """Return points (n, 2) as Qt's."""
    return QPolygonF(list(map(QPointF, *points.T.tolist())))


def _stroke(
    painter: QPainter,
    items: Items,
    lines: Iterator[tuple[int, Float64Array]],
    values: Properties,
    texel: float,
) -> None:
    from sketchterrain.drape.items import AFTER, BEFORE

    unit = 1.0 if values["unit"] == "px" else 1.0 / texel
    width = max(values["width"] * unit, 1.0)
    pen = QPen(QColor(values["colour"]), width, cap=_CAPS[values["cap"]], join=_JOINS[values["join"]])
    dashes = [float(each) * unit / width for each in values["dash"].split()]
    if dashes:
        pen.setDashPattern(dashes * (1 + len(dashes) % 2))
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.setPen(pen)
    path, count = QPainterPath(), 0
    for number, line in lines:
        bits = int(items.ends[number])
        line = line[bool(bits & BEFORE) : len(line) - bool(bits & AFTER)]
        path.addPolygon(polygon(line))
        count += 1
        if dashes:
            pen.setDashOffset(float(items.along[number]) / (texel * width))
            painter.setPen(pen)
        if dashes or count == _MANY:
            painter.drawPath(path)
            path, count = QPainterPath(), 0
    painter.drawPath(path)


def _fill(painter: QPainter, path: QPainterPath, values: Properties, unit: float) -> None:
    colour = QColor(values["fill"])
    colour.setAlphaF(values["fill_opacity"])
    if values["hatch"] == "none":
        painter.fillPath(path, QBrush(colour))
        return
    painter.save()
    painter.setClipPath(path)
    painter.setPen(QPen(colour, max(0.2 * values["hatch_spacing"] * unit, 1.0)))
    box, spacing = path.boundingRect(), max(values["hatch_spacing"] * unit, 2.0)
    reach = 0.5 * math.hypot(box.width(), box.height())
    for turn in (0.0, 90.0)[: 2 if values["hatch"] == "cross" else 1]:
        angle = math.radians(values["hatch_angle"] + turn)
        along, across = QPointF(math.cos(angle), -math.sin(angle)), QPointF(math.sin(angle), math.cos(angle))
        middle = QPointF.dotProduct(box.center(), across)
        start = math.ceil((middle - reach) / spacing)
        at = box.center() - across * middle
        for step in range(start, math.floor((middle + reach) / spacing) + 1):
            foot = at + across * (step * spacing)
            painter.drawLine(QLineF(foot - along * reach, foot + along * reach))
    painter.restore()
