"""Plants as triangles: one unit high, foot at the origin, grown by rules and fixed seeds."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

from sketchterrain.look.tree_levels import CUT, DETAILS, VARIANTS, level
from sketchterrain.look.tree_species import HEIGHTS, SPECIES

__all__ = ["CUT", "DETAILS", "HEIGHTS", "SPECIES", "VARIANTS", "plant_mesh"]

VERTEX: Final = np.dtype([("place", "f4", 3), ("outward", "u1", 4), ("colour", "u1", 4), ("sprig", "u1", 4)])


@cache
def plant_mesh(species: str, variant: int, detail: int) -> npt.NDArray[np.void]:
    """Make a plant.

    Parameters
    ----------
    species
        One of `SPECIES`.
    variant
        0 … ``VARIANTS - 1``: another plant of the same kind.
    detail
        0 for a plant close by … ``DETAILS - 1`` for one of a few pixels.

    Returns
    -------
    (3 · triangles,) structured, read-only
        place (plant heights); outward (unit normal, -1..1; then 1 where it is leaf, 0 where wood); colour
        (√albedo, openness); sprig (place on its spray: across -1..1, along 0..1; what is cut out of it;
        phase in the wind). All but the places in 0..255.
    """
    made = level(species, variant, detail)
    mesh = np.empty(made.place.shape[0] * 3, VERTEX)
    mesh["place"] = made.place.reshape(-1, 3)
    mesh["outward"][:, :3] = _byte(0.5 + 0.5 * made.outward.reshape(-1, 3))
    mesh["outward"][:, 3] = _byte(np.repeat(made.leafy, 3))
    mesh["colour"][:, :3] = _byte(np.sqrt(np.clip(made.albedo.reshape(-1, 3), 0.0, 1.0)))
    mesh["colour"][:, 3] = _byte(made.open.reshape(-1))
    mesh["sprig"][:, 0] = _byte(0.5 + 0.5 * made.sprig[..., 0].ravel())
    mesh["sprig"][:, 1] = _byte(made.sprig[..., 1].ravel())
    mesh["sprig"][:, 2] = _byte(np.repeat(made.kind, 3))
    mesh["sprig"][:, 3] = _byte(np.repeat(made.phase, 3))
    mesh.flags.writeable = False
    return mesh


def _byte(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(np.rint(255.0 * np.clip(values, 0.0, 1.0)))
