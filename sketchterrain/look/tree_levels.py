"""Tree meshes at several levels of detail."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.look.tree_growth import (
    Openness,
    Wood,
    frames,
    grow_crown,
    grow_whorls,
    leaves_of_crown,
    leaves_of_whorls,
)
from sketchterrain.look.tree_species import (
    BANDED,
    BROAD,
    GROWTH_FORMS,
    NEEDLES,
    SOLID,
    SPECIES,
    Colours,
    Crown,
    Leaves,
    Triangles,
    joined_triangles,
    unit,
)

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array, StructuredArray


BOUNDS = (-0.02, 1.08)  # range of heights that all leaves are clipped to, however large
ROOT_SHADE = 0.72  # openness of a spray's root, relative to its tip


class _Plant(NamedTuple):
    wood: Wood
    leaves: Leaves
    openness: Openness
    colours: Colours
    mask: float


def _bark_tubes(
    plant: _Plant, rng: np.random.Generator, curves: Float64Array, radius: Float64Array, *, sides: int
) -> Triangles:
    """Wrap bark around curves (n, k, 3) of radii (n, k), as tubes with a number of sides."""
    colours = plant.colours
    _, across, above = frames(curves)
    turn = 2.0 * np.pi * np.arange(sides + 1) / sides
    ring = across[:, :, None] * np.cos(turn)[:, None] + above[:, :, None] * np.sin(turn)[:, None]
    position = curves[:, :, None] + radius[:, :, None, None] * ring
    height = np.clip(curves[..., 2], 0.0, 1.0)
    up = np.clip((height - 0.30) / 0.25, 0.0, 1.0)[..., None]
    bark = np.array(colours.bark) * (1.0 - up) + np.array(colours.bark_above) * up
    dark = rng.uniform(0.0, 1.0, (*curves.shape[:2], sides)) < colours.marks
    shade = rng.uniform(0.8, 1.15, dark.shape) * np.where(dark, 0.16, 1.0)
    shade = np.concatenate([shade, shade[:, :, :1]], axis=2)[..., None]
    albedo = bark[:, :, None] * shade
    light = np.repeat(plant.openness.at(curves)[:, :, None], sides + 1, axis=2)[..., None]
    round_, up_ = np.broadcast_arrays(np.linspace(-1.0, 1.0, sides + 1), height[..., None])
    grid = np.concatenate([position, ring, albedo, light, round_[..., None], up_[..., None]], axis=-1)
    a, b, c, d = grid[:, :-1, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:], grid[:, 1:, :-1]
    both = np.stack([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)], axis=-3)
    rows = both.reshape(-1, 3, grid.shape[-1])
    count = len(rows)
    return Triangles(
        rows[..., :3],
        rows[..., 3:6],
        rows[..., 6:9],
        rows[..., 9],
        rows[..., 10:],
        np.full(count, BANDED if colours.marks else SOLID),
        np.zeros(count),
        np.zeros(count),
    )


def _leaf_quads(plant: _Plant, leaves: Leaves) -> Triangles:
    """Return two triangles for each spray, from which its leaves are cut by an alpha mask."""
    a, b = leaves.root - leaves.across, leaves.root + leaves.across
    c, d = b + leaves.along, a + leaves.along
    at = np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0]])
    first, second = [0, 1, 2], [0, 2, 3]
    corners = np.stack([a, b, c, d], axis=1)
    position = np.concatenate([corners[:, first], corners[:, second]])
    leaf_uv = np.concatenate([np.broadcast_to(at[each], (len(a), 3, 2)) for each in (first, second)])
    return _leaf_triangles(plant, leaves, position, leaf_uv, plant.mask)


def _single_triangles(plant: _Plant, leaves: Leaves, scale: float) -> Triangles:
    """Return one triangle for each spray, `scale` times as large."""
    middle = leaves.root + 0.4 * leaves.along
    along, across = scale * leaves.along, scale * leaves.across
    position = np.stack(
        [middle - 0.4 * along - across, middle - 0.4 * along + across, middle + 0.6 * along], axis=1
    )
    leaf_uv = np.broadcast_to([[-1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], (*position.shape[:2], 2))
    return _leaf_triangles(plant, leaves, position, leaf_uv, SOLID)


def _leaf_triangles(
    plant: _Plant, leaves: Leaves, position: Float64Array, leaf_uv: Float64Array, mask: float
) -> Triangles:
    count = len(position)
    copies = count // len(leaves.root)
    position[..., 2] = np.clip(position[..., 2], *BOUNDS)
    light = plant.openness.at(leaves.root + 0.5 * leaves.along)
    albedo = leaves.albedo + np.array(plant.colours.fresh) * (light**2)[:, None]
    normal, albedo = (np.tile(each[:, None], (copies, 3, 1)) for each in (leaves.normal, albedo))
    along = ROOT_SHADE + (1.0 - ROOT_SHADE) * leaf_uv[..., 1]
    return Triangles(
        position,
        normal,
        albedo,
        np.tile(light, copies)[:, None] * along,
        np.asarray(leaf_uv, dtype=np.float64),
        np.full(count, mask),
        np.ones(count),
        np.tile(leaves.phase, copies),
    )


VIEWS: Final = (0.4, 1.9)  # azimuths of view, rad
CELLS: Final = 48  # raster cells per plant height
PER_CELL: Final = 5.0  # sample points on a triangle as large as a cell


class PlantView(NamedTuple):
    """Covered area (squares of its height) and area-weighted mean of visible albedo · openness (3,)."""

    area: float
    colour: Float64Array


def leaf_mask(
    across: Float64Array,
    along: Float64Array,
    mask: Float64Array,
    spray: npt.NDArray[np.integer],
    *,
    wide: int = 1,
) -> Float64Array:
    """Return a spray's leaf mask, positive inside leaves; the oracle of kernels/render/sprig.glsl."""
    needles, clusters = mask > 0.5 * (BROAD + NEEDLES), wide > 1
    rows, cells = np.where(needles, 14.0, 5.0), np.where(needles, 18.0, 6.0)
    away, side = np.abs(across), np.where(across < 0.0, 1.0, 0.0)
    inclined = along - np.where(needles, 0.24, 0.26) * away
    row = inclined * rows + 0.5 * side + spray / 256.0
    of_row = np.floor(row)
    off = row - of_row - 0.5
    merged = clusters & ~needles
    half = np.where(merged, 0.0, off < 0.0)
    out = np.where(merged, 0.5 + off, 2.0 * np.abs(off))
    up = np.clip(inclined + 0.1, 0.0, 1.0)
    grown = np.mod(of_row * 0.618034 + 0.37 * side + spray * 0.0911, 1.0)
    reach = np.minimum(1.8 * np.sqrt(1.0 - up * up), 1.15) * np.minimum(5.0 * up + 0.1, 1.0)
    reach *= 0.35 + 0.65 * grown
    cell = away * cells / wide - np.where(needles, 2.0, 0.0 if clusters else 0.6) * out + 0.5 * half + 4.0
    of_cell = np.floor(cell)
    key = of_cell + 64.0 * (of_row + 32.0) + 4096.0 * (side + 2.0 * half)
    hashed = (key.astype(np.uint32) + (np.asarray(spray, np.uint32) << 16)) * np.uint32(0x9E3779B9)
    hashed = (hashed ^ hashed >> 15) * np.uint32(0x85EBCA6B)
    hashed ^= hashed >> 13
    size, chance = (hashed & 0xFFFF) / 65536.0, (hashed >> 16) / 65536.0
    full = np.where(clusters, 1.0, 0.84 + 0.18 * size) * np.sqrt(np.maximum(out * (1.0 - out), 0.0))
    full = np.where(needles, 2.0 * (0.67 - out) if clusters else 0.5 - 0.32 * out, full)
    full -= np.where(needles & clusters, 0.0, np.abs(cell - of_cell - 0.5))
    leaf = np.where((away < reach) & (chance < np.where(needles, 1.0, 0.98)), full, -1.0)
    twig = np.maximum(0.025 - away, np.where(away < reach, 0.06 - np.abs(off), -1.0))
    return np.where(mask < 0.5 * BROAD, 1.0, np.maximum(leaf, twig))


