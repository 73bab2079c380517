"""Cloud layer: its noise textures and its ray marching pass, for a picture or a dome of all directions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from sketchterrain.render.atmosphere import GROUND
from sketchterrain.render.programs import clamped, fullscreen_pass, mipmapped, set_uniforms
from sketchterrain.render.sky import SUN_IRRADIANCE
from sketchterrain.render.targets import bands, wrap_to_noise_period

if TYPE_CHECKING:
    from sketchterrain.array_types import BoolArray, Float32Array, Float64Array
    from sketchterrain.geometry.camera import Camera
    from sketchterrain.render.quality import Quality
    from sketchterrain.render.sky import Sky, Weather
    from sketchterrain.render.targets import RenderTargets

SIZE: Final = 512  # texels a side of the field, 64 m each
BILLOW_SIZE: Final = 64  # texels a side of the billow noise
PERIOD: Final = 32_768.0  # period of the field (m): CLOUD_PERIOD in kernels/render/clouds.glsl
CLEAR_BLOCK: Final = 4  # texels a side, between which distances to clouds are measured
HEIGHT: Final = 2500.0  # m over the haze's base, at which clouds are lit
REDUCED: Final = 2  # downscaling of the cloud pass, each axis
SUN_STEPS: Final = 3  # steps towards the sun, each some three times as long as the last
DOME, PICTURE = 1, 2  # values of CLOUDS in kernels/render/clouds.glsl
CIRRUS_OVER_CUMULUS: Final = 0.3  # share of the cover by cumulus
BLOCKS: Final = 16  # parts of a dome along each axis
PARALLAX: Final = (250.0, 1500.0)
"""m that the eye moves past the clouds of a dome until another one is computed, at once beyond the second."""
BASE, MIDDLE, LOWEST = 1900.0, 120.0, -0.003
"""CLOUD_BASE, CLOUD_MIDDLE (m) and LOWEST in kernels/render/clouds.glsl."""
RAYS: Final = np.linspace(-1.0, 1.0, 33)
"""Places along each axis of a picture whose rays tell which blocks it shows, with a margin ..."""
MARGIN: Final = 0.25  # ... in blocks: for filtering, and for bends between two rays


class CloudKind(NamedTuple):
    """Shape and arrangement of the clouds of a kind of sky."""

    sizes: tuple[tuple[float, float], ...]  # of bands of noise: wavelength (km), rarity (standard deviations)
    aspect: float  # height over half the width
    highest: float  # km, that tops approach
    streets: float  # standard deviations, of rows along the wind
    clearings: float  # standard deviations
    stretch: float = 1.0  # length along the wind over width


KINDS: Final = {
    # Numbers fall about as the diameter⁻² (Cahalan & Joseph 1989); stratocumulus are cells and rolls.
    "cumulus": CloudKind(((3.4, 0.8), (1.7, 0.3), (0.9, 0.0), (0.48, 0.0)), 0.65, 1.2, 0.45, 0.3),
    "stratocumulus": CloudKind(((2.2, 0.0), (1.1, 0.2)), 0.35, 0.35, 0.2, 0.3, 0.6),
}
# Wavelength (km), octaves that a band is wide, and length along the wind over width.
STREETS: Final = (5.0, 0.6, 3.0)
CLEARINGS: Final = (11.0, 0.6, 1.0)
SPREAD: Final = 0.45  # octaves that the band of a size is wide


class CloudDome:
    """Clouds in all directions above the horizon from one place, computed block by block as they are seen.

    Texels are directions in stereographic projection. `place` is where the eye was, m above the haze's base.
    """

    def __init__(self, context: moderngl.Context, texels: int) -> None:
        self.texture = clamped(context.texture((texels, texels), 4, dtype="f2"))
        self.target = context.framebuffer([self.texture])
        self.reset(None, np.zeros(3))

    def reset(self, place: Float64Array | None, wind: Float64Array) -> None:
        """Start again from a place (m), or none, after the wind moved the clouds (m)."""
        self.place, self._wind = place, wind
        self._computed = np.zeros((BLOCKS, BLOCKS), np.bool_)

    def seen_from(self, eye: Float64Array, wind: Float64Array) -> Float64Array:
        """Return the place, carried by the wind since, relative to an eye (m)."""
        return np.full(3, np.inf) if self.place is None else self.place + wind - self._wind - eye

    def missing(self, visible: BoolArray) -> npt.NDArray[np.intp]:
        """Return row and column (n, 2) of the blocks among `visible` ones that are not computed."""
        return np.argwhere(visible & ~self._computed)

    def blocks(self, numbers: npt.NDArray[np.intp]) -> Iterator[None]:
        """Limit drawing to one of some blocks after another."""
        side = self.texture.width // BLOCKS
        for row, column in numbers.tolist():
            self.target.scissor = (column * side, row * side, side, side)
            self.target.use()
            self._computed[row, column] = True
            yield


def _sampled_blocks(camera: Camera, aspect: float, *, up: float, origin: Float64Array) -> BoolArray:
    """Return which (BLOCKS, BLOCKS) blocks of a dome `dome_clouds` may sample in a view.

    They meet boxes around the texels of neighbouring rays. `up` is the height of the layer over the eye,
    `origin` the dome's (m). Rays just below the horizon count as horizontal, those further down see none.
    """
    half = np.tan(np.radians(camera.fov) / 2.0)
    x, y = np.meshgrid(half * aspect * RAYS, half * RAYS)
    rays = np.stack([x, y, np.full_like(x, -1.0)], axis=-1) @ camera.view()[:3, :3]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    above = rays[..., 2] > LOWEST
    rays[..., 2] = rise = np.maximum(rays[..., 2], 0.0)
    away = 2.0 * up / (rise + np.sqrt(rise**2 + 2.0 * up / GROUND))
    seen = rays / np.linalg.norm(rays, axis=-1, keepdims=True) * away[..., None] - origin
    seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
    at = BLOCKS * (0.5 + 0.5 * seen[..., :2] / (1.0 + np.maximum(seen[..., 2:], 0.0)))
    corners = [(i, j) for i in (slice(-1), slice(1, None)) for j in (slice(-1), slice(1, None))]
    cells = np.logical_or.reduce([above[corner] for corner in corners])
    low = np.minimum.reduce([at[corner] for corner in corners])[cells] - MARGIN
    high = np.maximum.reduce([at[corner] for corner in corners])[cells] + MARGIN
    number = np.arange(BLOCKS)
    meets = (low[..., None] < number + 1) & (high[..., None] > number)  # (cells, axis, blocks)
    return np.asarray(meets[:, 1].T.astype(np.float32) @ meets[:, 0].astype(np.float32) > 0.0)


class Clouds:
    """The cloud layer of one weather: in the picture, in a dome, or none, by `cloud_defines`."""

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
        self._shape: tuple[object, ...] = ()  # what the field depends on
        self._march: moderngl.VertexArray | None = None
        self._view: moderngl.Texture | None = None
        self._domes: list[CloudDome] = []  # the displayed one and the next one
        self._queue: list[tuple[Float64Array, CloudDome, npt.NDArray[np.intp]]] = []  # of the next picture
        if defines["CLOUDS"] == DOME:
            self._domes = [CloudDome(context, quality.cloud_texels) for _ in range(2)]
        self.set_weather(weather, sky)
        if defines["CLOUDS"]:
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
            "cirrus": _cirrus(weather),
            "cloud_sun": tuple(((1.0 - sky.overcast) * lit).tolist()),
        }
        for dome in self._domes:
            dome.reset(None, np.zeros(3))
        shape = (weather.sky, weather.clouds, weather.wind_from)
        if shape == self._shape:
            return
        self._shape = shape
        field = cloud_field(weather)
        texels = field.astype(np.float16).tobytes()
        self._field = mipmapped(self._context.texture((SIZE, SIZE), 1, texels, dtype="f2"))

    def textures(self, targets: RenderTargets) -> dict[str, moderngl.Texture | moderngl.Texture3D]:
        """Return the textures that passes into targets read, by sampler name."""
        if self._march is None:
            return {"cloud_field": self._field}
        textures: dict[str, moderngl.Texture | moderngl.Texture3D] = {
            "cloud_field": self._field,
            "billow_noise": self._billows,
        }
        if self._domes:
            return textures | {"cloud_view": self._domes[0].texture}
        size = (max(targets.size[0] // REDUCED, 1), max(targets.size[1] // REDUCED, 1))
        if self._view is None or self._view.size != size:
            self._view = clamped(self._context.texture(size, 4, dtype="f2"))
            self._target = self._context.framebuffer([self._view])
        return textures | {"cloud_view": self._view, "scene_depth_buffer": targets.depth}

    def follow(
        self, camera: Camera, aspect: float, *, base: float, clock: float, moving: bool
    ) -> dict[str, object]:
        """Choose the clouds of the next picture at a time (s); return the uniforms of all its passes.

        `base` is the height of the haze's base (m). A dome is kept while the picture is `moving`.
        """
        wind = np.array([*self._drift, 0.0]) * clock
        drift = tuple(wrap_to_noise_period(along) for along in wind[:2].tolist())
        uniforms = self._uniforms | {"cloud_drift": drift}
        if not self._domes:
            return uniforms
        eye = np.array([*camera.eye[:2], camera.eye[2] - base])
        up = max(BASE + MIDDLE - eye[2], 300.0)

        def missing(dome: CloudDome) -> npt.NDArray[np.intp]:
            return dome.missing(_sampled_blocks(camera, aspect, up=up, origin=dome.seen_from(eye, wind)))

        shown, following = self._domes
        ahead = missing(following) if following.place is not None else np.zeros((0, 2), np.intp)
        if following.place is not None and not len(ahead):
            shown.reset(None, wind)
            shown, following = self._domes = [following, shown]
        # Just below the clouds a change of height matters most: from above they would be no dome.
        away = np.linalg.norm(shown.seen_from(eye, wind) * (1.0, 1.0, BASE / up))
        rests = not moving and shown.place is not None and tuple(shown.place) != tuple(eye)
        if away > PARALLAX[1] or rests:
            shown.reset(eye, wind)
            following.reset(None, wind)
        elif away > PARALLAX[0] and following.place is None:
            following.reset(eye, wind)
            ahead = missing(following)
        origin = shown.seen_from(eye, wind)
        self._queue = [(origin, shown, missing(shown))]
        if following.place is not None:
            self._queue.append((following.seen_from(eye, wind), following, ahead[:1]))
        return uniforms | {"cloud_origin": tuple(origin)}

    def draw(self, uniforms: dict[str, object], *, parts: int) -> Iterator[None]:
        """Render the clouds that `follow` chose; yield between parts."""
        if self._march is None:
            return
        self._context.enable_only(moderngl.NOTHING)
        for origin, dome, blocks in self._queue:
            set_uniforms(self._march.program, uniforms | {"cloud_origin": tuple(origin)})
            for _ in dome.blocks(blocks):
                self._march.render(vertices=3)
        if self._view is not None:
            set_uniforms(self._march.program, uniforms | {"reduced_width": self._view.size[0]})
            for _ in bands(self._target, parts):
                self._march.render(vertices=3)
                yield


def cloud_defines(quality: Quality, weather: Weather) -> dict[str, int]:
    """Return the macros of kernels/render/clouds.glsl."""
    if not quality.includes("clouds"):
        return {"CLOUDS": 0, "GREY": 0, "CIRRUS": 0}
    cumulus = weather.cover > 0.0 and weather.overcast < 1.0
    return {
        "CLOUDS": (DOME if quality.cloud_texels else PICTURE) if cumulus else 0,
        "GREY": int(weather.overcast > 0.0),
        "CIRRUS": int(_cirrus(weather) > 0.0),
    }


def _cirrus(weather: Weather) -> float:
    """Return the share of the sky that cirrus covers: all of the clouds, or a little over cumulus."""
    share = {"cirrus": 1.0, "cumulus": CIRRUS_OVER_CUMULUS}.get(weather.sky, 0.0)
    return share * weather.clouds * (1.0 - weather.overcast)


def cloud_field(weather: Weather, size: int = SIZE) -> Float32Array:
    """Return the (size, size) height field of clouds with one condensation level, on a torus of `PERIOD`.

    Positive inside clouds, on a share `weather.cover` of the area: their top's height over the base, squared
    (km²), so that a paraboloid is a dome. Negative outside: at most the distance to a cloud (km). Clouds of
    each size are the maxima of a band of noise over a threshold common to all, in streets along the wind.
    """
    share = weather.cover
    if share in (0.0, 1.0):
        return np.full((size, size), -PERIOD / 1e3 if share == 0.0 else 1.0, np.float32)
    kind, cell = KINDS[weather.sky], PERIOD / size / 1e3
    noise = np.fft.rfft2(np.random.default_rng(20280).standard_normal((size, size), np.float32))
    east = np.fft.rfftfreq(size, cell)[None, :].astype(np.float32)  # cycles/km
    north = np.fft.fftfreq(size, cell)[:, None].astype(np.float32)
    x, y = (np.float32(f(np.radians(weather.wind_from))) for f in (np.sin, np.cos))
    along, across = (east * x + north * y) ** 2, (east * y - north * x) ** 2
    along[0, 0] = 1e-9

    def band(wavelength: float, octaves: float, stretch: float = 1.0) -> Float32Array:
        off = np.log2(wavelength**2 * (along * stretch**2 + across)) / (2.0 * octaves)
        layer = np.fft.irfft2(noise * np.exp(-(off**2)), s=(size, size))
        return np.asarray(layer / layer.std(), np.float32)

    groups = kind.streets * band(*STREETS) + kind.clearings * band(*CLEARINGS)
    sizes = [(each, band(each, SPREAD, kind.stretch) + groups - rarity) for each, rarity in kind.sizes]
    highest = np.maximum.reduce([layer for _, layer in sizes]).ravel()
    rank = min(int((1.0 - share) * highest.size), highest.size - 1)
    edge = np.partition(highest, rank)[rank]
    # Near a maximum such noise falls by (π distance / wavelength)² of its value, which is about 2.
    square = np.maximum.reduce([(kind.aspect * each / np.pi) ** 2 * (layer - edge) for each, layer in sizes])
    dome = square / (1.0 + np.maximum(square, 0.0) / kind.highest**2)
    outside = np.minimum(square, -_clearance(square > 0.0, cell))
    return np.where(square > 0.0, dome, outside).astype(np.float32)


def _clearance(inside: BoolArray, cell: float) -> Float32Array:
    """Return a lower bound of the distance (km) to cloud on a torus, from blocks of `CLEAR_BLOCK` cells."""
    n = len(inside) // CLEAR_BLOCK
    blocks = inside.reshape(n, CLEAR_BLOCK, n, CLEAR_BLOCK).any(axis=(1, 3))
    far = distance_transform_edt(~np.pad(blocks, n // 4, mode="wrap"))[n // 4 : -n // 4, n // 4 : -n // 4]
    bound = np.maximum(far - 2.0**0.5, 0.0) * cell * CLEAR_BLOCK
    return np.asarray(bound.repeat(CLEAR_BLOCK, 0).repeat(CLEAR_BLOCK, 1), np.float32)


def billow_noise(size: int = BILLOW_SIZE) -> Float32Array:
    """Return (size, size, size) billow noise in [0, 1] on a torus: 1 inside round lumps, 0 in the seams."""
    rng = np.random.default_rng(20262)
    axis, last = (np.float32(size) * f(size).astype(np.float32) for f in (np.fft.fftfreq, np.fft.rfftfreq))
    cycles = np.sqrt(axis[:, None, None] ** 2 + axis[None, :, None] ** 2 + last[None, None, :] ** 2)
    cycles[0, 0, 0] = 1.0
    total = np.zeros((size, size, size), np.float32)
    for octave in range(3):
        band = np.exp(-(((np.log2(cycles) - 2.0 - octave) / 0.45) ** 2))
        spectrum = band * np.fft.rfftn(rng.standard_normal((size,) * 3, np.float32))
        noise = np.fft.irfftn(spectrum, s=(size,) * 3, axes=(0, 1, 2))
        total += 0.55**octave * np.abs(noise) / noise.std()
    low, high = np.quantile(total, [0.01, 0.99])
    return np.asarray(np.clip((total - low) / (high - low), 0.0, 1.0), np.float32)
