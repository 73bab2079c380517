"""Procedural textures, made on the GPU when the renderer starts: no files, no repetition that shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.programs import fill_screen, set_uniforms

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["CANOPY", "LAYERS", "MaterialTextures", "noise_texture", "tileable_noise"]

SIZE: Final = 512
NOISE_SIZE: Final = 512


@dataclass(frozen=True)
class _Relief:
    """How rough a layer is: bump height in texture widths, roughness of its low and its high points."""

    bump: float
    low: float
    high: float


LAYERS: Final[dict[str, _Relief]] = {
    "grass": _Relief(0.016, 0.95, 0.75),
    "soil": _Relief(0.022, 0.95, 0.85),
    "rock": _Relief(0.080, 0.92, 0.70),
    "scree": _Relief(0.034, 0.95, 0.80),
    "sand": _Relief(0.007, 0.85, 0.70),
    "snow": _Relief(0.012, 0.70, 0.50),
    "river_bed": _Relief(0.026, 0.45, 0.55),
    "forest_floor": _Relief(0.020, 0.95, 0.85),
    "canopy": _Relief(0.060, 0.95, 0.80),
}
"""The terrain's materials in their order, then the forest's canopy for the distance."""
CANOPY: Final = len(LAYERS) - 1


class MaterialTextures:
    """Texture arrays with one layer a material, tileable, with mipmaps.

    Attributes
    ----------
    colour : moderngl.TextureArray
        RGBA8: √albedo and height, see kernels/render/material.frag.glsl.
    relief : moderngl.TextureArray
        RGBA8: normal x and y, roughness, openness, see kernels/render/relief.frag.glsl.
    """

    def __init__(self, context: moderngl.Context) -> None:
        self.colour = context.texture_array((SIZE, SIZE, len(LAYERS)), 4)
        self.relief = context.texture_array((SIZE, SIZE, len(LAYERS)), 4)
        colour, relief = context.texture((SIZE, SIZE), 4), context.texture((SIZE, SIZE), 4)
        to_colour, to_relief = context.framebuffer([colour]), context.framebuffer([relief])
        bands = _upload(context, band_noise())
        emboss = fill_screen(context, "relief.frag.glsl")
        pixels = context.buffer(reserve=4 * SIZE * SIZE)
        for layer, shape in enumerate(LAYERS.values()):
            paint = fill_screen(context, "material.frag.glsl", defines={"LAYER": layer})
            set_uniforms(paint.program, {"band_noise": 0, "neighbours": 9})
            to_colour.use()
            bands.use(0)
            paint.render(vertices=3)
            to_relief.use()
            colour.use(0)
            set_uniforms(
                emboss.program, {"material": 0, "bump": shape.bump, "roughness": (shape.low, shape.high)}
            )
            emboss.render(vertices=3)
            for texture, array in ((colour, self.colour), (relief, self.relief)):
                texture.read_into(pixels)
                array.write(pixels, viewport=(0, 0, layer, SIZE, SIZE, 1))
        for array in (self.colour, self.relief):
            array.build_mipmaps()
            # Two octaves are blended anyway: the nearest mipmap does, at half the price. No anisotropic
            # filter: Mesa's software driver hung in one.
            array.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)


def noise_texture(context: moderngl.Context) -> moderngl.Texture:
    """Upload `tileable_noise` with mipmaps, repeating, RGBA16F."""
    texture = _upload(context, tileable_noise())
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    return texture


def tileable_noise(size: int = NOISE_SIZE) -> npt.NDArray[np.float32]:
    """Make four independent fields of 1/f noise on a torus.

    Returns
    -------
    (size, size, 4) float32
        Mean 0, standard deviation 0.5; amplitude falls with frequency to the power 1.6, 1.6, 1.35 and 2.0.
    """
    rng = np.random.default_rng(20131)
    frequency = np.fft.fftfreq(size)[:, None] ** 2 + np.fft.rfftfreq(size)[None, :] ** 2
    frequency[0, 0] = np.inf
    fields = np.empty((size, size, 4), np.float32)
    for channel, power in enumerate((1.6, 1.6, 1.35, 2.0)):
        spectrum = np.fft.rfft2(rng.standard_normal((size, size))) * frequency ** (-power / 2)
        field = np.fft.irfft2(spectrum, s=(size, size))
        fields[..., channel] = 0.5 * field / field.std()
    return fields


def band_noise(size: int = 256, cells: int = 4) -> npt.NDArray[np.float32]:
    """Make four independent fields of noise with about `cells` cycles a side on a torus.

    Returns
    -------
    (size, size, 4) float32
        Mean 0, standard deviation 0.35.
    """
    rng = np.random.default_rng(20132)
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :]) * size
    fields = np.empty((size, size, 4), np.float32)
    for channel in range(4):
        spectrum = np.fft.rfft2(rng.standard_normal((size, size)))
        spectrum *= np.exp(-(((frequency - cells) / (0.45 * cells)) ** 2))
        field = np.fft.irfft2(spectrum, s=(size, size))
        fields[..., channel] = 0.35 * field / field.std()
    return fields


def _upload(context: moderngl.Context, fields: npt.NDArray[np.float32]) -> moderngl.Texture:
    height, width, channels = fields.shape
    return context.texture((width, height), channels, fields.astype(np.float16).tobytes(), dtype="f2")
