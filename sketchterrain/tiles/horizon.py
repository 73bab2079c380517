"""Horizon culling: tiles hidden behind nearer terrain, by a horizon raised from near to far.

Terrain is nowhere lower than its tile's box. So in all bearings that lie wholly within a tile, everything
farther away and below the line over the box's bottom is hidden. Conservative: nothing visible is ever culled.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.tiles.metrics import horizontal_distances

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array, Int64Array
    from sketchterrain.tiles.codes import Boxes
    from sketchterrain.tiles.view import CameraView


_BEARINGS: Final = 2048
"""Of the horizon, all round."""
_SHELL: Final = 1.15
"""Ratio of distances up to which tiles are judged by the same horizon."""


def occluded(view: CameraView, boxes: Boxes, ground: Boxes | None = None) -> npt.NDArray[np.bool_]:
    """Return which boxes, (n,), are hidden by `ground` boxes side by side (default: by each other)."""
    hidden = np.zeros(len(boxes.low), np.bool_)
    eye = np.asarray(view.eye)
    near, far = horizontal_distances(view, boxes)
    first, last = _bearings(eye, boxes)
    most = _tangent(boxes.high[:, 2] - eye[2], near, far)
    rising = _Horizon(view, boxes if ground is None else ground)
    shell = np.floor(np.log(np.maximum(near, 1e-3)) / np.log(_SHELL))
    beside = near > 0.0
    for number in np.unique(shell[beside]):
        here = np.flatnonzero(beside & (shell == number))
        # Not the nearest of these: whether a tile is hidden must not depend on which others are asked about.
        horizon = rising.up_to(_SHELL**number * (1 - 1e-9))
        tile, bearing = _spread(np.floor(first[here]), np.ceil(last[here]))
        lowest = np.full(len(here), np.inf)
        np.minimum.at(lowest, tile, horizon[bearing])
        hidden[here] = most[here] < lowest
    return hidden


class _Horizon:
    """Horizon formed by terrain boxes, from near to far."""

    def __init__(self, view: CameraView, ground: Boxes) -> None:
        near, far = horizontal_distances(view, ground)
        order = np.argsort(far)
        order = order[near[order] > 0.0]
        first, last = _bearings(np.asarray(view.eye), ground)
        # Only bearings that lie wholly within a tile are sure to meet it.
        self._first, self._last = np.ceil(first[order]), np.floor(last[order])
        self._far = far[order]
        self._least = _tangent(ground.low[:, 2] - view.eye[2], far, near)[order]
        self._horizon = np.full(_BEARINGS, -np.inf)
        self._raised = 0

    def up_to(self, distance: float) -> Float64Array:
        """Return the tangents that terrain within a distance (m) hides; distances must not decrease."""
        end = int(np.searchsorted(self._far, distance, side="right"))
        if end > self._raised:
            some = slice(self._raised, end)
            tile, bearing = _spread(self._first[some], self._last[some])
            np.maximum.at(self._horizon, bearing, self._least[some][tile])
            self._raised = end
        return self._horizon


def _bearings(eye: Float64Array, boxes: Boxes) -> tuple[Float64Array, Float64Array]:
    """Return first and last bearing, in horizon steps, of boxes that the eye is not in."""
    middle = 0.5 * (boxes.low + boxes.high) - eye
    to_middle = np.arctan2(middle[:, 1], middle[:, 0])
    west, east = boxes.low[:, 0] - eye[0], boxes.high[:, 0] - eye[0]
    south, north = boxes.low[:, 1] - eye[1], boxes.high[:, 1] - eye[1]
    to_corners = np.arctan2([south, south, north, north], [west, east, west, east])
    turn = (to_corners - to_middle + np.pi) % (2 * np.pi) - np.pi
    step = 2 * np.pi / _BEARINGS
    return (to_middle + turn.min(axis=0)) / step, (to_middle + turn.max(axis=0)) / step


def _tangent(height: Float64Array, when_above: Float64Array, when_below: Float64Array) -> Float64Array:
    """Return heights over one distance where above the eye, over the other where below."""
    distance = np.where(height > 0, when_above, when_below)
    return np.asarray(height / np.maximum(distance, 1e-9))


def _spread(first: Float64Array, last: Float64Array) -> tuple[Int64Array, Int64Array]:
    """Return (item, step) pairs: each item repeated for its steps first … last - 1, on a circle."""
    count = np.maximum(last - first, 0.0).astype(np.int64)
    tile = np.repeat(np.arange(len(first)), count)
    along = np.arange(len(tile)) - np.repeat(np.cumsum(count) - count, count)
    return tile, (first.astype(np.int64)[tile] + along) % _BEARINGS
