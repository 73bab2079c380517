"""The composited raster of the sketch: paper, relief, paint and adherence, updated where it is stale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar, cast

import numpy as np
import numpy.typing as npt
from PyQt6.QtCore import QObject, QPoint, QRect, QRectF, QSizeF, pyqtSignal
from PyQt6.QtGui import QColor, QImage, QPainter, QPen, QRegion

from sketchterrain.document.label_layers import Box
from sketchterrain.ui.canvas.layer_brushes import (
    Colours,
    HatchTable,
    LayerCompositor,
    hatches_of,
    level_for,
    paints_of,
)
from sketchterrain.ui.canvas.tool_context import ToolContext, Viewport
from sketchterrain.ui.engine.protocol import Adherence, Relief
from sketchterrain.ui.look.theme import looks, theme


def scrolled(image: QImage, right: int, down: int) -> list[QRect]:
    """Move the pixels of an image; return the areas that are left to draw."""
    width, height = image.width(), image.height()
    if abs(right) >= width or abs(down) >= height:
        return [image.rect()]
    moved = image.copy(max(-right, 0), max(-down, 0), width - abs(right), height - abs(down))
    painter = QPainter(image)
    painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Source)
    painter.drawImage(max(right, 0), max(down, 0), moved)
    painter.end()
    bared = []
    if right:
        bared.append(QRect(0 if right > 0 else width + right, 0, abs(right), height))
    if down:
        bared.append(QRect(0, 0 if down > 0 else height + down, width, abs(down)))
    return bared


_REACH = 10  # px of the shadow
_DROP = 2  # px that it lies lower


@dataclass(frozen=True)
class Surround:
    """Colours around the sheet, and device pixels a logical one."""

    ground: QColor
    shadow: QColor
    border: QColor
    ratio: float


def surround(ratio: float) -> Surround:
    """Return what goes with the theme that is shown."""
    dark = theme().name == "dark"
    shadow = QColor(0, 0, 0, 200 if dark else 90)
    border = QColor(0, 0, 0) if dark else QColor(150, 150, 147)
    return Surround(theme().canvas, shadow, border, ratio)


def draw_surround(painter: QPainter, area: QRect, sheet: QRect, colours: Surround) -> None:
    """Draw the ground and, around the sheet, its shadow and border; what lies on the sheet is undefined."""
    painter.save()
    painter.setClipRegion(QRegion(area) - QRegion(sheet))
    painter.fillRect(area, colours.ground)
    reach, drop = round(_REACH * colours.ratio), round(_DROP * colours.ratio)
    if sheet.adjusted(-reach, -reach, reach, reach + drop).intersects(area):
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        shadow = QColor(colours.shadow)
        for step in range(reach + drop):
            shadow.setAlphaF(colours.shadow.alphaF() * (1.0 - step / (reach + drop)) ** 2)
            away = step - drop + 0.5
            painter.setPen(QPen(shadow, 1.0))
            grown = QRectF(sheet.translated(0, drop)).adjusted(-away, -away, away, away)
            painter.drawRoundedRect(grown, max(away, 0.0), max(away, 0.0))
        line = max(round(colours.ratio), 1)
        painter.fillRect(sheet.adjusted(-line, -line, line, line), colours.border)
    painter.restore()


PAPER = QColor(247, 245, 240)
"""What nothing is painted on."""

AGREEMENT = {
    "as painted": QColor(0, 158, 115),
    "missing": QColor(230, 130, 0),
    "spill": QColor(204, 70, 150),
}
"""Okabe and Ito's colours for what is painted and shown, only painted, only shown."""

_LEVEL = 196.0  # shade from which the paper is bare; level ground has a little less
_DARKEST = (0.44, 0.42, 0.41)  # of the paper's red, green and blue, in the deepest shade
_TINT = 0.62  # opacity of the colours of agreement


def relief_image(relief: Relief) -> QImage:
    """Return the relief as light and shade on paper."""
    share = np.minimum(np.arange(256, dtype=np.float32) / _LEVEL, 1.0)[:, None]
    paper = np.array([PAPER.red(), PAPER.green(), PAPER.blue()], np.float32)
    colours = paper * (np.array(_DARKEST, np.float32) * (1.0 - share) + share)
    red, green, blue = np.rint(colours).astype(np.uint32).T
    table: npt.NDArray[np.uint32] = np.uint32(0xFF000000) | red << 16 | green << 8 | blue
    return _owned(table[relief.shade], QImage.Format.Format_RGB32)


