"""The picture of the sketch: paper, relief and paint, kept from paint event to paint event."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from PyQt6.QtCore import QPoint, QRect, QRectF, QSizeF
from PyQt6.QtGui import QImage, QPainter

from sketchterrain.ui.canvas.flattening import level_for
from sketchterrain.ui.canvas.scrolling import scrolled
from sketchterrain.ui.canvas.surround import draw_surround
from sketchterrain.ui.canvas.underlays import PAPER

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.sketch.box import Box
    from sketchterrain.ui.canvas.flattening import Colours, Flattening
    from sketchterrain.ui.canvas.hatch_table import HatchTable
    from sketchterrain.ui.canvas.surround import Surround
    from sketchterrain.ui.canvas.viewport import Viewport

_Pixel = TypeVar("_Pixel", np.uint16, np.uint32)

__all__ = ["Sheet"]

_MOST_AREAS = 12  # composed one by one
_BAND = 64  # rows of the screen at a time: their pixels stay in the processor's memory
_SHARP = 4.0  # px of the screen a pixel, from which pixels have sharp borders


class Sheet:
    """Composes the sketch into an image of the screen, where it is stale.

    Parameters
    ----------
    flattening : Flattening
    hatches : HatchTable
    surround : Surround
        Colours around the sheet.

    Attributes
    ----------
    relief : QImage or None
        Lies on the paper.
    relief_step : int
        px of the sketch along one of the relief's.
    tint : QImage or None
        Of the sketch's pixels, lies over the paint.
    """

    def __init__(self, flattening: Flattening, hatches: HatchTable, surround: Surround) -> None:
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
