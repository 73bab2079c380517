"""Heights written along index contours: where the line is straight, top of the figures uphill."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.export.map_contours import sampled
from sketchterrain.export.map_labels import discs_of
from sketchterrain.export.map_sheet import Words, text_width

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.export.map_contours import Contour
    from sketchterrain.export.map_frame import Frame
    from sketchterrain.export.map_ground import MapGround
    from sketchterrain.export.map_labels import Room

    Floats = npt.NDArray[np.float64]

__all__ = ["height_text", "label_contours"]

SIZE: Final = 1.75
"""Of the figures (mm)."""
COLOUR: Final = (110, 72, 40)
EVERY: Final = 1.6
"""mm between the places that are looked at."""
BEND: Final = 0.22
"""mm by which a line may leave the straight under its label."""
CROWDED: Final = 0.42
"""mm between contours under which no figures are written."""
APART: Final = 26.0
"""mm between two labels of one height."""
AIR: Final = 2.2
"""mm around a label, to others."""
UPRIGHT: Final = -0.15
"""Cosine of the turn of a text beyond which it would stand on its head."""


def label_contours(
    contours: Sequence[Contour], ground: MapGround, frame: Frame, room: Room, interval: float
) -> list[Words]:
    """Choose where index contours get their heights, the best places first.

    Parameters
    ----------
    contours
    ground
    frame
    room
        What is taken already; the labels take theirs.
    interval
        Of the contours (m).
    """
    steep = _steepness(ground)
    found: list[tuple[float, int, Words]] = []
    for contour in contours:
        if contour.index:
            found += [
                (score, len(found) + i, words)
                for i, (score, words) in enumerate(_candidates(contour, ground, frame, steep, interval))
            ]
    chosen: list[Words] = []
    for _, _, words in sorted(found, key=lambda each: (-each[0], each[1])):
        same = [other for other in chosen if other.text == words.text]
        if any(np.hypot(words.x - other.x, words.y - other.y) < APART for other in same):
            continue
        discs = discs_of(words, air=AIR)
        if room.free(discs):
            room.take(discs)
            chosen.append(words)
    return chosen


def height_text(height: float, interval: float) -> str:
    """Return a height as figures, with as many places as the interval has."""
    places = max(0, -int(np.floor(np.log10(interval) + 1e-9)))
    return f"{height:.{places}f}"


def _candidates(
    contour: Contour, ground: MapGround, frame: Frame, steep: Sequence[Floats], interval: float
) -> list[tuple[float, Words]]:
    """Return places along a contour, each with how good it is."""
    text = height_text(contour.height, interval)
    path = frame.place(contour.places)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    half = 0.5 * text_width(text, SIZE) + 0.4
    middles = np.arange(half, arc[-1] - half, EVERY)
    if not len(middles):
        return []
    along = np.linspace(-1.0, 1.0, 9) * half
    at = np.stack([np.interp(middles[:, None] + along, arc, path[:, axis]) for axis in (0, 1)], axis=-1)
    chord = at[:, -1] - at[:, 0]
    length = np.hypot(chord[:, 0], chord[:, 1])
    chord = chord / np.maximum(length, 1e-9)[:, None]
    off = at - at[:, :1]
    bend = np.abs(off[..., 0] * chord[:, None, 1] - off[..., 1] * chord[:, None, 0]).max(axis=1)
    places = np.stack([np.interp(middles, arc, contour.places[:, axis]) for axis in (0, 1)], axis=-1)
    slope = sampled(steep[2], ground, places)
    apart = interval / np.maximum(slope, 1e-6) * frame.metre
    dry = sampled(ground.depth, ground, places) < 0.0
    # The figures' upper side looks uphill: on the sheet (y down) along the slope's (east, −north).
    uphill = np.stack([sampled(steep[0], ground, places), -sampled(steep[1], ground, places)], axis=-1)
    top = chord[:, 1] * uphill[:, 0] - chord[:, 0] * uphill[:, 1]
    chord *= np.where(top >= 0.0, 1.0, -1.0)[:, None]
    good = (bend < BEND) & (apart > CROWDED) & dry & (length > 1.7 * half) & (chord[:, 0] > UPRIGHT)
    score = chord[:, 0] - 2.0 * bend / BEND + 0.6 * np.tanh(apart / 1.5)
    middle = at[:, len(along) // 2]
    turn = np.degrees(np.arctan2(chord[:, 1], chord[:, 0]))
    return [
        (
            float(score[i]),
            Words(text, float(middle[i, 0]), float(middle[i, 1]), SIZE, COLOUR, "middle", float(turn[i])),
        )
        for i in np.flatnonzero(good)
    ]


def _steepness(ground: MapGround) -> Sequence[Floats]:
    """Return the rise over run eastward, northward, and up the slope, each (rows, columns)."""
    south, east = np.gradient(ground.even, ground.spacing[1], ground.spacing[0])
    return [np.asarray(part, np.float64) for part in (east, -south, np.hypot(east, south))]
