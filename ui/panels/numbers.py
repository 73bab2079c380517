"""Number fields of panels, and their texts."""

from __future__ import annotations

import math
import re
import time
from dataclasses import dataclass
from typing import Final, Literal, TypeVar

from PyQt6.QtCore import QEvent, QLocale, QObject, Qt
from PyQt6.QtGui import QValidator
from PyQt6.QtWidgets import QAbstractSpinBox, QDoubleSpinBox, QSlider, QWidget

from sketchterrain.document.parameter_types import Parameter, format_number
from sketchterrain.document.parameters import LAYERS
from sketchterrain.ui.look.theme import tabular


@dataclass(frozen=True)
class Special:
    """A value of a parameter that is no number to a person.

    Attributes
    ----------
    value : float
        As it stands in the sketch.
    title : str
        What it means.
    start : float
        The number to begin with where a person wants one.
    low, high : float
        Numbers that a slider offers beside it.
    """

    value: float
    title: str
    start: float
    low: float
    high: float


_SPECIALS: Final = {
    "flow": Special(-1.0, "Downhill", 180.0, 0.0, 360.0),
    "conifers": Special(-1.0, "By elevation", 0.5, 0.0, 1.0),
    "quality": Special(-1.0, "Automatic", 0.5, 0.0, 1.0),
    "hour": Special(-1.0, "Best light", 12.0, 0.0, 24.0),
    "width": Special(0.0, "As wide as painted", 12.0, 0.5, 2000.0),
    "snow_line": Special(1e4, "No snow", 2000.0, 0.0, 5000.0),
    "tree_line": Special(1e4, "No limit", 1800.0, 0.0, 5000.0),
}

_COMFORTABLE: Final = {"extent": (128.0, 262144.0), "x": (0.0, 4096.0), "y": (0.0, 4096.0)}
"""What sliders offer where the declaration allows far more; the number beside them takes all."""


def setting_title(name: str) -> str:
    """Return a key of the file as words: ``"Snow line"``."""
    return name.replace("_", " ").capitalize()


def special_of(parameter: Parameter) -> Special | None:
    """Return the value of a parameter that is no number to a person, if it has one."""
    special = _SPECIALS.get(parameter.name)
    return special if special and special.value in (parameter.low, parameter.high) else None


def comfortable_range(parameter: Parameter) -> tuple[float, float]:
    """Return the least and the greatest value that a slider offers."""
    special = special_of(parameter)
    if special is not None:
        return special.low, special.high
    return _COMFORTABLE.get(parameter.name, (parameter.low, parameter.high))


def help_of(parameter: Parameter) -> str:
    """Return the line of help, without the words on a special value, for which there is a box to check."""
    special = special_of(parameter)
    text = parameter.help
    if special is not None:
        mark = f"{format_number(special.value)} "
        text = "; ".join(part for part in text.split("; ") if not part.startswith(mark))
    return text[:1].upper() + text[1:]


def suffix_of(parameter: Parameter) -> str:
    """Return what stands behind a number: its unit."""
    unit = parameter.unit.removeprefix("1")
    if not unit or parameter.kind is str:
        return ""
    return unit if unit == "°" else f" {unit}"


def number(value: float, *, decimals: int = 3) -> str:
    """Return a number as a person writes it, with few decimals: 600, 0.5, 12.25."""
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text in ("-0", "") else text.replace("-", "−")


def with_unit(parameter: Parameter, value: float | str) -> str:
    """Return a value in words: ``"600 m"``, ``"downhill"``, ``"rock"``."""
    if isinstance(value, str):
        return value.replace("_", " ")
    special = special_of(parameter)
    if special is not None and value == special.value:
        return special.title.lower()
    return number(value, decimals=2) + suffix_of(parameter)


def tool_tip(parameter: Parameter) -> str:
    """Return what a pointer that rests on a parameter is told: help, range and default."""
    lines = [help_of(parameter) + "."]
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


def label_title(layer: str, label: int) -> str:
    """Return what a label is called: ``"Mountains 2"``."""
    return f"{LAYERS[layer].title} {label}"


WAY = 1000
"""Steps of a slider."""
_RATIO_FROM = 100.0  # ratio of greatest to least value from which on a slider is not linear
_PAUSE = 0.8  # s after which another press of a key is an undo step of its own
_CLOCK = re.compile(r"\s*(\d{1,2})\s*:\s*(\d{0,2})\s*")


class Gesture:
    """Merge keys for `Document.do`: one for a whole drag, or for key presses in quick succession."""

    def __init__(self) -> None:
        self._key = object()
        self._held = False
        self._last = 0.0

    def begin(self) -> None:
        """Begin a drag: all changes until `end` have one key."""
        self._key, self._held = object(), True

    def end(self) -> None:
        """End the drag."""
        self._held, self._last = False, 0.0

    @property
    def key(self) -> object:
        """The key of a change made now."""
        now = time.monotonic()
        if not self._held and now - self._last > _PAUSE:
            self._key = object()
        self._last = now
        return self._key


