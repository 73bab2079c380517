"""The ground as tiles that are uploaded once and never change."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.programs import build_program
from sketchterrain.tiles import QUADS, TileKey

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.render.scene import Surface

    Floats = npt.NDArray[np.float64]

__all__ = ["SIDE", "VERTICES", "DrawnGround", "tile_indices"]

SIDE: Final = QUADS + 1
VERTICES: Final = SIDE * SIDE + 4 * SIDE
"""Of a tile: its grid, then its four borders once more as skirts: north, south, west, east."""
_VERTEX: Final = np.dtype([("height", "f4"), ("slope", "i2", 2), ("weights", "u1", 8)])


class DrawnGround:
    """Tiles on the GPU, and the surface that they draw.

    Parameters
    ----------
    context
        Where they are drawn.
    extent
        Width of a level-0 tile (m).
    keys, tiles
        Which tiles, nearest first, and their vertices.
    """

    def __init__(
        self, context: moderngl.Context, extent: float, keys: Sequence[TileKey], tiles: Sequence[Surface]
    ) -> None:
        self._keys = list(keys)
        self._width = extent * 2.0 ** -np.array([key.level for key in keys], dtype=np.float64)
        place = np.array([(key.col, key.row + 1) for key in keys], dtype=np.float64)
        self._corner = place * self._width[:, None]  # north-west
        self._heights = np.stack([tile.height for tile in tiles])
        normals = np.stack([tile.normal for tile in tiles])
        weights = np.stack([tile.materials for tile in tiles])
        vertices = context.buffer(_pack(self._heights, normals, weights, self._width / QUADS).tobytes())
        self._indices = context.buffer(tile_indices().tobytes())
        self._corners = context.buffer(reserve=12 * len(keys))
        self._commands = context.buffer(_commands(np.arange(len(keys))).tobytes())
        self._array = context.vertex_array(
            build_program(
                context, "fixed_ground.vert.glsl", "ground.frag.glsl", defines={"TILE_QUADS": QUADS}
            ),
            [
                (vertices, "1f4 2i2 4f1 4f1", "height", "slope", "low_weights", "high_weights"),
                (self._corners, "3f4/i", "corner"),
            ],
            index_buffer=self._indices,
        )

    @property
    def vertices(self) -> int:
        """Vertices of all tiles, skirts included."""
        return VERTICES * len(self._keys)

    def draw(self, eye: tuple[float, float, float]) -> None:
        """Draw all tiles as seen from `eye`; the camera stands in the frame's uniform block."""
        corners = np.empty((len(self._keys), 3), np.float32)
        corners[:, :2] = self._corner - np.asarray(eye[:2])
        corners[:, 2] = self._width / QUADS
        self._corners.write(corners.tobytes())
        self._array.render_indirect(self._commands, moderngl.TRIANGLES, count=len(self._keys))

    def surface(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Look the drawn surface up.

        Parameters
        ----------
        x, y
            (n,) m.

        Returns
        -------
        height, cell_size : (n,) float64
            m; NaN and infinity where no tile lies.
        """
        height = np.full(len(x), np.nan)
        cell = np.full(len(x), np.inf)
        levels = np.array([key.level for key in self._keys])
        place = np.array([(key.col, key.row) for key in self._keys], dtype=np.int64)
        for level in np.unique(levels):
            members = np.flatnonzero(levels == level)
            width = self._width[members[0]]
            tile = _find(place[members], np.floor(x / width), np.floor(y / width))
            here = np.flatnonzero(tile >= 0)
            owner = members[tile[here]]
            col = np.clip((x[here] - self._corner[owner, 0]) / width * QUADS, 0.0, QUADS - 1e-6)
            row = np.clip((self._corner[owner, 1] - y[here]) / width * QUADS, 0.0, QUADS - 1e-6)
            height[here] = _on_triangles(self._heights, owner, col, row)
            cell[here] = width / QUADS
        return height, cell


def tile_indices() -> npt.NDArray[np.uint32]:
    """Return a tile's triangles, counter-clockwise from above, quads cut from north-west to south-east."""
    index = np.arange(SIDE * SIDE, dtype=np.uint32).reshape(SIDE, SIDE)
    nw, ne, sw, se = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    grid = np.stack([nw, sw, se, nw, se, ne], axis=-1).reshape(-1)
    borders = (index[0], index[-1, ::-1], index[::-1, 0], index[:, -1])
    skirts = np.arange(SIDE * SIDE, VERTICES, dtype=np.uint32).reshape(4, SIDE)
    lowered = (skirts[0], skirts[1, ::-1], skirts[2, ::-1], skirts[3])
    sides = [
        np.stack([a[:-1], a[1:], b[1:], a[:-1], b[1:], b[:-1]], axis=-1).reshape(-1)
        for a, b in zip(borders, lowered, strict=True)
    ]
    return np.concatenate([grid, *sides])


def _pack(
    heights: npt.NDArray[np.float32],
    normals: npt.NDArray[np.float32],
    weights: npt.NDArray[np.float32],
    cells: Floats,
) -> npt.NDArray[np.void]:
    count = len(heights)
    grid = np.empty((count, SIDE, SIDE), _VERTEX)
    grid["height"] = heights
    grid["slope"] = np.rint(normals[..., :2] * 32767.0)
    grid["weights"] = np.rint(weights * 255.0)
    skirt = np.stack([grid[:, 0], grid[:, -1], grid[:, :, 0], grid[:, :, -1]], axis=1)
    skirt["height"] -= (3.0 * cells)[:, None, None].astype(np.float32)
    return np.concatenate([grid.reshape(count, -1), skirt.reshape(count, -1)], axis=1)


def _commands(tiles: npt.NDArray[np.intp]) -> npt.NDArray[np.uint32]:
    """Indirect draws: index count, instance count, first index, base vertex, base instance."""
    commands = np.zeros((len(tiles), 5), np.uint32)
    commands[:, 0] = len(tile_indices())
    commands[:, 1] = 1
    commands[:, 3] = tiles * VERTICES
    commands[:, 4] = tiles
    return commands


def _find(places: npt.NDArray[np.int64], col: Floats, row: Floats) -> npt.NDArray[np.intp]:
    """Return the index in `places` of each (col, row), -1 where there is none."""
    low = places.min(axis=0)
    span = places.max(axis=0) - low + 1
    inside = (col >= low[0]) & (col < low[0] + span[0]) & (row >= low[1]) & (row < low[1] + span[1])
    wanted = np.where(inside, (col - low[0]) * span[1] + (row - low[1]), -1).astype(np.int64)
    codes = (places[:, 0] - low[0]) * span[1] + (places[:, 1] - low[1])
    order = np.argsort(codes)
    slot = np.minimum(np.searchsorted(codes[order], wanted), len(codes) - 1)
    return np.where(codes[order][slot] == wanted, order[slot], -1)


def _on_triangles(
    heights: npt.NDArray[np.float32], tile: npt.NDArray[np.intp], col: Floats, row: Floats
) -> Floats:
    i, j = col.astype(np.intp), row.astype(np.intp)
    u, v = col - i, row - j
    nw, ne = heights[tile, j, i], heights[tile, j, i + 1]
    sw, se = heights[tile, j + 1, i], heights[tile, j + 1, i + 1]
    lower = nw + (sw - nw) * v + (se - sw) * u
    upper = nw + (ne - nw) * u + (se - ne) * v
    return np.asarray(np.where(v >= u, lower, upper), dtype=np.float64)
