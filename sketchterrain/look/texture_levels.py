"""Material textures: made by kernels, cached on disk, files of a user, resolution levels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from sketchterrain.array_types import Float64Array, UInt8Array
from sketchterrain.document.own_materials import picture_files
from sketchterrain.errors import InputError, one_line
from sketchterrain.host.library import host_function
from sketchterrain.io.disk_cache import cached_bytes
from sketchterrain.io.resources import kernel_constants, source
from sketchterrain.schema.colours import linear_from_hex, srgb_to_linear
from sketchterrain.schema.geology import Rock
from sketchterrain.schema.materials import BUILT_IN, MaterialTable, Texture

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sketchterrain.array_types import Float32Array
    from sketchterrain.compute.context import ComputeContext

    ContextFactory = Callable[[], ComputeContext]

Array = npt.NDArray[Any]

SOURCE: Final = "material_textures.cl"
_CASES = " ".join(f"case {index}: return {name}(u, v);" for index, name in enumerate(BUILT_IN.layers))
(_STEEPEST_MADE,) = kernel_constants("host/painting.h", "STEEPEST")
DEFINES: Final = (("TEXTURE_CASES", _CASES),)
"""Macros of `SOURCE`: the function of each texture layer."""


def paint_layer(context: ComputeContext, texture: str, size: int) -> Array:
    """Return (size, size, 4) linear albedo and height 0..1 of a texture layer, row 0 south."""
    painted = context.empty((size, size, 4), context.real_dtype)
    layer = np.int32(list(BUILT_IN.layers).index(texture))
    texel = context.real_dtype.type(1.0 / size)
    context.launch(SOURCE, "material_paint", (size, size), layer, texel, painted, defines=DEFINES)
    return context.download(painted, (size, size, 4), context.real_dtype)


def emboss(context: ComputeContext, painted: Array, layer: Texture) -> Array:
    """Return (n, n, 4) slopes east and north, roughness and openness of a result of :func:`paint_layer`."""
    real = context.real_dtype.type
    given = context.upload(painted.astype(context.real_dtype, copy=False))
    relief = context.empty(painted.shape, context.real_dtype)
    numbers = real(layer.bump), real(layer.low), real(layer.high)
    context.launch(SOURCE, "material_relief", painted.shape[:2], given, *numbers, relief, defines=DEFINES)
    return context.download(relief, painted.shape, context.real_dtype)


Moments = tuple["Float32Array", "Float32Array"]
"""(n, n, 4) linear albedo and height; (n, n, 5) slopes, the mean of both squared slopes, α², openness."""


def moments(painted: Array, relief: Array) -> Moments:
    """Return the moments that are averaged, of albedo and height and of slopes, roughness, openness."""
    east, north, roughness, openness = np.moveaxis(relief.astype(np.float32), -1, 0)
    square = (east * east + north * north) * np.float32(0.5)
    alpha = roughness * roughness
    return painted.astype(np.float32), np.stack([east, north, square, alpha * alpha, openness], axis=-1)


def halve(fields: Float32Array) -> Float32Array:
    """Average blocks of 2×2 texels; both sides are even."""
    rows = fields[0::2] + fields[1::2]
    return (rows[:, 0::2] + rows[:, 1::2]) * np.float32(0.25)


def encode_level(level: Moments) -> tuple[UInt8Array, UInt8Array]:
    """Return bytes (n, n, 4): √albedo and height; 0.5 + 0.5 normal xy, filtered roughness, openness."""
    painted, fields = (np.ascontiguousarray(part).reshape(-1, part.shape[-1]) for part in level)
    colour, relief = np.empty((2, *level[0].shape), np.uint8)
    host_function("encode_texels")(painted, fields, colour.reshape(-1, 4), relief.reshape(-1, 4))
    return colour, relief


def mipmaps(painted: Array, relief: Array) -> Iterator[tuple[UInt8Array, UInt8Array]]:
    """Yield the encoded levels of a texture, from the finest one to a single texel."""
    level = moments(painted, relief)
    yield encode_level(level)
    while len(level[0]) > 1:
        level = halve(level[0]), halve(level[1])
        yield encode_level(level)


def decode_level(colour: UInt8Array, relief: UInt8Array) -> tuple[Array, Array]:
    """Invert :func:`encode_level` for a texture's finest level."""
    painted = colour.astype(np.float64) / 255.0
    painted[..., :3] **= 2
    bytes_ = relief.astype(np.float64) / 255.0
    flat = 2.0 * bytes_[..., :2] - 1.0
    up = np.sqrt(np.maximum(1.0 - (flat * flat).sum(axis=-1, keepdims=True), 1.0 - _STEEPEST_MADE**2))
    return painted, np.concatenate([-flat / up, bytes_[..., 2:]], axis=-1)


