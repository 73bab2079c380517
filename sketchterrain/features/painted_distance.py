"""How far a place is from what was painted, in metres, anywhere in the world."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array

_FEW = 64  # pixels for each place asked about: for fewer places than so a map of distances does not pay


class PaintedDistance:
    """Distance to the nearest painted pixel of a mask.

    Inside the sketch it is exact at pixel centres, and taken from the pixel's centre elsewhere. Beyond the
    edge it is √(outside² + inside²) with the nearest point of the sketch as the elbow, which is never more
    than the true distance. The first places are looked up in a tree of the painted borders; when there were
    many, a map of all distances is made. Both give the same bits.

    Parameters
    ----------
    mask : (height, width) bool
        True where painted; row 0 is north.
    pixel_size : float
        Metres.
    """

    def __init__(self, mask: npt.NDArray[np.bool_], pixel_size: float) -> None:
        self._height, self._width = mask.shape
        self._pixel_size = pixel_size
        self._mask = mask
        self._asked = 0
        self._tree: cKDTree | None = None
        self._map: npt.NDArray[np.float32] | None = None

    def __call__(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Distance (m) at positions in metres; infinite when nothing is painted, 0 on a painted pixel."""
        column = np.asarray(x, dtype=np.float64) / self._pixel_size
        row = self._height - np.asarray(y, dtype=np.float64) / self._pixel_size
        inside_column, inside_row = np.clip(column, 0.0, self._width), np.clip(row, 0.0, self._height)
        columns = np.minimum(inside_column.astype(np.intp), self._width - 1)
        rows = np.minimum(inside_row.astype(np.intp), self._height - 1)
        outside = np.hypot(column - inside_column, row - inside_row) * self._pixel_size
        return np.asarray(np.hypot(outside, self._pixels(rows, columns) * np.float32(self._pixel_size)))

    def _pixels(self, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> npt.NDArray[np.float32]:
        """Distance in pixels from a pixel's centre to that of the nearest painted one."""
        self._asked += rows.size
        if self._map is None and self._asked * _FEW > self._mask.size and self._mask.any():
            distance = np.asarray(ndimage.distance_transform_edt(~self._mask), dtype=np.float32)
            self._map = distance
        if self._map is not None:
            return np.asarray(self._map[rows, columns])
        if self._tree is None:
            self._tree = cKDTree(np.argwhere(_border(self._mask)))
        result = np.zeros(rows.shape, dtype=np.float32)
        bare = ~self._mask[rows, columns]
        result[bare] = self._tree.query(np.stack([rows[bare], columns[bare]], axis=-1))[0]
        return result


def _border(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Painted pixels beside a bare one, along a row or a column: to bare places one of them is nearest."""
    inner = mask.copy()
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    inner[:, 1:] &= mask[:, :-1]
    inner[:, :-1] &= mask[:, 1:]
    return mask & ~inner
