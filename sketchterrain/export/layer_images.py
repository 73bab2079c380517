"""Weights and normals as engines want them: at other sizes, the other way round."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.export.weights import quantised_weights

if TYPE_CHECKING:
    import numpy.typing as npt

    Bytes = npt.NDArray[np.uint8]

__all__ = ["edge_to_edge", "normals_down"]

_ROWS_AT_ONCE = 64


def edge_to_edge(weights: Bytes) -> Bytes:
    """Return weights with one row and one column less, the outermost ones still on the edges.

    Unity's terrain has 2ⁿ + 1 heights a side and 2ⁿ weights, and its shader puts the first and the last
    weight on the terrain's edges (TerrainSplatmapCommon.cginc: "adjust splatUVs so the edges of the terrain
    tile lie on pixel centers"). So weight i of n lies at vertex i·n/(n − 1); values are interpolated there.

    Parameters
    ----------
    weights
        (rows + 1, columns + 1, materials), bytes that sum to 255.

    Returns
    -------
    (rows, columns, materials) uint8
        Bytes that sum to 255; edges that neighbouring tiles share stay equal to the bit.
    """
    rows, columns = weights.shape[0] - 1, weights.shape[1] - 1
    top, down = _places(rows)
    left, across = _places(columns)
    result = np.empty((rows, columns, weights.shape[2]), np.uint8)
    for first in range(0, rows, _ROWS_AT_ONCE):  # bounds the memory of large tiles
        part = slice(first, first + _ROWS_AT_ONCE)
        upper, lower = (weights[top[part] + step].astype(np.float32) for step in (0, 1))
        share = down[part, None, None]
        band = upper * (1.0 - share) + lower * share
        share = across[None, :, None]
        result[part] = quantised_weights(band[:, left] * (1.0 - share) + band[:, left + 1] * share)
    return result


def normals_down(normal: Bytes) -> Bytes:
    """Return a normal map with green pointing down the image (Y−, as DirectX has it) of one with green up."""
    result = normal.copy()
    result[..., 1] = 255 - result[..., 1]
    return result


def _places(count: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]]:
    """Return between which of count + 1 vertices each of `count` places lies, and how far."""
    place = np.arange(count) * (count / max(count - 1, 1))
    place[-1] = count
    first = np.minimum(place.astype(np.intp), count - 1)
    return first, (place - first).astype(np.float32)
