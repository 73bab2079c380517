"""Splines flattened to circular arcs or straight pieces within a tolerance, and the distance to an arc.

An arc through the ends of a piece of length L misses the curve by about κ′L³/125 where a chord misses it by
κL²/8 (κ: curvature, κ′: its change a metre): a few arcs do what many chords do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Reals = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.intp]

_CHECKS = 15  # places inside a piece where the curve is compared
_SHARE = 0.9  # of the tolerance that may be seen there: the rest is for what lies between, and for rounding
_MOST_BEND = 0.25  # a tangent: no arc of more than 56°, so that places have one nearest point beside it
_MOST_HALVINGS = 24
_CENTRE = 1e-4  # as CENTRE in kernels/spline_arcs.clh
_POINT = 1e-12  # m: a chord so short is a point


@dataclass(frozen=True)
class Pieces:
    """Pieces of cubics, in order.

    Attributes
    ----------
    cubic : (n,) int
        Index of the cubic that each belongs to.
    first, last : (n,) float64
        Where on the cubic each begins and ends, 0 … 1.
    bend : (n,) float64
        See `nearest_on_arc`; 0 for straight ones.
    """

    cubic: Ints
    first: Reals
    last: Reals
    bend: Reals


def position(cubics: Reals, t: Reals) -> Reals:
    """Evaluate cubics (n, 2, 4) at t (n, ...): shape (n, ..., 2)."""
    t = t[..., None]
    c = cubics.reshape(len(cubics), *([1] * (t.ndim - 2)), 2, 4)
    return np.asarray(((c[..., 3] * t + c[..., 2]) * t + c[..., 1]) * t + c[..., 0])


def flattened(
    cubics: Reals,
    tolerance: float,
    *,
    arcs: bool = True,
    spans: tuple[Ints, Reals, Reals] | None = None,
) -> Pieces:
    """Cut cubics in halves until each piece lies within the tolerance of an arc between its ends.

    Parameters
    ----------
    cubics : (n, 2, 4) float64
        As `sketchterrain.features.splines.cubics` makes them.
    tolerance : float
        Metres, > 0: no place is so much nearer to the curve than to the pieces, or farther.
    arcs : bool
        Or straight pieces.
    spans : (cubic, first, last), optional
        Stretches to cut instead of whole cubics; their ends are kept.
    """
    if spans is None:
        spans = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    cubic, first, last = spans
    done: list[tuple[Ints, Reals, Reals, Reals]] = []
    for halving in range(_MOST_HALVINGS + 1):
        bend, missed = _fitted(cubics[cubic], first, last, arcs=arcs)
        good = (missed <= _SHARE * tolerance) | (halving == _MOST_HALVINGS)
        done.append((cubic[good], first[good], last[good], bend[good]))
        cubic, first, last = cubic[~good], first[~good], last[~good]
        if not cubic.size:
            break
        middle = 0.5 * (first + last)
        cubic = np.repeat(cubic, 2)
        first, last = np.stack([first, middle], -1).ravel(), np.stack([middle, last], -1).ravel()
    cubic, first, last, bend = (np.concatenate(each) for each in zip(*done, strict=True))
    order = np.lexsort((first, cubic))
    return Pieces(cubic[order], first[order], last[order], bend[order])


def _fitted(cubics: Reals, first: Reals, last: Reals, *, arcs: bool) -> tuple[Reals, Reals]:
    """Bend of the arc nearest to each stretch, and how far (m) the stretch strays from it."""
    share = np.linspace(0.0, 1.0, _CHECKS + 2)
    at = position(cubics, first[:, None] + (last - first)[:, None] * share)
    chord, seen = at[:, -1] - at[:, 0], at[:, 1:-1] - at[:, :1]
    length2 = np.maximum((chord**2).sum(axis=-1), _POINT**2)[:, None]
    bend = np.zeros(len(cubics))
    if arcs:
        u = (seen * chord[:, None]).sum(axis=-1) / length2
        v = (chord[:, None, 0] * seen[..., 1] - chord[:, None, 1] * seen[..., 0]) / length2
        q = u - u * u - v * v
        # tan of half the arc's angle, by least squares: the circle is tan (u - u² - v²) = v.
        tangent = (v * q).sum(axis=-1) / np.maximum((q * q).sum(axis=-1), 1e-300)
        bend = tangent / (1.0 + np.sqrt(1.0 + tangent * tangent))
        bend = np.clip(bend, -_MOST_BEND, _MOST_BEND)
    _, square = nearest_on_arc(chord[:, None], bend[:, None], seen)
    return bend, np.sqrt(square.max(axis=-1))


def nearest_on_arc(chord: Reals, bend: Reals, seen: Reals) -> tuple[Reals, Reals]:
    """Return the nearest point of an arc, as ``kernels/spline_arcs.clh`` does; its comment has the formula.

    Parameters
    ----------
    chord : (..., 2) float64
        Vector from the arc's start to its end (m).
    bend : (...,) float64
        Tangent of a quarter of the arc's angle; positive bulges to the left.
    seen : (..., 2) float64
        The place, from the arc's start (m).

    Returns
    -------
    t : (...,) float64
        0 … 1 along the arc.
    square : (...,) float64
        Squared distance, m².
    """
    length2 = np.maximum((chord**2).sum(axis=-1), _POINT**2)
    u = (seen * chord).sum(axis=-1) / length2
    v = (chord[..., 0] * seen[..., 1] - chord[..., 1] * seen[..., 0]) / length2
    cosine, whole = 1.0 - bend * bend, 1.0 + bend * bend
    towards, beside = cosine + 4.0 * bend * v, u - 0.5
    t = 0.5 + beside * cosine / np.maximum(towards, _CENTRE)
    t = np.where(towards < _CENTRE, np.where(beside < 0.0, -1.0, 2.0), t)
    foot = np.clip(t, 0.0, 1.0)
    g = 2.0 * bend * (u * u - u + v * v) + cosine * v
    off = 2.0 * g / (whole + np.sqrt(np.maximum(whole * whole + 8.0 * bend * g, 0.0)))
    square = np.where(foot == t, off * off, (u - foot) ** 2 + v * v)
    return foot, square * (chord**2).sum(axis=-1)
