"""What stands above and below a map: its title, what its signs mean, its scale and where north is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.export.map_border import INK, rectangle
from sketchterrain.export.map_contour_labels import COLOUR as LABEL
from sketchterrain.export.map_contour_labels import SIZE as LABEL_SIZE
from sketchterrain.export.map_contour_lines import PENS, WIDTHS
from sketchterrain.export.map_contours import INDEX
from sketchterrain.export.map_frame import MARGIN, round_number
from sketchterrain.export.map_peaks import peak_sign
from sketchterrain.export.map_relief import TINTS
from sketchterrain.export.map_sheet import Areas, Lines, Words
from sketchterrain.export.map_water import BANK, FOREST, FOREST_EDGE, FOREST_SHARE, LEVEL, WATER

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sketchterrain.export.map_frame import Frame
    from sketchterrain.export.map_sheet import Shape

__all__ = ["Entry", "covered", "legend", "legend_height", "symbols", "title"]

Entry = tuple[str, "Callable[[float, float], list[Shape]]"]
"""What a sign means, and the sign, given the left end and the middle of its room (mm)."""

GREY: Final = (92, 90, 88)
TITLE: Final = 7.2
SUBTITLE: Final = 2.9
TEXT: Final = 2.5
ROOM: Final = (11.0, 5.2)
"""mm: a sign's width and height."""
COLUMN: Final = 52.0
ROW: Final = 6.6
ABOVE: Final = 13.0
"""mm from the map to the legend."""
SCALE_ROOM: Final = 78.0
"""mm that scale bar and north arrow are wide."""
BAR: Final = (36.0, 5)
"""mm that the scale bar is long, about, and its parts."""
NAMES: Final = {
    "grass": "Grassland",
    "soil": "Bare soil",
    "rock": "Rock",
    "scree": "Scree",
    "sand": "Sand",
    "snow": "Snow",
}
"""Materials that are told by their tint."""


def symbols(
    *, interval: float | None, shown: Sequence[str], tints: Sequence[str], example: str
) -> list[Entry]:
    """Return the legend's entries for what is on the sheet.

    Parameters
    ----------
    interval
        Of the contours (m), None where there are none.
    shown
        Some of ``index``, ``rock contours``, ``snow contours``, ``river``, ``lake``, ``forest``, ``peak``.
    tints
        Names of the materials that are seen.
    example
        Height that stands at the index contour.
    """
    entries: list[Entry] = []
    if interval is not None:
        if "index" in shown:
            each = _length(INDEX * interval)
            entries.append((f"Index contour, each {each}", lambda x, y: _index(x, y, example)))
        entries.append((f"Contour, each {_length(interval)}", lambda x, y: _contours(x, y, ("ground",))))
        stony = [name for name in ("rock", "snow") if f"{name} contours" in shown]
        if stony:
            entries.append((f"Contours on {' and '.join(stony)}", lambda x, y: _contours(x, y, tuple(stony))))
    known: dict[str, Entry] = {
        "river": ("River, flow", _river),
        "lake": ("Lake, water level (m)", _lake),
        "forest": ("Forest", _forest),
        "peak": ("Summit, height (m)", _peak),
    }
    entries += [entry for name, entry in known.items() if name in shown]
    for name in tints:
        entries.append((NAMES[name], _patch(name)))
    return entries


def covered(share: dict[str, float]) -> list[str]:
    """Return the materials worth an entry, by the share of the map (0 … 1) that each covers."""
    return [name for name in NAMES if share.get(name, 0.0) > 0.01]


def title(frame: Frame, name: str, subtitle: str) -> list[Shape]:
    """Return the map's name and what it is, above it."""
    left, right = MARGIN, frame.sheet_width - MARGIN
    size = TITLE
    head = Words(name, left, 11.0, size, INK, bold=True)
    if head.width > right - left:  # a long name is set smaller
        head = Words(name, left, 11.0, size * (right - left) / head.width, INK, bold=True)
    return [head, Words(subtitle, left, 17.6, SUBTITLE, GREY)]


