"""Which part of the sheet is on the screen: pixels of the sketch against pixels of the screen. No Qt."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

LARGEST: Final = 64.0
"""Most pixels of the screen along a pixel of the sketch."""

_LEAST_SEEN = 48  # px of the sheet that stay on the screen, however it is moved
_SMALLEST = 96.0  # px of the screen along the sheet's longer side


@dataclass(frozen=True)
class Viewport:
    """Where the sheet lies on the screen.

    All of the screen is counted in device pixels from the widget's upper left corner; pixels of the
    sketch are counted as floats from its north-west corner, x along columns, y along rows.
    """

    width: int  # px of the screen
    height: int
    columns: int  # px of the sketch
    rows: int
    scale: float = 1.0  # px of the screen along a pixel of the sketch
    left: int = 0  # The sheet's upper left corner on the screen
    top: int = 0

    @property
    def sheet_size(self) -> tuple[int, int]:
        """Width and height of the sheet on the screen (px)."""
        return max(round(self.columns * self.scale), 1), max(round(self.rows * self.scale), 1)

    def to_sketch(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of the sketch at a place of the screen."""
        return (x - self.left) / self.scale, (y - self.top) / self.scale

    def to_screen(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of the screen at a place of the sketch."""
        return self.left + x * self.scale, self.top + y * self.scale

    def fitted(self, *, margin: int) -> Viewport:
        """Return one that shows the whole sheet in the middle, a margin (px of the screen) around it."""
        room_x = max(self.width - 2 * margin, 16)
        room_y = max(self.height - 2 * margin, 16)
        scale = min(room_x / self.columns, room_y / self.rows, LARGEST)
        return self._with(scale, *self._centred(scale))

    def zoomed(self, factor: float, x: float, y: float) -> Viewport:
        """Return one in which the sheet is larger by a factor; what is at (x, y) of the screen stays."""
        smallest = min(_SMALLEST / max(self.columns, self.rows), 1.0)
        scale = min(max(self.scale * factor, smallest), LARGEST)
        at_x, at_y = self.to_sketch(x, y)
        return self._with(scale, x - at_x * scale, y - at_y * scale)

    def moved(self, right: float, down: float) -> Viewport:
        """Return one in which the sheet lies elsewhere, by px of the screen."""
        return self._with(self.scale, self.left + right, self.top + down)

    def resized(self, width: int, height: int) -> Viewport:
        """Return one for a screen of another size; what was in the middle stays there."""
        resized = Viewport(width, height, self.columns, self.rows, self.scale)
        right, down = 0.5 * (width - self.width), 0.5 * (height - self.height)
        return resized._with(self.scale, self.left + right, self.top + down)

    def with_middle(self, x: float, y: float) -> Viewport:
        """Return one with a place of the sketch in the middle of the screen."""
        return self._with(self.scale, 0.5 * self.width - x * self.scale, 0.5 * self.height - y * self.scale)

    def _centred(self, scale: float) -> tuple[float, float]:
        return 0.5 * (self.width - self.columns * scale), 0.5 * (self.height - self.rows * scale)

    def _with(self, scale: float, left: float, top: float) -> Viewport:
        """Keep the sheet within reach: some of it is always on the screen."""
        sides = (self.columns * scale, self.rows * scale)
        corner = []
        for at, side, room in zip((left, top), sides, (self.width, self.height), strict=True):
            seen = min(_LEAST_SEEN, side, room)
            corner.append(math.floor(min(max(at, seen - side), room - seen) + 0.5))
        return Viewport(self.width, self.height, self.columns, self.rows, scale, corner[0], corner[1])
