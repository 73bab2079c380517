"""Triangles of wood and of leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.look.tree_growth import frames
from sketchterrain.look.tree_shape import BANDED, SOLID, Leaves, Triangles

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.look.tree_leaves import Openness
    from sketchterrain.look.tree_species import Colours

    Floats = npt.NDArray[np.float64]

BOUNDS = (-0.02, 1.08)
"""Heights of the plant between which all leaves lie, however large."""
ROOT_SHADE = 0.72
"""Openness of a spray's root, of that of its tip."""


def tubes(
    curves: Floats,
    radius: Floats,
    *,
    sides: int,
    colours: Colours,
    opened: Openness,
    rng: np.random.Generator,
) -> Triangles:
    """Wrap bark around curves.

    Parameters
    ----------
    curves
        (n, k, 3) places along each.
    radius
        (n, k) there.
    sides
        Of the cross section.
    colours, opened, rng
        Of the bark, of the crown that shades it, for its marks.
    """
    _, aside, above = frames(curves)
    turn = 2.0 * np.pi * np.arange(sides + 1) / sides
    ring = aside[:, :, None] * np.cos(turn)[:, None] + above[:, :, None] * np.sin(turn)[:, None]
    place = curves[:, :, None] + radius[:, :, None, None] * ring
    height = np.clip(curves[..., 2], 0.0, 1.0)
    up = np.clip((height - 0.30) / 0.25, 0.0, 1.0)[..., None]
    bark = np.array(colours.bark) * (1.0 - up) + np.array(colours.bark_above) * up
    dark = rng.uniform(0.0, 1.0, (*curves.shape[:2], sides)) < colours.marks
    shade = rng.uniform(0.8, 1.15, dark.shape) * np.where(dark, 0.16, 1.0)
    shade = np.concatenate([shade, shade[:, :, :1]], axis=2)[..., None]
    albedo = bark[:, :, None] * shade
    light = np.repeat(opened.at(curves)[:, :, None], sides + 1, axis=2)[..., None]
    round_, up_ = np.broadcast_arrays(np.linspace(-1.0, 1.0, sides + 1), height[..., None])
    grid = np.concatenate([place, ring, albedo, light, round_[..., None], up_[..., None]], axis=-1)
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


def sheets(leaves: Leaves, kind: float, fresh: Floats, opened: Openness) -> Triangles:
    """Make each spray a sheet of two triangles, out of which its leaves are cut when it is drawn."""
    a, b = leaves.root - leaves.aside, leaves.root + leaves.aside
    c, d = b + leaves.along, a + leaves.along
    at = np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0]])
    first, second = [0, 1, 2], [0, 2, 3]
    corners = np.stack([a, b, c, d], axis=1)
    place = np.concatenate([corners[:, first], corners[:, second]])
    sprig = np.concatenate([np.broadcast_to(at[each], (len(a), 3, 2)) for each in (first, second)])
    return _leafy(leaves, place, sprig, kind, fresh, opened, copies=2)


def spears(leaves: Leaves, scale: float, fresh: Floats, opened: Openness) -> Triangles:
    """Make each spray one triangle, `scale` times as large."""
    middle = leaves.root + 0.4 * leaves.along
    along, aside = scale * leaves.along, scale * leaves.aside
    place = np.stack(
        [middle - 0.4 * along - aside, middle - 0.4 * along + aside, middle + 0.6 * along], axis=1
    )
    sprig = np.broadcast_to([[-1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], (*place.shape[:2], 2))
    return _leafy(leaves, place, sprig, SOLID, fresh, opened, copies=1)


def _leafy(
    leaves: Leaves, place: Floats, sprig: Floats, kind: float, fresh: Floats, opened: Openness, *, copies: int
) -> Triangles:
    place[..., 2] = np.clip(place[..., 2], *BOUNDS)
    light = opened.at(leaves.root + 0.5 * leaves.along)
    albedo = leaves.albedo + fresh * (light**2)[:, None]
    outward, albedo = (np.tile(each[:, None], (copies, 3, 1)) for each in (leaves.outward, albedo))
    along = ROOT_SHADE + (1.0 - ROOT_SHADE) * sprig[..., 1]
    count = len(place)
    return Triangles(
        place,
        outward,
        albedo,
        np.tile(light, copies)[:, None] * along,
        np.asarray(sprig, dtype=np.float64),
        np.full(count, kind),
        np.ones(count),
        np.tile(leaves.phase, copies),
    )
