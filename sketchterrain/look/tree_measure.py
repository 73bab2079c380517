"""Covered area and mean colour of a plant plant_view from the side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.look.tree_shape import BROAD, NEEDLES

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array
    from sketchterrain.look.tree_shape import Triangles


VIEWS: Final = (0.4, 1.9)
"""Azimuths of view, rad."""
CELLS: Final = 48
"""Raster cells per plant height."""
PER_CELL: Final = 5.0
"""Sample points on a triangle as large as a cell."""


class PlantView(NamedTuple):
    """Covered area (squares of its height) and area-weighted mean of visible albedo · openness (3,)."""

    area: float
    colour: Float64Array


def leaf_mask(across: Float64Array, along: Float64Array, mask: Float64Array) -> Float64Array:
    """Return a spray's leaf mask, positive inside leaves; the oracle of kernels/render/sprig.glsl."""
    needles = mask > 0.5 * (BROAD + NEEDLES)
    away = np.abs(across)
    forward, count = np.where(needles, 0.5, 0.55), np.where(needles, 8.0, 5.0)
    row = (along - 0.3 * forward * away) * count + np.where(across < 0.0, 0.5, 0.0)
    up = np.clip(along - 0.3 * forward * away, 0.0, 1.0)
    reach = np.sqrt(1.0 - up * up) * np.minimum(
        np.where(needles, 6.0, 4.0) * up + np.where(needles, 0.5, 0.35), 1.0
    )
    grown = np.where(needles, 1.0, 0.7 + 0.3 * np.mod(np.floor(row) * 0.618034 + 0.37 * (across < 0.0), 1.0))
    out = away / np.maximum(reach * grown, 1e-3)
    full = np.where(needles, 0.36 * (1.0 - 0.5 * out), 0.94 * np.sqrt(np.maximum(out * (1.0 - out), 0.0)))
    leaf = np.where(out < 1.0, full - np.abs(row - np.floor(row) - 0.5), -1.0)
    return np.where(mask < 0.5 * BROAD, 1.0, np.maximum(leaf, 0.06 - away))


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
    inside = leaf_mask(at[:, 0], at[:, 1], triangles.mask[of]) > 0.0
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
