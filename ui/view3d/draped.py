"""Lines and marks laid on the terrain: heights from the sketch's relief, and what hides behind ridges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from sketchterrain.ui.engine.messages import Relief

__all__ = ["Ground", "ring"]

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

_STEPS = 48  # along a line of sight
_CLEAR = (0.02, 0.98)  # shares of a line of sight that are looked at
_SLACK = 1.5  # samples of the relief: a line of sight may cut so deep into the ground, for it is coarse


class Ground:
    """Heights of the terrain at any place of the sketch.

    Parameters
    ----------
    relief
    spacing
        m between its samples.
    """

    def __init__(self, relief: Relief, spacing: float) -> None:
        self._height = relief.height
        self.spacing = spacing
        rows, columns = relief.height.shape
        self._size = columns * spacing, rows * spacing

    def height(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Floats:
        """Return heights (m) at places (m), those outside the sketch as at its edge."""
        rows, columns = self._height.shape
        column = np.clip(np.asarray(x, np.float64) / self.spacing - 0.5, 0.0, columns - 1.0)
        row = np.clip(rows - np.asarray(y, np.float64) / self.spacing - 0.5, 0.0, rows - 1.0)
        left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
        right, below = np.minimum(left + 1, columns - 1), np.minimum(top + 1, rows - 1)
        across, down = column - left, row - top
        upper = (1.0 - across) * self._height[top, left] + across * self._height[top, right]
        lower = (1.0 - across) * self._height[below, left] + across * self._height[below, right]
        return np.asarray((1.0 - down) * upper + down * lower)

    def covers(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Flags:
        """Return which places (m) lie in the sketch."""
        east, north = np.asarray(x), np.asarray(y)
        return np.asarray((east >= 0.0) & (east <= self._size[0]) & (north >= 0.0) & (north <= self._size[1]))

    def on(self, places: npt.ArrayLike, *, lift: float = 0.0) -> Floats:
        """Return places (n, 2) with their heights, (n, 3), `lift` m above the ground."""
        at = np.asarray(places, np.float64)
        return np.column_stack([at, self.height(at[:, 0], at[:, 1]) + lift])

    def hides(self, eye: npt.ArrayLike, places: npt.ArrayLike) -> Flags:
        """Return which places (n, 3) in m are hidden from an eye (m) by ground of the sketch."""
        start, ends = np.asarray(eye, np.float64), np.asarray(places, np.float64)
        share = np.linspace(*_CLEAR, _STEPS)[:, None]
        x = start[0] + share * (ends[:, 0] - start[0])
        y = start[1] + share * (ends[:, 1] - start[1])
        z = start[2] + share * (ends[:, 2] - start[2])
        # Near its end a line of sight is as near the ground as the place is, which itself lies on it.
        slack = _SLACK * self.spacing * (0.5 + share)
        return np.asarray(((self.height(x, y) > z + slack) & self.covers(x, y)).any(axis=0))


def ring(x: float, y: float, radius: float, *, count: int = 96) -> Floats:
    """Return a closed ring of places (count + 1, 2) around a place (m)."""
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])
