"""Controls of panels and dialogs: number fields, sliders, labels and small widgets."""

from __future__ import annotations

import math
import re
import time
from dataclasses import dataclass
from typing import Literal, TypeVar

from PyQt6.QtCore import QEvent, QLocale, QObject, QRectF, QSize, Qt
from PyQt6.QtGui import QColor, QFont, QIcon, QPainter, QPalette, QPixmap, QValidator
from PyQt6.QtWidgets import (
    QAbstractSpinBox,
    QCheckBox,
    QDoubleSpinBox,
    QFrame,
    QLabel,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QSlider,
    QStyle,
    QStyleOptionViewItem,
    QWidget,
)
from superqt import QElidingLabel

from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.parameters import Parameter, format_number
from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import MARGIN, MARKS, SPACING, column, described, heading, row, tabular

SLIDER_STEPS = 1000
_LOG_RATIO = 100.0  # ratio of the ends from which on a scale is not linear
_GESTURE_GAP = 0.8  # s between key presses that starts another undo step
_CLOCK = re.compile(r"\s*(\d{1,2})\s*:\s*(\d{0,2})\s*")


def title_from_key(name: str) -> str:
    """Return a key of the sketch file as a title: ``"Snow line"``."""
    return name.replace("_", " ").capitalize()


def label_title(layer: str, label: int) -> str:
    """Return the title of a label: ``"Mountains 2"``."""
    return f"{LAYERS[layer].title} {label}"


def slider_range(parameter: Parameter) -> tuple[float, float]:
    """Return the range that a slider offers."""
    return parameter.soft_range or (parameter.low, parameter.high)


def help_text(parameter: Parameter) -> str:
    """Return the line of help without the part about the sentinel, which has a check box."""
    text = parameter.help
    if parameter.sentinel is not None:
        prefix = f"{format_number(parameter.sentinel.value)} "
        text = "; ".join(part for part in text.split("; ") if not part.startswith(prefix))
    return text[:1].upper() + text[1:]


def suffix_of(parameter: Parameter) -> str:
    """Return the suffix of a number: its unit."""
    unit = parameter.unit.removeprefix("1")
    if not unit or parameter.kind is str:
        return ""
    return unit if unit == "°" else f" {unit}"


def number(value: float, *, decimals: int = 3) -> str:
    """Return a number without trailing zeros: 600, 0.5, 12.25."""
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text in ("-0", "") else text.replace("-", "−")


def with_unit(parameter: Parameter, value: float | str) -> str:
    """Return a value in words: ``"600 m"``, ``"downhill"``, ``"rock"``."""
    if isinstance(value, str):
        return value.replace("_", " ")
    if parameter.sentinel is not None and value == parameter.sentinel.value:
        return parameter.sentinel.title.lower()
    return number(value, decimals=2) + suffix_of(parameter)


def tool_tip(parameter: Parameter) -> str:
    """Return help, range and default as lines."""
    lines = [help_text(parameter) + "."]
    if parameter.kind is not str:
        lines.append(f"{parameter.expected[:1].upper()}{parameter.expected[1:]}.")
    if parameter.default != "":
        lines.append(f"Default: {with_unit(parameter, parameter.default)}.")
    return "\n".join(lines)


def size_text(size: float) -> str:
    """Return a number of bytes in words: ``"812 MB"``."""
    for unit in ("kB", "MB"):
        size /= 1000
        if size < 1000:
            return f"{number(size, decimals=0 if size >= 10 else 1)} {unit}"
    return f"{number(size / 1000, decimals=2)} GB"


class Gesture:
    """Merge keys for `Document.do`: one a drag, or one for key presses in quick succession."""

    def __init__(self) -> None:
        self._key = object()
        self._is_drag = False
        self._last = 0.0

    def begin(self) -> None:
        """Start a drag: all changes until `end` share one key."""
        self._key, self._is_drag = object(), True

    def end(self) -> None:
        self._is_drag, self._last = False, 0.0

    @property
    def key(self) -> object:
        """The key of a change at this moment."""
        now = time.monotonic()
        if not self._is_drag and now - self._last > _GESTURE_GAP:
            self._key = object()
        self._last = now
        return self._key


