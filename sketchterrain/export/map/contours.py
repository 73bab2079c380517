"""Contours: their interval, where they run and are drawn, and the heights written along them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.export.map.drawing import Colour, Label, LabelSpace, Points, Polylines, Shape
from sketchterrain.export.map.ground import Grid, MapSamples, nearest_round

INDEX: Final = 5  # every 5th contour is an index contour: heavier, with its height
STEEP_SHARE: Final = 85.0  # per cent of the ground that is less steep than what the interval is chosen for
SHORTEST, SHORTEST_PIECE = 2.4, 0.8  # mm around closed contours, and of pieces, at least
PENS: Final[dict[str, Colour]] = {"ground": (158, 108, 66), "rock": (98, 94, 92), "snow": (92, 138, 178)}
"""Colour of the contours on soil, on rock and scree, and on snow."""
WIDTHS: Final = {False: 0.12, True: 0.25}  # mm of contours, and of index contours
CROWDED: Final = 0.26  # mm between contours under which only index contours are drawn
GAP: Final = 0.45  # mm between a label and its contour

LABEL_SIZE, LABEL_COLOUR = 1.75, (110, 72, 40)  # mm
LABEL_EVERY: Final = 1.6  # mm between the places that are looked at
BEND: Final = 0.22  # mm by which a line may leave the straight under its label
LABEL_CROWDED: Final = 0.42  # mm between contours under which no heights are written
APART, AIR = 26.0, 2.2  # mm between two labels of one height, and between any two
UPRIGHT: Final = -0.15  # cosine of a label's turn beyond which it would be upside down


@dataclass(frozen=True, eq=False)
class Contour:
    """A line of one height (m): (n, 2) x, y (m), the last point the first where it is closed."""

    height: float
    index: bool
    points: Points


def choose_interval(ground: MapSamples) -> float:
    """Return the contour interval (m) for a ground, a round number.

    Imhof (Cartographic Relief Presentation, 1965, ch. C): A = n · log₁₀ n · tan α with n = √(scale/100 + 1),
    and α the slope of the steep ground that there is plenty of.
    """
    n = np.sqrt(ground.frame.scale / 100.0 + 1.0)
    slope = float(np.percentile(ground.slope[2], STEEP_SHARE))
    return nearest_round(max(n * np.log10(n) * slope, float(np.ptp(ground.smooth)) / 100.0, 0.1))


def trace_contours(ground: MapSamples, interval: float) -> list[Contour]:
    """Return the contours of the ground without those too small to be seen."""
    low, high = float(ground.smooth.min()), float(ground.smooth.max())
    numbers = range(int(np.floor(low / interval)) + 1, int(np.ceil(high / interval)))
    lines = ground.isolines(ground.smooth, [interval * number for number in numbers])
    return [
        Contour(interval * number, number % INDEX == 0, points)
        for number, of_level in zip(numbers, lines, strict=True)
        for points in of_level
        if arc_lengths(points)[-1] * ground.frame.mm_per_metre >= SHORTEST or (points[0] != points[-1]).any()
    ]


def contour_lines(
    contours: Sequence[Contour], ground: MapSamples, labels: Sequence[Label], interval: float
) -> list[Shape]:
    """Return the lines to draw, one set a pen, with gaps at labels and none on water."""
    kind = pen_numbers(ground)
    apart = interval / np.maximum(ground.slope[2], 1e-6) * ground.frame.mm_per_metre
    gaps = shapely.union_all([label.outline(air=GAP) for label in labels])
    shapely.prepare(gaps)
    paths: dict[tuple[bool, int], list[Points]] = {(i, pen): [] for i in (False, True) for pen in range(3)}
    for contour in contours:
        path = ground.frame.place(contour.points)
        drawn = (ground.at(ground.depth, contour.points) < 0.0) & ~shapely.contains_xy(gaps, path)
        if not contour.index:
            drawn &= ground.at(apart, contour.points) > CROWDED
        code = np.where(drawn, np.rint(ground.at(kind, contour.points)), -1).astype(int)
        for piece, pen in pieces(path, code):
            if arc_lengths(piece)[-1] >= SHORTEST_PIECE:
                paths[contour.index, pen].append(piece)
    colours = list(PENS.values())
    return [Polylines(found, colours[pen], WIDTHS[i]) for (i, pen), found in paths.items() if found]


def pen_numbers(ground: MapSamples) -> Grid:
    """Return which of the pens belongs to the ground at each sample."""
    stone = ground.share("rock", "scree") > 0.5
    return np.where(ground.share("snow") > 0.5, 2, np.where(stone, 1, 0)).astype(np.float32)


def pieces(path: Points, code: npt.NDArray[np.int_]) -> Iterator[tuple[Points, int]]:
    """Cut a path where its points' code changes; return pieces of a code ≥ 0, up to the next one's start."""
    cuts = (np.flatnonzero(np.diff(code)) + 1).tolist()
    for start, end in zip([0, *cuts], [*cuts, len(path)], strict=True):
        piece = path[start : end + 1]
        if code[start] >= 0 and len(piece) > 1:
            yield piece, int(code[start])


def label_contours(
    contours: Sequence[Contour], ground: MapSamples, space: LabelSpace, interval: float
) -> list[Label]:
    """Return the heights of index contours, the best places first."""
    indexed = (contour for contour in contours if contour.index)
    found = [candidate for contour in indexed for candidate in _candidates(contour, ground, interval)]
    chosen: dict[str, list[Label]] = {}
    for _, label in sorted(found, key=lambda each: -each[0]):
        same = chosen.setdefault(label.text, [])
        apart = all(np.hypot(label.x - other.x, label.y - other.y) >= APART for other in same)
        if apart and space.reserve(label.outline(air=AIR)):
            same.append(label)
    return [label for same in chosen.values() for label in same]


def _candidates(contour: Contour, ground: MapSamples, interval: float) -> list[tuple[float, Label]]:
    """Return places for labels along a contour, each with its score."""
    decimals = max(0, -int(np.floor(np.log10(interval) + 1e-9)))
    text = f"{contour.height:.{decimals}f}"
    path = ground.frame.place(contour.points)
    arc = arc_lengths(path)
    half = 0.5 * Label(text, 0.0, 0.0, LABEL_SIZE, LABEL_COLOUR).width + 0.4
    middles = np.arange(half, arc[-1] - half, LABEL_EVERY)
    at = along(path, arc, middles[:, None] + np.linspace(-1.0, 1.0, 9) * half)
    chord = at[:, -1] - at[:, 0]
    length = np.hypot(chord[:, 0], chord[:, 1])
    chord /= np.maximum(length, 1e-9)[:, None]
    off = at - at[:, :1]
    bend = np.abs(off[..., 0] * chord[:, None, 1] - off[..., 1] * chord[:, None, 0]).max(axis=1)
    points = along(contour.points, arc, middles)
    east, north, steep = (ground.at(field, points) for field in ground.slope)
    apart = interval / np.maximum(steep, 1e-6) * ground.frame.mm_per_metre
    # The top of the digits is uphill: on the sheet (y down) along (east, −north).
    chord *= np.where(chord[:, 1] * east + chord[:, 0] * north >= 0.0, 1.0, -1.0)[:, None]
    good = (bend < BEND) & (apart > LABEL_CROWDED) & (length > 1.7 * half) & (chord[:, 0] > UPRIGHT)
    good &= ground.at(ground.depth, points) < 0.0
    score = chord[:, 0] - 2.0 * bend / BEND + 0.6 * np.tanh(apart / 1.5)
    turn = np.degrees(np.arctan2(chord[:, 1], chord[:, 0]))
    rows = np.column_stack([score, at[:, 4], turn])[good]
    return [(s, Label(text, x, y, LABEL_SIZE, LABEL_COLOUR, "middle", t)) for s, x, y, t in rows.tolist()]


def arc_lengths(path: Points) -> Points:
    """Return the length of a path from its start to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])


def along(path: Points, arc: Points, lengths: Points) -> Points:
    """Return the points at lengths along a path."""
    return np.stack([np.interp(lengths, arc, path[:, axis]) for axis in (0, 1)], axis=-1)