def legend_height(frame: Frame, entries: Sequence[Entry]) -> float:
    """Return how much room the legend takes below the map (mm)."""
    columns = _columns(frame)
    rows = max(-(-len(entries) // columns), 4)
    return ABOVE + rows * ROW + 5.0


def legend(frame: Frame, entries: Sequence[Entry], note: str) -> list[Shape]:
    """Return the legend, the scale bar, the north arrow and a last line."""
    _, top, _, height = frame.box
    first = top + height + ABOVE
    columns = _columns(frame)
    rows = max(-(-len(entries) // columns), 4)
    shapes: list[Shape] = []
    for number, (meaning, sign) in enumerate(entries):
        column, row = divmod(number, rows)
        x, y = MARGIN + column * COLUMN, first + row * ROW + ROOM[1] / 2
        shapes += [*sign(x, y), Words(meaning, x + ROOM[0] + 2.2, y, TEXT, INK)]
    right = frame.sheet_width - MARGIN
    shapes += _north_arrow(right - 6.0, first + 10.0)
    shapes += _scale_bar(frame, right - SCALE_ROOM + 14.0, first + 3.0)
    last = first + rows * ROW + 2.2
    return [*shapes, Words(note, right, last, 2.0, GREY, "end")]


def _columns(frame: Frame) -> int:
    return max(int((frame.sheet_width - 2 * MARGIN - SCALE_ROOM) / COLUMN), 1)


def _index(x: float, y: float, text: str) -> list[Shape]:
    words = Words(text, x + ROOM[0] / 2, y, LABEL_SIZE, LABEL, "middle")
    half = words.width / 2 + 0.4
    middle = x + ROOM[0] / 2
    pieces = [[[x, y], [middle - half, y]], [[middle + half, y], [x + ROOM[0], y]]]
    return [Lines([np.array(piece) for piece in pieces], PENS["ground"], WIDTHS[True]), words]


def _contours(x: float, y: float, pens: tuple[str, ...]) -> list[Shape]:
    shapes: list[Shape] = []
    along = np.linspace(0.0, 1.0, 24)
    for number, pen in enumerate(pens):
        part = ROOM[0] / len(pens)
        for off in (-1.1, 0.0, 1.1):
            wave = y + off + 0.35 * np.sin(2 * np.pi * along)
            at = x + number * part + along * (part - 0.8 * (len(pens) > 1))
            shapes.append(Lines([np.stack([at, wave], axis=-1)], PENS[pen], WIDTHS[False]))
    return shapes


def _river(x: float, y: float) -> list[Shape]:
    along = np.linspace(0.0, 1.0, 24)
    path = np.stack([x + along * ROOM[0], y + 0.6 * np.sin(2 * np.pi * along) + 0.5], axis=-1)
    tail, tip = np.array([x + 4.2, y - 1.5]), np.array([x + 7.2, y - 1.5])
    head = tip + np.array([[0.0, 0.0], [-1.1, 0.4], [-1.1, -0.4]])
    return [
        Lines([path], BANK, 0.8),
        Lines([path], WATER, 0.52),
        Lines([np.stack([tail, tip - [1.1, 0.0]])], BANK, 0.18),
        Areas([head], BANK),
    ]


def _lake(x: float, y: float) -> list[Shape]:
    angle = np.linspace(0.0, 2 * np.pi, 48)
    radius = 1.0 + 0.08 * np.sin(3 * angle)
    middle = np.array([x + ROOM[0] / 2, y])
    ring = middle + np.stack([ROOM[0] / 2 * radius * np.cos(angle), 2.2 * radius * np.sin(angle)], axis=-1)
    return [
        Areas([ring], WATER),
        Lines([ring], BANK, 0.2),
        Words("12", x + ROOM[0] / 2, y, 2.0, LEVEL, "middle"),
    ]


def _forest(x: float, y: float) -> list[Shape]:
    ring = rectangle(x, y - ROOM[1] / 2 + 0.4, ROOM[0], ROOM[1] - 0.8)
    edge = np.concatenate([ring, ring[:1]])
    return [
        Areas([ring], TINTS["grass"]),
        Areas([ring], FOREST, FOREST_SHARE),
        Lines([edge], FOREST_EDGE, 0.14, 0.8),
    ]


def _peak(x: float, y: float) -> list[Shape]:
    return [*peak_sign(x + 2.4, y + 0.4), Words("345", x + 4.0, y, 2.05, INK)]


def _patch(name: str) -> Callable[[float, float], list[Shape]]:
    def sign(x: float, y: float) -> list[Shape]:
        ring = rectangle(x, y - ROOM[1] / 2 + 0.4, ROOM[0], ROOM[1] - 0.8)
        return [Areas([ring], TINTS[name]), Lines([np.concatenate([ring, ring[:1]])], GREY, 0.1)]

    return sign


def _scale_bar(frame: Frame, left: float, y: float) -> list[Shape]:
    length, parts = BAR
    part = round_number(length / parts / frame.metre, steps=(1.0, 2.0, 5.0))
    wide = part * frame.metre
    parts = max(min(round(length / wide), 6), 2)
    scale = Words(f"1 : {frame.scale:,.10g}".replace(",", " "), left, y, 3.6, INK, bold=True)
    shapes: list[Shape] = [scale]
    top = y + 4.6
    for number in range(parts):
        fill = INK if number % 2 == 0 else (255, 255, 255)
        shapes.append(Areas([rectangle(left + number * wide, top, wide, 1.3)], fill))
    ring = rectangle(left, top, parts * wide, 1.3)
    shapes.append(Lines([np.concatenate([ring, ring[:1]])], INK, 0.14))
    unit, metres = ("km", 1000.0) if part >= 500.0 else ("m", 1.0)
    every = 1 if wide > 9.0 else 2
    for number in range(0, parts + 1, every):
        text = f"{number * part / metres:g}"
        shapes.append(Words(text, left + number * wide, top + 3.2, 2.1, INK, "middle"))
    shapes.append(Words(unit, left + parts * wide + 2.6, top + 0.65, 2.1, INK))
    shapes.append(Words("Heights and coordinates in metres", left, top + 7.4, 2.1, GREY))
    shapes.append(Words("from the sketch's south-west corner", left, top + 10.2, 2.1, GREY))
    return shapes


def _north_arrow(x: float, y: float) -> list[Shape]:
    tip, tail = [x, y - 8.0], [x, y + 4.5]
    west, east = [x - 3.1, y + 7.5], [x + 3.1, y + 7.5]
    outline = np.array([tip, east, tail, west, tip], np.float64)
    return [
        Areas([np.array([tip, tail, west], np.float64)], INK),
        Areas([np.array([tip, east, tail], np.float64)], (255, 255, 255)),
        Lines([outline], INK, 0.2),
        Words("N", x, y + 10.6, 4.0, INK, "middle", bold=True),
    ]


def _length(metres: float) -> str:
    return f"{metres:g} m"
