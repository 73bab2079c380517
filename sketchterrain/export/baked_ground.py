"""The ground's materials as one picture: each vertex in the mean colour and roughness of what covers it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.look.texture_levels import changed_levels, made_levels

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain import Terrain

    Bytes = npt.NDArray[np.uint8]

__all__ = ["MaterialLooks", "baked_colour", "baked_roughness", "material_looks"]

_TEXELS = 256  # of the textures whose means are taken
_ROWS_AT_ONCE = 256
_WHOLE = 255  # what weights sum to
_STEPS = 65535


class MaterialLooks(NamedTuple):
    """What materials look like from afar.

    Attributes
    ----------
    albedo : (materials, 3) float64
        Linear, 0 … 1.
    roughness : (materials,) float64
        As glTF has it: √α of Trowbridge and Reitz's distribution.
    """

    albedo: npt.NDArray[np.float64]
    roughness: npt.NDArray[np.float64]


def material_looks(terrain: Terrain) -> MaterialLooks:
    """Return what a terrain's materials look like: the program's own, or as its sketch wants them."""
    from sketchterrain import compute  # OpenCL: not for a list of targets

    device = terrain.context.device

    def opened() -> ComputeContext:
        return compute.ComputeContext(device if isinstance(device, compute.Device) else None)

    levels = changed_levels(made_levels(_TEXELS, opened), terrain.sketch.look, {}, opened)
    colour, relief = (part.reshape(-1, 4)[: len(terrain.material_names)] / 255.0 for part in levels[-1])
    return MaterialLooks(colour[:, :3] ** 2, relief[:, 2])


def baked_colour(weights: Bytes, looks: MaterialLooks) -> Bytes:
    """Return the colours of the ground: materials mixed as light is, then written as sRGB.

    Parameters
    ----------
    weights
        (rows, columns, materials), bytes that sum to 255.
    looks

    Returns
    -------
    (rows, columns, 3) uint8
        sRGB.
    """
    steps = np.rint(_STEPS * looks.albedo).astype(np.int64)
    return _srgb()[_mixed(weights, steps)]


def baked_roughness(weights: Bytes, looks: MaterialLooks) -> Bytes:
    """Return the roughness of the ground as glTF reads it: in green; blue, the metal in it, is 0.

    Returns
    -------
    (rows, columns, 3) uint8
    """
    steps = np.rint(255.0 * looks.roughness).astype(np.int64)[:, None]
    image = np.zeros((*weights.shape[:2], 3), np.uint8)
    image[..., 1] = _mixed(weights, steps)[..., 0]
    return image


def _mixed(weights: Bytes, values: npt.NDArray[np.int64]) -> npt.NDArray[np.uint16]:
    """Return weighted means in whole numbers, which are the same on every machine."""
    result = np.empty((*weights.shape[:2], values.shape[1]), np.uint16)
    for top in range(0, len(weights), _ROWS_AT_ONCE):
        rows = slice(top, top + _ROWS_AT_ONCE)
        for channel in range(values.shape[1]):
            total = np.full(weights[rows].shape[:2], _WHOLE // 2, np.int32)
            for material, value in enumerate(values[:, channel]):
                total += weights[rows, :, material] * np.int32(value)
            result[rows, :, channel] = total // _WHOLE
    return result


def _srgb() -> Bytes:
    """Return the sRGB byte of each linear step (IEC 61966-2-1)."""
    linear = np.arange(_STEPS + 1) / _STEPS
    values = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return np.rint(255.0 * values).astype(np.uint8)
