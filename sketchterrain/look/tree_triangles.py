"""Triangles of wood and leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.look.tree_growth import frames
from sketchterrain.look.tree_shape import BANDED, SOLID, Leaves, Triangles

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array
    from sketchterrain.look.tree_leaves import Openness
    from sketchterrain.look.tree_species import Colours


BOUNDS = (-0.02, 1.08)
"""Range of heights that all leaves are clipped to, however large."""
ROOT_SHADE = 0.72
"""Openness of a spray's root, relative to its tip."""


def bark_tubes(
    curves: Float64Array,
    radius: Float64Array,
    *,
    sides: int,
    colours: Colours,
    openness: Openness,
    rng: np.random.Generator,
) -> Triangles:
    """Wrap bark around curves (n, k, 3) of radii (n, k), as bark_tubes with a number of sides."""
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
    light = np.repeat(openness.at(curves)[:, :, None], sides + 1, axis=2)[..., None]
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


def leaf_quads(leaves: Leaves, mask: float, fresh: Float64Array, openness: Openness) -> Triangles:
    """Return two triangles for each spray, from which its leaves are cut by an alpha mask."""
    a, b = leaves.root - leaves.across, leaves.root + leaves.across
    c, d = b + leaves.along, a + leaves.along
    at = np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0]])
    first, second = [0, 1, 2], [0, 2, 3]
    corners = np.stack([a, b, c, d], axis=1)
    position = np.concatenate([corners[:, first], corners[:, second]])
    leaf_uv = np.concatenate([np.broadcast_to(at[each], (len(a), 3, 2)) for each in (first, second)])
    return _leaf_triangles(leaves, position, leaf_uv, mask, fresh, openness, copies=2)


def single_triangles(leaves: Leaves, scale: float, fresh: Float64Array, openness: Openness) -> Triangles:
    """Return one triangle for each spray, `scale` times as large."""
    middle = leaves.root + 0.4 * leaves.along
    along, across = scale * leaves.along, scale * leaves.across
    position = np.stack(
        [middle - 0.4 * along - across, middle - 0.4 * along + across, middle + 0.6 * along], axis=1
    )
    leaf_uv = np.broadcast_to([[-1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], (*position.shape[:2], 2))
    return _leaf_triangles(leaves, position, leaf_uv, SOLID, fresh, openness, copies=1)


def _leaf_triangles(
    leaves: Leaves,
    position: Float64Array,
    leaf_uv: Float64Array,
    mask: float,
    fresh: Float64Array,
    openness: Openness,
    *,
    copies: int,
) -> Triangles:
    position[..., 2] = np.clip(position[..., 2], *BOUNDS)
    light = openness.at(leaves.root + 0.5 * leaves.along)
    albedo = leaves.albedo + fresh * (light**2)[:, None]
    normal, albedo = (np.tile(each[:, None], (copies, 3, 1)) for each in (leaves.normal, albedo))
    along = ROOT_SHADE + (1.0 - ROOT_SHADE) * leaf_uv[..., 1]
    count = len(position)
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