def plant_view(triangles: Triangles, *, views: tuple[float, ...] = VIEWS, points: int = 60_000) -> PlantView:
    """Rasterise at most `points` samples of a plant from horizontal views (azimuths in rad).

    Too few points leave holes in the covered area.
    """
    rng = np.random.default_rng(7)
    position = triangles.position
    area = 0.5 * np.linalg.norm(
        np.cross(position[:, 1] - position[:, 0], position[:, 2] - position[:, 0]), axis=1
    )
    count = area * CELLS**2 * PER_CELL
    count *= min(points / max(count.sum(), 1.0), 1.0)
    of = np.repeat(np.arange(len(area)), np.maximum(np.rint(count).astype(np.int64), 1))
    u, v = rng.uniform(0.0, 1.0, (2, len(of)))
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    weights = np.stack([1.0 - u - v, u, v], axis=1)[:, None]
    at = (weights @ triangles.leaf_uv[of])[:, 0]
    inside = leaf_mask(at[:, 0], at[:, 1], triangles.mask[of], of & 255) > 0.0
    of, weights = of[inside], weights[inside]
    point = (weights @ position[of])[:, 0]
    light = (weights @ triangles.openness[of][..., None])[:, 0]
    colour = (weights @ triangles.albedo[of])[:, 0] * light
    covered, total = 0, np.zeros(3)
    for azimuth in views:
        c, s = np.cos(azimuth), np.sin(azimuth)
        across, depth = point[:, 0] * c + point[:, 1] * s, point[:, 1] * c - point[:, 0] * s
        cell = np.floor(np.stack([across + 1.0, point[:, 2] + 0.1]) * CELLS).astype(np.int64)
        flat = np.clip(cell[1], 0, 2 * CELLS - 1) * 2 * CELLS + np.clip(cell[0], 0, 2 * CELLS - 1)
        nearest = np.argsort(-depth, kind="stable")
        front = np.full(4 * CELLS**2, -1)
        front[flat[nearest]] = nearest
        front = front[front >= 0]
        covered += len(front)
        total += colour[front].sum(axis=0)
    return PlantView(covered / (len(views) * CELLS**2), np.asarray(total / max(covered, 1)))


