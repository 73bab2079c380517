"""Cloud layer: its noise textures and its ray marching pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.programs import fullscreen_pass, set_uniforms
from sketchterrain.render.sky import OVERCAST, SUN_IRRADIANCE
from sketchterrain.render.targets import bands, wrap_to_noise_period

if TYPE_CHECKING:
    from sketchterrain.array_types import Float32Array
    from sketchterrain.render.quality import Quality
    from sketchterrain.render.sky import Sky, Weather
    from sketchterrain.render.targets import RenderTargets

SIZE: Final = 512  # texels a side of the coverage field, 32 m each
BILLOW_SIZE: Final = 64  # texels a side of the billow noise
PERIOD: Final = 16_384.0  # period of the field (m): CLOUD_PERIOD in kernels/render/clouds.glsl
HEIGHT: Final = 2500.0  # m over the haze's base, at which clouds are lit
REDUCED: Final = 2  # downscaling of the cloud pass, each axis
SUN_STEPS: Final = 4  # steps towards the sun, each about twice as long as the last
VOLUMETRIC: Final = 2


class Clouds:
    """The cloud layer of one weather: volumetric, flat or none, by `cloud_defines`."""

    def __init__(
        self,
        context: moderngl.Context,
        weather: Weather,
        sky: Sky,
        *,
        quality: Quality,
        defines: Mapping[str, int | str],
    ) -> None:
        self._context = context
        self._cover: float | None = None
        self._march: moderngl.VertexArray | None = None
        self._view: moderngl.Texture | None = None
        self.set_weather(weather, sky)
        if defines["CLOUDS"] == VOLUMETRIC:
            billows = np.round(billow_noise() * 255.0).astype(np.uint8)
            self._billows = context.texture3d((BILLOW_SIZE, BILLOW_SIZE, BILLOW_SIZE), 1, billows.tobytes())
            marching = {**defines, "STEPS": quality.cloud_steps, "SUN_STEPS": SUN_STEPS}
            self._march = fullscreen_pass(context, "clouds.frag.glsl", defines=marching)

    def set_weather(self, weather: Weather, sky: Sky) -> None:
        """Replace weather and sky by others of the same `cloud_defines`."""
        self._drift = weather.drift
        lit = sky.air.sunlight(np.array(HEIGHT), np.array(sky.sun.direction[2])) * SUN_IRRADIANCE
        self._uniforms: dict[str, object] = {
            "overcast": sky.overcast,
            "cloud_sun": tuple(((1.0 - sky.overcast) * lit).tolist()),
        }
        if weather.clouds == self._cover:
            return
        self._cover = weather.clouds
        field = cloud_field(weather.clouds)
        self._field = self._context.texture((SIZE, SIZE), 1, field.astype(np.float16).tobytes(), dtype="f2")
        self._field.build_mipmaps()
        self._field.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)

    def textures(self, targets: RenderTargets) -> dict[str, moderngl.Texture | moderngl.Texture3D]:
        """Return the textures that passes into targets read, by sampler name."""
        if self._march is None:
            return {"cloud_field": self._field}
        size = (max(targets.size[0] // REDUCED, 1), max(targets.size[1] // REDUCED, 1))
        if self._view is None or self._view.size != size:
            self._view = self._context.texture(size, 4, dtype="f2")
            self._view.repeat_x = self._view.repeat_y = False
            self._view.filter = (moderngl.LINEAR, moderngl.LINEAR)
            self._target = self._context.framebuffer([self._view])
        return {
            "cloud_field": self._field,
            "cloud_view": self._view,
            "billow_noise": self._billows,
            "scene_depth_buffer": targets.depth,
        }

    def uniforms(self, clock: float) -> dict[str, object]:
        """Return the uniforms of all passes at a time (s)."""
        drift = tuple(wrap_to_noise_period(speed * clock) for speed in self._drift)
        return self._uniforms | {"cloud_drift": drift}

    def draw(self, uniforms: dict[str, object], *, parts: int) -> Iterator[None]:
        """Render volumetric clouds; yield between parts."""
        if self._march is not None and self._view is not None:
            self._context.enable_only(moderngl.NOTHING)
            width = {"reduced_width": self._view.size[0]}
            set_uniforms(self._march.program, uniforms | width)
            for _ in bands(self._target, parts):
                self._march.render(vertices=3)
                yield


def cloud_defines(quality: Quality, weather: Weather) -> dict[str, int]:
    """Return the macros of kernels/render/clouds.glsl."""
    if not quality.includes("clouds") or weather.clouds == 0.0:
        return {"CLOUDS": 0, "GREY": 0}
    kind = VOLUMETRIC if quality.cloud_steps else 1
    return {"CLOUDS": kind, "GREY": int(weather.clouds > OVERCAST[0])}


def cloud_field(cover: float, size: int = SIZE) -> Float32Array:
    """Return the (size, size) coverage field on a torus of `PERIOD`, standard deviation 1.

    It is positive inside clouds, on a share `cover` of the area; clouds are about 1 km wide, in groups.
    """
    rng = np.random.default_rng(20261)
    cycles = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :]) * size
    cycles[0, 0] = 1.0
    wide = np.exp(-(((np.log2(cycles) - 1.3) / 0.8) ** 2))
    lumps = np.exp(-(((np.log2(cycles) - 3.2) / 0.75) ** 2)) / cycles**0.5
    fine = np.where(cycles > 10.0, cycles**-1.75, 0.0)
    total = np.zeros((size, size))
    for spectrum, amount in ((wide, 0.45), (lumps, 1.0), (fine, 0.42)):
        layer = np.fft.irfft2(spectrum * np.fft.rfft2(rng.standard_normal((size, size))), s=(size, size))
        layer /= layer.std()
        # Where noise changes its sign billows meet: seams between round lumps.
        total += amount * (layer if spectrum is not fine else np.abs(layer) * 1.6 - 1.2)
    total /= total.std()
    share = min(max(cover, 0.0), 1.0)
    edge = np.quantile(total, 1.0 - share) if 0.0 < share < 1.0 else (1.0 - share) * 99.0 - 4.0
    return np.asarray(total - edge, np.float32)


def billow_noise(size: int = BILLOW_SIZE) -> Float32Array:
    """Return (size, size, size) billow noise in [0, 1] on a torus: 1 inside round lumps, 0 in the seams."""
    rng = np.random.default_rng(20262)
    axis, last = np.fft.fftfreq(size) * size, np.fft.rfftfreq(size) * size
    cycles = np.sqrt(axis[:, None, None] ** 2 + axis[None, :, None] ** 2 + last[None, None, :] ** 2)
    cycles[0, 0, 0] = 1.0
    total = np.zeros((size, size, size))
    for octave in range(3):
        band = np.exp(-(((np.log2(cycles) - 2.0 - octave) / 0.45) ** 2))
        spectrum = band * np.fft.rfftn(rng.standard_normal((size,) * 3))
        noise = np.fft.irfftn(spectrum, s=(size,) * 3, axes=(0, 1, 2))
        total += 0.55**octave * np.abs(noise) / noise.std()
    low, high = np.quantile(total, [0.01, 0.99])
    return np.asarray(np.clip((total - low) / (high - low), 0.0, 1.0), np.float32)
