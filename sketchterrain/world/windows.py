"""Windows of a stored world's layers, put together from chunks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.errors import InputError, one_line
from sketchterrain.world.grid import CHUNK

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sketchterrain.world.grid import Level
    from sketchterrain.world.stored import StoredWorld

__all__ = ["check_window", "fill_from_chunks"]


def check_window(
    world: StoredWorld, layer: str, level: int, *, top: int, left: int, rows: int, columns: int
) -> Level:
    """Refuse what a world does not hold; return the level.

    Raises
    ------
    InputError
        With what was expected, and what was given.
    """
    if layer not in world.layers:
        raise InputError(f"expected a layer among {', '.join(world.layers)}, got {one_line(layer)!r}")
    if not 0 <= level < len(world.levels):
        raise InputError(f"expected a level from 0 to {len(world.levels) - 1}, got {level}")
    grid = world.levels[level]
    inside = min(top, left) >= 0 and top + rows <= grid.rows and left + columns <= grid.columns
    if not inside or min(rows, columns) < 1:
        raise InputError(
            f"expected a window inside {grid.rows} rows and {grid.columns} columns, got rows {top} to "
            f"{top + rows} and columns {left} to {left + columns}"
        )
    return grid


def fill_from_chunks(
    window: npt.NDArray[Any], chunk: Callable[[int, int], npt.NDArray[Any]], *, top: int, left: int
) -> None:
    """Fill a window with the parts of the chunks that it lies over.

    Parameters
    ----------
    window
        (..., rows, columns).
    chunk
        Returns that of a row and a column of the level's chunks, (..., CHUNK, CHUNK).
    top, left
        Of the window, in the level.
    """
    bottom, right = top + window.shape[-2], left + window.shape[-1]
    for row in range(top // CHUNK, (bottom - 1) // CHUNK + 1):
        for column in range(left // CHUNK, (right - 1) // CHUNK + 1):
            down, across = row * CHUNK, column * CHUNK  # of the chunk's first vertex
            first, last = max(top, down), min(bottom, down + CHUNK)
            begin, end = max(left, across), min(right, across + CHUNK)
            part = chunk(row, column)[..., first - down : last - down, begin - across : end - across]
            window[..., first - top : last - top, begin - left : end - left] = part
