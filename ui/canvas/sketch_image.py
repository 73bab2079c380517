"""The composited raster of the sketch: paper, reliefs, pictures, paint, adherence, redrawn where stale."""

import numpy as np
import numpy.typing as npt
from PyQt6.QtCore import QObject, QPoint, QPointF, QRect, QRectF, QSizeF, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QImage, QPainter, QPen, QRegion, QTransform

from sketchterrain.document.label_layers import Box
from sketchterrain.ui.canvas.compositing import Colours, HatchTable, LayerCompositor, level_for, paints_of
from sketchterrain.ui.canvas.drapes import DrapePictures
from sketchterrain.ui.canvas.tool_context import CanvasImage, ToolContext, Viewport
from sketchterrain.ui.canvas.underlay import RasterUnderlay
from sketchterrain.ui.engine.protocol import Agreement, Relief
from sketchterrain.ui.look.theme import active_theme, theme

PAPER = QColor(247, 245, 240)  # the unpainted sketch
AGREEMENT = {
    "as painted": QColor(0, 158, 115),
    "missing": QColor(230, 130, 0),
    "spill": QColor(204, 70, 150),
}
"""Okabe and Ito's colours of painted and present, only painted, only present pixels."""

FAULT_COLOURS = {
    "steeper than real land": QColor(230, 130, 0),
    "closed hollow": QColor(40, 110, 220),
    "channel that rises": QColor(204, 40, 120),
}
"""Colours of walls, hollows and rising channels, in the order of `Agreement.faults`."""

_SHADOW = 10  # logical px of the sketch's drop shadow
_SHADOW_OFFSET = 2  # px down
_BRIGHT_SHADE = 196.0  # from which the paper is not darkened; level terrain is a little below
_DARKEST = (0.44, 0.42, 0.41)  # of the paper's red, green and blue, in the deepest shade
_SEA = (198.0, 220.0, 232.0), (120.0, 164.0, 198.0)  # at the shore, and where it is deepest
_DEEP = 20.0  # m at which it is halfway between them
_TINT = 0.62  # opacity of the adherence colours
_BAND = 64  # screen rows composed at a time, so that their pixels stay in the CPU's cache
_SHARP = 4.0  # px of the screen per pixel, from which pixels have sharp edges


def _draw_surround(painter: QPainter, area: QRect, sketch: QRect, ratio: float) -> None:
    """Draw background, drop shadow and border outside the sketch's rectangle."""
    dark = theme().name == "dark"
    shadow, opacity = QColor(0, 0, 0), (200 if dark else 90) / 255
    painter.save()
    painter.setClipRegion(QRegion(area) - QRegion(sketch))
    painter.fillRect(area, theme().canvas)
    size, offset = round(_SHADOW * ratio), round(_SHADOW_OFFSET * ratio)
    if sketch.adjusted(-size, -size, size, size + offset).intersects(area):
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for step in range(size + offset):
            shadow.setAlphaF(opacity * (1.0 - step / (size + offset)) ** 2)
            away = step - offset + 0.5
            painter.setPen(QPen(shadow, 1.0))
            grown = QRectF(sketch.translated(0, offset)).adjusted(-away, -away, away, away)
            painter.drawRoundedRect(grown, max(away, 0.0), max(away, 0.0))
        line = max(round(ratio), 1)
        border = QColor(0, 0, 0) if dark else QColor(150, 150, 147)
        painter.fillRect(sketch.adjusted(-line, -line, line, line), border)
    painter.restore()


def relief_image(relief: Relief) -> QImage:
    """Return the relief as shaded paper, with the sea by its depth."""
    share = np.minimum(np.arange(256, dtype=np.float32) / _BRIGHT_SHADE, 1.0)[:, None]
    factors = np.array(_DARKEST, np.float32) * (1.0 - share) + share
    pixels = _packed(np.array([PAPER.red(), PAPER.green(), PAPER.blue()], np.float32) * factors)[relief.shade]
    if relief.sea_level is not None:
        depth = relief.sea_level - relief.height
        deep = (1.0 - 2.0 ** (-depth[depth > 0.0] / _DEEP))[:, None]
        pixels[depth > 0.0] = _packed(np.array(_SEA[0]) * (1.0 - deep) + np.array(_SEA[1]) * deep)
    return _view_image(pixels, QImage.Format.Format_RGB32).copy()


