"""Where a map lies on its sheet: its scale, its grid, and the way from metres to millimetres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.map_sheet import Box

    Floats = npt.NDArray[np.float64]

__all__ = ["MARGIN", "Frame", "frame_of", "round_number"]

LONGEST: Final = 275.0
"""mm that the map's longer side has at most: a sheet of A3."""
MARGIN: Final = 12.5
TOP: Final = 28.0
"""mm from the sheet's edges to the map's."""
NARROWEST: Final = 160.0
"""mm that a sheet is wide at least, so that there is room for the legend."""
_SCALES: Final = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.5, 8.0)
_GRID: Final = 25.0  # mm between grid lines at least


@dataclass(frozen=True)
class Frame:
    """A map's place on the sheet.

    Attributes
    ----------
    left, top : float
        Its north-west corner on the sheet (mm).
    east, north : float
        What it shows (m), from the sketch's south-west corner.
    scale : float
        Metres of ground over metres of paper: 25 000 is 1:25 000.
    """

    left: float
    top: float
    east: float
    north: float
    scale: float

    @property
    def metre(self) -> float:
        """Of the ground, on the sheet (mm)."""
        return 1000.0 / self.scale

    @property
    def sheet_width(self) -> float:
        """Of the sheet (mm)."""
        return 2.0 * self.left + self.east * self.metre

    @property
    def box(self) -> Box:
        """Of the map on the sheet (mm)."""
        return self.left, self.top, self.east * self.metre, self.north * self.metre

    def place(self, points: npt.ArrayLike) -> Floats:
        """Return where points (…, 2 or more) x, y (m) lie on the sheet: (…, 2) mm, y down."""
        point = np.asarray(points, np.float64)
        x = self.left + point[..., 0] * self.metre
        y = self.top + (self.north - point[..., 1]) * self.metre
        return np.stack([x, y], axis=-1)

    def grid(self) -> float:
        """Return the metres between grid lines, a round number."""
        return round_number(_GRID / self.metre, steps=(1.0, 2.0, 5.0), up=True)


def frame_of(size: tuple[float, float]) -> Frame:
    """Return the frame of a sketch of a size (m), east and north, at the largest round scale that fits."""
    longest = max(size)
    scale = round_number(longest * 1000.0 / LONGEST, steps=_SCALES, up=True)
    width = size[0] * 1000.0 / scale
    return Frame(max(MARGIN, (NARROWEST - width) / 2.0), TOP, size[0], size[1], scale)


def round_number(number: float, *, steps: tuple[float, ...], up: bool = False) -> float:
    """Return the nearest step times a power of ten, by factor; with `up` the least one not below."""
    power = np.floor(np.log10(number))
    choices = np.array([step * 10.0 ** (power + shift) for shift in (-1, 0, 1) for step in steps])
    if up:
        return float(choices[choices >= number * (1.0 - 1e-9)].min())
    return float(choices[np.argmin(np.abs(np.log(choices / number)))])
