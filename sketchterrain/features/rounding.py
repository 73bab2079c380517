"""Rounding that keeps results the same on every CPU.

The last bits of exponentials, powers and sines depend on the CPU: NumPy and the C library choose their code
by its features (AVX2, FMA, AVX-512). Sums, products, quotients and square roots are exact everywhere. So what
comes of the former is rounded to a step far above these differences and far below what can be seen.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.ndimage import correlate1d

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array


STEP = 2.0**-10
"""Metres: what river points and water levels are rounded to."""

RATIO_STEP = 2.0**-20
"""What ratios near 1 are rounded to."""

# Not ½: straight strokes have points exactly halfway between steps, which either rounding could win.
_UP_FROM = 0.53
_WEIGHT_STEP = 2.0**-40


def rounded(values: npt.ArrayLike, step: float = STEP) -> Float64Array:
    """Round to multiples of a step, a power of two; multiples keep their bits."""
    return np.asarray(np.floor(np.asarray(values, dtype=np.float64) / step + (1.0 - _UP_FROM)) * step)


def gaussian_filter(
    values: npt.ArrayLike,
    sigma: float,
    *,
    axes: Sequence[int] = (-1,),
    mode: Literal["nearest", "reflect", "wrap"] = "nearest",
    truncate: float = 4.0,
) -> Float64Array:
    """Blur along axes as SciPy's `gaussian_filter` does, with weights that are the same on every CPU."""
    radius = int(truncate * sigma + 0.5)
    weights = rounded(np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2), _WEIGHT_STEP)
    weights /= weights.sum()  # exact in whatever order
    blurred = np.asarray(values, dtype=np.float64)
    for axis in axes:
        blurred = correlate1d(blurred, weights, axis=axis, mode=mode)
    return blurred