SUFFIX_FIELDS: Final = {"": "albedo", "_height": "height", "_normal": "slopes", "_roughness": "roughness"}
"""Suffixes of a material's name, and what they hold."""
SUFFIXES: Final = (".png", ".jpg", ".jpeg")
_STEEPEST: Final = 8.0  # largest slope of a normal map
_LARGEST: Final = 16384  # largest side, px


MaterialImages = dict[str, Array]
"""Images of a material by `SUFFIX_FIELDS`, row 0 south: albedo linear, slopes eastward and northward."""


def read_material_images(folder: Path, size: int, table: MaterialTable) -> dict[str, MaterialImages]:
    """Read ``rock.png``, ``rock_height.png``, ``rock_normal.jpg``, …, resized to `size` texels a side.

    Colours are sRGB; a normal map has x to the right, y up and z to the eye in red, green and blue; height
    and roughness are grey, of 8 or 16 bits. Any image may be missing; other files are ignored.
    """
    if not folder.is_dir():
        raise InputError(f"{one_line(folder)}: expected a folder of textures")
    names = {name + suffix: (name, suffix) for name in table.layers for suffix in SUFFIX_FIELDS}
    found: dict[str, MaterialImages] = {}
    for path in sorted(each for each in folder.iterdir() if each.suffix.lower() in SUFFIXES):
        if path.stem not in names:
            raise InputError(
                f"{one_line(path)}: expected the name of a material, {', '.join(table.layers)}, alone "
                f"or with {', '.join(list(SUFFIX_FIELDS)[1:])}"
            )
        material, suffix = names[path.stem]
        field = SUFFIX_FIELDS[suffix]
        if field in found.setdefault(material, {}):
            raise InputError(
                f"{one_line(path)}: expected one picture {path.stem}, got two of different suffixes"
            )
        found[material][field] = _read_image(path, field, size)
    return found


def own_material_images(own: Mapping[str, Mapping[str, Any]], size: int) -> dict[str, MaterialImages]:
    """Read the pictures of a sketch's own materials that have a folder, resized to `size` texels a side."""
    folders = {name: values["folder"] for name, values in own.items() if values.get("folder")}
    return {
        name: {field: _read_image(path, field, size) for field, path in picture_files(folder, name).items()}
        for name, folder in folders.items()
    }


def _read_image(path: Path, field: str, size: int) -> Array:
    try:
        with Image.open(path) as picture:
            if max(picture.size) > _LARGEST:
                got = f"{picture.width}×{picture.height}"
                raise InputError(f"{one_line(path)}: expected sides of {_LARGEST} px at most, got {got}")
            if field in {"albedo", "slopes"}:
                values = np.asarray(picture.convert("RGB"), np.float32) / 255.0
            else:
                wide = picture.mode.startswith(("I", "F"))
                values = np.asarray(picture if wide else picture.convert("L"), np.float32)
                values = values / (65535.0 if wide else 255.0)
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise InputError(f"{one_line(path)}: expected a picture, PNG or JPEG ({one_line(error)})") from error
    if field == "albedo":
        values = srgb_to_linear(values)
    elif field == "slopes":
        normal = 2.0 * values - 1.0
        values = -normal[..., :2] / np.maximum(normal[..., 2:], 1.0 / _STEEPEST)
    resampling = Image.Resampling.BOX if min(values.shape[:2]) >= size else Image.Resampling.BICUBIC
    resized = [
        np.asarray(
            Image.fromarray(np.ascontiguousarray(channel, np.float32)).resize((size, size), resampling)
        )[::-1]
        for channel in np.moveaxis(np.atleast_3d(values), -1, 0)
    ]
    return resized[0] if values.ndim == 2 else np.stack(resized, axis=-1)


Levels = list[tuple[UInt8Array, UInt8Array]]
"""Colour and relief, (layers, n, n, 4) each, from the finest level to single texels, as of `mipmaps`."""

_FORMAT: Final = 1  # to be changed when `mipmaps` encodes the same textures differently


def procedural_levels(size: int, open_context: ContextFactory) -> Levels:
    """Return the procedural textures, `size` (a power of two) texels a side, cached on disk."""
    recipe = f"{source(SOURCE, DEFINES)}\n{BUILT_IN.layers.values()}\n{size}\n{_FORMAT}"
    content = cached_bytes(f"materials-{size}", recipe, lambda: _compute_levels(size, open_context()))
    return _levels_in(np.frombuffer(content, np.uint8), size)


def _levels_in(flat: UInt8Array, size: int) -> Levels:
    """Return the levels that follow each other in bytes."""
    levels, start = [], 0
    for side in (size >> level for level in range(size.bit_length())):
        shape = 2, len(BUILT_IN.layers), side, side, 4
        colour, relief = flat[start : start + prod(shape)].reshape(shape)
        levels.append((colour, relief))
        start += prod(shape)
    return levels


