"""Which tiles of the endless quadtree cover the world around an eye, and at what level.

Tile (level, col, row) covers [col, col+1] × [row, row+1] · extent / 2^level metres. A tile is split while
it is wider than ``split`` times its distance, so all tiles look about equally wide on the screen. For
``split`` up to 1/√2 this alone keeps neighbours within one level of each other. Proof: let a tile B of width
w be a leaf and its neighbour P of width w/2 be split. P touches B, so d(B) ≤ d(P) + diagonal(P), that is
d(B) ≤ d(P) + w/√2. P is split, so split·d(P) < w/2. B is a leaf, so w ≤ split·d(B) < w/2 + split·w/√2 ≤ w,
a contradiction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Protocol

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.tiles.codes import TileKey
from sketchterrain.tiles.view import inside_frustum

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["COARSEST", "FINEST", "QUADS", "HeightRange", "TileKey", "inside_frustum", "select_tiles"]

QUADS: Final = 64
"""Quads along a tile's side."""
COARSEST: Final = -12
FINEST: Final = 14

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class HeightRange(Protocol):
    """Bounds of the ground's height over rectangles, for culling."""

    def __call__(self, west: Floats, south: Floats, east: Floats, north: Floats) -> tuple[Floats, Floats]:
        """Return lowest and highest ground (m) in each rectangle (m); may be generous, never too tight."""
        ...


def select_tiles(
    eye: Sequence[float],
    extent: float,
    *,
    draw_distance: float,
    split: float = 0.5,
    clearance: float = 0.0,
    finest: int = FINEST,
    frustum: Floats | None = None,
    height_range: HeightRange | None = None,
) -> list[TileKey]:
    """Choose the tiles to draw: no overlaps, no holes, nearest first.

    Parameters
    ----------
    eye
        x, y (m) of the viewer; further coordinates are ignored.
    extent
        Width of a level-0 tile (m), > 0.
    draw_distance
        Horizontal distance (m) up to which the ground is covered, > 0.
    split
        A tile is split while its width exceeds this share of its distance; in (0, 2].
        Neighbours differ by one level at most for values up to 0.7.
    clearance
        Height of the eye above the ground (m), taken as the least distance to any tile.
    finest
        Level at which splitting ends.
    frustum
        (k, 4) float64 planes a·x + b·y + c·z + d ≥ 0 inside; tiles wholly outside one of them are left out.
    height_range
        Bounds of the ground's height, wanted when `frustum` is given; without it columns of any height count.

    Returns
    -------
    list of TileKey
    """
    if not extent > 0 or not draw_distance > 0:
        raise InputError(f"expected extent and draw distance > 0 m, got {extent:g} and {draw_distance:g}")
    if not 0 < split <= 2:
        raise InputError(f"expected split in (0, 2], got {split:g}")
    x, y = float(eye[0]), float(eye[1])
    level = int(np.clip(np.floor(np.log2(extent / draw_distance)), COARSEST, finest))
    cols, rows = _roots(x, y, extent * 2.0**-level, draw_distance)
    found: list[tuple[Floats, int, Ints, Ints]] = []
    while cols.size:
        width = extent * 2.0**-level
        west, south = (cols * width).astype(np.float64), (rows * width).astype(np.float64)
        distance = _distance(x, y, west, south, width)
        keep = distance <= draw_distance
        if frustum is not None:
            keep &= _visible(frustum, west, south, width, height_range)
        cols, rows, distance = cols[keep], rows[keep], distance[keep]
        split_up = (width > split * np.hypot(distance, clearance)) & (level < finest)
        found.append((distance[~split_up], level, cols[~split_up], rows[~split_up]))
        cols, rows = _children(cols[split_up], rows[split_up])
        level += 1
    return _nearest_first(found)


def _roots(x: float, y: float, width: float, reach: float) -> tuple[Ints, Ints]:
    cols = np.arange(np.floor((x - reach) / width), np.floor((x + reach) / width) + 1).astype(np.int64)
    rows = np.arange(np.floor((y - reach) / width), np.floor((y + reach) / width) + 1).astype(np.int64)
    grid_cols, grid_rows = np.meshgrid(cols, rows)
    return grid_cols.ravel(), grid_rows.ravel()


def _distance(x: float, y: float, west: Floats, south: Floats, width: float) -> Floats:
    """Horizontal distance from the eye to each tile, 0 inside."""
    dx = np.maximum(np.maximum(west - x, x - (west + width)), 0.0)
    dy = np.maximum(np.maximum(south - y, y - (south + width)), 0.0)
    return np.hypot(dx, dy)


def _visible(
    frustum: Floats, west: Floats, south: Floats, width: float, height_range: HeightRange | None
) -> npt.NDArray[np.bool_]:
    east, north = west + width, south + width
    if height_range is None:
        bottom, top = np.full(len(west), -1e5), np.full(len(west), 1e5)
    else:
        bottom, top = height_range(west, south, east, north)
    return inside_frustum(
        frustum, np.stack([west, south, bottom], axis=1), np.stack([east, north, top], axis=1)
    )


def _children(cols: Ints, rows: Ints) -> tuple[Ints, Ints]:
    return (
        np.concatenate([2 * cols, 2 * cols + 1, 2 * cols, 2 * cols + 1]),
        np.concatenate([2 * rows, 2 * rows, 2 * rows + 1, 2 * rows + 1]),
    )


def _nearest_first(found: list[tuple[Floats, int, Ints, Ints]]) -> list[TileKey]:
    distance = np.concatenate([entry[0] for entry in found])
    keys = np.concatenate([np.stack([np.full_like(c, lv), c, r], axis=1) for _, lv, c, r in found])
    order = np.lexsort((keys[:, 2], keys[:, 1], keys[:, 0], distance))
    return [TileKey(*key) for key in keys[order].tolist()]
