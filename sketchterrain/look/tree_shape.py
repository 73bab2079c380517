"""Geometry of plants: leaves as vectors along and across them, and coloured triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]


SOLID, BANDED, BROAD, NEEDLES = 0.0, 0.125, 0.5, 1.0
"""Alpha mask (kernels/render/sprig.glsl): none on furrowed or banded bark, leaf pairs, needles."""


class Leaves(NamedTuple):
    """Sprays of leaves, in heights of the plant."""

    root: Floats  # (n, 3)
    along: Floats  # (n, 3) from root to tip
    across: Floats  # (n, 3) half the width
    normal: Floats  # (n, 3) unit normals that light them
    albedo: Floats  # (n, 3)
    phase: Floats  # (n,) 0..1, of its bough in the wind


class Triangles(NamedTuple):
    """Triangles with their vertex attributes."""

    position: Floats  # (n, 3, 3)
    normal: Floats  # (n, 3, 3)
    albedo: Floats  # (n, 3, 3)
    openness: Floats  # (n, 3) openness to sky and sun, 0..1
    leaf_uv: Floats  # (n, 3, 2) across -1..1 and along 0..1
    mask: Floats  # (n,) what is cut out: `SOLID`, `BANDED`, `BROAD` or `NEEDLES`
    leafiness: Floats  # (n,) 0 wood … 1 leaf: lets light through and flutters
    phase: Floats  # (n,) 0..1


def unit(vectors: Floats) -> Floats:
    """Normalise vectors."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def perpendicular(vectors: Floats) -> Floats:
    """Return a unit vector perpendicular to each of (…, 3) vectors, horizontal where possible."""
    across = np.cross(vectors, [0.0, 0.0, 1.0])
    upright = np.linalg.norm(across, axis=-1, keepdims=True) < 1e-3 * np.linalg.norm(
        vectors, axis=-1, keepdims=True
    )
    return unit(np.where(upright, np.cross(vectors, [1.0, 0.0, 0.0]), across))


def joined_triangles(parts: Sequence[Triangles]) -> Triangles:
    """Concatenate triangles."""
    return Triangles(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