def _packed(colours: npt.NDArray[np.floating]) -> npt.NDArray[np.uint32]:
    """Return colours (n, 3), 0 … 255, as opaque pixels (n,)."""
    red, green, blue = np.rint(colours).astype(np.uint32).T
    return np.asarray(np.uint32(0xFF000000) | red << 16 | green << 8 | blue)


def tint_image(adherence: Agreement, name: str) -> QImage | None:
    """Return a layer's agreement with the terrain, or the faults of ``realism``, in transparent colours.

    None if it was not measured.
    """
    codes, colours = adherence.faults, [*FAULT_COLOURS.values()]  # of codes from 1 on; 0 is nothing
    if name != "realism":
        images = adherence.images.get(name)
        codes = None if images is None else images[0] + np.uint8(2) * images[1]
        colours = [AGREEMENT[each] for each in ("missing", "spill", "as painted")]
    if codes is None:
        return None
    table = np.zeros(len(colours) + 1, np.uint32)
    for at, colour in enumerate(colours, start=1):
        red, green, blue = (round(part * _TINT) for part in (colour.red(), colour.green(), colour.blue()))
        table[at] = round(255 * _TINT) << 24 | red << 16 | green << 8 | blue
    return _view_image(table[codes]).copy()


def _view_image(pixels: Colours, form: QImage.Format = QImage.Format.Format_ARGB32_Premultiplied) -> QImage:
    """Return an image that refers to an array's memory, which must outlive it."""
    height, width = pixels.shape
    image: QImage = QImage(pixels.data, width, height, 4 * width, form)  # type: ignore[call-overload] # a buffer
    return image


def _source_indices(first: int, count: int, scale: float, side: int) -> npt.NDArray[np.intp]:
    """Return the sketch pixel that each screen pixel shows, counted from the sketch's corner."""
    places = np.floor((np.arange(first, first + count) + 0.5) / scale)
    return np.asarray(np.clip(places, 0, side - 1), np.intp)


