"""Material weights as bytes, for images of four materials, Unity's splat maps and Terrain3D's control map."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError

Bytes = npt.NDArray[np.uint8]
CHANNELS = ("red", "green", "blue", "alpha")
_WHOLE = 255
_ROWS_AT_ONCE = 256  # bounds the memory of large grids
# Of the control map: the lowest bit of each field.
_BASE, _OVERLAY, _BLEND = 27, 22, 14
# Overlay 30 or 31 on base 15 or 31 would be Inf or NaN, which not every program keeps.
_MOST_TEXTURES = 30


def quantised_weights(weights: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Return weights as bytes that sum to exactly 255, by the method of the largest remainder.

    A byte is off from 255 times its weight by less than 1, and a weight of 0 stays 0.

    Parameters
    ----------
    weights
        (rows, columns, materials), ≥ 0, with a sum above 0 at each vertex.

    Returns
    -------
    (rows, columns, materials) uint8
        Where remainders are equal the first material gets the step.

    Raises
    ------
    InputError
        If a weight is negative or not finite, or all weights of a vertex are 0.
    """
    result = np.empty(weights.shape, np.uint8)
    for top in range(0, weights.shape[0], _ROWS_AT_ONCE):  # bounds the memory of large rasters
        rows = slice(top, top + _ROWS_AT_ONCE)
        result[rows] = _rounded(weights[rows].reshape(-1, weights.shape[-1])).reshape(result[rows].shape)
    return result


def _rounded(weights: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
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


def four_of(weights: Bytes, first: int) -> npt.NDArray[np.uint8]:
    """Return four materials as the channels of an image, from one on; channels without a material are 0."""
    image = np.zeros((*weights.shape[:2], len(CHANNELS)), np.uint8)
    part = weights[..., first : first + len(CHANNELS)]
    image[..., : part.shape[-1]] = part
    return image


def edge_to_edge(weights: Bytes) -> Bytes:
    """Return weights with one row and one column less, the outermost ones still on the edges.

    Unity's terrain has 2ⁿ + 1 heights a side and 2ⁿ weights, and its shader puts the first and the last
    weight on the terrain's edges (TerrainSplatmapCommon.cginc: "adjust splatUVs so the edges of the terrain
    tile lie on pixel centers"). So weight i of n lies at vertex i·n/(n − 1); values are interpolated there.
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


def _places(count: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]]:
    """Return between which of count + 1 vertices each of `count` places lies, and how far."""
    place = np.arange(count) * (count / max(count - 1, 1))
    place[-1] = count
    first = np.minimum(place.astype(np.intp), count - 1)
    return first, (place - first).astype(np.float32)


def normals_down(normal: Bytes) -> Bytes:
    """Return a normal map with green pointing down the image (Y−, as DirectX has it) of one with green up."""
    result = normal.copy()
    result[..., 1] = 255 - result[..., 1]
    return result


def control_map(weights: Bytes) -> npt.NDArray[np.float32]:
    """Return the two heaviest materials of each vertex and how they share it.

    From the highest bit on: 5 bits of the base's texture, 5 of the overlay's, 8 of the overlay's share (255
    is all of it); the other bits are 0: no turn, usual scale, no hole, painted by hand ("Control Map Format"
    in Terrain3D's documentation). Texture i is material i. The numbers are bits of uint32 that are kept as
    float32: never calculate with them.
    """
    if weights.shape[-1] > _MOST_TEXTURES:
        raise InputError(f"expected at most {_MOST_TEXTURES} materials, got {weights.shape[-1]}")
    result = np.empty(weights.shape[:2], np.uint32)
    for first in range(0, len(weights), _ROWS_AT_ONCE):  # bounds the memory of large grids
        rows = slice(first, first + _ROWS_AT_ONCE)
        result[rows] = _bits(weights[rows])
    return result.view(np.float32)


def _bits(weights: Bytes) -> npt.NDArray[np.uint32]:
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
