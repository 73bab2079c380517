"""Summits on a map: those that stand out, with their heights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.export.map_labels import discs_of
from sketchterrain.export.map_sheet import Areas, Words

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.map_frame import Frame
    from sketchterrain.export.map_ground import MapGround
    from sketchterrain.export.map_labels import Room
    from sketchterrain.export.map_sheet import Shape
    from sketchterrain.terrain import Terrain

__all__ = ["Peak", "find_peaks", "peak_sign", "peak_signs", "prominences"]

CELL: Final = 1.2
"""mm of the sheet: how finely summits are told apart."""
LEAST: Final = 1.6
"""Contour intervals by which a summit stands out at least."""
APART: Final = 8.0
"""mm between summits that are shown."""
MOST: Final = 48
SIZE: Final = 2.05
"""mm of the figures."""
INK: Final = (34, 30, 28)
PAPER: Final = (250, 248, 238)


@dataclass(frozen=True)
class Peak:
    """A summit.

    Attributes
    ----------
    x, y, height : float
        m.
    prominence : float
        How far one has to go down from it to get to a higher one (m); for the highest, to the lowest ground.
    """

    x: float
    y: float
    height: float
    prominence: float


def find_peaks(terrain: Terrain, ground: MapGround, frame: Frame, interval: float) -> list[Peak]:
    """Return the summits that stand out by more than about a contour interval, those that do most first."""
    cell = max(round(CELL / (ground.spacing[0] * frame.metre)), 1)
    rows, columns = (length // cell for length in ground.even.shape)
    cut = ground.even[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell)
    blocks = cut.transpose(0, 2, 1, 3).reshape(rows, columns, cell * cell)
    peaks: list[Peak] = []
    for prominence, row, column in prominences(blocks.max(axis=-1)):
        if prominence < LEAST * interval or len(peaks) == MOST:
            break
        inner = int(blocks[row, column].argmax())
        index = np.array([[row * cell + inner // cell, column * cell + inner % cell]], np.float64)
        x, y = ground.metres(index)[0].tolist()
        if any(np.hypot(x - peak.x, y - peak.y) * frame.metre < APART for peak in peaks):
            continue
        x, y, height = _summit(terrain, x, y, ground.cell_size)
        peaks.append(Peak(x, y, height, prominence))
    return peaks


def prominences(heights: npt.NDArray[np.floating]) -> list[tuple[float, int, int]]:
    """Return (prominence, row, column) of all summits in a grid, the greatest prominence first.

    From the highest place down, islands grow out of a falling sea: where two meet, the lower one's summit
    has the height that the sea has fallen since as its prominence.
    """
    rows, columns = heights.shape
    flat = heights.ravel().tolist()
    order = np.argsort(-heights.ravel(), kind="stable").tolist()
    island = [-1] * len(flat)  # the place through which each one's summit is found
    found: list[tuple[float, int]] = []

    def summit(place: int) -> int:
        while island[place] != place:
            island[place] = island[island[place]]
            place = island[place]
        return place

    for place in order:
        row, column = divmod(place, columns)
        island[place] = place
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                other = r * columns + c
                if other == place or island[other] < 0:
                    continue
                high, low = summit(place), summit(other)
                if high == low:
                    continue
                if (flat[low], -low) > (flat[high], -high):
                    high, low = low, high
                if flat[low] > flat[place]:
                    found.append((flat[low] - flat[place], low))
                island[low] = high
    found.append((max(flat) - min(flat), order[0]))
    found.sort(key=lambda each: (-each[0], each[1]))
    return [(prominence, *divmod(place, columns)) for prominence, place in found]


def peak_signs(peaks: list[Peak], frame: Frame, room: Room) -> list[Shape]:
    """Return a triangle and a height for each summit that there is room for."""
    shapes: list[Shape] = []
    for peak in peaks:
        x, y = frame.place([peak.x, peak.y]).tolist()
        sign = np.array([[x, y, 0.9]])
        if not room.free(sign):
            continue
        for dx, dy, anchor in (
            (1.1, -1.0, "start"),
            (-1.1, -1.0, "end"),
            (0.0, -2.0, "middle"),
            (1.1, 1.2, "start"),
        ):
            text = Words(_figures(peak.height), x + dx, y + dy, SIZE, INK, anchor, halo=PAPER)
            discs = discs_of(text, air=0.3)
            if room.free(discs):
                room.take(np.concatenate([discs, sign]))
                shapes += [*peak_sign(x, y), text]
                break
    return shapes


def peak_sign(x: float, y: float) -> list[Shape]:
    """Return a triangle around a place (mm)."""
    place = np.array([x, y])
    corners = np.array([[0.0, -0.85], [0.8, 0.55], [-0.8, 0.55]])
    return [Areas([place + 1.35 * corners], PAPER), Areas([place + corners], INK)]


def _figures(height: float) -> str:
    return f"{height:.0f}"


def _summit(terrain: Terrain, x: float, y: float, reach: float) -> tuple[float, float, float]:
    """Return the highest place of full detail near a place (m)."""
    off = np.linspace(-reach, reach, 9)
    east, north = (grid.ravel() for grid in np.meshgrid(x + off, y + off))
    east = np.clip(east, 0.0, terrain.size[0])
    north = np.clip(north, 0.0, terrain.size[1])
    heights = terrain.heights(east, north)
    best = int(heights.argmax())
    return float(east[best]), float(north[best]), float(heights[best])
