"""Wide grids evaluated as adjacent patches, band by band."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.terrain.answers import Band
from sketchterrain.terrain.lattice import QUADS, to_lattice

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy.typing as npt

    from sketchterrain.terrain.evaluation import Evaluator

# The patches of one launch: fewer would leave a device idle, more would only need memory.
_PATCHES_PER_BAND = 256


def bands(
    evaluator: Evaluator,
    area: tuple[float, float, float, float],
    columns: int,
    rows: int,
    *,
    cell_size: float,
    progress: Callable[[float], None] | None = None,
) -> Iterator[Band]:
    """Evaluate a grid over a rectangle (west, south, east, north, m) in bands of rows from the north.

    The outermost vertices are on the rectangle's border; ``columns``, ``rows`` ≥ 2. Positions depend only on
    the index in the whole grid, so no bit depends on the bands.
    """
    west, south, east, north = area
    if columns < 2 or rows < 2:
        raise InputError(f"expected at least 2 × 2 vertices, got {columns} × {rows}")
    if not (np.isfinite(area).all() and west < east and south < north):
        raise InputError(f"expected a rectangle west < east, south < north, got {area}")
    extent = evaluator.recipe.extent
    axis_x, axis_y = _axis_of(west, east, columns, extent), _axis_of(south, north, rows, extent)[::-1]
    return _bands(evaluator, axis_x, axis_y, cell_size, progress)


def window_bands(
    evaluator: Evaluator,
    corner: tuple[float, float],
    cell: float,
    left: int,
    top: int,
    columns: int,
    rows: int,
) -> Iterator[Band]:
    """Evaluate a window of an unbounded grid in bands of rows from the north.

    Vertex (row j, column i) is at (west + i·cell, north − j·cell), m, with ``corner`` (west, north):
    positions depend on j and i alone, so a vertex has the same bits in every window.
    """
    axes = window_axes(evaluator.recipe.extent, corner, cell, left, top, columns, rows)
    return _bands(evaluator, *axes, cell, None)


def window_axes(
    extent: float, corner: tuple[float, float], cell: float, left: int, top: int, columns: int, rows: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return lattice coordinates of a window's columns and rows, with one more beyond each end."""
    if columns < 1 or rows < 1:
        raise InputError(f"expected at least 1 × 1 vertices, got {columns} × {rows}")
    west, north = corner
    axis_x = to_lattice(west + np.arange(left - 1, left + columns + 1) * cell, extent)
    axis_y = to_lattice(north - np.arange(top - 1, top + rows + 1) * cell, extent)
    return axis_x, axis_y


class Strip(NamedTuple):
    """Some rows of a grid as adjacent patches, row by row."""

    top: int  # its first row in the grid
    rows: int
    shape: tuple[int, int]  # rows and columns of patches
    axis_x: npt.NDArray[np.int64]  # (patches, QUADS + 3)
    axis_y: npt.NDArray[np.int64]
    share: tuple[float, float]  # its part of the grid's patches, 0 … 1


def strips(axis_x: npt.NDArray[np.int64], axis_y: npt.NDArray[np.int64]) -> Iterator[Strip]:
    """Cut the vertices of two axes, each with one more beyond its ends; y runs from north to south."""
    across, down = _windows_of(axis_x), _windows_of(axis_y)
    at_once = max(_PATCHES_PER_BAND // len(across), 1)
    for first in range(0, len(down), at_once):
        part = down[first : first + at_once]
        shape = (len(part), len(across))
        top = QUADS * first
        # A strip's last row is the next one's first, except in the last strip.
        rows = len(axis_y) - 2 - top if first + len(part) == len(down) else QUADS * len(part)
        yield Strip(
            top,
            rows,
            shape,
            np.broadcast_to(across[None], (*shape, QUADS + 3)).reshape(-1, QUADS + 3),
            np.broadcast_to(part[:, None], (*shape, QUADS + 3)).reshape(-1, QUADS + 3),
            (first / len(down), (first + len(part)) / len(down)),
        )


def _bands(
    evaluator: Evaluator,
    axis_x: npt.NDArray[np.int64],
    axis_y: npt.NDArray[np.int64],
    cell_size: float,
    progress: Callable[[float], None] | None,
) -> Iterator[Band]:
    """Evaluate the vertices of two axes, each with one more beyond its ends; y runs from north to south."""
    columns = len(axis_x) - 2
    for strip in strips(axis_x, axis_y):
        surface = evaluator.surface(
            strip.axis_x,
            strip.axis_y,
            cell_size=cell_size,
            progress=_partial_progress(progress, *strip.share),
        )
        parts = (surface.height, surface.normal, surface.materials)
        yield Band(strip.top, *(_join(each, strip.shape, strip.rows, columns) for each in parts))


def _axis_of(first: float, last: float, count: int, extent: float) -> npt.NDArray[np.int64]:
    """Return lattice coordinates of ``count`` vertices from first to last (m), plus one beyond each end."""
    return to_lattice(first + np.arange(-1, count + 1) * ((last - first) / (count - 1)), extent)


def _windows_of(axis: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Cut an axis into overlapping windows of QUADS + 3; the last is padded with its last vertex."""
    inner = len(axis) - 2
    starts = range(0, max(inner - 1, 1), QUADS)
    index = np.minimum(np.array(starts)[:, None] + np.arange(QUADS + 3), len(axis) - 1)
    return axis[index]


def _join(
    patches: npt.NDArray[np.floating], shape: tuple[int, int], rows: int, columns: int
) -> npt.NDArray[np.float32]:
    """Join adjacent patches, which share rows and columns of vertices."""
    result = np.empty((rows, columns, *patches.shape[3:]), np.float32)
    for number, patch in enumerate(patches):
        top, left = (QUADS * place for place in divmod(number, shape[1]))
        part = result[top : top + QUADS + 1, left : left + QUADS + 1]
        part[...] = patch[: part.shape[0], : part.shape[1]]
    return result


def _partial_progress(
    progress: Callable[[float], None] | None, first: float, last: float
) -> Callable[[float], None] | None:
    return None if progress is None else lambda share: progress(first + share * (last - first))
