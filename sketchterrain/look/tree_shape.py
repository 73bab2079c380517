"""What plants are made of: leaves, each a vector along and one across; triangles with colours."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["BANDED", "BROAD", "NEEDLES", "SOLID", "Leaves", "Triangles", "across", "joined_triangles", "unit"]

SOLID, BANDED, BROAD, NEEDLES = 0.0, 0.125, 0.5, 1.0
"""What is cut out of a piece: nothing, of furrowed bark or of banded; pairs of leaves; a comb of needles.

See kernels/render/sprig.glsl.
"""


class Leaves(NamedTuple):
    """Sprays of leaves, in heights of the plant."""

    root: Floats  # (n, 3)
    along: Floats  # (n, 3) from root to tip
    aside: Floats  # (n, 3) half the width
    outward: Floats  # (n, 3) unit normals that light them
    albedo: Floats  # (n, 3)
    phase: Floats  # (n,) 0..1, of its bough in the wind


class Triangles(NamedTuple):
    """Triangles, each corner with all that is drawn of it."""

    place: Floats  # (n, 3, 3)
    outward: Floats  # (n, 3, 3)
    albedo: Floats  # (n, 3, 3)
    open: Floats  # (n, 3) openness to sky and sun, 0..1
    sprig: Floats  # (n, 3, 2) across -1..1 and along 0..1
    kind: Floats  # (n,) what is cut out: `SOLID`, `BANDED`, `BROAD` or `NEEDLES`
    leafy: Floats  # (n,) 0 wood … 1 leaf: lets light through and flutters
    phase: Floats  # (n,) 0..1


def unit(vectors: Floats) -> Floats:
    """Scale vectors to length 1."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def across(vectors: Floats) -> Floats:
    """Return a unit vector at right angles to each of (…, 3) vectors; level where it can be."""
    aside = np.cross(vectors, [0.0, 0.0, 1.0])
    upright = np.linalg.norm(aside, axis=-1, keepdims=True) < 1e-3 * np.linalg.norm(
        vectors, axis=-1, keepdims=True
    )
    return unit(np.where(upright, np.cross(vectors, [1.0, 0.0, 0.0]), aside))


def joined_triangles(parts: Sequence[Triangles]) -> Triangles:
    """Put all triangles into one."""
    return Triangles(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
