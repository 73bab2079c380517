"""Procedural material textures by kernels/material_textures.cl: the same bits on every device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext

SOURCE: Final = "material_textures.cl"


@dataclass(frozen=True)
class TextureLayer:
    """Size and relief of a material's texture, besides its colours."""

    width: float  # m that it covers where it is laid finest
    bump: float  # height range, texture widths
    low: float  # roughness of its lowest points
    high: float  # roughness of its highest points


LAYERS: Final[dict[str, TextureLayer]] = {
    "grass": TextureLayer(5.0, 0.010, 0.95, 0.80),
    "soil": TextureLayer(5.0, 0.030, 0.95, 0.85),
    "rock": TextureLayer(8.0, 0.150, 0.90, 0.75),
    "scree": TextureLayer(7.0, 0.060, 0.95, 0.80),
    "sand": TextureLayer(4.0, 0.018, 0.85, 0.75),
    "snow": TextureLayer(6.0, 0.030, 0.75, 0.55),
    "river_bed": TextureLayer(5.0, 0.045, 0.60, 0.50),
    "forest_floor": TextureLayer(4.0, 0.022, 0.95, 0.85),
    "canopy": TextureLayer(8.0, 0.060, 0.95, 0.85),
}
"""The terrain's materials in their order, then the forest's canopy seen from afar."""


def paint_layer(context: ComputeContext, layer: int, size: int) -> npt.NDArray[Any]:
    """Return (size, size, 4) linear albedo and height 0..1 of the i-th of `LAYERS`, row 0 south."""
    painted = context.empty((size, size, 4), context.real_dtype)
    texel = context.real_dtype.type(1.0 / size)
    context.launch(SOURCE, "material_paint", (size, size), np.int32(layer), texel, painted)
    return context.download(painted, (size, size, 4), context.real_dtype)


def emboss(context: ComputeContext, painted: npt.NDArray[Any], layer: TextureLayer) -> npt.NDArray[Any]:
    """Return (n, n, 4) slopes east and north, roughness and openness of a result of :func:`paint_layer`."""
    real = context.real_dtype.type
    given = context.upload(painted.astype(context.real_dtype, copy=False))
    relief = context.empty(painted.shape, context.real_dtype)
    numbers = real(layer.bump), real(layer.low), real(layer.high)
    context.launch(SOURCE, "material_relief", painted.shape[:2], given, *numbers, relief)
    return context.download(relief, painted.shape, context.real_dtype)
