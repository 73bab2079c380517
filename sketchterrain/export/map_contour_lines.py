"""Contours as lines of ink: by what they run over, with gaps for labels, none on water."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.export.map_contours import sampled, simplified
from sketchterrain.export.map_labels import corners_of
from sketchterrain.export.map_sheet import Lines

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.export.map_contours import Contour
    from sketchterrain.export.map_frame import Frame
    from sketchterrain.export.map_ground import MapGround
    from sketchterrain.export.map_sheet import Colour, Words

    Floats = npt.NDArray[np.float64]
    Flags = npt.NDArray[np.bool_]

__all__ = ["PENS", "WIDTHS", "contour_lines", "covers"]

PENS: Final[dict[str, Colour]] = {"ground": (158, 108, 66), "rock": (98, 94, 92), "snow": (92, 138, 178)}
"""Colour of the contours on soil, on rock and scree, and on snow."""
WIDTHS: Final = {False: 0.12, True: 0.25}
"""mm of contours, and of index contours."""
CROWDED: Final = 0.26
"""mm between contours under which only index contours are drawn."""
SHORTEST: Final = 0.8
"""mm of a piece of a line that is worth being drawn."""
AIR: Final = 0.3
"""mm between a label and the lines around it."""


def contour_lines(
    contours: Sequence[Contour], ground: MapGround, frame: Frame, labels: Sequence[Words], interval: float
) -> list[Lines]:
    """Return the lines to draw, one set a pen.

    Parameters
    ----------
    contours
    ground
    frame
    labels
        Whatever stands on the contours: they keep off it.
    interval
        Of the contours (m).
    """
    kind = covers(ground)
    south, east = np.gradient(ground.even, ground.spacing[1], ground.spacing[0])
    apart = interval / np.maximum(np.hypot(south, east), 1e-6) * frame.metre
    boxes = [corners_of(words, air=AIR) for words in labels]
    paths: dict[tuple[bool, int], list[Floats]] = {
        (index, code): [] for index in (False, True) for code in range(len(PENS))
    }
    for contour in contours:
        path = frame.place(contour.places)
        drawn = (sampled(ground.depth, ground, contour.places) < 0.0) & _outside(path, boxes)
        if not contour.index:
            drawn &= sampled(apart, ground, contour.places) > CROWDED
        # One code a vertex; −1 is not drawn.
        code = np.where(drawn, np.rint(sampled(kind, ground, contour.places)), -1).astype(int)
        for piece, of in _runs(path, code):
            if np.hypot(*np.diff(piece, axis=0).T).sum() >= SHORTEST:
                paths[contour.index, of].append(simplified(piece))
    return [
        Lines(paths[index, code], colour, WIDTHS[index])
        for index in (False, True)
        for code, colour in enumerate(PENS.values())
        if paths[index, code]
    ]


def covers(ground: MapGround) -> npt.NDArray[np.float32]:
    """Return which of the pens belongs to the ground at each sample."""
    stone = ground.share("rock", "scree") > 0.5
    return np.where(ground.share("snow") > 0.5, 2, np.where(stone, 1, 0)).astype(np.float32)


def _runs(path: Floats, code: npt.NDArray[np.intp]) -> list[tuple[Floats, int]]:
    """Cut a path where its code changes; pieces with a code reach to the next one's first point."""
    cuts = np.flatnonzero(np.diff(code)) + 1
    starts, ends = np.concatenate([[0], cuts]), np.concatenate([cuts, [len(code)]])
    pieces = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        of = int(code[start])
        until = min(end + 1, len(path)) if end < len(code) and code[end] >= 0 else end
        if of >= 0 and until - start >= 2:
            pieces.append((path[start:until], of))
    return pieces


def _outside(path: Floats, boxes: Sequence[Floats]) -> Flags:
    """Tell which points lie in none of the boxes, (4, 2) corners in turn."""
    free = np.ones(len(path), bool)
    low, high = path.min(axis=0), path.max(axis=0)
    for box in boxes:
        if (box.max(axis=0) < low).any() or (box.min(axis=0) > high).any():
            continue
        inside = np.ones(len(path), bool)
        for here, there in zip(box, np.roll(box, -1, axis=0), strict=True):
            side, off = there - here, path - here
            inside &= side[0] * off[:, 1] - side[1] * off[:, 0] >= 0.0
        free &= ~inside
    return free