DETAILS: Final = 7  # levels of detail, 0 the finest
MASKED_DETAILS: Final = 2  # number of finest levels whose leaves are cut out of quads
VARIANTS: Final = 3  # of each species
LEAVES: Final = (1000, 560, 150, 26)
"""Sprays in the levels between the finest and the hull: two triangles each where cut out, else one."""
TONE_POINTS: Final = 12_000  # sample points for a plant's mean colour


def level(species: str, variant: int, detail: int) -> Triangles:
    """Return a plant's triangles at a level of detail; the last ones are a hull of 12 and a cone of 3."""
    triangles = _untoned(species, variant, detail)
    if detail == 0:
        return triangles
    # Each level gets the mean colour of the finest one.
    tone = _mean_colour(species, variant, 0) / _mean_colour(species, variant, detail)
    return triangles._replace(albedo=triangles.albedo * tone)


def _untoned(species: str, variant: int, detail: int) -> Triangles:
    plant = _plant(species, variant)
    if detail == 0:
        return joined_triangles([_leaf_quads(plant, plant.leaves), *_wood(plant, detail=0)])
    size = GROWTH_FORMS[species].sizes[detail - 1]
    if detail <= len(LEAVES):
        return _reduced(plant, detail, size)
    return _hull(plant, size) if detail < DETAILS - 1 else _cone(plant, size)


@cache
def _mean_colour(species: str, variant: int, detail: int) -> Float64Array:
    return plant_view(_untoned(species, variant, detail), points=TONE_POINTS).colour


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


def _reduced(plant: _Plant, detail: int, size: float) -> Triangles:
    """Return every n-th leaf, `size` times as large."""
    count = len(plant.leaves.root)
    target = min(LEAVES[detail - 1], count)
    offsets = np.arange(target) + np.random.default_rng(detail).uniform(0.0, 1.0, target)
    selected = np.minimum(offsets * count / target, count - 1).astype(np.int64)
    leaves = Leaves(*(each[selected] for each in plant.leaves))
    if detail < MASKED_DETAILS:
        leaves = leaves._replace(along=size * leaves.along, across=size * leaves.across)
        leafy = _leaf_quads(plant, leaves)
    else:
        leafy = _single_triangles(plant, leaves, size)
    return joined_triangles([leafy, *_wood(plant, detail=detail)])


def _wood(plant: _Plant, *, detail: int) -> list[Triangles]:
    """Return the wood visible at a level: the trunk, nearer the boughs, near the twigs."""
    rng = np.random.default_rng(3)
    wood = plant.wood
    wrapped = partial(_bark_tubes, plant, rng)
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
    return _lit_crown(plant, np.stack(cap + belt + blades), low, high, leaves=9)


