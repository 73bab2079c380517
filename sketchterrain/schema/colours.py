"""Colours of sRGB and their linear albedo."""

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array


def linear_from_hex(colour: str) -> Float64Array:
    """Return the linear albedo of an sRGB colour ``#rrggbb``."""
    return srgb_to_linear(np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0)


def srgb_to_linear(values: npt.NDArray[np.floating]) -> Float64Array:
    """Convert sRGB values 0..1 to linear ones (IEC 61966-2-1)."""
    return np.asarray(np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4))
