"""Framebuffers, and the constants of a frame."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.io.system import release_freed_memory
from sketchterrain.render.programs import FRAME_BINDING, Textures, clamped, fullscreen_pass, set_uniforms


class RenderTargets:
    """Framebuffers for pictures of `size` (px): visibility at samples² samples a pixel, shading at one.

    `gbuffer` has depth, normal and `words` of material weights of the terrain at all samples
    (`sample_size`, px). With more than one sample `shaded` and `sky` have radiance at one sample a pixel,
    and `upsampled` receives it at all samples (spread.frag.glsl). `scene` is the same colour buffer with
    depth, for plants and water, `copy` a copy of it that water reads, `tonemapped` the picture if it is to
    be enlarged. `textures` has all of them by sampler name. Those for a single picture, drawn `once`, have
    the weights and the scene one after the other.
    """

    def __init__(
        self, context: moderngl.Context, size: tuple[int, int], samples: int, words: int, *, once: bool
    ) -> None:
        self.size = size
        sample_size = (size[0] * samples, size[1] * samples)
        self.sample_size = sample_size
        self._context, self._once = context, once and samples > 1
        self.depth = depth = _depth(context, sample_size)
        normal = clamped(context.texture(sample_size, 4, dtype="f2"))
        self._weights = [clamped(context.texture(sample_size, 4)) for _ in range(words)]
        self.gbuffer = context.framebuffer([normal, *self._weights], depth)
        self.textures: dict[str, Textures] = {
            "gbuffer_depth": depth,
            "gbuffer_normal": normal,
            "gbuffer_weights": self._weights,
        }
        if samples > 1:
            self.textures["shaded"] = clamped(context.texture(size, 4, dtype="f4"))
            self.textures["sky"] = clamped(context.texture(size, 4, dtype="f2"))
            self.shaded = context.framebuffer([self.textures["shaded"]])
            self.sky = context.framebuffer([self.textures["sky"]])
        if not self._once:
            self.add_scene()
        if samples == 1:
            self.textures["gbuffer_depth"] = self.copy_depth

    def add_scene(self) -> None:
        """Add what follows the shading of the ground, unless it is there."""
        if "scene" in self.textures:
            return
        if self._once:
            release_freed_memory()
        context = self._context
        colour, copy_colour = (clamped(context.texture(self.sample_size, 4, dtype="f2")) for _ in range(2))
        self.copy_depth = _depth(context, self.sample_size)
        tonemapped = clamped(context.texture(self.size, 4))
        self.upsampled = context.framebuffer([colour])
        self.scene = context.framebuffer([colour], self.depth)
        self.copy = context.framebuffer([copy_colour], self.copy_depth)
        self.tonemapped = context.framebuffer([tonemapped])
        self.textures |= {
            "radiance": colour,
            "scene": copy_colour,
            "scene_depth": self.copy_depth,
            "tonemapped": tonemapped,
        }

    def release_weights(self) -> None:
        """Release the weights of a picture drawn once: the ground is shaded."""
        if self._once:
            self.gbuffer.release()
            for weights in self._weights:
                weights.release()
            del self.textures["gbuffer_weights"]

    def copy_scene(self) -> None:
        """Copy radiance and depth of the scene, for passes that read and overwrite them."""
        self.scene.use()  # the copy is clipped by the scissor of the bound framebuffer
        self._context.copy_framebuffer(self.copy, self.scene)


def bands(framebuffer: moderngl.Framebuffer, count: int) -> Iterator[None]:
    """Bind a framebuffer, and limit what is drawn to one of `count` horizontal bands after another."""
    width, height = framebuffer.size
    edges = [height * number // count for number in range(count + 1)]
    try:
        for low, high in pairwise(edges):
            framebuffer.scissor = (0, low, width, high - low)
            framebuffer.use()
            yield
    finally:
        framebuffer.scissor = None  # type: ignore[assignment] # moderngl takes None


def _depth(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Texture:
    texture = clamped(context.depth_texture(size))
    texture.compare_func = ""
    return texture


def depth_rows(texture: moderngl.Texture) -> npt.NDArray[np.float32]:
    """Return the depths 0 … 1 of a depth texture, (height, width), row 0 on top."""
    return np.frombuffer(texture.read(), np.float32).reshape(texture.size[::-1])[::-1]


class PictureTarget:
    """RGBA texture with a framebuffer, re-created when the size changes."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._texture: moderngl.Texture | None = None
        self._framebuffer: moderngl.Framebuffer | None = None

    def sized(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        """Return the framebuffer of a width and a height (px)."""
        if self._framebuffer is None or self._framebuffer.size != size:
            for old in (self._framebuffer, self._texture):
                if old is not None:
                    old.release()
            self._texture = self._context.texture(size, 4)
            self._framebuffer = self._context.framebuffer([self._texture])
        return self._framebuffer

    def read_into(self, memory: memoryview) -> None:
        """Copy the pixels, 4 bytes each (red, green, blue, unused), row 0 on top."""
        if self._texture is None:
            raise ValueError("expected a call of `sized` before")
        width, height = self._texture.size
        read = np.frombuffer(self._texture.read(), np.uint8).reshape(height, width, 4)
        np.frombuffer(memory, np.uint8).reshape(height, width, 4)[:] = read[::-1]


DRAPED_SAMPLES: Final = 4  # a pixel


def averaging_pass(context: moderngl.Context, *, samples: int) -> moderngl.VertexArray:
    """Return the pass that `DrapedBuffer` needs, for a G-buffer of `samples` along each axis of a pixel."""
    macros = {"SAMPLES": samples, "FRAGMENTS": _fragments(context)}
    return fullscreen_pass(context, "draped_mean.frag.glsl", defines=macros)


def _fragments(context: moderngl.Context) -> int:
    return min(DRAPED_SAMPLES, context.max_samples)


class DrapedBuffer:
    """Albedo times share, and share, at several samples a pixel of a size (px), and their mean, `colour`."""

    def __init__(
        self, context: moderngl.Context, size: tuple[int, int], average: moderngl.VertexArray
    ) -> None:
        fragments = _fragments(context)
        self.size = size
        self.nbytes = 8 * size[0] * size[1] * (1 + fragments)
        self._context, self._average = context, average
        self._samples = context.texture(size, 4, samples=fragments, dtype="f2")
        self._drawn = context.framebuffer([self._samples])
        self.colour = clamped(context.texture(size, 4, dtype="f2"))
        self._mean = context.framebuffer([self.colour])

    def clear(self) -> None:
        """Bind and clear it, for what is premultiplied by its share."""
        self._drawn.use()
        self._drawn.clear(0.0, 0.0, 0.0, 0.0)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA

    def resolve(self, depth: moderngl.Texture) -> None:
        """Average samples on the ground in front by a G-buffer's depth; restore the usual blending."""
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._context.enable_only(moderngl.NOTHING)
        self._mean.use()
        self._samples.use(7)
        depth.use(8)
        set_uniforms(self._average.program, {"drawn": 7, "ground_depth": 8})
        self._average.render(vertices=3)


NOISE_PERIOD: Final = 65_536.0  # m; positional noise repeats after this, so the eye is passed modulo it

_FRAME: Final = np.dtype(
    [
        *((name, "f4", (4, 4)) for name in ("to_clip", "from_clip")),
        *((name, "f4", 4) for name in ("eye", "to_sun", "sun_light")),
        ("sky_light", "f4", (9, 4)),
        *((name, "f4", 4) for name in ("haze", "air", "view_range")),
        *((name, "f4", 4) for name in ("near_map", "far_map", "close_map")),
        *((name, "f4", 4) for name in ("near_window", "far_window", "close_window", "map_strength")),
        ("to_shade", "f4", (4, 4, 4)),
        *((name, "f4", 4) for name in ("shade_share", "trees")),
    ]
)


def wrap_to_noise_period(coordinate: float) -> float:
    """Return a coordinate (m) modulo `NOISE_PERIOD`, with the least magnitude.

    Lookups that do not fit the period jump where this does: far from any sketch, not at its western and
    southern border.
    """
    return math.remainder(coordinate, NOISE_PERIOD)


class FrameBlock:
    """Values of the block by field name, and their GPU buffer."""

    def __init__(self, context: moderngl.Context) -> None:
        self._values = np.zeros((), _FRAME)
        self._buffer = context.buffer(reserve=_FRAME.itemsize)
        self._buffer.bind_to_uniform_block(FRAME_BINDING)

    def __setitem__(self, field: str, value: npt.ArrayLike) -> None:
        """Set a field; matrices are row-major, and missing components stay unchanged."""
        array = np.asarray(value, dtype=np.float64)
        target = self._values[field]
        if target.ndim >= 2 and target.shape[-2:] == (4, 4):
            target[...] = np.swapaxes(array, -1, -2)
        else:
            target[..., : array.shape[-1]] = array

    def upload(self) -> None:
        """Upload all fields."""
        self._buffer.write(self._values.tobytes())
        self._buffer.bind_to_uniform_block(FRAME_BINDING)