def _cone(plant: _Plant, size: float) -> Triangles:
    """Return three triangles from around the lowest leaves to the top."""
    position = plant.leaves.root
    low, high = np.quantile(position[:, 2], [0.05, 1.0])
    turn = 2.0 * np.pi * np.arange(4) / 3.0
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(4)], axis=1)
    ring *= size * np.quantile(np.linalg.norm(position[:, :2], axis=1), 0.85)
    ring[:, 2] = low
    sides = [np.stack([ring[k], ring[k + 1], [0.0, 0.0, high]]) for k in range(3)]
    return _lit_crown(plant, np.stack(sides), low, high, leaves=3)


def _lit_crown(plant: _Plant, corners: Float64Array, low: float, high: float, *, leaves: int) -> Triangles:
    """Return (n, 3, 3) triangles with light of a crown between two heights; the first `leaves` are leaves."""
    middle = np.array([0.0, 0.0, 0.5 * (low + high)])
    normal = unit((corners - middle) * [1.0, 1.0, 0.7] + [0.0, 0.0, 0.02])
    count = len(corners)
    leaf = np.arange(count) < leaves
    light = np.where(leaf[:, None], 0.35 + 0.55 * (corners[..., 2] - low) / (high - low), 0.4)
    albedo = np.where(leaf[:, None, None], plant.leaves.albedo.mean(axis=0), np.array(plant.colours.bark))
    albedo = np.broadcast_to(albedo, corners.shape)
    zero = np.zeros(count)
    return Triangles(
        corners, normal, albedo, light, np.zeros((count, 3, 2)), zero + SOLID, leaf.astype(np.float64), zero
    )


VERTEX: Final = np.dtype(
    [("position", "f4", 3), ("normal", "u1", 4), ("colour", "u1", 4), ("leaf_uv", "u1", 4)]
)


@cache
def plant_mesh(species: str, variant: int, detail: int) -> StructuredArray:
    """Return a plant's (3 · triangles,) `VERTEX` array, read-only; `detail` 0 is the finest.

    position: plant heights. normal: unit vector -1..1, then 1 for leaf or 0 for wood. colour: √albedo,
    openness. leaf_uv: position on its spray, across -1..1 and along 0..1; alpha mask; wind phase. All but
    positions are in 0..255.
    """
    triangles = level(species, variant, detail)
    mesh = np.empty(triangles.position.shape[0] * 3, VERTEX)
    mesh["position"] = triangles.position.reshape(-1, 3)
    mesh["normal"][:, :3] = _byte(0.5 + 0.5 * triangles.normal.reshape(-1, 3))
    mesh["normal"][:, 3] = _byte(np.repeat(triangles.leafiness, 3))
    mesh["colour"][:, :3] = _byte(np.sqrt(np.clip(triangles.albedo.reshape(-1, 3), 0.0, 1.0)))
    mesh["colour"][:, 3] = _byte(triangles.openness.reshape(-1))
    mesh["leaf_uv"][:, 0] = _byte(0.5 + 0.5 * triangles.leaf_uv[..., 0].ravel())
    mesh["leaf_uv"][:, 1] = _byte(triangles.leaf_uv[..., 1].ravel())
    mesh["leaf_uv"][:, 2] = _byte(np.repeat(triangles.mask, 3))
    mesh["leaf_uv"][:, 3] = _byte(np.repeat(triangles.phase, 3))
    mesh.flags.writeable = False
    return mesh


def _byte(values: Float64Array) -> Float64Array:
    return np.asarray(np.rint(255.0 * np.clip(values, 0.0, 1.0)))


def plant_chances(plants: StructuredArray) -> tuple[Float64Array, Float64Array]:
    """Return two numbers in 0..1 for each plant (`PLANT`) from its position alone."""
    x, y = ((plants[axis] * 8.0).astype(np.int64) for axis in ("x", "y"))
    seed = x * 73_856_093 ^ y * 19_349_663
    bits = (seed.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(24)
    first = ((bits >> np.uint64(16)) & np.uint64(0xFFFF)).astype(np.float64) / 0xFFFF
    second = ((bits >> np.uint64(32)) & np.uint64(0xFF)).astype(np.float64) / 0xFF
    return first, second


def plant_variants(chance: Float64Array) -> npt.NDArray[Any]:
    """Return 0 … `VARIANTS` - 1 for each second chance, as whole numbers in float64."""
    return np.floor(np.minimum(chance * VARIANTS, VARIANTS - 1))
