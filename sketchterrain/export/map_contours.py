"""Contours: which heights get one, where they run, and where their heights are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.ndimage import map_coordinates
from skimage.measure import find_contours

from sketchterrain.export.map_frame import round_number

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.map_frame import Frame
    from sketchterrain.export.map_ground import MapGround

    Floats = npt.NDArray[np.float64]

__all__ = ["INDEX", "Contour", "choose_interval", "find_levels", "sampled", "simplified", "trace"]

INDEX: Final = 5
"""Every so manieth contour is drawn heavier, with its height."""
STEEP_SHARE: Final = 85.0
"""Per cent of the ground that is less steep than what the interval is chosen for."""
SHORTEST: Final = 2.4
"""mm around the smallest closed contours that are drawn."""
TOLERANCE: Final = 0.02
"""mm by which a point may lie off the line through its neighbours to be left out."""
_STEPS: Final = (1.0, 2.0, 5.0)


@dataclass(frozen=True, eq=False)
class Contour:
    """A line of one height.

    Attributes
    ----------
    height : float
        m.
    index : bool
        Whether it is one of the heavier ones.
    places : (n, 2) float64
        x, y (m); the last is the first where it is closed.
    """

    height: float
    index: bool
    places: Floats


def choose_interval(ground: MapGround, scale: float) -> float:
    """Return the contour interval (m) for a ground at a scale, a round number.

    Imhof (Cartographic Relief Presentation, 1965, ch. C): A = n · log₁₀ n · tan α with n = √(scale/100 + 1),
    and α the slope of the steep ground that there is plenty of.
    """
    n = np.sqrt(scale / 100.0 + 1.0)
    south, east = np.gradient(ground.even, ground.spacing[1], ground.spacing[0])
    slope = float(np.percentile(np.hypot(south, east), STEEP_SHARE))
    relief = float(np.ptp(ground.even))
    wanted = n * np.log10(n) * slope
    return round_number(max(wanted, relief / 100.0, 0.1), steps=_STEPS)


def find_levels(ground: MapGround, interval: float) -> list[float]:
    """Return the multiples of the interval between the lowest and the highest ground."""
    low, high = float(ground.even.min()), float(ground.even.max())
    first, last = int(np.floor(low / interval)) + 1, int(np.ceil(high / interval)) - 1
    return [interval * number for number in range(first, last + 1)]


def trace(ground: MapGround, frame: Frame, interval: float) -> list[Contour]:
    """Find the contours of the ground; those too small to be seen are left out."""
    contours = []
    for height in find_levels(ground, interval):
        index = round(height / interval) % INDEX == 0
        for line in find_contours(ground.even, height):
            places = ground.metres(line)
            length = np.hypot(*np.diff(places, axis=0).T).sum() * frame.metre
            closed = bool((line[0] == line[-1]).all())
            if length >= SHORTEST or not closed:
                contours.append(Contour(height, index, places))
    return contours


def simplified(path: Floats, tolerance: float = TOLERANCE) -> Floats:
    """Return a path without points that lie nearly on the line through their neighbours (path's unit)."""
    for _ in range(6):
        if len(path) < 4:
            break
        before, here, after = path[:-2], path[1:-1], path[2:]
        along = after - before
        off = np.abs(along[:, 0] * (here - before)[:, 1] - along[:, 1] * (here - before)[:, 0])
        length = np.hypot(along[:, 0], along[:, 1])
        idle = np.zeros(len(path), bool)
        idle[1:-1] = (off <= tolerance * length) & (length > 0.0)
        # Of two neighbours one stays, so that what is lost stays small.
        idle[2::2] = False
        if not idle.any():
            idle[1:-1] = (off <= tolerance * length) & (length > 0.0)
            idle[1::2] = False
            if not idle.any():
                break
        path = path[~idle]
    return path


def sampled(field: npt.NDArray[np.floating], ground: MapGround, places: Floats) -> Floats:
    """Return a field's values at places x, y (m) of the ground's grid, interpolated."""
    rows = len(ground.fine)
    row = (rows - 1) - places[:, 1] / ground.spacing[1]
    column = places[:, 0] / ground.spacing[0]
    values = map_coordinates(field, [row, column], np.float64, order=1, mode="nearest")
    return np.asarray(values)