@dataclass(frozen=True)
class Scale:
    """Maps a slider's fraction, 0 … 1, to values from `low` to `high`, rounded to three digits.

    ``ratio``: logarithmic (`low` > 0); ``cube``: finer towards `low`.
    """

    low: float
    high: float
    kind: Literal["even", "ratio", "cube"] = "even"
    whole: bool = False

    @classmethod
    def suited(cls, parameter: Parameter, low: float, high: float) -> Scale:
        """Return the scale that suits a parameter between two values."""
        whole = parameter.kind is int
        if low > 0 and high / low >= _LOG_RATIO:
            return cls(low, high, "ratio", whole)
        is_wide = low == 0 and high >= _LOG_RATIO and parameter.unit != "°"
        return cls(low, high, "cube" if is_wide else "even", whole)

    def value(self, fraction: float) -> float:
        fraction = min(max(fraction, 0.0), 1.0)
        if fraction in (0.0, 1.0):
            return self.high if fraction else self.low
        if self.kind == "ratio":
            exact = self.low * (self.high / self.low) ** fraction
        else:
            exact = self.low + (self.high - self.low) * (fraction**3 if self.kind == "cube" else fraction)
        if self.whole:
            exact = round(exact)
        elif self.kind == "even":
            exact = round(exact, 2 - math.floor(math.log10(self.high - self.low)))
        else:
            exact = float(f"{exact:.3g}")
        return min(max(float(exact), self.low), self.high)

    def fraction(self, value: float) -> float:
        """Return the fraction of a value, clamped to the ends."""
        value = min(max(value, self.low), self.high)
        if self.kind == "ratio":
            return math.log(value / self.low) / math.log(self.high / self.low)
        fraction = (value - self.low) / (self.high - self.low)
        return fraction ** (1 / 3) if self.kind == "cube" else fraction


class _WheelFilter(QObject):
    """Event filter that leaves the wheel to the scrolling panel unless the control has the focus."""

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        if isinstance(watched, QWidget) and event is not None and event.type() == QEvent.Type.Wheel:
            event.setAccepted(watched.hasFocus())
            return not watched.hasFocus()
        return False


_W = TypeVar("_W", bound=QWidget)


def scroll_past(control: _W) -> _W:
    """Let the wheel change a control only while it has the focus; return the control."""
    control.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    control.installEventFilter(_WheelFilter(control))
    return control


