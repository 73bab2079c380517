"""All textures of materials with their mipmaps: the program's own, and those that a person changed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.look.texture_cache import kept
from sketchterrain.look.texture_maker import LAYERS, SOURCE, embossed, painted_layer
from sketchterrain.look.texture_mips import decoded, linear_of, mipmaps
from sketchterrain.resources import source

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.look.texture_files import Pictures

Levels = list[tuple["npt.NDArray[np.uint8]", "npt.NDArray[np.uint8]"]]
"""Colour and relief, (layers, n, n, 4) each, from whole textures to single texels; see `texture_mips`."""

_FORMAT: Final = 1
"""Another one when `texture_mips` makes other bytes of the same textures."""


def made_levels(size: int, open_context: Callable[[], ComputeContext]) -> Levels:
    """Return the program's own textures: from the disk if they were made before.

    Parameters
    ----------
    size
        Texels a side, a power of two.
    open_context
        Opens what computes them, if they are not on the disk.
    """
    shapes = [(len(LAYERS), side, side, 4) for side in _sides(size)]
    recipe = f"{source(SOURCE)}\n{LAYERS}\n{size}\n{_FORMAT}"
    nbytes = 2 * sum(int(np.prod(shape)) for shape in shapes)
    flat = np.frombuffer(
        kept(f"materials-{size}", recipe, nbytes, lambda: _made(size, open_context())), np.uint8
    )
    levels, start = [], 0
    for shape in shapes:
        one = int(np.prod(shape))
        pair = flat[start : start + 2 * one].reshape(2, *shape)
        levels.append((pair[0], pair[1]))
        start += 2 * one
    return levels


def changed_levels(
    levels: Levels,
    looks: Mapping[str, Mapping[str, Any]],
    pictures: Mapping[str, Pictures],
    open_context: Callable[[], ComputeContext],
) -> Levels:
    """Return textures as a sketch and a folder of pictures want them.

    A colour becomes the mean albedo, a roughness the mean roughness; heights of a picture without a normal
    map get slopes and openness as the program's own do. Pictures go first.

    Parameters
    ----------
    levels
        The program's own.
    looks
        ``[look.…]`` of a sketch by material.
    pictures
        By material; as large as the textures.
    open_context
        Opens what computes slopes.
    """
    names = [name for name in LAYERS if name in looks or name in pictures]
    if not names:
        return levels
    levels = [(colour.copy(), relief.copy()) for colour, relief in levels]
    for name in names:
        index = list(LAYERS).index(name)
        painted, relief = decoded(levels[0][0][index], levels[0][1][index])
        if name in pictures:
            painted, relief = _with_pictures(name, painted, relief, pictures[name], open_context)
        painted, relief = _with_look(painted, relief, looks.get(name, {}))
        for level, (colour, slopes) in zip(levels, mipmaps(painted, relief), strict=True):
            level[0][index], level[1][index] = colour, slopes
    return levels


def _with_pictures(
    name: str,
    painted: npt.NDArray[Any],
    relief: npt.NDArray[Any],
    given: Pictures,
    open_context: Callable[[], ComputeContext],
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    if given.albedo is not None:
        painted[..., :3] = given.albedo
    height = given.height
    if height is None and given.albedo is not None:
        # What is light stands out: a guess, but one that goes with the picture.
        grey = np.sqrt(given.albedo.mean(axis=-1))
        height = (grey - grey.min()) / max(float(np.ptp(grey)), 1e-6)
    if height is not None:
        painted[..., 3] = height
        own = relief
        relief = embossed(open_context(), painted, LAYERS[name])
        if given.albedo is None:
            relief[..., 2] = own[..., 2]
    if given.slopes is not None:
        relief[..., :2] = given.slopes
    if given.roughness is not None:
        relief[..., 2] = given.roughness
    return painted, relief


def _with_look(
    painted: npt.NDArray[Any], relief: npt.NDArray[Any], look: Mapping[str, Any]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    if look.get("colour"):
        wanted = linear_of(str(look["colour"]))
        painted[..., :3] *= wanted / np.maximum(painted[..., :3].mean(axis=(0, 1)), 1e-4)
    relief[..., :2] *= look.get("bump", 1.0)
    if look.get("roughness", -1.0) >= 0.0:
        relief[..., 2] += look["roughness"] - relief[..., 2].mean()
    return painted, np.concatenate([relief[..., :2], np.clip(relief[..., 2:], 0.0, 1.0)], axis=-1)


def _sides(size: int) -> Sequence[int]:
    return [size >> level for level in range(size.bit_length())]


def _made(size: int, context: ComputeContext) -> bytes:
    layers = []
    for index, layer in enumerate(LAYERS.values()):
        painted = painted_layer(context, index, size)
        layers.append(mipmaps(painted, embossed(context, painted, layer)))
    levels = (zip(*level, strict=True) for level in zip(*layers, strict=True))
    return b"".join(np.stack(part).tobytes() for level in levels for part in level)
