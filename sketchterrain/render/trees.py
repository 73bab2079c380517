"""Plants as triangles: one unit high, foot at the origin, leaf clumps by a few rules and a fixed seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["DETAILS", "HEIGHTS", "SPECIES", "plant_mesh"]

SPECIES: Final = ("conifer", "broadleaf", "shrub")
"""In the terrain's order."""
HEIGHTS: Final = (16.0, 11.0, 1.9)
"""m, of a grown plant of each species."""
DETAILS: Final = 4
"""Levels of detail, 0 the finest."""

VERTEX: Final = np.dtype([("place", "f4", 3), ("outward", "f4", 3), ("colour", "u1", 4)])


@dataclass(frozen=True)
class _Leaves:
    """Triangles with a normal, an albedo and an openness 0..1 at each corner."""

    place: Floats  # (n, 3, 3)
    outward: Floats  # (n, 3, 3)
    albedo: Floats  # (n, 3, 3)
    open: Floats  # (n, 3)


def plant_mesh(species: str, detail: int) -> npt.NDArray[np.void]:
    """Make a plant.

    Parameters
    ----------
    species
        One of `SPECIES`.
    detail
        0 for a plant close by … ``DETAILS - 1`` for one of a few pixels.

    Returns
    -------
    (3 · triangles,) structured
        place (plant heights), outward (unit normal), colour (√albedo, openness; 0..255).
    """
    rng = np.random.default_rng([SPECIES.index(species), detail])
    if species == "conifer":
        leaves = _conifer(rng, tiers=(21, 9, 5, 3)[detail], branches=(14, 7, 4, 3)[detail])
        wood = _trunk(0.030, 0.92, 5 if detail == 0 else 3)
    elif species == "broadleaf":
        clumps = (760, 170, 36, 12)[detail]
        leaves = _crown(rng, clumps=clumps, centre=(0.0, 0.0, 0.54), radii=(0.40, 0.40, 0.45))
        wood = _trunk(0.035, 0.5, 5 if detail == 0 else 3)
    else:
        clumps = (120, 36, 12, 6)[detail]
        leaves = _crown(rng, clumps=clumps, centre=(0.0, 0.0, 0.42), radii=(0.62, 0.62, 0.52))
        wood = _trunk(0.05, 0.3, 3)
    parts = [leaves] if detail >= 2 else [leaves, wood]
    return np.concatenate([_pack(part) for part in parts])


def _conifer(rng: np.random.Generator, *, tiers: int, branches: int) -> _Leaves:
    """Whorls of drooping boughs; each bough is a tent of two triangles."""
    tier, bough = np.meshgrid(np.arange(tiers), np.arange(branches), indexing="ij")
    up = (tier + rng.uniform(-0.3, 0.3, tier.shape)) / tiers
    z = 0.13 + 0.84 * up
    reach = (0.215 * (1.0 - up) ** 0.85 + 0.012) * rng.uniform(0.75, 1.2, tier.shape)
    angle = 2 * np.pi * (bough + 0.5 * (tier % 2) + rng.uniform(-0.25, 0.25, tier.shape)) / branches
    drop = (0.45 + 0.25 * (1 - up)) * reach
    spread = reach * (3.0 / branches) * 1.05
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(z)], axis=-1)
    aside = np.stack([-np.sin(angle), np.cos(angle), np.zeros_like(z)], axis=-1)
    high = np.array([0.0, 0.0, 1.0])
    thick = 1.0 / tiers
    root = high * (z + 0.55 * thick)[..., None]
    tip = out * reach[..., None] + high * (z - drop)[..., None]
    middle = out * (0.55 * reach)[..., None] + high * (z - 0.45 * drop)[..., None]
    sag = high * (0.5 * thick)
    left = middle + aside * spread[..., None] - sag
    right = middle - aside * spread[..., None] - sag
    place = np.stack([np.stack([root, left, tip], -2), np.stack([root, tip, right], -2)], axis=2)
    place = place.reshape(-1, 3, 3)
    radial = place * [1.0, 1.0, 0.0]
    outward = _unit(radial / 0.2 + [0.0, 0.0, 0.45] + 0.25 * rng.standard_normal(place.shape))
    away = np.linalg.norm(radial, axis=-1) / np.repeat(np.maximum(reach.ravel(), 1e-3), 2)[:, None]
    shade = np.clip(0.25 + 0.75 * away, 0.0, 1.0)
    green = np.array([0.050, 0.080, 0.030]) * rng.uniform(0.8, 1.25, (len(place), 1, 1))
    fresh = np.array([0.030, 0.034, 0.006])
    albedo = green * (0.55 + 0.6 * shade[..., None]) + fresh * np.clip(away - 0.6, 0.0, 1.0)[..., None]
    return _Leaves(place, outward, albedo, 0.25 + 0.75 * shade * np.clip(0.5 + 0.6 * place[..., 2], 0, 1))


