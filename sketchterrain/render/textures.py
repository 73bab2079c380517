"""Materials for shaders: textures as texture arrays, uniforms, and macros of counts and expressions."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import Device
from sketchterrain.look.texture_levels import (
    customized_levels,
    own_material_images,
    procedural_levels,
    read_material_images,
)
from sketchterrain.render.programs import mipmapped
from sketchterrain.render.quality import Quality
from sketchterrain.render.vertex_memory import gl_function
from sketchterrain.schema.materials import BEDROCK, Material, MaterialTable, Variation, weight_words

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

OCTAVES: Final = 6  # number of texture scales
RATIO: Final = 3.7  # width ratio of successive octaves
PERIOD: Final = 64  # texture widths after which the hexagons of kernels/render/hex_tiling.glsl repeat
OCTAVE_ROTATION: Final = 0.65  # rad, rotation of successive octaves of layers without a direction
_PLANES: Final = ((1, 2), (0, 2), (0, 1))


def texture_widths(
    table: MaterialTable, looks: Mapping[str, Mapping[str, Any]] | None = None
) -> npt.NDArray[np.float64]:
    """Return the width (m) of each layer's texture at octave 0, from the sketch's looks or defaults."""
    defaults = {name: layer.width for name, layer in table.layers.items()}
    requested = {name: look["size"] for name, look in (looks or {}).items() if look.get("size", 0.0) > 0.0}
    return np.array([{**defaults, **requested}[name] for name in table.layers])


def texture_uniforms(table: MaterialTable, widths: npt.NDArray[np.float64]) -> dict[str, object]:
    """Return uniforms of kernels/render/matter.glsl for layers of these texture widths (m)."""
    layers = table.layers.values()
    tiling = [
        (width, *layer.octaves, rotation)
        for layer, width, rotation in zip(layers, widths, _octave_rotations(table), strict=True)
    ]
    return {"texture_tiling": tiling, "max_rotations": [layer.rotation for layer in layers]}


def texture_phases(
    table: MaterialTable, eye: Sequence[float], widths: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Return the eye's texture coordinates (layers · 3 planes · OCTAVES, 2), modulo PERIOD.

    Planes are yz, xz, xy. Computed in float64, so that textures do not swim far from the origin.
    """
    octave = np.arange(OCTAVES)
    angle = np.multiply.outer(_octave_rotations(table), octave)[:, None, :]
    scale = 1.0 / np.multiply.outer(widths, RATIO**octave)[:, None, :]
    first, second = (np.array([eye[plane[k]] for plane in _PLANES])[:, None] for k in (0, 1))
    u = (np.cos(angle) * first - np.sin(angle) * second) * scale
    v = (np.sin(angle) * first + np.cos(angle) * second) * scale
    return (np.stack([u, v], axis=-1) % PERIOD).reshape(-1, 2).astype(np.float32)


def _octave_rotations(table: MaterialTable) -> npt.NDArray[np.float64]:
    return np.array([0.0 if layer.is_directed else OCTAVE_ROTATION for layer in table.layers.values()])


NOISE_SIZE: Final = 512
_TEXTURE_2D_ARRAY, _RGBA8, _RGBA, _UNSIGNED_BYTE = 0x8C1A, 0x8058, 0x1908, 0x1401


class MaterialTextures:
    """Tileable texture arrays with one layer per material of a sketch, and mipmaps.

    `colour` has √albedo and height (RGBA8), `relief` normal x and y, roughness and openness,
    `means` the mean albedo of each layer. Pictures of the sketch's own materials, and those in `folder`,
    replace textures (`texture_levels`). Textures missing on disk are computed on a compute device, or else
    on the best one.
    """

    def __init__(
        self,
        context: moderngl.Context,
        sketch: Sketch,
        device: object,
        quality: Quality,
        *,
        folder: Path | None = None,
    ) -> None:
        def opened() -> ComputeContext:
            return ComputeContext(device if isinstance(device, Device) else None)

        size, table = quality.material_texels, sketch.material_table
        pictures = own_material_images(sketch.materials, size)
        if folder is not None:
            pictures |= read_material_images(folder, size, table)
        levels = customized_levels(procedural_levels(size, opened), table, sketch.looks, pictures, opened)
        layers = len(table.layers)
        # No anisotropic filter: Mesa's software driver hung in one.
        least = moderngl.LINEAR_MIPMAP_LINEAR if quality.hexes > 1 else moderngl.LINEAR_MIPMAP_NEAREST
        self.colour, self.relief = (context.texture_array((size, size, layers), 4) for _ in range(2))
        roots = levels[-1][0].reshape(layers, -1)[:, :3] / 255.0
        self.means = [tuple(mean) for mean in np.maximum(roots**2, 1e-3).tolist()]
        for part, array in enumerate((self.colour, self.relief)):
            array.use(0)
            _write_levels([np.ascontiguousarray(both[part]) for both in levels])
            array.filter = (least, moderngl.LINEAR)


def _write_levels(levels: Sequence[npt.NDArray[np.uint8]]) -> None:
    """Write all mipmap levels of the bound array; moderngl has no function for it."""
    enum, integer, pointer = ctypes.c_uint, ctypes.c_int, ctypes.c_void_p
    allocate = gl_function("glTexStorage3D", None, enum, integer, enum, *[integer] * 3)
    write = gl_function("glTexSubImage3D", None, enum, *[integer] * 7, enum, enum, pointer)
    for level, texels in enumerate(levels):
        layers, height, width, _ = texels.shape
        size = (width, height, layers)
        if not level:  # without storage for all of them Mesa keeps each one twice
            allocate(_TEXTURE_2D_ARRAY, len(levels), _RGBA8, *size)
        write(_TEXTURE_2D_ARRAY, level, 0, 0, 0, *size, _RGBA, _UNSIGNED_BYTE, texels.ctypes.data)


