"""What stands around a map: its border with a scale of metres, and the grid within."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.export.map_sheet import Areas, Lines, Words

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.map_frame import Frame
    from sketchterrain.export.map_sheet import Shape

    Floats = npt.NDArray[np.float64]

__all__ = ["INK", "border", "grid_lines", "rectangle"]

INK: Final = (38, 36, 34)
GREY: Final = (90, 88, 86)
BAND: Final = (0.9, 1.0)
"""mm from the map to the band of black and white, and its width."""
OUTER: Final = 3.0
"""mm from the map to the outer line."""
FIGURES: Final = 2.0
"""mm of the coordinates."""
CROSS: Final = 1.6
"""mm of the arms of the grid's crosses."""
_ARMS: Final = CROSS * np.array([[[-1.0, 0.0], [1.0, 0.0]], [[0.0, -1.0], [0.0, 1.0]]])


def grid_lines(frame: Frame) -> list[Shape]:
    """Return a cross wherever two lines of the grid meet, and the lines themselves, faint."""
    step = frame.grid()
    east, north = (np.arange(step, length - 0.01 * step, step) for length in (frame.east, frame.north))
    lines = [frame.place([[x, 0.0], [x, frame.north]]) for x in east]
    lines += [frame.place([[0.0, y], [frame.east, y]]) for y in north]
    arms = []
    for x in east:
        for y in north:
            arms += [frame.place([x, y]) + arm for arm in _ARMS]
    return [Lines(lines, INK, 0.08, 0.28), Lines(arms, INK, 0.14, 0.75)]


def border(frame: Frame) -> list[Shape]:
    """Return the border, and the coordinates (m) of the grid along it."""
    left, top, width, height = frame.box
    near, wide = BAND
    shapes: list[Shape] = [Areas([_around(frame, near + wide), _around(frame, near)], (255, 255, 255))]
    half = frame.grid() / 2.0
    for start, end in _every_second(frame.east, half):
        x, length = left + start * frame.metre, (end - start) * frame.metre
        shapes += [
            Areas([rectangle(x, top - near - wide, length, wide)], INK),
            Areas([rectangle(x, top + height + near, length, wide)], INK),
        ]
    for start, end in _every_second(frame.north, half):
        y, length = top + height - end * frame.metre, (end - start) * frame.metre
        shapes += [
            Areas([rectangle(left - near - wide, y, wide, length)], INK),
            Areas([rectangle(left + width + near, y, wide, length)], INK),
        ]
    for off, pen in ((0.0, 0.2), (near, 0.12), (near + wide, 0.12), (OUTER, 0.45)):
        ring = _around(frame, off)
        shapes.append(Lines([np.concatenate([ring, ring[:1]])], INK, pen))
    return [*shapes, *_coordinates(frame)]


def rectangle(left: float, top: float, width: float, height: float) -> Floats:
    """Return the four corners of a box (mm)."""
    return np.array(
        [[left, top], [left + width, top], [left + width, top + height], [left, top + height]], np.float64
    )


def _around(frame: Frame, off: float) -> Floats:
    left, top, width, height = frame.box
    return rectangle(left - off, top - off, width + 2 * off, height + 2 * off)


def _every_second(length: float, step: float) -> list[tuple[float, float]]:
    starts = np.arange(0.0, length, 2.0 * step).tolist()
    return [(start, min(start + step, length)) for start in starts]


def _coordinates(frame: Frame) -> list[Shape]:
    left, top, width, height = frame.box
    step = frame.grid()
    off = OUTER + 1.9
    shapes: list[Shape] = []
    for x in np.arange(0.0, frame.east + 0.01 * step, step).tolist():
        at = left + x * frame.metre
        shapes.append(Words(_metres(x), at, top - off, FIGURES, GREY, "middle"))
        shapes.append(Words(_metres(x), at, top + height + off, FIGURES, GREY, "middle"))
    for y in np.arange(0.0, frame.north + 0.01 * step, step).tolist():
        at = top + height - y * frame.metre
        shapes.append(Words(_metres(y), left - off, at, FIGURES, GREY, "middle", -90.0))
        shapes.append(Words(_metres(y), left + width + off, at, FIGURES, GREY, "middle", -90.0))
    return shapes


def _metres(number: float) -> str:
    """Return a coordinate with thin gaps between thousands: that is how maps write it."""
    return f"{number:,.10g}".replace(",", " ")
