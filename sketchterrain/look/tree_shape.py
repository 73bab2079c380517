"""Geometry of plants: leaves as vectors along and across them, and coloured triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.array_types import Float64Array


SOLID, BANDED, BROAD, NEEDLES = 0.0, 0.125, 0.5, 1.0
"""Alpha mask (kernels/render/sprig.glsl): none on furrowed or banded bark, leaf pairs, needles."""


class Leaves(NamedTuple):
    """Sprays of leaves, in heights of the plant."""

    root: Float64Array  # (n, 3)
    along: Float64Array  # (n, 3) from root to tip
    across: Float64Array  # (n, 3) half the width
    normal: Float64Array  # (n, 3) unit normals that light them
    albedo: Float64Array  # (n, 3)
    phase: Float64Array  # (n,) 0..1, of its bough in the wind


class Triangles(NamedTuple):
    """Triangles with their vertex attributes."""

    position: Float64Array  # (n, 3, 3)
    normal: Float64Array  # (n, 3, 3)
    albedo: Float64Array  # (n, 3, 3)
    openness: Float64Array  # (n, 3) openness to sky and sun, 0..1
    leaf_uv: Float64Array  # (n, 3, 2) across -1..1 and along 0..1
    mask: Float64Array  # (n,) what is cut out: `SOLID`, `BANDED`, `BROAD` or `NEEDLES`
    leafiness: Float64Array  # (n,) 0 wood … 1 leaf: lets light through and flutters
    phase: Float64Array  # (n,) 0..1


def unit(vectors: Float64Array) -> Float64Array:
    """Normalise vectors."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def perpendicular(vectors: Float64Array) -> Float64Array:
    """Return a unit vector perpendicular to each of (…, 3) vectors, horizontal where possible."""
    across = np.cross(vectors, [0.0, 0.0, 1.0])
    upright = np.linalg.norm(across, axis=-1, keepdims=True) < 1e-3 * np.linalg.norm(
        vectors, axis=-1, keepdims=True
    )
    return unit(np.where(upright, np.cross(vectors, [1.0, 0.0, 0.0]), across))


def joined_triangles(parts: Sequence[Triangles]) -> Triangles:
    """Concatenate triangles."""
    return Triangles(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