def _crown(
    rng: np.random.Generator,
    *,
    clumps: int,
    centre: tuple[float, float, float],
    radii: tuple[float, float, float],
) -> _Leaves:
    """Leaf clumps scattered over a lumpy ball, lit like the lumps that they cover."""
    direction = _unit(rng.standard_normal((clumps, 3)))
    direction[:, 2] = np.where(direction[:, 2] < -0.85, -direction[:, 2], direction[:, 2])
    lumps = _unit(rng.standard_normal((9, 3)) + np.array([0.0, 0.0, 0.35]))
    near = direction @ lumps.T
    lump = lumps[np.argmax(near, axis=1)]
    swell = 0.70 + 0.34 * np.max(near, axis=1) ** 6 + 0.05 * rng.standard_normal(clumps)
    depth = rng.uniform(0.72, 1.0, clumps) if clumps > 60 else np.full(clumps, 0.9)
    middle = np.asarray(centre) + direction * np.asarray(radii) * (swell * depth)[:, None]
    size = 2.1 * np.mean(radii) / np.sqrt(clumps) * rng.uniform(0.8, 1.35, clumps)
    facing = _unit(direction + 0.55 * rng.standard_normal((clumps, 3)))
    first = _unit(np.cross(facing, _unit(rng.standard_normal((clumps, 3)))))
    second = np.cross(facing, first)
    corners = 2 * np.pi * np.arange(3) / 3
    spokes = first[:, None] * np.cos(corners)[:, None] + second[:, None] * np.sin(corners)[:, None]
    stretch = rng.uniform(0.8, 1.5, (clumps, 3, 1))
    place = middle[:, None] + spokes * stretch * size[:, None, None]
    place[..., 2] = np.maximum(place[..., 2], 0.02)
    outward = _unit(
        0.55 * direction[:, None]
        + 0.45 * _unit(direction + 0.9 * (direction - lump))[:, None]
        + 0.18 * rng.standard_normal(place.shape)
        + [0.0, 0.0, 0.15]
    )
    height = (place[..., 2] - centre[2]) / radii[2]
    shade = np.clip(0.62 + 0.34 * height, 0.22, 1.0) * (0.55 + 0.45 * depth**2)[:, None]
    leaf = np.array([0.082, 0.118, 0.028]) * rng.uniform(0.72, 1.3, (clumps, 1, 1))
    leaf = leaf * (1.0 + np.array([0.22, 0.0, -0.1]) * rng.uniform(-0.5, 1.0, (clumps, 1, 1)))
    return _Leaves(place, outward, leaf * np.ones_like(place), shade)


def _trunk(radius: float, height: float, sides: int) -> _Leaves:
    angle = 2 * np.pi * np.arange(sides + 1) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides + 1)], axis=1)
    foot = ring * radius - [0.0, 0.0, 0.05]
    top = ring * radius * 0.35 + [0.0, 0.0, height]
    place = np.concatenate(
        [
            np.stack([foot[:-1], foot[1:], top[1:]], axis=1),
            np.stack([foot[:-1], top[1:], top[:-1]], axis=1),
        ]
    )
    outward = np.concatenate(
        [np.stack([ring[:-1], ring[1:], ring[1:]], 1), np.stack([ring[:-1], ring[1:], ring[:-1]], 1)]
    )
    albedo = np.broadcast_to([0.075, 0.056, 0.040], place.shape)
    return _Leaves(place, outward, np.asarray(albedo), np.full(place.shape[:2], 0.5))


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def _pack(leaves: _Leaves) -> npt.NDArray[np.void]:
    mesh = np.empty(leaves.place.shape[0] * 3, VERTEX)
    mesh["place"] = leaves.place.reshape(-1, 3)
    mesh["outward"] = leaves.outward.reshape(-1, 3)
    mesh["colour"][:, :3] = np.rint(255 * np.sqrt(np.clip(leaves.albedo.reshape(-1, 3), 0, 1)))
    mesh["colour"][:, 3] = np.rint(255 * np.clip(leaves.open.reshape(-1), 0, 1))
    return mesh
