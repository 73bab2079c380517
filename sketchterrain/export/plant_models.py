"""Plants as a few triangles each, as tall as they grow, for programs that place many of them."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.look.tree_levels import CUT, DETAILS, VARIANTS, level
from sketchterrain.look.tree_species import HEIGHTS, SPECIES

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["COARSEST", "FINEST", "Model", "herb_model", "plant_colour", "variants_of", "woody_model"]

FINEST: Final = CUT
"""Of the levels of detail the first one whose leaves are triangles, not sheets that a shader cuts."""
COARSEST: Final = DETAILS - 1

_SHADE: Final = 0.45  # of the light in the open that reaches the inside of a crown
_STEPS: Final = 65535


class _Herb(NamedTuple):
    """Leaves around a foot: how many, their height and width (m), how far they lean, albedos."""

    leaves: int
    tall: float
    wide: float
    lean: float
    albedo: tuple[float, float, float]
    head: tuple[float, float, float] | None = None


_HERBS: Final = {
    "grass": _Herb(7, 0.35, 0.012, 0.35, (0.090, 0.130, 0.035)),
    "flower": _Herb(4, 0.30, 0.016, 0.30, (0.080, 0.125, 0.035), (0.62, 0.52, 0.10)),
    "fern": _Herb(8, 0.55, 0.080, 0.85, (0.055, 0.105, 0.025)),
}


class Model(NamedTuple):
    """Triangles of a grown plant, three corners each; x east, y up, z south, m from its foot.

    Attributes
    ----------
    place, normal : (3 · triangles, 3) float32
    colour : (3 · triangles, 4) uint16
        Linear albedo, darker inside the crown; opaque.
    """

    place: npt.NDArray[np.float32]
    normal: npt.NDArray[np.float32]
    colour: npt.NDArray[np.uint16]


def variants_of(species: str) -> int:
    """Return how many different plants of a species there are."""
    return VARIANTS if species in SPECIES else 1


@cache
def woody_model(species: str, variant: int, detail: int) -> Model:
    """Return a tree or shrub.

    Parameters
    ----------
    species
        One of `sketchterrain.look.tree_species.SPECIES`.
    variant
        0 … `VARIANTS` - 1.
    detail
        `FINEST` … `COARSEST`.
    """
    made = level(species, variant, detail)
    place = HEIGHTS[SPECIES.index(species)] * made.place
    light = _SHADE + (1.0 - _SHADE) * made.open[..., None]
    return _model(place, made.outward, made.albedo * light)


@cache
def herb_model(species: str) -> Model:
    """Return a tuft of grass, a flower or a fern."""
    herb = _HERBS[species]
    turn = 2.0 * np.pi * (np.arange(herb.leaves) + 0.31 * (np.arange(herb.leaves) % 3)) / herb.leaves
    out = np.stack([np.cos(turn), np.sin(turn), np.zeros(herb.leaves)], axis=-1)
    aside = 0.5 * herb.wide * np.stack([-np.sin(turn), np.cos(turn), np.zeros(herb.leaves)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    tip = herb.lean * herb.tall * out + herb.tall * up
    place = np.stack([-aside, aside, tip], axis=1)
    outward = np.broadcast_to((0.35 * out + 0.94 * up)[:, None, :], place.shape)
    albedo = np.broadcast_to(np.array(herb.albedo), place.shape)
    if herb.head is not None:
        size = 0.035
        ring = size * np.stack([np.cos(turn[:3]), np.sin(turn[:3]), np.zeros(3)], axis=-1) + herb.tall * up
        place = np.concatenate([place, ring[None]])
        outward = np.concatenate([outward, np.broadcast_to(up, (1, 3, 3))])
        albedo = np.concatenate([albedo, np.broadcast_to(np.array(herb.head), (1, 3, 3))])
    return _model(place, outward, albedo)


@cache
def plant_colour(species: str) -> tuple[float, float, float]:
    """Return the linear albedo of a species as a point."""
    if species in SPECIES:
        mean = woody_model(species, 0, COARSEST).colour[:, :3].mean(axis=0) / _STEPS
        return float(mean[0]), float(mean[1]), float(mean[2])
    herb = _HERBS[species]
    return herb.head or herb.albedo


def _model(place: Floats, outward: Floats, albedo: Floats) -> Model:
    """Turn triangles so that their fronts show where their normals point, and stand them upright in y."""
    faced = np.cross(place[:, 1] - place[:, 0], place[:, 2] - place[:, 0])
    back = (faced * outward.mean(axis=1)).sum(axis=-1) < 0.0
    order = np.where(back[:, None], [0, 2, 1], [0, 1, 2])[..., None]
    place, outward, albedo = (np.take_along_axis(each, order, axis=1) for each in (place, outward, albedo))
    colour = np.full((place.shape[0] * 3, 4), _STEPS, np.uint16)
    colour[:, :3] = np.rint(_STEPS * np.clip(albedo.reshape(-1, 3), 0.0, 1.0))
    unit = outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    return Model(_upright(place), _upright(unit), colour)


def _upright(vectors: Floats) -> npt.NDArray[np.float32]:
    east, north, up = vectors.reshape(-1, 3).T
    return np.stack([east, up, -north], axis=-1).astype(np.float32)
