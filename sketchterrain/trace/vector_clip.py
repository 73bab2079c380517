"""Lines and areas cut to a rectangle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Box = tuple[float, float, float, float]
    Places = npt.NDArray[np.float64]

__all__ = ["ring_in", "segments_in", "segments_of"]


def segments_of(line: Places) -> Places:
    """Return a line's (n − 1, 2, 2) segments, from point to point; of a single point one of no length."""
    return np.stack([line[:-1], line[1:]], axis=1) if len(line) > 1 else np.stack([line, line], axis=1)


def segments_in(segments: Places, box: Box) -> Places:
    """Return the parts of segments that lie in a rectangle (Liang and Barsky 1984).

    Parameters
    ----------
    segments
        (n, 2, 2): from x, y to x, y.
    box
        West, south, east, north; all of it belongs to it.
    """
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    enters, leaves = np.zeros(len(segments)), np.ones(len(segments))
    there = np.ones(len(segments), dtype=np.bool_)
    for axis in range(2):
        for sign, edge in ((-1.0, -box[axis]), (1.0, box[axis + 2])):
            # Where sign · (start + t · along) ≤ edge.
            speed, room = sign * along[:, axis], edge - sign * start[:, axis]
            there &= (speed != 0) | (room >= 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                time = room / speed
            enters = np.where(speed < 0, np.maximum(enters, time), enters)
            leaves = np.where(speed > 0, np.minimum(leaves, time), leaves)
    there &= enters <= leaves
    start, along = start[there], along[there]
    ends = [start + along * time[there, None] for time in (enters, leaves)]
    return np.stack(ends, axis=1)


def ring_in(ring: Places, box: Box) -> Places:
    """Return a ring cut to a rectangle (Sutherland and Hodgman 1974).

    What the ring goes around within the rectangle, the result goes around too; it may run along the edges.

    Parameters
    ----------
    ring
        (n, 2), the last point is the first.
    box
        West, south, east, north.

    Returns
    -------
    (m, 2) float64
        Closed; empty if nothing is left.
    """
    for axis in range(2):
        for sign, edge in ((-1.0, -box[axis]), (1.0, box[axis + 2])):
            if len(ring) == 0:
                return ring
            room = edge - sign * ring[:, axis]
            inside = room >= 0
            if inside.all():
                continue
            # Each edge gives its start, if that is inside, and the place where it crosses, if it does.
            share = room[:-1] / np.where(room[:-1] == room[1:], 1.0, room[:-1] - room[1:])
            crossing = ring[:-1] + share[:, None] * (ring[1:] - ring[:-1])
            crossing[:, axis] = sign * edge
            both = np.stack([ring[:-1], crossing], axis=1).reshape(-1, 2)
            kept = both[np.stack([inside[:-1], inside[:-1] != inside[1:]], axis=1).ravel()]
            ring = np.concatenate([kept, kept[:1]])
    return ring
