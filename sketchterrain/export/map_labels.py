"""Where labels find room on a map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.map_sheet import Box, Words

    Floats = npt.NDArray[np.float64]

__all__ = ["Room", "corners_of", "discs_of"]


class Room:
    """What is taken of a map: labels and signs as rows of discs.

    Parameters
    ----------
    box
        Of the map; nothing may reach over it.
    """

    def __init__(self, box: Box) -> None:
        left, top, width, height = box
        self._low, self._high = np.array([left, top]), np.array([left + width, top + height])
        self._taken = np.zeros((0, 3))

    def free(self, discs: Floats) -> bool:
        """Tell whether discs (n, 3) of x, y, radius (mm) lie in the map and touch nothing."""
        place, radius = discs[:, :2], discs[:, 2:]
        if (place - radius < self._low).any() or (place + radius > self._high).any():
            return False
        apart = np.hypot(*(place[:, None] - self._taken[None, :, :2]).transpose(2, 0, 1))
        return bool((apart >= radius + self._taken[None, :, 2]).all())

    def take(self, discs: Floats) -> None:
        """Take room, free or not."""
        self._taken = np.concatenate([self._taken, discs])


def discs_of(words: Words, *, air: float) -> Floats:
    """Return the discs (n, 3) that cover a text, with so much room around it (mm)."""
    radius = 0.42 * words.size + air
    count = max(int(np.ceil(words.width / words.size)), 1) + 1
    start = {"start": 0.0, "middle": -0.5, "end": -1.0}[words.anchor] * words.width
    along = start + np.linspace(0.0, 1.0, count) * words.width
    turn = np.radians(words.turn)
    x, y = words.x + along * np.cos(turn), words.y + along * np.sin(turn)
    return np.stack([x, y, np.full(count, radius)], axis=-1)


def corners_of(words: Words, *, air: float) -> Floats:
    """Return the (4, 2) corners of the box around a text with so much room around it (mm)."""
    start = {"start": 0.0, "middle": -0.5, "end": -1.0}[words.anchor] * words.width
    x = np.array([start - air, start + words.width + air])
    y = np.array([-0.36, 0.36]) * words.size + [-air, air]
    corner = np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]])
    turn = np.radians(words.turn)
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return np.asarray(corner @ rotation + [words.x, words.y])
