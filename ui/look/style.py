"""Fusion with marks of our own: boxes that are ticked, arrows of boxes that unfold."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtCore import QPointF, QRectF, QSize, Qt
from PyQt6.QtGui import QColor, QPainter, QPainterPath, QPen
from PyQt6.QtWidgets import (
    QAbstractSpinBox,
    QProxyStyle,
    QStyle,
    QStyleOption,
    QStyleOptionComboBox,
    QStyleOptionComplex,
    QStyleOptionSpinBox,
    QWidget,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.ui.look.theme import Theme

__all__ = ["Marks"]

_BOX = 15  # px
_SIGN = 12.0
_AROUND = 9  # px above and below a text together

_Drawing = tuple[tuple[float, float], ...]


class Marks(QProxyStyle):
    """Draws what a style sheet cannot without picture files.

    Parameters
    ----------
    theme
        Returns the colours of now.
    """

    def __init__(self, theme: Callable[[], Theme]) -> None:
        super().__init__("Fusion")
        self._theme = theme

    def pixelMetric(
        self, metric: QStyle.PixelMetric, option: QStyleOption | None = None, widget: QWidget | None = None
    ) -> int:
        """Give ticked boxes their size."""
        wanted = QStyle.PixelMetric
        if metric in (
            wanted.PM_IndicatorWidth,
            wanted.PM_IndicatorHeight,
            wanted.PM_ExclusiveIndicatorWidth,
            wanted.PM_ExclusiveIndicatorHeight,
        ):
            return _BOX
        return super().pixelMetric(metric, option, widget)

    def sizeFromContents(
        self,
        kind: QStyle.ContentsType,
        option: QStyleOption | None,
        size: QSize,
        widget: QWidget | None = None,
    ) -> QSize:
        """Make boxes as high as lines of text."""
        wanted = super().sizeFromContents(kind, option, size, widget)
        if option is not None and kind in (QStyle.ContentsType.CT_ComboBox, QStyle.ContentsType.CT_SpinBox):
            wanted.setHeight(max(wanted.height(), option.fontMetrics.height() + _AROUND))
        return wanted

    def drawPrimitive(
        self,
        element: QStyle.PrimitiveElement,
        option: QStyleOption | None,
        painter: QPainter | None,
        widget: QWidget | None = None,
    ) -> None:
        """Draw marks in our own way, all else as Fusion does."""
        kinds = QStyle.PrimitiveElement
        if option is None or painter is None:
            return
        if element in (kinds.PE_IndicatorCheckBox, kinds.PE_IndicatorRadioButton):
            self._draw_box(option, painter, is_round=element == kinds.PE_IndicatorRadioButton)
        elif element in _ARROWS:
            enabled = bool(option.state & QStyle.StateFlag.State_Enabled)
            self._draw_sign(QRectF(option.rect), painter, _ARROWS[element], enabled=enabled)
        else:
            super().drawPrimitive(element, option, painter, widget)

    def drawComplexControl(
        self,
        control: QStyle.ComplexControl,
        option: QStyleOptionComplex | None,
        painter: QPainter | None,
        widget: QWidget | None = None,
    ) -> None:
        """Draw boxes that unfold and boxes of numbers like lines of text, all else as Fusion does."""
        if option is None or painter is None:
            return
        if isinstance(option, QStyleOptionComboBox):
            self._draw_field(option, painter)
            arrow = QStyle.SubControl.SC_ComboBoxArrow
            self._draw_part(control, option, arrow, painter, widget, _DOWN)
        elif isinstance(option, QStyleOptionSpinBox):
            self._draw_field(option, painter)
            if option.buttonSymbols != QAbstractSpinBox.ButtonSymbols.NoButtons:
                up, down = QStyle.SubControl.SC_SpinBoxUp, QStyle.SubControl.SC_SpinBoxDown
                self._draw_part(control, option, up, painter, widget, _UP)
                self._draw_part(control, option, down, painter, widget, _DOWN)
        else:
            super().drawComplexControl(control, option, painter, widget)

    def _draw_field(self, option: QStyleOption, painter: QPainter) -> None:
        colours, states = self._theme(), QStyle.StateFlag
        enabled = bool(option.state & states.State_Enabled)
        focus = enabled and bool(option.state & states.State_HasFocus)
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(QPen(colours.accent if focus else colours.line, 1.0))
        painter.setBrush(colours.base if enabled else colours.window)
        painter.drawRoundedRect(QRectF(option.rect).adjusted(0.5, 0.5, -0.5, -0.5), 4, 4)
        painter.restore()

    def _draw_part(
        self,
        control: QStyle.ComplexControl,
        option: QStyleOptionComplex,
        part: QStyle.SubControl,
        painter: QPainter,
        widget: QWidget | None,
        drawing: _Drawing,
    ) -> None:
        place = self.subControlRect(control, option, part, widget)
        enabled = bool(option.state & QStyle.StateFlag.State_Enabled)
        self._draw_sign(QRectF(place), painter, drawing, enabled=enabled)

    def _draw_box(self, option: QStyleOption, painter: QPainter, *, is_round: bool) -> None:
        colours, states = self._theme(), QStyle.StateFlag
        enabled = bool(option.state & states.State_Enabled)
        on = bool(option.state & states.State_On)
        partly = bool(option.state & states.State_NoChange)
        focus = bool(option.state & states.State_HasFocus)
        box = QRectF(option.rect).adjusted(0.5, 0.5, -0.5, -0.5)
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        filled = enabled and (on or partly)
        border = colours.accent if filled or focus else colours.faint
        painter.setPen(QPen(border if enabled else colours.line, 1.0))
        painter.setBrush(colours.accent if filled else colours.base)
        corner = box.width() / 2 if is_round else 3.5
        painter.drawRoundedRect(box, corner, corner)
        ink = colours.on_accent if enabled else colours.faint
        if on and is_round:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(ink)
            painter.drawEllipse(box.center(), box.width() / 5, box.width() / 5)
        elif on or partly:
            _stroke(painter, box, _TICK if on else _DASH, ink)
        painter.restore()

    def _draw_sign(self, around: QRectF, painter: QPainter, drawing: _Drawing, *, enabled: bool) -> None:
        side = min(around.width(), around.height(), _SIGN)
        place = QRectF(0, 0, side, side)
        place.moveCenter(around.center())
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        _stroke(painter, place, drawing, self._theme().faint if enabled else self._theme().line)
        painter.restore()


_TICK = ((0.24, 0.52), (0.43, 0.71), (0.77, 0.30))
_DASH = ((0.26, 0.5), (0.74, 0.5))
_UP, _DOWN = ((0.2, 0.64), (0.5, 0.34), (0.8, 0.64)), ((0.2, 0.36), (0.5, 0.66), (0.8, 0.36))
_ARROWS: dict[QStyle.PrimitiveElement, _Drawing] = {
    QStyle.PrimitiveElement.PE_IndicatorArrowDown: _DOWN,
    QStyle.PrimitiveElement.PE_IndicatorArrowUp: _UP,
    QStyle.PrimitiveElement.PE_IndicatorArrowRight: ((0.36, 0.2), (0.66, 0.5), (0.36, 0.8)),
    QStyle.PrimitiveElement.PE_IndicatorArrowLeft: ((0.64, 0.2), (0.34, 0.5), (0.64, 0.8)),
}


def _stroke(painter: QPainter, place: QRectF, drawing: _Drawing, colour: QColor) -> None:
    points = [QPointF(place.x() + x * place.width(), place.y() + y * place.height()) for x, y in drawing]
    path = QPainterPath(points[0])
    for point in points[1:]:
        path.lineTo(point)
    pen = QPen(colour, 1.7, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin)
    painter.strokePath(path, pen)
