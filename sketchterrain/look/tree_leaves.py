"""Leaves on a plant's wood, and the openness of its crown to sky and sun."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.look.tree_growth import GOLDEN_ANGLE, frames
from sketchterrain.look.tree_shape import Leaves, unit

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.look.tree_growth import Wood
    from sketchterrain.look.tree_species import Crown, Whorls


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
    centre = 0.5 * (crown.profile[0][0] + crown.profile[-1][0])
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
    reach = np.linalg.norm(wood.boughs[:, -1] - wood.boughs[:, 0], axis=1)
    pairs = np.maximum(np.rint(whorls.sprays * (reach / whorls.spread) ** 0.8), 2)
    bough, step, side = (
        each.ravel()
        for each in np.meshgrid(
            np.arange(len(reach)), np.arange(whorls.sprays + 2), np.arange(3), indexing="ij"
        )
    )
    selected = step < pairs[bough]
    bough, step, side = bough[selected], step[selected], side[selected]
    count = len(bough)
    t = np.clip((step + rng.uniform(0.35, 1.05, count)) / pairs[bough], 0.06, 1.0)
    ahead, across, below = frames(wood.boughs)
    where = t * (wood.boughs.shape[1] - 1)
    piece = np.minimum(where.astype(np.int64), wood.boughs.shape[1] - 2)
    share = (where - piece)[:, None]
    root = wood.boughs[bough, piece] * (1.0 - share) + wood.boughs[bough, piece + 1] * share
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
    young = 0.16 + 0.84 * (reach / whorls.spread)[bough]
    grown = rng.uniform(0.75, 1.25, count) * (1.05 - 0.45 * t) * young
    grown = np.where(side == 2, 0.75, 1.0) * grown
    flat = np.where(hangs, unit(ahead), unit(np.cross(along, UP)))
    flat = unit(flat + 0.45 * rng.standard_normal((count, 3)))
    flat = unit(flat - along * np.sum(flat * along, axis=1, keepdims=True))
    middle = root + 0.5 * length * grown[:, None] * along
    normal = unit(unit(middle * [1.0, 1.0, 0.0]) + 0.5 * UP + 0.2 * rng.standard_normal((count, 3)))
    of_bough = rng.uniform(0.85, 1.15, (len(reach), 1))
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
    x, y = (np.interp(up, wood.trunk[:, 2], wood.trunk[:, axis]) for axis in (0, 1))
    along = unit(out * (0.9 - 5.0 * (up - 0.9))[:, None] + UP * rng.uniform(0.9, 1.3, (count, 1)))
    length, half_width = whorls.leaf
    across = np.stack([-np.sin(angle), np.cos(angle), np.zeros(count)], axis=1)
    albedo = np.broadcast_to(whorls.colours.leaf, (count, 3)) * rng.uniform(0.9, 1.2, (count, 1))
    root = np.stack([x, y, up], axis=1)
    return Leaves(
        root, 0.42 * length * along, 0.5 * half_width * across, unit(out + 0.5 * UP), albedo, np.zeros(count)
    )


class Openness:
    """Openness of places in a crown: light from above and four sides is attenuated by the leaves' areas."""

    CELLS: Final = 20
    """Along each side of the bounding box of all leaves."""
    SHADE: Final = 0.18
    """Share of the light that a leaf as large as its cell's face absorbs."""

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

    def _at(self, places: Float64Array) -> npt.NDArray[np.int64]:
        cell = np.floor((places - self._low) / self._cell).astype(np.int64)
        return np.asarray(np.clip(cell, 0, self.CELLS - 1))
