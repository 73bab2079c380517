"""Procedural material textures and their mipmaps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_constants
from sketchterrain.schema.materials import BUILT_IN, Texture

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.array_types import Float32Array, UInt8Array
    from sketchterrain.compute.context import ComputeContext

    Array = npt.NDArray[Any]


SOURCE: Final = "material_textures.cl"
_CASES = " ".join(f"case {index}: return {name}(u, v);" for index, name in enumerate(BUILT_IN.layers))
(_STEEPEST,) = kernel_constants("host/painting.h", "STEEPEST")
DEFINES: Final = (("TEXTURE_CASES", _CASES),)
"""Macros of `SOURCE`: the function of each texture layer."""


def paint_layer(context: ComputeContext, texture: str, size: int) -> Array:
    """Return (size, size, 4) linear albedo and height 0..1 of a texture layer, row 0 south."""
    painted = context.empty((size, size, 4), context.real_dtype)
    layer = np.int32(list(BUILT_IN.layers).index(texture))
    texel = context.real_dtype.type(1.0 / size)
    context.launch(SOURCE, "material_paint", (size, size), layer, texel, painted, defines=DEFINES)
    return context.download(painted, (size, size, 4), context.real_dtype)


def emboss(context: ComputeContext, painted: Array, layer: Texture) -> Array:
    """Return (n, n, 4) slopes east and north, roughness and openness of a result of :func:`paint_layer`."""
    real = context.real_dtype.type
    given = context.upload(painted.astype(context.real_dtype, copy=False))
    relief = context.empty(painted.shape, context.real_dtype)
    numbers = real(layer.bump), real(layer.low), real(layer.high)
    context.launch(SOURCE, "material_relief", painted.shape[:2], given, *numbers, relief, defines=DEFINES)
    return context.download(relief, painted.shape, context.real_dtype)


Moments = tuple["Float32Array", "Float32Array"]
"""(n, n, 4) linear albedo and height; (n, n, 5) slopes, the mean of both squared slopes, α², openness."""


def moments(painted: Array, relief: Array) -> Moments:
    """Return the moments that are averaged, of albedo and height and of slopes, roughness, openness."""
    east, north, roughness, openness = np.moveaxis(relief.astype(np.float32), -1, 0)
    square = (east * east + north * north) * np.float32(0.5)
    alpha = roughness * roughness
    return painted.astype(np.float32), np.stack([east, north, square, alpha * alpha, openness], axis=-1)


def halve(fields: Float32Array) -> Float32Array:
    """Average blocks of 2×2 texels; both sides are even."""
    rows = fields[0::2] + fields[1::2]
    return (rows[:, 0::2] + rows[:, 1::2]) * np.float32(0.25)


def encode_level(level: Moments) -> tuple[UInt8Array, UInt8Array]:
    """Return bytes (n, n, 4): √albedo and height; 0.5 + 0.5 normal xy, filtered roughness, openness."""
    painted, fields = (np.ascontiguousarray(part).reshape(-1, part.shape[-1]) for part in level)
    colour, relief = np.empty((2, *level[0].shape), np.uint8)
    host_function("encode_texels")(painted, fields, colour.reshape(-1, 4), relief.reshape(-1, 4))
    return colour, relief


def mipmaps(painted: Array, relief: Array) -> Iterator[tuple[UInt8Array, UInt8Array]]:
    """Yield the encoded levels of a texture, from the finest one to a single texel."""
    level = moments(painted, relief)
    yield encode_level(level)
    while len(level[0]) > 1:
        level = halve(level[0]), halve(level[1])
        yield encode_level(level)


def decode_level(colour: UInt8Array, relief: UInt8Array) -> tuple[Array, Array]:
    """Invert :func:`encode_level` for a texture's finest level."""
    painted = colour.astype(np.float64) / 255.0
    painted[..., :3] **= 2
    bytes_ = relief.astype(np.float64) / 255.0
    flat = 2.0 * bytes_[..., :2] - 1.0
    up = np.sqrt(np.maximum(1.0 - (flat * flat).sum(axis=-1, keepdims=True), 1.0 - _STEEPEST**2))
    return painted, np.concatenate([-flat / up, bytes_[..., 2:]], axis=-1)
