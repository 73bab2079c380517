"""Centripetal Catmull-Rom splines: no cusps and no loops within a segment (Yuksel et al. 2011)."""

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError


def drop_repeats(points: Float64Array, *, of: int | None = None) -> Float64Array:
    """Drop points that equal the one before them in the first `of` columns (all by default)."""
    distinct = np.ones(len(points), dtype=np.bool_)
    distinct[1:] = (np.diff(points[:, :of], axis=0) != 0.0).any(axis=1)
    return points[distinct]


def arc_length(path: Float64Array) -> Float64Array:
    """Return the length along a path, in x and y, from its first point to each."""
    steps = np.sqrt((np.diff(path[:, :2], axis=0) ** 2).sum(axis=1))
    return np.concatenate([[0.0], np.cumsum(steps)])


def at_lengths(path: Float64Array, arc: Float64Array, lengths: Float64Array) -> Float64Array:
    """Return the points of a path at lengths, of which `arc` are those of its own points."""
    return np.stack([np.interp(lengths, arc, column) for column in path.T], axis=-1)


def catmull_rom(points: Float64Array, u: Float64Array) -> Float64Array:
    """Evaluate the curve through control points (n, d) at positions `u` (m,) in 0 … n - 1; (m, d).

    The whole part of `u` is the segment; at whole `u` the result is the control point, bit for bit. The ends
    are continued by reflection. Raises InputError for fewer than two points or equal neighbours.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or len(points) < 2 or len(drop_repeats(points)) < len(points):
        raise InputError(
            f"expected two or more points with no two neighbours equal, got an array of shape {points.shape}"
        )
    ends = 2.0 * points[[0, -1]] - points[[1, -2]]
    padded = np.concatenate([ends[:1], points, ends[1:]])
    segment = np.clip(np.floor(u).astype(np.intp), 0, len(points) - 2)
    fraction = (np.asarray(u, dtype=np.float64) - segment)[:, None]
    p0, p1, p2, p3 = (padded[segment + i] for i in range(4))
    first, middle, last = (_root_chord(a, b) for a, b in ((p0, p1), (p1, p2), (p2, p3)))

    # Barry & Goldman's pyramid, with the knots counted from p1.
    t = fraction * middle
    a1 = p1 + (p1 - p0) * (t / first)
    a2 = p1 + (p2 - p1) * fraction
    a3 = p2 + (p3 - p2) * ((t - middle) / last)
    b1 = a1 + (a2 - a1) * ((t + first) / (first + middle))
    b2 = a2 + (a3 - a2) * (t / (middle + last))
    curve = b1 + (b2 - b1) * fraction
    curve = np.where(fraction == 0.0, p1, np.where(fraction == 1.0, p2, curve))
    return np.asarray(curve)


def cubics(points: Float64Array) -> Float64Array:
    """Return curves through control points (…, n, d) as cubic polynomials of each segment, (…, n - 1, d, 4).

    Segment k is ``c[k] @ [1, t, t², t³]`` for t from 0 to 1; the same curve as `catmull_rom`.
    """
    ends = 2.0 * points[..., [0, -1], :] - points[..., [1, -2], :]
    p = np.concatenate([ends[..., :1, :], points, ends[..., 1:, :]], axis=-2)
    step = np.diff(p, axis=-2)
    # Not a power of ¼: its last bits depend on the CPU.
    knots = np.sqrt(np.sqrt((step**2).sum(axis=-1, keepdims=True)))
    # The slope at a control point: the derivative there of Barry & Goldman's pyramid.
    before, after = step[..., :-1, :] / knots[..., :-1, :], step[..., 1:, :] / knots[..., 1:, :]
    across = (p[..., 2:, :] - p[..., :-2, :]) / (knots[..., :-1, :] + knots[..., 1:, :])
    slope, middle, chord = before + after - across, knots[..., 1:-1, :], step[..., 1:-1, :]
    leaving, arriving = middle * slope[..., :-1, :], middle * slope[..., 1:, :]
    powers = [
        points[..., :-1, :],
        leaving,
        3.0 * chord - 2.0 * leaving - arriving,
        leaving + arriving - 2.0 * chord,
    ]
    return np.stack(powers, axis=-1)


def sample_catmull_rom(
    points: Float64Array, step: float, *, sagitta: float = np.inf, most: float = np.inf
) -> tuple[Float64Array, Float64Array]:
    """Return samples of the curve at most about `step` apart, (m, d), and their positions `u`, (m,).

    Every control point is among them, bit for bit, at whole `u`. `sagitta` bounds the deviation of the curve
    from straight lines between samples, with up to `most` samples per segment.
    """
    chord = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    # Two at least, so that a bend between two control points is never cut; 5 % for the arc over its chord.
    counts = np.maximum(np.ceil(1.05 * chord / step), 2.0)
    # Over a part h of a segment a chord misses the curve by |c''| h²/8; c'' is linear, so greatest at an end.
    c = cubics(points)
    bend = np.maximum(*(np.sqrt((part**2).sum(axis=-1)) for part in (c[..., 2], c[..., 2] + 3.0 * c[..., 3])))
    counts = np.maximum(counts, np.minimum(np.ceil(np.sqrt(bend / (4.0 * sagitta))), most)).astype(np.intp)
    segment = np.repeat(np.arange(len(chord)), counts)
    within = np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)
    u = np.append(segment + within / counts[segment], float(len(chord)))
    return catmull_rom(points, u), u


def _root_chord(a: Float64Array, b: Float64Array) -> Float64Array:
    squares: Float64Array = ((b - a) ** 2).sum(axis=1)[:, None]
    return np.sqrt(np.sqrt(squares))