def slider() -> QSlider:
    """Return a horizontal slider of `SLIDER_STEPS` steps."""
    control = QSlider(Qt.Orientation.Horizontal)
    control.setRange(0, SLIDER_STEPS)
    control.setSingleStep(SLIDER_STEPS // 100)
    control.setPageStep(SLIDER_STEPS // 10)
    control.setMinimumWidth(60)
    return scroll_past(control)


class NumberBox(QDoubleSpinBox):
    """A number with a unit, reported when typing ends; arrow keys step by about a tenth of it."""

    def __init__(self, low: float, high: float, *, suffix: str = "", decimals: int = 3) -> None:
        super().__init__()
        self.setLocale(QLocale.c())
        self.setFont(tabular(self.font()))
        self.setDecimals(decimals)
        self.setRange(low, high)
        self.setSuffix(suffix)
        self.setStepType(QAbstractSpinBox.StepType.AdaptiveDecimalStepType)
        self.setKeyboardTracking(False)
        self.setButtonSymbols(QAbstractSpinBox.ButtonSymbols.NoButtons)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setFixedWidth(88)
        scroll_past(self)

    def textFromValue(self, v: float) -> str:
        return number(v, decimals=self.decimals()).replace("−", "-")

    def validate(self, input: str | None, pos: int) -> tuple[QValidator.State, str, int]:  # noqa: A002 # Qt's
        """Accept a decimal comma too."""
        return super().validate((input or "").replace(",", "."), pos)


class ClockBox(NumberBox):
    """Hours of a day, shown as ``18:30``; ``18.5`` is accepted too."""

    def textFromValue(self, v: float) -> str:
        minutes = round(60 * v)
        return f"{minutes // 60}:{minutes % 60:02}"

    def valueFromText(self, text: str | None) -> float:
        clock = _CLOCK.fullmatch(text or "")
        if clock is None:
            return super().valueFromText(text)
        return int(clock[1]) + int(clock[2] or 0) / 60

    def validate(self, input: str | None, pos: int) -> tuple[QValidator.State, str, int]:  # noqa: A002 # Qt's
        clock = _CLOCK.fullmatch(input or "")
        if clock is None:
            return super().validate(input, pos)
        is_whole = clock[2] != "" and int(clock[2]) < 60
        is_valid = is_whole and self.minimum() <= self.valueFromText(input) <= self.maximum()
        return QValidator.State.Acceptable if is_valid else QValidator.State.Intermediate, input or "", pos


_SMALLER = 0.88
_SWATCH = 28


def small(font: QFont) -> QFont:
    """Return a slightly smaller font."""
    smaller = QFont(font)
    if font.pointSizeF() > 0:
        smaller.setPointSizeF(font.pointSizeF() * _SMALLER)
    else:
        smaller.setPixelSize(max(1, round(font.pixelSize() * _SMALLER)))
    return smaller


def faint_label(text: str = "") -> QLabel:
    """Return a label for secondary text: small, pale, wrapped."""
    label = QLabel(text)
    label.setFont(small(label.font()))
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    label.setWordWrap(True)
    return label


def check_box(title: str, tip: str) -> QCheckBox:
    """Return a check box, its title with ``&`` before its key."""
    return described(QCheckBox(title), title.replace("&", ""), tip)


def status_label(tip: str, sample: str | None = None) -> QElidingLabel:
    """Return one elided line of secondary text, as wide as `sample` or as the available room."""
    label = QElidingLabel()
    label.setFont(tabular(label.font()))
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    label.setToolTip(tip)
    if sample is None:
        label.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
    else:
        label.setFixedWidth(label.fontMetrics().horizontalAdvance(sample) + 4)
    return label


def draw_band(painter: QPainter, option: QStyleOptionViewItem, band: QRectF) -> tuple[QColor, QColor]:
    """Draw the rounded background of a selected or hovered row, clipped to its cell.

    Return the colours of its primary and secondary text.
    """
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    role, palette = QPalette.ColorRole, option.palette
    is_selected = bool(option.state & QStyle.StateFlag.State_Selected)
    if is_selected or option.state & QStyle.StateFlag.State_MouseOver:
        colour = QColor(palette.color(role.Highlight if is_selected else role.Mid))
        colour.setAlpha(255 if is_selected else 90)
        painter.setClipRect(option.rect)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(colour)
        painter.drawRoundedRect(band, 5, 5)
    roles = (role.HighlightedText,) * 2 if is_selected else (role.Text, role.PlaceholderText)
    return palette.color(roles[0]), palette.color(roles[1])


class CollapsibleGroup(QWidget):
    """Controls under a heading, which shows or hides them."""

    def __init__(self, title: str, content: QWidget, *, is_open: bool = True) -> None:
        super().__init__()
        mark = QIcon(str(MARKS / "right.svg"))
        mark.addFile(str(MARKS / "down.svg"), state=QIcon.State.On)
        header = described(QPushButton(mark, title), title, f"Show or hide: {title.lower()}")
        header.setCheckable(True)
        header.setChecked(is_open)
        header.setAutoDefault(False)
        header.toggled.connect(content.setVisible)
        column(self, header, content)
        content.setVisible(is_open)


class Panel(QWidget):
    """A dock's content with its usual and smallest size."""

    usual, smallest = QSize(300, 320), QSize(220, 80)

    def sizeHint(self) -> QSize:
        return self.usual

    def minimumSizeHint(self) -> QSize:
        return self.smallest


class ScrollingPanel(QScrollArea):
    """A vertically scrolling panel of controls."""

    def __init__(self) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        page = QWidget(self)
        self._column = column(page, 1, margins=MARGIN, spacing=MARGIN)
        self.setWidget(page)

    def add(self, *widgets: QWidget) -> None:
        for widget in widgets:
            self._column.insertWidget(self._column.count() - 1, widget)

    def sizeHint(self) -> QSize:
        return QSize(300, 420)

    def minimumSizeHint(self) -> QSize:
        return QSize(220, 80)


class PageHead(QWidget):
    """The head of a properties page: a swatch, a title and a line."""

    def __init__(self) -> None:
        super().__init__()
        self._picture, self._title, self._line = QLabel(), heading(), faint_label()
        self._picture.setFixedSize(_SWATCH, _SWATCH)
        line = row(self, self._picture, column(None, self._title, self._line, spacing=0), spacing=SPACING + 2)
        line.setStretch(1, 1)

    def show_text(self, title: str, line: str, label: tuple[str, int] | None = None) -> None:
        picture = QPixmap() if label is None else swatch(*label, _SWATCH, self.devicePixelRatioF())
        self._picture.setPixmap(picture)
        self._title.setText(title)
        self._line.setText(line[:1].upper() + line[1:])
