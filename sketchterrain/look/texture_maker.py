"""Procedural textures of materials, by kernels/material_textures.cl: the same bits on every device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext

SOURCE: Final = "material_textures.cl"
"""In `kernels/`."""


@dataclass(frozen=True)
class Layer:
    """What a material's texture is like beyond its colours.

    Attributes
    ----------
    width : float
        m that it covers where it is laid finest.
    bump : float
        How far its highest points stand over its lowest, in texture widths.
    low, high : float
        Roughness of its low and its high points.
    """

    width: float
    bump: float
    low: float
    high: float


LAYERS: Final[dict[str, Layer]] = {
    "grass": Layer(5.0, 0.010, 0.95, 0.80),
    "soil": Layer(5.0, 0.030, 0.95, 0.85),
    "rock": Layer(8.0, 0.150, 0.90, 0.75),
    "scree": Layer(7.0, 0.060, 0.95, 0.80),
    "sand": Layer(4.0, 0.018, 0.85, 0.75),
    "snow": Layer(6.0, 0.030, 0.75, 0.55),
    "river_bed": Layer(5.0, 0.045, 0.60, 0.50),
    "forest_floor": Layer(4.0, 0.022, 0.95, 0.85),
    "canopy": Layer(8.0, 0.060, 0.95, 0.85),
}
"""The terrain's materials in their order, then the forest's canopy for the distance."""


def painted_layer(context: ComputeContext, layer: int, size: int) -> npt.NDArray[Any]:
    """Compute what a material looks like.

    Parameters
    ----------
    context
        What computes it; 32- or 64-bit reals.
    layer
        Place in `LAYERS`.
    size
        Texels a side, a power of two.

    Returns
    -------
    (size, size, 4)
        Linear albedo, and height 0..1; row 0 is the south.
    """
    painted = context.empty((size, size, 4), context.real_dtype)
    texel = context.real_dtype.type(1.0 / size)
    context.launch(SOURCE, "material_paint", (size, size), np.int32(layer), texel, painted)
    return context.download(painted, (size, size, 4), context.real_dtype)


def embossed(context: ComputeContext, painted: npt.NDArray[Any], layer: Layer) -> npt.NDArray[Any]:
    """Compute what follows from a texture's heights.

    Parameters
    ----------
    context
        What computes it.
    painted : (n, n, 4)
        As of :func:`painted_layer`; n is a power of two.
    layer
        How high the heights are, and how rough.

    Returns
    -------
    (n, n, 4)
        Slope eastward and northward, roughness, openness to the sky.
    """
    real = context.real_dtype.type
    given = context.upload(painted.astype(context.real_dtype, copy=False))
    relief = context.empty(painted.shape, context.real_dtype)
    numbers = real(layer.bump), real(layer.low), real(layer.high)
    context.launch(SOURCE, "material_relief", painted.shape[:2], given, *numbers, relief)
    return context.download(relief, painted.shape, context.real_dtype)
