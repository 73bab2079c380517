"""Waves of water as a texture of slopes, and how it is laid: kernels/render/water_waves.glsl."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Reals = npt.NDArray[np.float64]

SIZE: Final = 256
"""Texels along a side of the texture."""
BAND: Final = (3.0, 56.0)
"""Waves along a side: the longest and the shortest."""
LAYERS: Final = ((8.0, -0.42, 0.40), (2.3, 0.55, 0.28), (31.0, 0.16, 0.32))
"""Of each size in which the texture is laid: side (m), turn against the wind (rad), share of slope²."""
GRAVITY: Final = 9.81
"""m/s²."""
TYPICAL: Final = 7.0
"""Waves along a side of those whose speed a layer drifts at."""


def wave_slopes(size: int = SIZE, *, seed: int = 1954) -> Reals:
    """Make slopes of a surface of waves on a torus, running along x for the most part.

    Waves in a wide band have the same slope² an octave, as short gravity waves have (Phillips 1958), and
    spread about the wind by cos² (Mitsuyasu 1975), with a part that runs anywhere.

    Parameters
    ----------
    size
        Texels a side.
    seed
        Of their phases.

    Returns
    -------
    (size, size, 3) float64
        Slopes along x and y, and the height in units of the texture's side. Mean 0; slope² has the mean 1.
    """
    rng = np.random.default_rng(seed)
    across, along = np.meshgrid(np.fft.fftfreq(size, 1 / size), np.fft.fftfreq(size, 1 / size))
    waves = np.hypot(across, along)
    waves[0, 0] = 1.0
    low, high = BAND
    fade = 1.0 / (1.0 + (low / waves) ** 8) / (1.0 + (waves / high) ** 8)
    spread = 0.3 + 0.7 * (across / waves) ** 2
    amplitude = np.sqrt(fade * spread) / waves**2
    amplitude[0, 0] = 0.0
    spectrum = np.fft.fft2(rng.standard_normal((size, size))) * amplitude
    height, east, north = (
        np.fft.ifft2(spectrum * factor).real for factor in (1.0, 2j * np.pi * across, 2j * np.pi * along)
    )
    field = np.stack([east, north, height], axis=-1)
    return np.asarray(field / np.sqrt(np.mean(east**2 + north**2)))


def wave_mipmaps(slopes: Reals) -> list[npt.NDArray[np.float32]]:
    """Average slopes and their squares to ever coarser texels.

    Parameters
    ----------
    slopes
        `wave_slopes`.

    Returns
    -------
    list of (n, n, 4) float32
        From the finest to one texel: both slopes, their squared length, the height.
    """
    level = np.concatenate(
        [slopes[..., :2], (slopes[..., :2] ** 2).sum(-1, keepdims=True), slopes[..., 2:]], -1
    )
    levels = [level.astype(np.float32)]
    while len(level) > 1:
        level = 0.25 * (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2])
        levels.append(level.astype(np.float32))
    return levels


def wave_texture(context: moderngl.Context) -> moderngl.Texture:
    """Upload `wave_mipmaps`, repeating, RGBA16F."""
    levels = wave_mipmaps(wave_slopes())
    texture = context.texture((SIZE, SIZE), 4, dtype="f2")
    texture.build_mipmaps()
    for number, level in enumerate(levels):
        texture.write(level.astype(np.float16).tobytes(), level=number)
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    return texture


def wave_layers(wind: tuple[float, float], count: int = len(LAYERS)) -> Reals:
    """Return how the texture is laid under a wind.

    Parameters
    ----------
    wind
        m/s, east and north; only its direction counts.
    count
        How many layers are wanted; the first ones, which then stand for all.

    Returns
    -------
    (count, 4) float64
        The texture's x axis over its side (1/m), the root of the layer's share of slope², 0.
    """
    heading = np.arctan2(wind[1], wind[0])
    side, turn, share = np.array(LAYERS[:count]).T
    angle = heading + turn
    rows = [np.cos(angle) / side, np.sin(angle) / side, np.sqrt(share / share.sum()), np.zeros(count)]
    return np.stack(rows, axis=-1)


def wave_phases(layers: Reals, eye: tuple[float, float, float], clock: float) -> Reals:
    """Return where the eye lies in each layer, in [0, 1): waves run downwind at the speed of deep water.

    Parameters
    ----------
    layers
        (n, 4), `wave_layers`.
    eye
        World coordinates (m).
    clock
        s.

    Returns
    -------
    (n, 2) float64
    """
    x, y = layers[:, 0], layers[:, 1]
    side = 1.0 / np.hypot(x, y)
    speed = np.sqrt(GRAVITY * side / TYPICAL / (2.0 * np.pi))
    drift = speed * clock / side
    return np.stack([x * eye[0] + y * eye[1] - drift, x * eye[1] - y * eye[0]], axis=-1) % 1.0
