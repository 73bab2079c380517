"""Water waves as a repeating texture of slopes, laid in several layers: kernels/render/water_waves.glsl."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array


SIZE: Final = 256
"""Texels along a side of the texture."""
BAND: Final = (3.0, 56.0)
"""Longest and shortest waves, per side."""
LAYERS: Final = ((8.0, -0.42, 0.40), (2.3, 0.55, 0.28), (31.0, 0.16, 0.32))
"""Side (m), rotation against the wind (rad) and share of slope² of each layer."""
GRAVITY: Final = 9.81
"""m/s²."""
TYPICAL: Final = 7.0
"""Waves per side whose phase speed a layer drifts at."""


def wave_slopes(size: int = SIZE, *, seed: int = 1954) -> Float64Array:
    """Return (size, size, 3) slopes along x and y and height in sides of a wave field on a torus.

    Waves in a wide band have the same slope² an octave, as short gravity waves have (Phillips 1958), and
    spread about the wind (x) by cos² (Mitsuyasu 1975), with an isotropic part. The mean is 0, that of slope²
    1.
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


def wave_mipmaps(slopes: Float64Array) -> list[npt.NDArray[np.float32]]:
    """Return (n, n, 4) levels of `wave_slopes`: both slopes, their squared length, the height."""
    level = np.concatenate(
        [slopes[..., :2], (slopes[..., :2] ** 2).sum(-1, keepdims=True), slopes[..., 2:]], -1
    )
    levels = [level.astype(np.float32)]
    while len(level) > 1:
        level = 0.25 * (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2])
        levels.append(level.astype(np.float32))
    return levels


def wave_texture(context: moderngl.Context) -> moderngl.Texture:
    """Upload `wave_mipmaps` as a repeating RGBA16F texture."""
    levels = wave_mipmaps(wave_slopes())
    texture = context.texture((SIZE, SIZE), 4, dtype="f2")
    texture.build_mipmaps()
    for number, level in enumerate(levels):
        texture.write(level.astype(np.float16).tobytes(), level=number)
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    return texture


def wave_layers(wind: tuple[float, float], count: int = len(LAYERS)) -> Float64Array:
    """Return (count, 4): the texture's x axis over its side (1/m), √ of the share of slope², 0.

    Only the direction of the wind (m/s, east and north) counts.
    """
    heading = np.arctan2(wind[1], wind[0])
    side, turn, share = np.array(LAYERS[:count]).T
    angle = heading + turn
    rows = [np.cos(angle) / side, np.sin(angle) / side, np.sqrt(share / share.sum()), np.zeros(count)]
    return np.stack(rows, axis=-1)


def wave_phases(layers: Float64Array, eye: tuple[float, float, float], clock: float) -> Float64Array:
    """Return the eye's (n, 2) position in each layer, in [0, 1), at a time (s): waves run downwind."""
    x, y = layers[:, 0], layers[:, 1]
    side = 1.0 / np.hypot(x, y)
    speed = np.sqrt(GRAVITY * side / TYPICAL / (2.0 * np.pi))
    drift = speed * clock / side
    return np.stack([x * eye[0] + y * eye[1] - drift, x * eye[1] - y * eye[0]], axis=-1) % 1.0
