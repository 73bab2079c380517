"""How far a place is from what was painted, in metres, anywhere in the world."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

Floats = npt.NDArray[np.float64]


class PaintedDistance:
    """Distance to the nearest painted pixel of a mask.

    Inside the sketch it is exact at pixel centres, and taken from the pixel's centre elsewhere. Beyond the
    edge it is √(outside² + inside²) with the nearest point of the sketch as the elbow, which is never more
    than the true distance.

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
        self._distance = _distance(mask, pixel_size)

    def __call__(self, x: Floats, y: Floats) -> Floats:
        """Distance (m) at positions in metres; infinite when nothing is painted, 0 on a painted pixel."""
        if self._distance is None:
            return np.full(np.broadcast(x, y).shape, np.inf)
        column = np.asarray(x, dtype=np.float64) / self._pixel_size
        row = self._height - np.asarray(y, dtype=np.float64) / self._pixel_size
        inside_column, inside_row = np.clip(column, 0.0, self._width), np.clip(row, 0.0, self._height)
        columns = np.minimum(inside_column.astype(np.intp), self._width - 1)
        rows = np.minimum(inside_row.astype(np.intp), self._height - 1)
        outside = np.hypot(column - inside_column, row - inside_row) * self._pixel_size
        return np.asarray(np.hypot(outside, self._distance[rows, columns]))


def _distance(mask: npt.NDArray[np.bool_], pixel_size: float) -> npt.NDArray[np.float32] | None:
    if not mask.any():
        return None
    distance = np.asarray(ndimage.distance_transform_edt(~mask), dtype=np.float32)
    return distance * np.float32(pixel_size)
