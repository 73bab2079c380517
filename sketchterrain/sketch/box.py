"""Pixel rectangles of a layer."""

from __future__ import annotations

Box = tuple[int, int, int, int]
"""Top, left, bottom, right: rows and columns of a sketch, the last two exclusive."""


def union_box(a: Box | None, b: Box | None) -> Box | None:
    """Return the bounding box of two boxes, either of which may be missing."""
    if a is None or b is None:
        return a or b
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])
