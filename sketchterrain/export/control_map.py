"""Terrain3D's control map: which textures lie on the ground, as bits in an image of floats."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["control_map"]

_MOST = 30  # overlay 30 or 31 on base 15 or 31 would be infinity or no number, which not every program keeps
_BASE, _OVERLAY, _BLEND = 27, 22, 14  # the lowest bit of each field
_WHOLE = 255
_ROWS_AT_ONCE = 256


def control_map(weights: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Return the two heaviest materials of each vertex and how they share it.

    From the highest bit on: 5 bits of the base's texture, 5 of the overlay's, 8 of the overlay's share (255
    is all of it); the other bits are 0: no turn, usual scale, no hole, painted by hand ("Control Map Format"
    in Terrain3D's documentation). Texture i is material i. The numbers are bits of uint32 that are kept as
    float32: never calculate with them.

    Parameters
    ----------
    weights
        (rows, columns, materials), at most 30 materials.

    Returns
    -------
    (rows, columns) float32

    Raises
    ------
    InputError
        If there are more materials.
    """
    if weights.shape[-1] > _MOST:
        raise InputError(f"expected at most {_MOST} materials, got {weights.shape[-1]}")
    result = np.empty(weights.shape[:2], np.uint32)
    for first in range(0, len(weights), _ROWS_AT_ONCE):  # bounds the memory of large grids
        rows = slice(first, first + _ROWS_AT_ONCE)
        result[rows] = _bits(weights[rows])
    return result.view(np.float32)


def _bits(weights: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint32]:
    base = weights.argmax(axis=-1)
    rest = weights.copy()
    np.put_along_axis(rest, base[..., None], 0, axis=-1)
    under = rest.argmax(axis=-1)
    most, second = (
        np.take_along_axis(of, each[..., None], axis=-1)[..., 0].astype(np.uint32)
        for of, each in ((weights, base), (rest, under))
    )
    overlay = np.where(second == 0, base, under).astype(np.uint32)
    share = (_WHOLE * second + (most + second) // 2) // (most + second)
    bits: npt.NDArray[np.uint32] = base.astype(np.uint32) << _BASE | overlay << _OVERLAY | share << _BLEND
    return bits
