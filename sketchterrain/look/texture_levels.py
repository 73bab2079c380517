"""Material textures with their mipmaps: procedural ones, and those modified by a sketch or user images."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.look.texture_cache import cached_bytes
from sketchterrain.look.texture_maker import LAYERS, SOURCE, emboss, paint_layer
from sketchterrain.look.texture_mips import decode_level, linear_from_hex, mipmaps
from sketchterrain.resources import source

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.look.texture_files import MaterialImages

Levels = list[tuple["npt.NDArray[np.uint8]", "npt.NDArray[np.uint8]"]]
"""Colour and relief, (layers, n, n, 4) each, from the finest level to single texels; see `texture_mips`."""

_FORMAT: Final = 1
"""To be changed when `texture_mips` encodes the same textures differently."""


def procedural_levels(size: int, open_context: Callable[[], ComputeContext]) -> Levels:
    """Return the procedural textures, `size` (a power of two) texels a side, cached on disk."""
    shapes = [(len(LAYERS), size >> level, size >> level, 4) for level in range(size.bit_length())]
    recipe = f"{source(SOURCE)}\n{LAYERS}\n{size}\n{_FORMAT}"
    nbytes = 2 * sum(int(np.prod(shape)) for shape in shapes)
    flat = np.frombuffer(
        cached_bytes(f"materials-{size}", recipe, nbytes, lambda: _compute_levels(size, open_context())),
        np.uint8,
    )
    levels, start = [], 0
    for shape in shapes:
        one = int(np.prod(shape))
        pair = flat[start : start + 2 * one].reshape(2, *shape)
        levels.append((pair[0], pair[1]))
        start += 2 * one
    return levels


def customized_levels(
    levels: Levels,
    looks: Mapping[str, Mapping[str, Any]],
    images: Mapping[str, MaterialImages],
    open_context: Callable[[], ComputeContext],
) -> Levels:
    """Return textures with a sketch's ``[look.…]`` and user images (of the same size) applied, images first.

    A colour becomes the mean albedo, a roughness the mean roughness; heights of an image without a normal map
    get slopes and openness as the procedural ones do, by a context that is opened only then.
    """
    names = [name for name in LAYERS if name in looks or name in images]
    if not names:
        return levels
    levels = [(colour.copy(), relief.copy()) for colour, relief in levels]
    for name in names:
        index = list(LAYERS).index(name)
        painted, relief = decode_level(levels[0][0][index], levels[0][1][index])
        if name in images:
            painted, relief = _with_images(name, painted, relief, images[name], open_context)
        painted, relief = _with_look(painted, relief, looks.get(name, {}))
        for level, (colour, slopes) in zip(levels, mipmaps(painted, relief), strict=True):
            level[0][index], level[1][index] = colour, slopes
    return levels


def _with_images(
    name: str,
    painted: npt.NDArray[Any],
    relief: npt.NDArray[Any],
    images: MaterialImages,
    open_context: Callable[[], ComputeContext],
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    if images.albedo is not None:
        painted[..., :3] = images.albedo
    height = images.height
    if height is None and images.albedo is not None:
        # Bright texels are assumed to be high: a guess, but it matches the image.
        grey = np.sqrt(images.albedo.mean(axis=-1))
        height = (grey - grey.min()) / max(float(np.ptp(grey)), 1e-6)
    if height is not None:
        painted[..., 3] = height
        own = relief
        relief = emboss(open_context(), painted, LAYERS[name])
        if images.albedo is None:
            relief[..., 2] = own[..., 2]
    if images.slopes is not None:
        relief[..., :2] = images.slopes
    if images.roughness is not None:
        relief[..., 2] = images.roughness
    return painted, relief


def _with_look(
    painted: npt.NDArray[Any], relief: npt.NDArray[Any], look: Mapping[str, Any]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    if look.get("colour"):
        target = linear_from_hex(str(look["colour"]))
        painted[..., :3] *= target / np.maximum(painted[..., :3].mean(axis=(0, 1)), 1e-4)
    relief[..., :2] *= look.get("bump", 1.0)
    if look.get("roughness", -1.0) >= 0.0:
        relief[..., 2] += look["roughness"] - relief[..., 2].mean()
    return painted, np.concatenate([relief[..., :2], np.clip(relief[..., 2:], 0.0, 1.0)], axis=-1)


def _compute_levels(size: int, context: ComputeContext) -> bytes:
    layers = []
    for index, layer in enumerate(LAYERS.values()):
        painted = paint_layer(context, index, size)
        layers.append(mipmaps(painted, emboss(context, painted, layer)))
    levels = (zip(*level, strict=True) for level in zip(*layers, strict=True))
    return b"".join(np.stack(part).tobytes() for level in levels for part in level)