def noise_texture(context: moderngl.Context) -> moderngl.Texture:
    """Upload `tileable_noise` with mipmaps, repeating, RGBA16F."""
    noise = tileable_noise().astype(np.float16)
    return mipmapped(context.texture(noise.shape[1::-1], 4, noise.tobytes(), dtype="f2"))


def tileable_noise(size: int = NOISE_SIZE) -> npt.NDArray[np.float32]:
    """Return four independent fields of 1/f noise on a torus, (size, size, 4).

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


def material_macros(table: MaterialTable) -> dict[str, int | str]:
    """Return the macros of a table for programs that shade the terrain and what lies and grows on it."""
    layers, materials = list(table.layers), table.materials
    distant = [
        (index, layers.index(far.name)) for index, each in enumerate(materials) if (far := each.distant)
    ]
    bedded = [index for index, texture in enumerate(table.layers.values()) if texture.bedded]
    return {
        "WEIGHT_WORDS": weight_words(len(table)),
        "LAYERS": len(layers),
        "BEDROCK": layers.index(BEDROCK),
        "MEADOW_KINDS": _meadow_kinds(table),
        "IS_BEDDED(layer)": _is_any("layer", bedded),
        "DISTANT_LAYER(layer)": _choice("layer", distant),
        "VARIATIONS": _variations(table),
        "WOODED(w)": wooded_share(table),
        "MEADOW_SHARE(w)": _sum(table, lambda material: material.meadow),
        "UNDERGROWTH_SHARE(w)": _sum(table, lambda material: material.undergrowth),
        "WET_SHARE(w)": _sum(table, lambda material: material.wet),
        "BUNCH_SHARE(w)": _sum(table, lambda material: material.bunches),
        "STONES_ANYWHERE(w)": _sum(table, lambda material: material.stones.anywhere),
        "STONES_IN_HEAPS(w)": _sum(table, lambda material: material.stones.heaps),
        "STONES_IN_MIDDLES(w)": _sum(table, lambda material: material.stones.middles),
        "PAVED(w)": _sum(table, lambda material: float(material.is_paved)),
        "STONE_COLOURS": _stone_colours(table),
        "STONE_WEAR(w)": _stone_wear(table),
    }


def wooded_share(table: MaterialTable) -> str:
    """Return an expression of the weight of ground under trees, from the weights w."""
    return _sum(table, lambda material: float(material.is_wooded))


def _weight(index: int, name: str = "w") -> str:
    """Return the weight of a material in an array of words."""
    return f"{name}[{index // 4}][{index % 4}]"


def _sum(table: MaterialTable, value: Callable[[Material], float]) -> str:
    """Return the sum of a property over the materials."""
    terms = [f"{value(each)} * {_weight(index)}" for index, each in enumerate(table) if value(each)]
    return f"({' + '.join(terms) or '0.0'})"


def _is_any(name: str, values: Sequence[int]) -> str:
    return f"({' || '.join(f'{name} == {value}' for value in values) or 'false'})"


def _choice(name: str, pairs: Sequence[tuple[int, int]]) -> str:
    """Return the second of the pair whose first a variable equals, or the variable."""
    return f"({''.join(f'{name} == {one} ? {other} : ' for one, other in pairs)}{name})"


def _variations(table: MaterialTable) -> str:
    """Return statements that vary ``colour`` by the texture's ``layer``."""
    varied: dict[Variation, list[int]] = {}
    for index, texture in enumerate(table.layers.values()):
        for variation in texture.variations:
            varied.setdefault(variation, []).append(index)
    return " ".join(
        f"if ({_is_any('layer', layers)}) colour *= mix(vec3{each.low}, vec3{each.high}, "
        f"smoothstep({each.start}, {each.full}, {each.noise}));"
        for each, layers in varied.items()
    )


def _meadow_kinds(table: MaterialTable) -> str:
    """Return statements that set a tuft's ``layer`` and ``sward`` to those at ``pick`` of the shares."""
    return " ".join(
        f"if (pick > 0.0) {{ layer = {index}; sward = {each.sward}; }} "
        f"pick -= {each.meadow} * {_weight(index, 'weights')};"
        for index, each in enumerate(table)
        if each.meadow
    )


def _stone_colours(table: MaterialTable) -> str:
    """Return statements that give stones, ``lying``, the colours of materials with stones of their own."""
    return " ".join(
        f"lying = mix(lying, stone_albedo({index}, wide, middle, small), "
        f"smoothstep({each.stones.colours[0]}, {each.stones.colours[1]}, {_weight(index, 'weights')}));"
        for index, each in enumerate(table)
        if each.stones.colours
    )


def _stone_wear(table: MaterialTable) -> str:
    """Return how much water has rounded stones."""
    terms = [
        f"smoothstep({each.stones.colours[0]}, {each.stones.colours[1]}, {_weight(index)})"
        for index, each in enumerate(table)
        if each.stones.worn and each.stones.colours
    ]
    return f"({' + '.join(terms) or '0.0'})"