def _gather(pixels: Colours, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> Colours:
    gathered: Colours = pixels.take(rows, axis=0).take(columns, axis=1)
    return gathered


class SketchView(QObject):
    """Composes the sketch into an image of the screen (device px) where it is stale, and draws it."""

    stale = pyqtSignal(object)  # QRect of the screen (device px) that changed

    def __init__(self, context: ToolContext, parent: QObject) -> None:
        super().__init__(parent)
        self._context = context
        self._ratio = context.ratio  # device pixels a logical one
        paints = paints_of(context.workspace)
        self._hatches = HatchTable(paints, context.ratio)
        self._compositor = LayerCompositor(context.document.layer, paints)
        self._relief: Relief | None = None
        self._relief_image: QImage | None = None
        self._relief_step = 1
        self.underlay = RasterUnderlay(context.document, self)
        self.drapes = DrapePictures(context, self)
        self._tint: tuple[Agreement | None, str] = (None, "")
        self._tint_image: QImage | None = None
        self._image = CanvasImage(context, self._compose, Qt.GlobalColor.white)

        context.document.opened.connect(self._on_opened)
        context.document.painted.connect(self._on_painted)
        context.workspace.look_changed.connect(self.refresh)
        context.workspace.overlays_changed.connect(self.refresh_overlays)
        self.underlay.changed.connect(self.refresh)
        self.drapes.changed.connect(self._on_drapes)
        context.workspace.label_changed.connect(self.refresh_overlays)
        context.link.adherence_changed.connect(self.refresh_overlays)
        context.link.relief_changed.connect(self._on_relief)
        active_theme.changed.connect(self.refresh)

    def refresh(self, *_: object) -> None:
        """Compose everything again: another document, layer look or theme."""
        context, paints = self._context, paints_of(self._context.workspace)
        self._compositor = LayerCompositor(context.document.layer, paints)
        self._hatches = HatchTable(paints, context.ratio)
        self._ratio = context.ratio
        self._image.invalidate()
        self.refresh_overlays()

    def refresh_overlays(self, *_: object) -> None:
        context, overlays = self._context, self._context.workspace.overlays
        relief = context.link.relief if "relief" in overlays else None
        if (relief is None) != (self._relief_image is None):
            self._relief = self._relief_image = None
            self._update_relief()
            self._image.invalidate()
        if self.underlay.pictures or self.underlay.hillshade:
            self._image.invalidate()
        measured = context.link.adherence if {"adherence", "realism"} & overlays else None
        name = "realism" if "realism" in overlays else "" if measured is None else context.workspace.layer
        if measured is not self._tint[0] or name != self._tint[1]:
            self._tint = measured, name
            self._tint_image = None if measured is None else tint_image(measured, name)
            self._image.invalidate()
        self.stale.emit(QRect(0, 0, context.viewport.width, context.viewport.height))

    def _on_drapes(self, are_beneath: bool) -> None:
        if are_beneath:
            self._image.invalidate()
        self.stale.emit(QRect(0, 0, self._context.viewport.width, self._context.viewport.height))

    def _on_relief(self) -> None:
        area = self._update_relief()
        if not area.isEmpty():
            self.stale.emit(area)

    def _update_relief(self) -> QRect:
        """Apply the newest relief; return the area of the screen (device px) that changed."""
        relief, sketch = self._context.link.relief, self._context.document.sketch
        if relief is None or "relief" not in self._context.workspace.overlays:
            return QRect()
        rows, columns = relief.shade.shape
        if (rows, columns) != (-(-sketch.height_px // relief.step), -(-sketch.width_px // relief.step)):
            return QRect()  # of the previous document
        before, self._relief = self._relief, relief
        self._relief_image, self._relief_step = relief_image(relief), relief.step
        box = (0, 0, rows, columns)
        if (
            before is not None
            and before.shade.shape == relief.shade.shape
            and (before.sea_level == relief.sea_level)
        ):
            changed = before.shade != relief.shade
            if relief.sea_level is not None:
                changed |= before.height != relief.height
            down, across = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
            if not len(down):
                return QRect()
            box = (int(down[0]), int(across[0]), int(down[-1]) + 1, int(across[-1]) + 1)
        top, left, bottom, right = (side * relief.step for side in box)
        margin = 2 * relief.step
        area = self._area_of((top - margin, left - margin, bottom + margin, right + margin))
        self._image.invalidate(area)
        return area

    def _on_opened(self) -> None:
        self._relief = self._relief_image = None
        self._image.invalidate()

    def _on_painted(self, layer: str, box: Box) -> None:
        if any(paint.layer == layer for paint in self._compositor.paints):
            self._compositor.invalidate(box)
            area = self._area_of(box)
            self._image.invalidate(area)
            self.stale.emit(area)

    def draw(self, painter: QPainter, area: QRect) -> None:
        """Draw an area (logical px) of the canvas."""
        ratio = self._context.ratio
        if self._ratio != ratio:
            self.refresh()
        self.drapes.update()
        source = QRectF(area.x() * ratio, area.y() * ratio, area.width() * ratio, area.height() * ratio)
        painter.drawPixmap(QRectF(area), self._image.updated(), source)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        corner, scale = self._context.screen_from_sketch(0.0, 0.0), self._context.scale
        for image, place in self.drapes.above:
            width, height = scale * self._context.viewport.columns, scale * self._context.viewport.rows
            to_screen = QTransform(width, 0, 0, height, corner.x(), corner.y())
            painter.drawImage(to_screen.mapRect(place), image)

    def _area_of(self, box: Box) -> QRect:
        """Return the area of the screen that a box of the sketch affects."""
        viewport = self._image.viewport
        if viewport is None:
            return QRect()
        step = 1 << level_for(viewport.scale)
        top, left = box[0] // step * step, box[1] // step * step
        bottom, right = -(-box[2] // step) * step, -(-box[3] // step) * step
        margin = 2 + self._hatches.halo + int(viewport.scale * step)
        x0, y0 = viewport.to_screen(left, top)
        x1, y1 = viewport.to_screen(right, bottom)
        corner = QPoint(int(np.floor(x0)) - margin, int(np.floor(y0)) - margin)
        return QRect(corner, QPoint(int(np.ceil(x1)) + margin, int(np.ceil(y1)) + margin))

    def _compose(self, painter: QPainter, area: QRect) -> None:
        viewport = self._context.viewport
        painter.save()
        painter.setClipRect(area)
        sketch = QRect(viewport.left, viewport.top, *viewport.sketch_size)
        _draw_surround(painter, area, sketch, self._ratio)
        inner = sketch.intersected(area)
        if not inner.isEmpty():
            painter.setClipRect(inner)
            painter.fillRect(inner, PAPER)
            corner, scale = QPointF(viewport.left, viewport.top), viewport.scale
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            if self._relief_image is not None:
                side = scale * self._relief_step
                samples = QSizeF(self._relief_image.width() * side, self._relief_image.height() * side)
                painter.drawImage(QRectF(corner, samples), self._relief_image)
            width, height = viewport.columns * scale, viewport.rows * scale
            to_screen = QTransform(width, 0, 0, height, corner.x(), corner.y())
            pictures = self.underlay.visible(self._context.workspace.overlays)
            for image, place in (*pictures, *self.drapes.beneath):
                painter.drawImage(to_screen.mapRect(place), image)
            if self._compositor.paints:
                for top in range(inner.top(), inner.bottom() + 1, _BAND):
                    height = min(_BAND, inner.bottom() + 1 - top)
                    self._paint(painter, viewport, QRect(inner.left(), top, inner.width(), height))
            painter.setClipRect(inner)
            if self._tint_image is not None:
                painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, scale < _SHARP)
                size = QSizeF(viewport.columns * scale, viewport.rows * scale)
                painter.drawImage(QRectF(corner, size), self._tint_image)
        painter.restore()

    def _paint(self, painter: QPainter, viewport: Viewport, area: QRect) -> None:
        """Draw colours and hatches in a band of the screen."""
        level, halo = level_for(viewport.scale), self._hatches.halo
        scale = viewport.scale * (1 << level)
        x, y = area.left() - viewport.left, area.top() - viewport.top
        sides = (-(-viewport.columns >> level), -(-viewport.rows >> level))
        across = _source_indices(x - halo, area.width() + 2 * halo, scale, sides[0])
        down = _source_indices(y - halo, area.height() + 2 * halo, scale, sides[1])
        margin = 2 if scale < _SHARP else 0
        left, right = max(across[0] - margin, 0), min(across[-1] + 1 + margin, sides[0])
        top, bottom = max(down[0] - margin, 0), min(down[-1] + 1 + margin, sides[1])
        colours, codes = self._compositor.read(level, (int(top), int(left), int(bottom), int(right)))
        if not codes.any():
            return
        across, down = across - left, down - top
        painter.setClipRect(area)
        if scale < _SHARP:
            size = QSizeF((right - left) * scale, (bottom - top) * scale)
            corner = QPointF(viewport.left + left * scale, viewport.top + top * scale)
            painter.drawImage(QRectF(corner, size), _view_image(colours))
        else:
            inner = np.s_[halo:-halo]
            painter.drawImage(area.topLeft(), _view_image(_gather(colours, down[inner], across[inner])))
        painter.drawImage(
            area.topLeft(), _view_image(self._hatches.render(_gather(codes, down, across), x, y))
        )