@dataclass(frozen=True)
class Scale:
    """Maps a slider's share of its way, 0 … 1, to values from `low` to `high`, rounded to three digits.

    ``ratio``: equal distances are equal ratios (`low` > 0); ``cube``: finer towards `low`.
    """

    low: float
    high: float
    kind: Literal["even", "ratio", "cube"] = "even"
    whole: bool = False

    @classmethod
    def of(cls, parameter: Parameter, low: float, high: float) -> Scale:
        """Return the scale that suits a parameter between two values."""
        whole = parameter.kind is int
        if low > 0 and high / low >= _RATIO_FROM:
            return cls(low, high, "ratio", whole)
        is_wide = low == 0 and high >= _RATIO_FROM and parameter.unit != "°"
        return cls(low, high, "cube" if is_wide else "even", whole)

    def at(self, share: float) -> float:
        """Return the value at a share of the way."""
        share = min(max(share, 0.0), 1.0)
        if share in (0.0, 1.0):
            return self.high if share else self.low
        if self.kind == "ratio":
            exact = self.low * (self.high / self.low) ** share
        else:
            exact = self.low + (self.high - self.low) * (share**3 if self.kind == "cube" else share)
        if self.whole:
            exact = round(exact)
        elif self.kind == "even":
            exact = round(exact, 2 - math.floor(math.log10(self.high - self.low)))
        else:
            exact = float(f"{exact:.3g}")
        return min(max(float(exact), self.low), self.high)

    def share(self, value: float) -> float:
        """Return the share of the way at which a value lies; one beyond the ends lies at an end."""
        value = min(max(value, self.low), self.high)
        if self.kind == "ratio":
            return math.log(value / self.low) / math.log(self.high / self.low)
        share = (value - self.low) / (self.high - self.low)
        return share ** (1 / 3) if self.kind == "cube" else share


class _WheelFilter(QObject):
    """Gives the wheel to a control only while it has the focus; otherwise the panel scrolls."""

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        if isinstance(watched, QWidget) and event is not None and event.type() == QEvent.Type.Wheel:
            event.setAccepted(watched.hasFocus())
            return not watched.hasFocus()
        return False


_W = TypeVar("_W", bound=QWidget)


def scroll_past(control: _W) -> _W:
    """Let the wheel change a control only while it has the focus, and return the control."""
    control.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    control.installEventFilter(_WheelFilter(control))
    return control


def slider(parent: QWidget | None = None) -> QSlider:
    """Return a horizontal slider of `WAY` steps."""
    made = QSlider(Qt.Orientation.Horizontal, parent)
    made.setRange(0, WAY)
    made.setSingleStep(WAY // 100)
    made.setPageStep(WAY // 10)
    made.setMinimumWidth(60)
    return scroll_past(made)


class NumberBox(QDoubleSpinBox):
    """A number with its unit, told when typing has ended; arrow keys step by about a tenth of it."""

    def __init__(
        self, low: float, high: float, *, suffix: str = "", decimals: int = 3, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
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
        """Return a number without trailing zeros."""
        return number(v, decimals=self.decimals()).replace("−", "-")

    def validate(self, input: str | None, pos: int) -> tuple[QValidator.State, str, int]:  # noqa: A002 # Qt's name
        """Accept a comma for a point."""
        return super().validate((input or "").replace(",", "."), pos)


class ClockBox(NumberBox):
    """Hours of a day, shown as ``18:30``; ``18.5`` may be typed too."""

    def textFromValue(self, v: float) -> str:
        """Return hours and minutes."""
        minutes = round(60 * v)
        return f"{minutes // 60}:{minutes % 60:02}"

    def valueFromText(self, text: str | None) -> float:
        """Return the hours of a clock time, or of a number."""
        clock = _CLOCK.fullmatch(text or "")
        if clock is None:
            return super().valueFromText(text)
        return int(clock[1]) + int(clock[2] or 0) / 60

    def validate(self, input: str | None, pos: int) -> tuple[QValidator.State, str, int]:  # noqa: A002 # Qt's
        """Accept a clock time, or a number."""
        clock = _CLOCK.fullmatch(input or "")
        if clock is None:
            return super().validate(input, pos)
        whole = clock[2] != "" and int(clock[2]) < 60
        good = whole and self.minimum() <= self.valueFromText(input) <= self.maximum()
        return QValidator.State.Acceptable if good else QValidator.State.Intermediate, input or "", pos
