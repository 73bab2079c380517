"""Textures of materials as OpenGL reads them, every mipmap ours.

What a coarse texel must keep of the fine ones under it is how light leaves them together. Albedo and openness
are averaged as light. Slopes are averaged, and how far they scatter around their mean goes into the
roughness, so that rock is as rough from afar as near (Olano & Baker 2010, "LEAN Mapping", eq. 6; Kaplanyan
et al. 2016, "Filtering Distributions of Normals for Shading Antialiasing", §3: α² grows by twice the variance
of a slope).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    Floats = npt.NDArray[np.float32]

Moments = tuple["Floats", "Floats"]
"""(n, n, 4) linear albedo and height; (n, n, 5) slopes, the mean of both squared slopes, α², openness."""

_STEEPEST: Final = 0.999
"""Length of a normal's horizontal part at most, so that a byte a component holds it."""


def moments(painted: npt.NDArray[Any], relief: npt.NDArray[Any]) -> Moments:
    """Return what can be averaged of a texture.

    Parameters
    ----------
    painted : (n, n, 4)
        Linear albedo, and height 0..1.
    relief : (n, n, 4)
        Slope eastward and northward, roughness, openness.
    """
    east, north, roughness, openness = np.moveaxis(relief.astype(np.float32), -1, 0)
    square = (east * east + north * north) * np.float32(0.5)
    alpha = roughness * roughness
    return painted.astype(np.float32), np.stack([east, north, square, alpha * alpha, openness], axis=-1)


def halved(fields: Floats) -> Floats:
    """Average squares of four texels; both sides are even."""
    rows = fields[0::2] + fields[1::2]
    return (rows[:, 0::2] + rows[:, 1::2]) * np.float32(0.25)


def roughened(roughness: npt.NDArray[Any], variance: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the roughness of a surface whose slopes scatter around their mean.

    Parameters
    ----------
    roughness
        Of the surface itself, √α of Trowbridge and Reitz's distribution.
    variance
        Of a slope in one direction, the mean of two that are at right angles.
    """
    return np.sqrt(np.sqrt(np.clip(roughness**4 + 2.0 * variance, 0.0, 1.0)))


def encoded(level: Moments) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Return a level as bytes.

    Returns
    -------
    colour : (n, n, 4)
        √albedo and height.
    relief : (n, n, 4)
        The normal's x and y as 0.5 + 0.5 n, roughness with the scatter of slopes in it, openness.
    """
    painted, (east, north, square, alpha2, openness) = level[0], np.moveaxis(level[1], -1, 0)
    variance = np.maximum(square - (east * east + north * north) * np.float32(0.5), np.float32(0.0))
    roughness = roughened(np.sqrt(np.sqrt(alpha2)), variance)
    shorter = np.float32(1.0) / np.sqrt(np.float32(1.0) + east * east + north * north)
    flat = np.stack([-east * shorter, -north * shorter], axis=-1)
    flat *= np.minimum(_STEEPEST / np.maximum(np.hypot(flat[..., 0], flat[..., 1]), 1e-6), 1.0)[..., None]
    colour = np.concatenate([np.sqrt(np.clip(painted[..., :3], 0.0, 1.0)), painted[..., 3:]], axis=-1)
    relief = np.concatenate([0.5 + 0.5 * flat, np.stack([roughness, openness], axis=-1)], axis=-1)
    return _bytes(colour), _bytes(relief)


def mipmaps(
    painted: npt.NDArray[Any], relief: npt.NDArray[Any]
) -> Iterator[tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]]:
    """Yield a texture's levels as :func:`encoded` gives them, from the whole one to a single texel."""
    level = moments(painted, relief)
    yield encoded(level)
    while len(level[0]) > 1:
        level = halved(level[0]), halved(level[1])
        yield encoded(level)


def decoded(
    colour: npt.NDArray[np.uint8], relief: npt.NDArray[np.uint8]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Return what was encoded of a texture's whole level: painted and relief, as `moments` takes them."""
    painted = colour.astype(np.float64) / 255.0
    painted[..., :3] **= 2
    bytes_ = relief.astype(np.float64) / 255.0
    flat = 2.0 * bytes_[..., :2] - 1.0
    up = np.sqrt(np.maximum(1.0 - (flat * flat).sum(axis=-1, keepdims=True), 1.0 - _STEEPEST**2))
    return painted, np.concatenate([-flat / up, bytes_[..., 2:]], axis=-1)


def linear_of(colour: str) -> npt.NDArray[np.float64]:
    """Return the linear albedo of an sRGB colour written as ``#rrggbb``."""
    return linear(np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0)


def linear(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return linear values 0..1 of sRGB ones (IEC 61966-2-1)."""
    return np.asarray(np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4))


def _bytes(fields: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    texels: npt.NDArray[np.uint8] = np.rint(np.clip(fields, 0.0, 1.0) * 255.0).astype(np.uint8)
    return texels
