"""Plant meshes: one unit high, foot at the origin, grown from fixed seeds."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

from sketchterrain.look.tree_levels import level

VERTEX: Final = np.dtype([("place", "f4", 3), ("outward", "u1", 4), ("colour", "u1", 4), ("sprig", "u1", 4)])


@cache
def plant_mesh(species: str, variant: int, detail: int) -> npt.NDArray[np.void]:
    """Return a plant's (3 · triangles,) `VERTEX` array, read-only; `detail` 0 is the finest.

    position: plant heights. normal: unit vector -1..1, then 1 for leaf or 0 for wood. colour: √albedo,
    openness. leaf_uv: position on its spray, across -1..1 and along 0..1; alpha mask; wind phase. All but
    positions are in 0..255.
    """
    triangles = level(species, variant, detail)
    mesh = np.empty(triangles.position.shape[0] * 3, VERTEX)
    mesh["place"] = triangles.position.reshape(-1, 3)
    mesh["outward"][:, :3] = _byte(0.5 + 0.5 * triangles.normal.reshape(-1, 3))
    mesh["outward"][:, 3] = _byte(np.repeat(triangles.leafiness, 3))
    mesh["colour"][:, :3] = _byte(np.sqrt(np.clip(triangles.albedo.reshape(-1, 3), 0.0, 1.0)))
    mesh["colour"][:, 3] = _byte(triangles.openness.reshape(-1))
    mesh["sprig"][:, 0] = _byte(0.5 + 0.5 * triangles.leaf_uv[..., 0].ravel())
    mesh["sprig"][:, 1] = _byte(triangles.leaf_uv[..., 1].ravel())
    mesh["sprig"][:, 2] = _byte(np.repeat(triangles.mask, 3))
    mesh["sprig"][:, 3] = _byte(np.repeat(triangles.phase, 3))
    mesh.flags.writeable = False
    return mesh


def _byte(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(np.rint(255.0 * np.clip(values, 0.0, 1.0)))
