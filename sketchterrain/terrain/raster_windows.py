"""A wide grid as patches side by side: cut into windows, and joined again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.lattice import QUADS, to_lattice

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["axis_of", "joined", "windows_of"]


def axis_of(length: float, count: int, extent: float) -> npt.NDArray[np.int64]:
    """Return lattice coordinates of ``count`` vertices over a length, with one more beyond each end."""
    return to_lattice(np.arange(-1, count + 1) * (length / (count - 1)), extent)


def windows_of(axis: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Cut an axis into overlapping windows of QUADS + 3; the last is filled up with its last vertex."""
    inner = len(axis) - 2
    starts = range(0, max(inner - 1, 1), QUADS)
    index = np.minimum(np.array(starts)[:, None] + np.arange(QUADS + 3), len(axis) - 1)
    return axis[index]


def joined(
    patches: npt.NDArray[np.floating], shape: tuple[int, int], rows: int, columns: int
) -> npt.NDArray[np.float32]:
    """Put patches side by side; neighbours share a row or column of vertices."""
    result = np.empty((rows, columns, *patches.shape[3:]), np.float32)
    for number, patch in enumerate(patches):
        top, left = (QUADS * place for place in divmod(number, shape[1]))
        part = result[top : top + QUADS + 1, left : left + QUADS + 1]
        part[...] = patch[: part.shape[0], : part.shape[1]]
    return result
