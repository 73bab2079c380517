"""A number as text that is typed, and a slider: neither listens to a wheel that only scrolls past."""

from __future__ import annotations

from PyQt6.QtCore import QLocale, QSize, Qt
from PyQt6.QtGui import QValidator, QWheelEvent
from PyQt6.QtWidgets import QAbstractSpinBox, QDoubleSpinBox, QSlider, QWidget

from sketchterrain.ui.look.theme import tabular
from sketchterrain.ui.panels.wording import number

_WIDTH = 88
WAY = 1000
"""Steps of a slider's way."""


class NumberBox(QDoubleSpinBox):
    """A number with its unit. It speaks when typing has ended; arrow keys add and take steps."""

    def __init__(
        self,
        low: float,
        high: float,
        *,
        suffix: str = "",
        step: float = 0.0,
        decimals: int = 3,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self.setLocale(QLocale.c())
        self.setFont(tabular(self.font()))
        self.setDecimals(decimals)
        self.setRange(low, high)
        self.setSuffix(suffix)
        if step:
            self.setSingleStep(step)
        else:
            self.setStepType(QAbstractSpinBox.StepType.AdaptiveDecimalStepType)
        self.setKeyboardTracking(False)
        self.setButtonSymbols(QAbstractSpinBox.ButtonSymbols.NoButtons)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setFixedWidth(_WIDTH)

    def textFromValue(self, v: float) -> str:
        """Return a number without zeros at its end."""
        return number(v, decimals=self.decimals()).replace("−", "-")

    def validate(self, input: str | None, pos: int) -> tuple[QValidator.State, str, int]:  # noqa: A002 # Qt's name
        """Let a comma stand for a point."""
        return super().validate((input or "").replace(",", "."), pos)

    def wheelEvent(self, e: QWheelEvent | None) -> None:
        """Turn only while it has the keyboard; else the panel scrolls."""
        _turn(self, super().wheelEvent, e)


class PatientSlider(QSlider):
    """A horizontal slider of `WAY` steps that jumps to where it is clicked."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self.setRange(0, WAY)
        self.setSingleStep(WAY // 100)
        self.setPageStep(WAY // 10)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)

    @property
    def share(self) -> float:
        """How far along its way it stands, 0 … 1."""
        return self.value() / WAY

    def sizeHint(self) -> QSize:
        """Return room for it in a narrow panel."""
        return QSize(120, super().sizeHint().height())

    def wheelEvent(self, e: QWheelEvent | None) -> None:
        """Turn only while it has the keyboard; else the panel scrolls."""
        _turn(self, super().wheelEvent, e)


def _turn(widget: QWidget, turn: object, event: QWheelEvent | None) -> None:
    if event is None:
        return
    if widget.hasFocus():
        turn(event)  # type: ignore[operator] # a bound event handler of Qt
    else:
        event.ignore()
