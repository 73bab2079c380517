"""Branching structure of a plant: a trunk and boughs grown towards points in its crown.

After space colonisation (Runions, Lane & Prusinkiewicz 2007) with one step for each order of branching: the
crown is filled with points, some of them attract boughs from the trunk, and a twig leads from the nearest
bough to each of the rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.look.tree_shape import perpendicular, unit

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.look.tree_species import Crown, Whorls


GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
STEPS = 5
"""Segments of a bough."""
TWIG_STEPS = 2


class Wood(NamedTuple):
    """Curves of the wood and the radii along them, in heights of the plant."""

    trunk: Float64Array  # (k, 3)
    trunk_radius: Float64Array  # (k,)
    boughs: Float64Array  # (b, steps + 1, 3)
    bough_radius: Float64Array  # (b, steps + 1)
    twigs: Float64Array  # (t, twig steps + 1, 3), ends are where leaves grow
    twig_radius: Float64Array  # (t, twig steps + 1)
    bough_of: npt.NDArray[np.int64]  # (t,)


def grow_crown(crown: Crown, rng: np.random.Generator) -> Wood:
    """Grow the wood of a plant with a round crown."""
    tips = _tips(crown, rng)
    trunk = _trunk(rng, crown.trunk_top, crown.bend, pieces=14)
    trunk_radius = crown.trunk_radius * (1.0 - 0.72 * trunk[:, 2] / crown.trunk_top) ** 0.9
    trunk_radius[0] *= 1.45  # where the roots begin
    ends = _spread_out(tips, crown.boughs, rng)
    target = tips[ends]
    lateral = np.linalg.norm(target[:, :2], axis=1)
    leave = np.clip(target[:, 2] - crown.rise * lateral, crown.lowest, 0.97 * crown.trunk_top)
    start = _at_height(trunk, leave)
    middle = start + (target - start) * 0.55 + [0.0, 0.0, 0.16] * (lateral * crown.arch)[:, None]
    middle += 0.12 * lateral[:, None] * rng.standard_normal(middle.shape)
    boughs = _bent(start, middle, target, STEPS)
    bough_thickness = 0.62 * np.interp(start[:, 2], trunk[:, 2], trunk_radius)
    taper = np.linspace(1.0, 0.22, STEPS + 1)
    bough_of = np.argmin(np.linalg.norm(tips[:, None] - boughs[:, 3], axis=-1), axis=1)
    bough_of[ends] = np.arange(crown.boughs)
    where = rng.uniform(0.45, 0.95, len(tips)) * STEPS
    piece = np.minimum(where.astype(np.int64), STEPS - 1)
    share = (where - piece)[:, None]
    start_point = boughs[bough_of, piece] * (1.0 - share) + boughs[bough_of, piece + 1] * share
    twig_middle = 0.5 * (start_point + tips) + [0.0, 0.0, 0.04 * crown.arch]
    twigs = _bent(start_point, twig_middle, tips, TWIG_STEPS)
    twig_thick = 0.30 * bough_thickness[bough_of]
    return Wood(
        trunk,
        trunk_radius,
        boughs,
        bough_thickness[:, None] * taper,
        twigs,
        twig_thick[:, None] * np.linspace(1.0, 0.3, TWIG_STEPS + 1),
        bough_of,
    )


def grow_whorls(whorls: Whorls, rng: np.random.Generator) -> Wood:
    """Grow a straight trunk with whorls of boughs that hang and rise again at their tips."""
    count = whorls.tiers * whorls.boughs
    tier, bough = np.divmod(np.arange(count), whorls.boughs)
    up = (tier + rng.uniform(-0.35, 0.35, count)) / whorls.tiers
    height = whorls.lowest + (0.985 - whorls.lowest) * np.clip(up, 0.0, 1.0) ** 0.92
    reach = (whorls.spread * (1.0 - height) ** 0.78 + 0.012) * rng.uniform(0.68, 1.18, count)
    angle = 2.0 * np.pi * bough / whorls.boughs + GOLDEN_ANGLE * tier + rng.uniform(-0.3, 0.3, count)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    trunk = _trunk(rng, 0.99, whorls.bend, pieces=12)
    start = _at_height(trunk, height)
    # Young boughs rise, old ones hang under their own weight; the tips of all turn up.
    climb = 0.55 * np.clip(height - 0.55, -0.55, 0.45) * 1.6 - 0.30 * (1.0 - height) * whorls.hang
    middle = start + reach[:, None] * (0.58 * out + [0.0, 0.0, 1.0] * (climb - 0.10 * whorls.hang)[:, None])
    tip = start + reach[:, None] * (out + [0.0, 0.0, 1.0] * (1.1 * climb)[:, None])
    boughs = _bent(start, middle, tip, STEPS)
    boughs[..., 2] = np.maximum(boughs[..., 2], 0.01)
    trunk_radius = whorls.trunk_radius * np.clip(1.02 - trunk[:, 2], 0.02, 1.0) ** 0.8
    trunk_radius[0] *= 1.4
    bough_thickness = 0.26 * whorls.trunk_radius * (reach / whorls.spread) ** 0.6
    return Wood(
        trunk,
        trunk_radius,
        boughs,
        bough_thickness[:, None] * np.linspace(1.0, 0.25, STEPS + 1),
        np.zeros((0, TWIG_STEPS + 1, 3)),
        np.zeros((0, TWIG_STEPS + 1)),
        np.zeros(0, np.int64),
    )


def _tips(crown: Crown, rng: np.random.Generator) -> Float64Array:
    """Fill a crown with lumps of points for leaves, denser near its border."""
    heights, radii = np.array(crown.profile).T
    fine = np.linspace(heights[0], heights[-1], 200)
    wide = np.interp(fine, heights, radii)
    summed = np.cumsum(wide + 0.02)
    turn = (np.arange(crown.tips) + rng.uniform(0.0, 1.0, crown.tips)) / crown.tips
    z = np.interp(turn * summed[-1], summed, fine)
    angle = GOLDEN_ANGLE * np.arange(crown.tips) + rng.uniform(-0.5, 0.5, crown.tips)
    lobes = rng.uniform(0.0, 2.0 * np.pi, 4)
    lump = 1.0 + crown.lumps * (
        np.sin(2.0 * angle + 5.0 * z + lobes[0])
        + np.sin(3.0 * angle - 9.0 * z + lobes[1])
        + 0.7 * np.sin(5.0 * angle + 13.0 * z + lobes[2])
    )
    inside = rng.uniform(0.0, 1.0, crown.tips) < crown.filling
    depth = np.where(inside, rng.uniform(0.25, 0.75, crown.tips), rng.uniform(0.82, 1.0, crown.tips))
    radius = np.interp(z, heights, radii) * lump * depth
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def _spread_out(points: Float64Array, count: int, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Select points far from each other (farthest-point sampling)."""
    selected = [int(rng.integers(len(points)))]
    away = np.linalg.norm(points - points[selected[0]], axis=1)
    for _ in range(count - 1):
        selected.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[selected[-1]], axis=1))
    return np.array(selected, dtype=np.int64)


