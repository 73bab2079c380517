"""Splines flattened to circular arcs or chords within a tolerance, and the distance to an arc.

An arc through the ends of a piece of length L misses the curve by about κ′L³/125 where a chord misses it by
κL²/8 (κ: curvature, κ′: its derivative): few arcs replace many chords.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array

    Ints = npt.NDArray[np.intp]

_CHECKS = 15  # samples inside a piece where the curve is compared
_SHARE = 0.9  # of the tolerance allowed at the samples: the rest is for what lies between, and for rounding
_MAX_BEND = 0.25  # a tangent: no arc of more than 56°, so that points beside it have one nearest point
_MAX_HALVINGS = 24
_CENTRE = 1e-4  # as CENTRE in kernels/spline_arcs.clh
_POINT = 1e-12  # m: shorter chords are points


@dataclass(frozen=True)
class Pieces:
    """Pieces of cubics, in order, shape (n,) each: the cubic, its parameters 0 … 1 at both ends, the bend."""

    cubic: Ints
    first: Float64Array
    last: Float64Array
    bend: Float64Array


def position(cubics: Float64Array, t: Float64Array) -> Float64Array:
    """Evaluate cubics (n, 2, 4) at t (n, ...): shape (n, ..., 2)."""
    t = t[..., None]
    c = cubics.reshape(len(cubics), *([1] * (t.ndim - 2)), 2, 4)
    return np.asarray(((c[..., 3] * t + c[..., 2]) * t + c[..., 1]) * t + c[..., 0])


def flatten(
    cubics: Float64Array,
    tolerance: float,
    *,
    arcs: bool = True,
    spans: tuple[Ints, Float64Array, Float64Array] | None = None,
) -> Pieces:
    """Bisect cubics (n, 2, 4) until each piece is within the tolerance (m) of an arc or chord.

    ``spans`` (cubic, first, last) are stretches to flatten instead of whole cubics; their ends stay ends.
    """
    if spans is None:
        spans = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    cubic, first, last = spans
    done: list[tuple[Ints, Float64Array, Float64Array, Float64Array]] = []
    for halving in range(_MAX_HALVINGS + 1):
        bend, missed = _fit_arcs(cubics[cubic], first, last, arcs=arcs)
        good = (missed <= _SHARE * tolerance) | (halving == _MAX_HALVINGS)
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


def _fit_arcs(
    cubics: Float64Array, first: Float64Array, last: Float64Array, *, arcs: bool
) -> tuple[Float64Array, Float64Array]:
    """Return the bend of the best arc for each stretch, and its maximum distance (m) from the curve."""
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
        bend = np.clip(bend, -_MAX_BEND, _MAX_BEND)
    _, square = nearest_on_arc(chord[:, None], bend[:, None], seen)
    return bend, np.sqrt(square.max(axis=-1))


def nearest_on_arc(
    chord: Float64Array, bend: Float64Array, seen: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return the nearest point of an arc: parameter t (0 … 1) and squared distance (m²).

    ``chord`` runs from the arc's start to its end, ``seen`` from its start to the point (m); ``bend`` is the
    tangent of a quarter of the arc's angle, positive to the left. Derivation: ``kernels/spline_arcs.clh``.
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