def customized_levels(
    levels: Levels,
    table: MaterialTable,
    looks: Mapping[str, Mapping[str, Any]],
    images: Mapping[str, MaterialImages],
    open_context: ContextFactory,
) -> Levels:
    """Return the layers of a table, with a sketch's looks and user images (of the same size), images first.

    A colour becomes the mean albedo, a roughness the mean roughness; heights of an image without a normal map
    get slopes and openness as the procedural ones do, by a context that is opened only then.
    """
    names = [name for name in table.layers if name in looks or name in images]
    if not names and table == BUILT_IN:
        return levels
    known = list(BUILT_IN.layers)
    order = [known.index(texture.name) for texture in table.layers.values()]
    levels = [(colour[order], relief[order]) for colour, relief in levels]
    for name in names:
        index, look = list(table.layers).index(name), looks.get(name, {})
        if name not in images and look.get("bump", 1.0) == 1.0 and look.get("roughness", -1.0) < 0.0:
            _recolour([colour[index] for colour, _ in levels], look)
            continue
        painted, relief = decode_level(levels[0][0][index], levels[0][1][index])
        if name in images:
            painted, relief = _with_images(table.layers[name], painted, images[name], relief, open_context)
        painted, relief = _with_look(painted, relief, look)
        for level, (colour, slopes) in zip(levels, mipmaps(painted, relief), strict=True):
            level[0][index], level[1][index] = colour, slopes
    return levels


def _with_images(
    layer: Texture, painted: Array, images: MaterialImages, relief: Array, open_context: ContextFactory
) -> tuple[Array, Array]:
    albedo, height = images.get("albedo"), images.get("height")
    if albedo is not None:
        painted[..., :3] = albedo
        if height is None:
            # Bright texels are assumed to be high: a guess, but it matches the image.
            grey = np.sqrt(albedo.mean(axis=-1))
            height = (grey - grey.min()) / max(float(np.ptp(grey)), 1e-6)
    if height is not None:
        painted[..., 3] = height
        own = relief
        relief = emboss(open_context(), painted, layer)
        if albedo is None:
            relief[..., 2] = own[..., 2]
    if "slopes" in images:
        relief[..., :2] = images["slopes"]
    if "roughness" in images:
        relief[..., 2] = images["roughness"]
    return painted, relief


def layer_tints(
    table: MaterialTable, aridity: float, looks: Mapping[str, Mapping[str, Any]], rock: Rock
) -> Float64Array:
    """Return the tint of each layer, (layers, 3): stone has its rock's; arid land has straw and red stone."""
    tints = np.ones((len(table.layers), 3))
    for tint, (name, layer) in zip(tints, table.layers.items(), strict=True):
        if not looks.get(name, {}).get("colour"):
            share = max(0.0, aridity - layer.arid_from) / (1.0 - layer.arid_from)
            tint += (np.array(layer.arid_tint) - 1.0) * share
            tint *= np.array(rock.tint) ** layer.of_rock
    return tints


def _recolour(levels: list[UInt8Array], look: Mapping[str, Any]) -> None:
    """Apply the colour of a look to encoded levels (n, n, 4) of √albedo and height."""
    if not look.get("colour"):
        return
    codes = np.arange(256) / 255.0
    for channel, target in enumerate(linear_from_hex(str(look["colour"]))):
        shares = np.bincount(levels[0][..., channel].ravel(), minlength=256) / levels[0][..., channel].size
        gain = np.sqrt(target / max(float(shares @ codes**2), 1e-4))
        scaled = np.rint(np.clip(gain * codes, 0.0, 1.0) * 255.0).astype(np.uint8)
        for level in levels:
            level[..., channel] = scaled[level[..., channel]]


def _with_look(painted: Array, relief: Array, look: Mapping[str, Any]) -> tuple[Array, Array]:
    if look.get("colour"):
        target = linear_from_hex(str(look["colour"]))
        painted[..., :3] *= target / np.maximum(painted[..., :3].mean(axis=(0, 1)), 1e-4)
    relief[..., :2] *= look.get("bump", 1.0)
    if look.get("roughness", -1.0) >= 0.0:
        relief[..., 2] += look["roughness"] - relief[..., 2].mean()
    return painted, np.concatenate([relief[..., :2], np.clip(relief[..., 2:], 0.0, 1.0)], axis=-1)


def _compute_levels(size: int, context: ComputeContext) -> memoryview:
    flat = np.empty(8 * len(BUILT_IN.layers) * ((4 * size * size - 1) // 3), np.uint8)
    levels = _levels_in(flat, size)
    context.build_ahead([(SOURCE, DEFINES)])
    for index, layer in enumerate(BUILT_IN.layers.values()):
        painted = paint_layer(context, layer.name, size)
        for level, parts in zip(levels, mipmaps(painted, emboss(context, painted, layer)), strict=True):
            level[0][index], level[1][index] = parts
    return flat.data
