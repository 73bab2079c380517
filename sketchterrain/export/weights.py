"""Material weights as bytes: RGBA images, Unity's splat maps and Terrain3D's control map."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import UInt8Array
from sketchterrain.errors import InputError

CHANNELS = ("red", "green", "blue", "alpha")
_WHOLE = 255
_ROWS_AT_ONCE = 256  # bounds the memory of large grids
# Lowest bit of each field of Terrain3D's control map.
_BASE, _OVERLAY, _BLEND = 27, 22, 14
# Overlay 30 or 31 on base 15 or 31 would be Inf or NaN, which some programs normalise.
_MAX_TEXTURES = 30


def quantise_weights(weights: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Return weights (rows, columns, materials) as bytes with a sum of 255, by the largest remainder method.

    A byte differs from 255 times its weight by less than 1, a weight of 0 stays 0, and of equal remainders
    the first is rounded up.
    """
    result = np.empty(weights.shape, np.uint8)
    for top in range(0, weights.shape[0], _ROWS_AT_ONCE):
        rows = slice(top, top + _ROWS_AT_ONCE)
        result[rows] = _largest_remainder(weights[rows].reshape(-1, weights.shape[-1])).reshape(
            result[rows].shape
        )
    return result


def _largest_remainder(weights: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    total = weights.sum(axis=1, dtype=np.float64, keepdims=True)
    if not (np.isfinite(total).all() and (total > 0).all() and (weights >= 0).all()):
        raise InputError("expected material weights ≥ 0 with a finite sum above 0 at each vertex")
    scaled = weights * (_WHOLE / total)
    whole = np.floor(scaled)
    remainder = scaled - whole
    missing = np.rint(_WHOLE - whole.sum(axis=1)).astype(np.intp)
    result: npt.NDArray[np.uint8] = whole.astype(np.uint8)
    # Few vertices miss more than one or two steps, so this is quicker than sorting all remainders.
    open_rows = np.flatnonzero(missing)
    while open_rows.size:
        largest = remainder[open_rows].argmax(axis=1)
        result[open_rows, largest] += 1
        remainder[open_rows, largest] = -1.0
        missing[open_rows] -= 1
        open_rows = open_rows[missing[open_rows] > 0]
    return result


def rgba_weights(weights: UInt8Array, first: int) -> npt.NDArray[np.uint8]:
    """Return up to four materials, from a first one, as an RGBA image; unused channels are 0."""
    image = np.zeros((*weights.shape[:2], len(CHANNELS)), np.uint8)
    part = weights[..., first : first + len(CHANNELS)]
    image[..., : part.shape[-1]] = part
    return image


def splat_weights(weights: UInt8Array) -> UInt8Array:
    """Return weights for Unity's splat maps: interpolated, one row and column less, the edges still edges.

    Unity's terrain has 2ⁿ + 1 heights and 2ⁿ weights along a side, and its shader puts the outermost weights
    on the terrain's edges (TerrainSplatmapCommon.cginc: "adjust splatUVs so the edges of the terrain tile lie
    on pixel centers"). So weight i of n is at vertex i·n/(n − 1).
    """
    rows, columns = weights.shape[0] - 1, weights.shape[1] - 1
    top, down = _splat_positions(rows)
    left, across = _splat_positions(columns)
    result = np.empty((rows, columns, weights.shape[2]), np.uint8)
    for first in range(0, rows, _ROWS_AT_ONCE):
        part = slice(first, first + _ROWS_AT_ONCE)
        upper, lower = (weights[top[part] + step].astype(np.float32) for step in (0, 1))
        share = down[part, None, None]
        band = upper * (1.0 - share) + lower * share
        share = across[None, :, None]
        result[part] = quantise_weights(band[:, left] * (1.0 - share) + band[:, left + 1] * share)
    return result


def _splat_positions(count: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]]:
    """Return the quad of each of `count` positions over count + 1 vertices, and the position within it."""
    position = np.arange(count) * (count / max(count - 1, 1))
    position[-1] = count
    first = np.minimum(position.astype(np.intp), count - 1)
    return first, (position - first).astype(np.float32)


def flip_green(normal: UInt8Array) -> UInt8Array:
    """Convert a normal map from Y+ (OpenGL) to Y− (DirectX)."""
    result = normal.copy()
    result[..., 1] = 255 - result[..., 1]
    return result


def control_map(weights: UInt8Array) -> npt.NDArray[np.float32]:
    """Return Terrain3D's control map: the two heaviest materials of each vertex and their blend.

    From the highest bit: 5 bits of the base texture, 5 of the overlay texture, 8 of the overlay's share; the
    other bits are 0: no rotation, default scale, no hole, not automatic ("Control Map Format" in Terrain3D's
    documentation). Texture i is material i. The values are uint32 bits stored as float32: do not calculate
    with them.
    """
    if weights.shape[-1] > _MAX_TEXTURES:
        raise InputError(f"expected at most {_MAX_TEXTURES} materials, got {weights.shape[-1]}")
    result = np.empty(weights.shape[:2], np.uint32)
    for first in range(0, len(weights), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        result[rows] = _control_bits(weights[rows])
    return result.view(np.float32)


def _control_bits(weights: UInt8Array) -> npt.NDArray[np.uint32]:
    base = weights.argmax(axis=-1)
    rest = weights.copy()
    np.put_along_axis(rest, base[..., None], 0, axis=-1)
    runner_up = rest.argmax(axis=-1)
    most, second = (
        np.take_along_axis(values, index[..., None], axis=-1)[..., 0].astype(np.uint32)
        for values, index in ((weights, base), (rest, runner_up))
    )
    overlay = np.where(second == 0, base, runner_up).astype(np.uint32)
    share = (_WHOLE * second + (most + second) // 2) // (most + second)
    bits: npt.NDArray[np.uint32] = base.astype(np.uint32) << _BASE | overlay << _OVERLAY | share << _BLEND
    return bits
