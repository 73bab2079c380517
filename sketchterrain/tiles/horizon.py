"""Which tiles lie behind nearer ground: a horizon about the eye, raised by tiles from near to far.

Ground is nowhere lower than its tile's box. So in all directions that lie wholly within a tile, what is
farther away and lower than the line over the box's bottom cannot be seen. Nothing that can be seen is ever
called hidden.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.tiles.codes import Boxes
    from sketchterrain.tiles.view import View

    Floats = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int64]

__all__ = ["behind_ground"]

_BEARINGS: Final = 2048
"""Of the horizon, all round."""
_SHELL: Final = 1.25
"""Ratio of distances up to which tiles are judged by the same horizon."""


def behind_ground(view: View, boxes: Boxes) -> npt.NDArray[np.bool_]:
    """Tell which tiles others hide wholly.

    Parameters
    ----------
    view
        From where; only the eye counts.
    boxes
        Tiles that are drawn, beside one another; each holds its ground.

    Returns
    -------
    (n,) bool
    """
    hidden = np.zeros(len(boxes.low), np.bool_)
    eye = np.asarray(view.eye)
    near, far = _distances(view, boxes)
    beside = near > 0.0
    first, last = _bearings(eye, boxes)
    least = _tangent(boxes.low[:, 2] - eye[2], far, near)
    most = _tangent(boxes.high[:, 2] - eye[2], near, far)
    horizon = np.full(_BEARINGS, -np.inf)
    by_far = np.argsort(far)
    by_far = by_far[beside[by_far]]
    raised = 0
    shell = np.floor(np.log(np.maximum(near, 1e-3)) / np.log(_SHELL))
    for number in np.unique(shell[beside]):
        here = np.flatnonzero(beside & (shell == number))
        nearer = int(np.searchsorted(far[by_far], near[here].min(), side="right"))
        if nearer > raised:
            some = by_far[raised:nearer]
            tile, bearing = _spread(np.ceil(first[some]), np.floor(last[some]))
            np.maximum.at(horizon, bearing, least[some][tile])
            raised = nearer
        if raised:
            tile, bearing = _spread(np.floor(first[here]), np.ceil(last[here]))
            lowest = np.full(len(here), np.inf)
            np.minimum.at(lowest, tile, horizon[bearing])
            hidden[here] = most[here] < lowest
    return hidden


def _distances(view: View, boxes: Boxes) -> tuple[Floats, Floats]:
    """Return the horizontal distances from the eye to the nearest and farthest of boxes, m."""
    eye = np.asarray(view.eye[:2])
    apart = np.maximum(np.maximum(boxes.low[:, :2] - eye, eye - boxes.high[:, :2]), 0.0)
    away = np.maximum(np.abs(boxes.low[:, :2] - eye), np.abs(boxes.high[:, :2] - eye))
    return np.hypot(apart[:, 0], apart[:, 1]), np.hypot(away[:, 0], away[:, 1])


def _bearings(eye: Floats, boxes: Boxes) -> tuple[Floats, Floats]:
    """Return between which bearings, in the horizon's steps, boxes lie that the eye is not in."""
    middle = 0.5 * (boxes.low + boxes.high) - eye
    to_middle = np.arctan2(middle[:, 1], middle[:, 0])
    west, east = boxes.low[:, 0] - eye[0], boxes.high[:, 0] - eye[0]
    south, north = boxes.low[:, 1] - eye[1], boxes.high[:, 1] - eye[1]
    to_corners = np.arctan2([south, south, north, north], [west, east, west, east])
    turn = (to_corners - to_middle + np.pi) % (2 * np.pi) - np.pi
    step = 2 * np.pi / _BEARINGS
    return (to_middle + turn.min(axis=0)) / step, (to_middle + turn.max(axis=0)) / step


def _tangent(height: Floats, when_above: Floats, when_below: Floats) -> Floats:
    """Return heights over one distance where they are above the eye, over the other where they are below."""
    distance = np.where(height > 0, when_above, when_below)
    return np.asarray(height / np.maximum(distance, 1e-9))


def _spread(first: Floats, last: Floats) -> tuple[Ints, Ints]:
    """Return the numbers of things and each of the steps first … last - 1 of theirs, on a circle."""
    count = np.maximum(last - first, 0.0).astype(np.int64)
    tile = np.repeat(np.arange(len(first)), count)
    along = np.arange(len(tile)) - np.repeat(np.cumsum(count) - count, count)
    return tile, (first.astype(np.int64)[tile] + along) % _BEARINGS