def _trunk(rng: np.random.Generator, top: float, bend: float, *, pieces: int) -> Float64Array:
    """Return a wavering curve from below the ground to the top, upright at its foot."""
    t = np.linspace(0.0, 1.0, pieces + 1)
    swing, turns = rng.uniform(0.0, 2.0 * np.pi, 2), rng.uniform(0.7, 1.6, 2)
    lateral = bend * t[:, None] * (np.sin(2.0 * np.pi * turns * t[:, None] + swing) - np.sin(swing))
    lean = bend * rng.uniform(-0.8, 0.8, 2) * t[:, None] ** 2
    z = -0.03 + (top + 0.03) * t
    return np.concatenate([lateral + lean, z[:, None]], axis=1)


def _at_height(trunk: Float64Array, height: Float64Array) -> Float64Array:
    x, y = (np.interp(height, trunk[:, 2], trunk[:, axis]) for axis in (0, 1))
    return np.stack([x, y, height], axis=1)


def _bent(start: Float64Array, middle: Float64Array, end: Float64Array, steps: int) -> Float64Array:
    """Return points of quadratic Bézier curves, (n, steps + 1, 3)."""
    t = np.linspace(0.0, 1.0, steps + 1)[:, None]
    return np.asarray(
        (1.0 - t) ** 2 * start[:, None] + 2.0 * t * (1.0 - t) * middle[:, None] + t**2 * end[:, None]
    )


def frames(curves: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return unit tangents of curves (n, k, 3) and two unit vectors perpendicular to them."""
    along = unit(np.gradient(curves, axis=1))
    lateral = perpendicular(along)
    return along, lateral, np.cross(lateral, along)