def adherence_image(adherence: Adherence, layer: str) -> QImage | None:
    """Return where a layer is as painted, missing or spilt; None if that was not measured."""
    if layer not in adherence.images:
        return None
    painted, shown = adherence.images[layer]
    table = np.zeros(4, np.uint32)
    for at, name in ((3, "as painted"), (1, "missing"), (2, "spill")):
        colour = AGREEMENT[name]
        red, green, blue = (round(part * _TINT) for part in (colour.red(), colour.green(), colour.blue()))
        table[at] = round(255 * _TINT) << 24 | red << 16 | green << 8 | blue
    pixels = table[painted.astype(np.uint8) | shown.astype(np.uint8) << 1]
    return _owned(pixels, QImage.Format.Format_ARGB32_Premultiplied)


def _owned(pixels: npt.NDArray[np.uint32], form: QImage.Format) -> QImage:
    height, width = pixels.shape
    return QImage(np.ascontiguousarray(pixels).tobytes(), width, height, 4 * width, form).copy()


_Pixel = TypeVar("_Pixel", np.uint16, np.uint32)


_MOST_AREAS = 12  # composed one by one
_BAND = 64  # rows of the screen at a time: their pixels stay in the processor's memory
_SHARP = 4.0  # px of the screen a pixel, from which pixels have sharp borders


