"""Tree growth: branches and leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.look.tree_species import Leaves, perpendicular, unit

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array, Int64Array
    from sketchterrain.look.tree_species import Crown, Whorls


GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
STEPS = 5  # segments of a bough
TWIG_STEPS = 2


class Wood(NamedTuple):
    """Curves of the wood and the radii along them, in heights of the plant."""

    trunk: Float64Array  # (k, 3)
    trunk_radius: Float64Array  # (k,)
    boughs: Float64Array  # (b, steps + 1, 3)
    bough_radius: Float64Array  # (b, steps + 1)
    twigs: Float64Array  # (t, twig steps + 1, 3), ends are where leaves grow
    twig_radius: Float64Array  # (t, twig steps + 1)
    bough_of: Int64Array  # (t,)


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
    start_point, _ = _along(boughs, bough_of, rng.uniform(0.45, 0.95, len(tips)))
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
    bough_length = (whorls.spread * (1.0 - height) ** 0.78 + 0.012) * rng.uniform(0.68, 1.18, count)
    angle = 2.0 * np.pi * bough / whorls.boughs + GOLDEN_ANGLE * tier + rng.uniform(-0.3, 0.3, count)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    trunk = _trunk(rng, 0.99, whorls.bend, pieces=12)
    start = _at_height(trunk, height)
    # Young boughs rise, old ones hang under their own weight; the tips of all turn up.
    climb = 0.55 * np.clip(height - 0.55, -0.55, 0.45) * 1.6 - 0.30 * (1.0 - height) * whorls.hang
    middle = start + bough_length[:, None] * (
        0.58 * out + [0.0, 0.0, 1.0] * (climb - 0.10 * whorls.hang)[:, None]
    )
    tip = start + bough_length[:, None] * (out + [0.0, 0.0, 1.0] * (1.1 * climb)[:, None])
    boughs = _bent(start, middle, tip, STEPS)
    boughs[..., 2] = np.maximum(boughs[..., 2], 0.01)
    trunk_radius = whorls.trunk_radius * np.clip(1.02 - trunk[:, 2], 0.02, 1.0) ** 0.8
    trunk_radius[0] *= 1.4
    bough_thickness = 0.26 * whorls.trunk_radius * (bough_length / whorls.spread) ** 0.6
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
    heights, radii = np.array(crown.heights), np.array(crown.radii)
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


def _spread_out(points: Float64Array, count: int, rng: np.random.Generator) -> Int64Array:
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


def _along(boughs: Float64Array, bough: Int64Array, t: Float64Array) -> tuple[Float64Array, Int64Array]:
    """Return points on some of the boughs at shares of their lengths, and the segments that they are on."""
    where = t * (boughs.shape[1] - 1)
    piece = np.minimum(where.astype(np.int64), boughs.shape[1] - 2)
    share = (where - piece)[:, None]
    return boughs[bough, piece] * (1.0 - share) + boughs[bough, piece + 1] * share, piece


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


UP: Final = np.array([0.0, 0.0, 1.0])


def leaves_of_crown(crown: Crown, wood: Wood, rng: np.random.Generator) -> Leaves:
    """Put a tuft of leaves at each tip of a round crown."""
    tips = wood.twigs[:, -1]
    tuft = np.repeat(np.arange(len(tips)), crown.sprays)
    count = len(tuft)
    ball = unit(rng.standard_normal((count, 3)))
    radius, height, hang = crown.clump
    size = rng.uniform(0.75, 1.25, len(tips))[tuft]
    offset = ball * [radius, radius, height] * (size * rng.uniform(0.35, 1.0, count) ** 0.5)[:, None]
    offset[:, 2] -= hang * height * rng.uniform(0.0, 2.0, count)
    middle = tips[tuft] + offset
    radial = middle * [1.0, 1.0, 0.0]
    centre = 0.5 * (crown.heights[0] + crown.heights[-1])
    round_out = unit(radial + UP * ((middle[:, 2:] - centre) * 0.6))
    scatter = rng.standard_normal((count, 3))
    along = unit(ball + 0.6 * round_out + 0.55 * scatter - UP * crown.droop)
    facing = unit(0.6 * ball + 0.6 * round_out + 0.5 * UP + 0.55 * rng.standard_normal((count, 3)))
    across = unit(np.cross(along, facing) + 1e-6)
    length, half_width = crown.leaf
    grown = rng.uniform(0.75, 1.3, (count, 1))
    normal = unit(0.75 * round_out + 0.55 * ball + 0.22 * UP + 0.10 * scatter)
    root = middle - 0.5 * length * grown * along
    root[:, 2] = np.maximum(root[:, 2], 0.015)
    bough = wood.bough_of[tuft]
    of_bough = rng.uniform(0.86, 1.14, (len(wood.boughs), 1)) + rng.uniform(
        -0.04, 0.04, (len(wood.boughs), 3)
    )
    albedo = np.array(crown.colours.leaf) * of_bough[bough] * rng.uniform(0.80, 1.2, (count, 1))
    phase = np.mod(0.618 * bough + 0.13 * tuft, 1.0)
    return Leaves(root, length * grown * along, half_width * grown * across, normal, albedo, phase)


def leaves_of_whorls(whorls: Whorls, wood: Wood, rng: np.random.Generator) -> Leaves:
    """Put needle sprays on both sides of each bough, others hanging from it, and one at its tip."""
    bough_length = np.linalg.norm(wood.boughs[:, -1] - wood.boughs[:, 0], axis=1)
    pairs = np.maximum(np.rint(whorls.sprays * (bough_length / whorls.spread) ** 0.8), 2)
    bough, step, side = (
        each.ravel()
        for each in np.meshgrid(
            np.arange(len(bough_length)), np.arange(whorls.sprays + 2), np.arange(3), indexing="ij"
        )
    )
    selected = step < pairs[bough]
    bough, step, side = bough[selected], step[selected], side[selected]
    count = len(bough)
    t = np.clip((step + rng.uniform(0.35, 1.05, count)) / pairs[bough], 0.06, 1.0)
    ahead, across, below = frames(wood.boughs)
    root, piece = _along(wood.boughs, bough, t)
    ahead, across, below = ahead[bough, piece], across[bough, piece], -below[bough, piece]
    below = np.where(below[:, 2:] > 0.0, -below, below)
    turn = np.where(side == 2, 0.0, np.where(side == 0, 1.0, -1.0))[:, None]
    hangs = (side == 2)[:, None]
    open_angle = 0.95 - 0.55 * t[:, None]
    along = unit(
        ahead * np.where(hangs, 0.35, 0.8)
        + across * turn * open_angle
        + below * np.where(hangs, 0.8, 0.22)
        + 0.16 * rng.standard_normal((count, 3))
    )
    length, half_width = whorls.leaf
    young = 0.16 + 0.84 * (bough_length / whorls.spread)[bough]
    grown = rng.uniform(0.75, 1.25, count) * (1.05 - 0.45 * t) * young
    grown = np.where(side == 2, 0.75, 1.0) * grown
    flat = np.where(hangs, unit(ahead), unit(np.cross(along, UP)))
    flat = unit(flat + 0.45 * rng.standard_normal((count, 3)))
    flat = unit(flat - along * np.sum(flat * along, axis=1, keepdims=True))
    middle = root + 0.5 * length * grown[:, None] * along
    normal = unit(unit(middle * [1.0, 1.0, 0.0]) + 0.5 * UP + 0.2 * rng.standard_normal((count, 3)))
    of_bough = rng.uniform(0.85, 1.15, (len(bough_length), 1))
    albedo = np.array(whorls.colours.leaf) * of_bough[bough] * rng.uniform(0.82, 1.18, (count, 1))
    phase = np.mod(0.618 * bough, 1.0)
    width = half_width * np.sqrt(grown)[:, None] * flat
    leaves = Leaves(root, length * grown[:, None] * along, width, normal, albedo, phase)
    return Leaves(*(np.concatenate(pair) for pair in zip(leaves, _leader(whorls, wood, rng), strict=True)))


def _leader(whorls: Whorls, wood: Wood, rng: np.random.Generator) -> Leaves:
    """Put sprays close around the last segment of a trunk: the plant ends in a point."""
    count = 18
    up = 0.9 + 0.1 * np.arange(count) / count
    angle = GOLDEN_ANGLE * np.arange(count)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    along = unit(out * (0.9 - 5.0 * (up - 0.9))[:, None] + UP * rng.uniform(0.9, 1.3, (count, 1)))
    length, half_width = whorls.leaf
    across = np.stack([-np.sin(angle), np.cos(angle), np.zeros(count)], axis=1)
    albedo = np.broadcast_to(whorls.colours.leaf, (count, 3)) * rng.uniform(0.9, 1.2, (count, 1))
    root, normal = _at_height(wood.trunk, up), unit(out + 0.5 * UP)
    return Leaves(root, 0.42 * length * along, 0.5 * half_width * across, normal, albedo, np.zeros(count))


class Openness:
    """Openness of places in a crown: light from above and four sides is attenuated by the leaves' areas."""

    CELLS: Final = 20  # along each side of the bounding box of all leaves
    SHADE: Final = 0.18  # share of the light that a leaf as large as its cell's face absorbs

    def __init__(self, leaves: Leaves) -> None:
        middle = leaves.root + 0.5 * leaves.along
        self._low = middle.min(axis=0) - 1e-3
        self._cell = (middle.max(axis=0) + 1e-3 - self._low) / self.CELLS
        area = 2.0 * np.linalg.norm(np.cross(leaves.along, leaves.across), axis=1)
        at = np.ravel_multi_index(tuple(self._at(middle).T), (self.CELLS,) * 3)
        filled = np.bincount(at, area, minlength=self.CELLS**3).reshape((self.CELLS,) * 3)
        light = np.zeros_like(filled)
        for axis, backward, weight in (
            (2, True, 2.0),
            (0, False, 1.0),
            (0, True, 1.0),
            (1, False, 1.0),
            (1, True, 1.0),
        ):
            face = np.prod(self._cell) / self._cell[axis]
            depth = np.flip(filled, axis) if backward else filled
            depth = np.cumsum(depth, axis=axis) - 0.5 * depth
            depth = np.flip(depth, axis) if backward else depth
            light += weight * np.exp(-self.SHADE * depth / face)
        # A leaf at the crown's border has half the world before it: that counts as open.
        self._light = np.minimum(light / np.quantile(light[filled > 0.0], 0.9), 1.0)

    def at(self, places: Float64Array) -> Float64Array:
        """Return 0..1 for each of (…, 3) places."""
        x, y, z = np.moveaxis(self._at(places), -1, 0)
        return np.asarray(self._light[x, y, z])

    def _at(self, places: Float64Array) -> Int64Array:
        cell = np.floor((places - self._low) / self._cell).astype(np.int64)
        return np.asarray(np.clip(cell, 0, self.CELLS - 1))
