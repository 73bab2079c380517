"""Hours of a day, typed and shown as a clock does: 18:30."""

from __future__ import annotations

import re

from PyQt6.QtGui import QValidator

from sketchterrain.ui.panels.number_box import NumberBox

_CLOCK = re.compile(r"\s*(\d{1,2})\s*:\s*(\d{0,2})\s*")


class ClockBox(NumberBox):
    """A number of hours. It takes ``18:30`` and ``18.5``."""

    def textFromValue(self, v: float) -> str:
        """Return hours and minutes."""
        minutes = round(60 * v)
        return f"{minutes // 60}:{minutes % 60:02}"

    def valueFromText(self, text: str | None) -> float:
        """Return the hours that a text means."""
        clock = _CLOCK.fullmatch(text or "")
        if clock is None:
            return super().valueFromText(text)
        return int(clock[1]) + int(clock[2] or 0) / 60

    def validate(self, input: str | None, pos: int) -> tuple[QValidator.State, str, int]:  # noqa: A002 # Qt's
        """Let a clock's time pass, and a number."""
        clock = _CLOCK.fullmatch(input or "")
        if clock is None:
            return super().validate(input, pos)
        whole = clock[2] != "" and int(clock[2]) < 60
        good = whole and self.minimum() <= self.valueFromText(input) <= self.maximum()
        return QValidator.State.Acceptable if good else QValidator.State.Intermediate, input or "", pos