class SketchImage:
    """Composes the sketch into an image of the screen, where it is stale."""

    def __init__(self, flattening: LayerCompositor, hatches: HatchTable, surround: Surround) -> None:
        self.flattening = flattening
        self.hatches = hatches
        self.surround = surround
        self.relief: QImage | None = None
        self.relief_step = 1
        self.tint: QImage | None = None
        self._viewport: Viewport | None = None
        self._image = QImage()
        self._stale: list[QRect] = []

    def look(self, viewport: Viewport) -> None:
        """Show the sketch through another viewport; what was only moved is kept."""
        before, self._viewport = self._viewport, viewport
        size = (viewport.width, viewport.height)
        if size != (self._image.width(), self._image.height()):
            self._image = QImage(*size, QImage.Format.Format_RGB32)
            self.spoil()
        elif before == viewport:
            return
        elif before is not None and replace(before, left=viewport.left, top=viewport.top) == viewport:
            self._scroll(viewport.left - before.left, viewport.top - before.top)
        else:
            self.spoil()

    def spoil(self, area: QRect | None = None) -> None:
        """Mark an area of the screen as stale; None: all of it."""
        whole = self._image.rect()
        area = whole if area is None else area.intersected(whole)
        if area == whole:
            self._stale.clear()
        if not area.isEmpty():
            self._stale.append(area)

    def spoil_box(self, box: Box) -> QRect:
        """Forget a box of the sketch; return the area of the screen that is stale now."""
        self.flattening.forget(box)
        area = self.area_of(box)
        self.spoil(area)
        return area

    def area_of(self, box: Box) -> QRect:
        """Return the area of the screen in which a box of the sketch shows."""
        if self._viewport is None:
            return QRect()
        step = 1 << level_for(self._viewport.scale)
        top, left, bottom, right = (
            box[0] // step * step,
            box[1] // step * step,
            -(-box[2] // step) * step,
            -(-box[3] // step) * step,
        )
        margin = 2 + self.hatches.halo + int(self._viewport.scale * step)
        x0, y0 = self._viewport.to_screen(left, top)
        x1, y1 = self._viewport.to_screen(right, bottom)
        corner = QPoint(int(np.floor(x0)) - margin, int(np.floor(y0)) - margin)
        return QRect(corner, QPoint(int(np.ceil(x1)) + margin, int(np.ceil(y1)) + margin))

    def image(self) -> QImage:
        """Return the picture, composed anew where it was stale."""
        stale, self._stale = self._stale, []
        if stale:
            painter = QPainter(self._image)
            for area in stale if len(stale) <= _MOST_AREAS else [_around(stale)]:
                self._compose(painter, area)
            painter.end()
        return self._image

    def _scroll(self, right: int, down: int) -> None:
        stale, self._stale = self._stale, []
        for area in [*(each.translated(right, down) for each in stale), *scrolled(self._image, right, down)]:
            self.spoil(area)

    def _compose(self, painter: QPainter, area: QRect) -> None:
        viewport = self._viewport
        assert viewport is not None  # noqa: S101 # there is nothing stale without one
        painter.save()
        painter.setClipRect(area)
        sheet = QRect(viewport.left, viewport.top, *viewport.sheet_size)
        draw_surround(painter, area, sheet, self.surround)
        inner = sheet.intersected(area)
        if not inner.isEmpty():
            painter.setClipRect(inner)
            painter.fillRect(inner, PAPER)
            exact = QRectF(
                viewport.left,
                viewport.top,
                viewport.columns * viewport.scale,
                viewport.rows * viewport.scale,
            )
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            if self.relief is not None:
                side = viewport.scale * self.relief_step
                samples = QSizeF(self.relief.width() * side, self.relief.height() * side)
                painter.drawImage(QRectF(exact.topLeft(), samples), self.relief)
            if self.flattening.paints:
                for top in range(inner.top(), inner.bottom() + 1, _BAND):
                    height = min(_BAND, inner.bottom() + 1 - top)
                    self._paint(painter, viewport, QRect(inner.left(), top, inner.width(), height))
            painter.setClipRect(inner)
            if self.tint is not None:
                painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, viewport.scale < _SHARP)
                painter.drawImage(exact, self.tint)
        painter.restore()

    def _paint(self, painter: QPainter, viewport: Viewport, area: QRect) -> None:
        """Paint a band of the screen with colours and hatches."""
        level, halo = level_for(viewport.scale), self.hatches.halo
        scale = viewport.scale * (1 << level)
        x, y = area.left() - viewport.left, area.top() - viewport.top
        sides = (-(-viewport.columns >> level), -(-viewport.rows >> level))
        across = _places(x - halo, area.width() + 2 * halo, scale, sides[0])
        down = _places(y - halo, area.height() + 2 * halo, scale, sides[1])
        margin = 2 if scale < _SHARP else 0
        left, right = max(across[0] - margin, 0), min(across[-1] + 1 + margin, sides[0])
        top, bottom = max(down[0] - margin, 0), min(down[-1] + 1 + margin, sides[1])
        colours, codes = self.flattening.window(level, (int(top), int(left), int(bottom), int(right)))
        if not codes.any():
            return
        across, down = across - left, down - top
        painter.setClipRect(area)
        if scale < _SHARP:
            target = QRectF(
                viewport.left + left * scale,
                viewport.top + top * scale,
                (right - left) * scale,
                (bottom - top) * scale,
            )
            painter.drawImage(target, _as_image(colours))
        else:
            within = np.s_[halo:-halo]
            painter.drawImage(area.topLeft(), _as_image(_picked(colours, down[within], across[within])))
        painter.drawImage(area.topLeft(), _as_image(self.hatches.drawn(_picked(codes, down, across), x, y)))


def _around(areas: Sequence[QRect]) -> QRect:
    whole = QRect()
    for area in areas:
        whole = whole.united(area)
    return whole


def _places(first: int, count: int, scale: float, side: int) -> npt.NDArray[np.intp]:
    """Return which pixel of the sketch each pixel of the screen shows, from the sheet's corner on."""
    places = np.floor((np.arange(first, first + count) + 0.5) / scale)
    return np.asarray(np.clip(places, 0, side - 1), np.intp)


def _picked(
    pixels: npt.NDArray[_Pixel], rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]
) -> npt.NDArray[_Pixel]:
    picked: npt.NDArray[_Pixel] = pixels.take(rows, axis=0).take(columns, axis=1)
    return picked


def _as_image(pixels: Colours) -> QImage:
    """Return an image that looks at an array, which must outlive it."""
    height, width = pixels.shape
    form = QImage.Format.Format_ARGB32_Premultiplied
    image: QImage = QImage(pixels.data, width, height, 4 * width, form)  # type: ignore[call-overload] # a buffer
    return image


