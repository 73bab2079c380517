"""Levels of detail of a plant: fewer, larger leaves with the same covered area and mean colour."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.look.tree_growth import Wood, grow_crown, grow_whorls
from sketchterrain.look.tree_leaves import Openness, leaves_of_crown, leaves_of_whorls
from sketchterrain.look.tree_measure import plant_view
from sketchterrain.look.tree_shape import SOLID, Leaves, Triangles, joined_triangles, unit
from sketchterrain.look.tree_species import GROWTH_FORMS, SPECIES, Colours, Crown
from sketchterrain.look.tree_triangles import bark_tubes, leaf_quads, single_triangles

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array


DETAILS: Final = 6
"""Levels of detail, 0 the finest."""
MASKED_DETAILS: Final = 2
"""Number of finest levels whose leaves are cut out of leaf_quads."""
VARIANTS: Final = 3
"""Of each species."""
LEAVES: Final = (1000, 560, 150, 26)
"""Sprays in the levels between the finest and the coarsest: two triangles each where cut out, else one."""
TONE_POINTS: Final = 12_000
"""Sample points for a plant's mean colour."""


class _Plant(NamedTuple):
    wood: Wood
    leaves: Leaves
    openness: Openness
    colours: Colours
    mask: float


def level(species: str, variant: int, detail: int) -> Triangles:
    """Return a plant's triangles at a level of detail; the last one is a hull of 12 triangles."""
    made = _shaped(species, variant, detail)
    return made._replace(albedo=made.albedo * _tone(species, variant, detail))


def _shaped(species: str, variant: int, detail: int) -> Triangles:
    plant = _plant(species, variant)
    if detail == 0:
        leafy = leaf_quads(plant.leaves, plant.mask, np.array(plant.colours.fresh), plant.openness)
        return joined_triangles([leafy, *_wood(plant, detail=0)])
    size = GROWTH_FORMS[species].sizes[detail - 1]
    return _hull(plant, size) if detail == DETAILS - 1 else _fewer(plant, detail, size)


def _tone(species: str, variant: int, detail: int) -> Float64Array:
    """Return the factor that gives a level the mean colour of the finest one."""
    if detail == 0:
        return np.ones(3)
    return np.asarray(_colour(species, variant, 0) / _colour(species, variant, detail))


@cache
def _colour(species: str, variant: int, detail: int) -> Float64Array:
    return plant_view(_shaped(species, variant, detail), points=TONE_POINTS).colour


@cache
def _plant(species: str, variant: int) -> _Plant:
    rng = np.random.default_rng([SPECIES.index(species), variant])
    form = GROWTH_FORMS[species]
    if isinstance(form, Crown):
        wood = grow_crown(form, rng)
        leaves = leaves_of_crown(form, wood, rng)
    else:
        wood = grow_whorls(form, rng)
        leaves = leaves_of_whorls(form, wood, rng)
    return _Plant(wood, leaves, Openness(leaves), form.colours, form.mask)


def _fewer(plant: _Plant, detail: int, size: float) -> Triangles:
    """Return every n-th leaf, `size` times as large."""
    count = len(plant.leaves.root)
    target = min(LEAVES[detail - 1], count)
    offsets = np.arange(target) + np.random.default_rng(detail).uniform(0.0, 1.0, target)
    selected = np.minimum(offsets * count / target, count - 1).astype(np.int64)
    leaves = Leaves(*(each[selected] for each in plant.leaves))
    fresh = np.array(plant.colours.fresh)
    if detail < MASKED_DETAILS:
        leaves = leaves._replace(along=size * leaves.along, across=size * leaves.across)
        leafy = leaf_quads(leaves, plant.mask, fresh, plant.openness)
    else:
        leafy = single_triangles(leaves, size, fresh, plant.openness)
    return joined_triangles([leafy, *_wood(plant, detail=detail)])


def _wood(plant: _Plant, *, detail: int) -> list[Triangles]:
    """Return the wood visible at a level: the trunk, nearer the boughs, near the twigs."""
    rng = np.random.default_rng(3)
    wood = plant.wood
    wrapped = partial(bark_tubes, colours=plant.colours, openness=plant.openness, rng=rng)
    every, sides = ((1, 8), (2, 5), (3, 4), (5, 3), (14, 3))[detail]
    selected = np.unique(np.append(np.arange(0, len(wood.trunk), every), len(wood.trunk) - 1))
    parts = [wrapped(wood.trunk[None, selected], wood.trunk_radius[None, selected], sides=sides)]
    slender = len(wood.boughs) > 60  # many, and hidden by their own needles
    if detail == 0:
        some = slice(None, None, 2 if slender else 1)
        points = [0, 3, 5] if slender else list(range(wood.boughs.shape[1]))
        boughs, radius = wood.boughs[some][:, points], wood.bough_radius[some][:, points]
        parts.append(wrapped(boughs, radius, sides=3 if slender else 4))
        if len(wood.twigs):
            parts.append(wrapped(wood.twigs[:, [0, 2]], wood.twig_radius[:, [0, 2]], sides=3))
    elif detail == 1 and not slender:
        points = [0, 2, 5]
        parts.append(wrapped(wood.boughs[:, points], wood.bough_radius[:, points], sides=3))
    return parts


def _hull(plant: _Plant, size: float) -> Triangles:
    """Return a cap and a belt around the crown, and three blades for the trunk: 12 triangles."""
    position = plant.leaves.root + 0.5 * plant.leaves.along
    z, away = position[:, 2], np.linalg.norm(position[:, :2], axis=1)
    low, high = np.quantile(z, [0.01, 1.0])
    rings = []
    for share, start in ((0.16, 0.0), (0.66, np.pi / 3.0)):
        height = low + share * (high - low)
        near = np.abs(z - height) < 0.16 * (high - low)
        radius = size * np.quantile(away[near], 0.85)
        turn = start + 2.0 * np.pi * np.arange(3) / 3.0
        rings.append(np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(3, height)], axis=1))
    below, above = rings
    top = np.array([0.0, 0.0, high])
    following = [1, 2, 0]
    cap = [np.stack([above[k], above[following[k]], top]) for k in range(3)]
    belt = [np.stack([below[k], below[following[k]], above[k]]) for k in range(3)]
    belt += [np.stack([below[following[k]], above[following[k]], above[k]]) for k in range(3)]
    trunk_radius = plant.wood.trunk_radius[1]
    blades = []
    for turn in np.pi * np.arange(3) / 3.0:
        across = trunk_radius * np.array([np.cos(turn), np.sin(turn), 0.0])
        blades.append(np.stack([-across, across, np.array([0.0, 0.0, below[0, 2] + 0.1])]))
    corners = np.stack(cap + belt + blades)
    middle = np.array([0.0, 0.0, 0.5 * (low + high)])
    normal = unit((corners - middle) * [1.0, 1.0, 0.7] + [0.0, 0.0, 0.02])
    leaf = np.arange(12) < 9
    light = np.where(leaf[:, None], 0.35 + 0.55 * (corners[..., 2] - low) / (high - low), 0.4)
    albedo = np.where(leaf[:, None, None], plant.leaves.albedo.mean(axis=0), np.array(plant.colours.bark))
    albedo = np.broadcast_to(albedo, corners.shape)
    nothing = np.zeros(12)
    return Triangles(
        corners,
        normal,
        albedo,
        light,
        np.zeros((12, 3, 2)),
        nothing + SOLID,
        leaf.astype(np.float64),
        nothing,
    )
