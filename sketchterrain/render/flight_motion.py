"""Smooth motion through the keys of a flight."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.features.splines import catmull_rom

if TYPE_CHECKING:
    from sketchterrain.render.camera import Floats

_PER_SEGMENT: Final = 64
"""Samples of the curve between two keys, for the length of its arc."""
_MOMENT: Final = 1e-5
"""s, over which a velocity is measured."""
_APART: Final = 1e-3
"""m between two points of the curve, at least."""


class Motion:
    """An eye that goes along a curve, by a schedule, and looks along directions that turn.

    How far along the curve it is, and where it looks, follow the keys by monotone cubics (Fritsch & Carlson),
    which never overshoot: a camera that halts, halts.
    """

    def __init__(self, times: Floats, eyes: Floats, targets: Floats, fovs: Floats) -> None:
        from scipy.interpolate import PchipInterpolator  # takes half a second: only for whoever flies

        self._end = float(times[-1])
        self._points, knot = _places(eyes)
        if len(self._points) > 1:
            # Centripetal knots: over them the curve's velocity has no jumps.
            self._knots = _sums(np.sqrt(np.linalg.norm(np.diff(self._points, axis=0), axis=1)))
            u = np.linspace(0.0, len(self._points) - 1.0, _PER_SEGMENT * (len(self._points) - 1) + 1)
            curve = catmull_rom(self._points, u)
            arc = _sums(np.linalg.norm(np.diff(curve, axis=0), axis=1))
            self._place = PchipInterpolator(arc, np.interp(u, np.arange(len(self._knots)), self._knots))
            self._arc = PchipInterpolator(times, arc[::_PER_SEGMENT][knot])
        self._look = PchipInterpolator(times, np.column_stack([*_looks(targets - eyes), fovs]))

    def at(self, times: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return eyes (n, 3), targets (n, 3), fields of view (n,) and velocities (n, 3) at times (s)."""
        times = np.clip(times, 0.0, self._end)
        eye = self._eye(times)
        heading, pitch, distance, fov = self._look(times).T
        level = np.cos(pitch)
        along = np.stack([np.sin(heading) * level, np.cos(heading) * level, np.sin(pitch)], axis=1)
        before, after = np.maximum(times - _MOMENT, 0.0), np.minimum(times + _MOMENT, self._end)
        velocity = (self._eye(after) - self._eye(before)) / (after - before)[:, None]
        return eye, eye + np.exp(distance)[:, None] * along, fov, velocity

    def _eye(self, times: Floats) -> Floats:
        if len(self._points) == 1:
            return np.repeat(self._points, len(times), axis=0)
        knot = self._place(self._arc(times))
        return catmull_rom(self._points, np.interp(knot, self._knots, np.arange(len(self._knots))))


def _sums(steps: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(steps)])


def _places(eyes: Floats) -> tuple[Floats, list[int]]:
    """Return the points that a curve goes through, and at which of them each eye is."""
    points, knots = [eyes[0]], [0]
    for eye in eyes[1:]:
        if float(np.abs(eye - points[-1]).max()) > _APART:
            points.append(eye)
        knots.append(len(points) - 1)
    return np.array(points), knots


def _looks(along: Floats) -> tuple[Floats, Floats, Floats]:
    """Return headings without jumps, pitches (radians) and logarithms of lengths of (n, 3) vectors."""
    length = np.linalg.norm(along, axis=1)
    level = np.hypot(along[:, 0], along[:, 1])
    heading = np.arctan2(along[:, 0], along[:, 1])
    # Straight up or down there is no heading: the key before lends its own, or else the first that has one.
    has_one = level > 1e-9 * length
    last = np.maximum.accumulate(np.where(has_one, np.arange(len(along)), -1))
    first = int(np.argmax(has_one))
    heading = np.unwrap(heading[np.where(last < 0, first, last)])
    return heading, np.arctan2(along[:, 2], level), np.log(length)