class SketchView(QObject):
    """Keeps the picture of the sketch in step with the models."""

    stale = pyqtSignal(object)
    """A `QRect` of the screen (device px) in which the picture is another one."""

    def __init__(self, context: ToolContext, parent: QObject) -> None:
        super().__init__(parent)
        self._desk = context
        self._relief: Relief | None = None
        self._tint: tuple[Adherence | None, str] = (None, "")
        hatches = HatchTable(hatches_of(context.workspace), context.ratio)
        flattening = LayerCompositor(context.document.layer, paints_of(context.workspace))
        self._sheet = SketchImage(flattening, hatches, surround(context.ratio))

        context.document.opened.connect(self._on_opened)
        context.document.painted.connect(self._on_painted)
        context.workspace.look_changed.connect(self.refresh)
        context.workspace.overlays_changed.connect(self.refresh_pictures)
        context.workspace.label_changed.connect(self.refresh_pictures)
        context.link.adherence_changed.connect(self.refresh_pictures)
        context.link.relief_changed.connect(self._on_relief)
        looks.changed.connect(self.refresh)

    def refresh(self, *_: object) -> None:
        """Compose all anew: another document, other layers are shown, another theme."""
        context = self._desk
        self._sheet.flattening.paints = paints_of(context.workspace)
        self._sheet.hatches = HatchTable(hatches_of(context.workspace), context.ratio)
        self._sheet.surround = surround(context.ratio)
        self._sheet.spoil()
        self.refresh_pictures()

    def refresh_pictures(self, *_: object) -> None:
        """Show the relief and the adherence, or not, as the workspace says."""
        context, shown = self._desk, self._desk.workspace.overlays
        wanted = context.link.relief if "relief" in shown else None
        if (wanted is None) != (self._sheet.relief is None):
            self._relief = None
            self._sheet.relief = None
            self._take_relief()
            self._sheet.spoil()
        measured = context.link.adherence if "adherence" in shown else None
        tint = (measured, context.workspace.layer if measured is not None else "")
        if tint[0] is not self._tint[0] or tint[1] != self._tint[1]:
            self._tint = tint
            self._sheet.tint = None if measured is None else adherence_image(measured, tint[1])
            self._sheet.spoil()
        self._tell_all()

    def _tell_all(self) -> None:
        self.stale.emit(QRect(0, 0, self._desk.viewport.width, self._desk.viewport.height))

    def _on_relief(self) -> None:
        area = self._take_relief()
        if not area.isEmpty():
            self.stale.emit(area)

    def _take_relief(self) -> QRect:
        """Take the newest relief; return the area of the screen (device px) in which it is another one."""
        relief, sketch = self._desk.link.relief, self._desk.document.sketch
        if relief is None or "relief" not in self._desk.workspace.overlays:
            return QRect()
        rows, columns = relief.shade.shape
        if (rows, columns) != (-(-sketch.height_px // relief.step), -(-sketch.width_px // relief.step)):
            return QRect()  # of the document before
        before, self._relief = self._relief, relief
        self._sheet.relief, self._sheet.relief_step = relief_image(relief), relief.step
        box = (0, 0, rows, columns)
        if before is not None and before.shade.shape == relief.shade.shape:
            changed = before.shade != relief.shade
            down, across = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
            if not len(down):
                return QRect()
            box = (int(down[0]), int(across[0]), int(down[-1]) + 1, int(across[-1]) + 1)
        top, left, bottom, right = (side * relief.step for side in box)
        margin = 2 * relief.step
        area = self._sheet.area_of((top - margin, left - margin, bottom + margin, right + margin))
        self._sheet.spoil(area)
        return area

    def _on_opened(self) -> None:
        self._relief = self._sheet.relief = None
        self._sheet.spoil()

    def _on_painted(self, layer: str, box: object) -> None:
        if any(paint.layer == layer for paint in self._sheet.flattening.paints):
            self.stale.emit(self._sheet.spoil_box(cast("Box", box)))

    def draw(self, painter: QPainter, area: QRect) -> None:
        """Draw the sketch into an area (logical px) of the canvas."""
        ratio = self._desk.ratio
        if self._sheet.surround.ratio != ratio:
            self.refresh()
        self._sheet.look(self._desk.viewport)
        source = QRectF(area.x() * ratio, area.y() * ratio, area.width() * ratio, area.height() * ratio)
        painter.drawImage(QRectF(area), self._sheet.image(), source)
