"""Label images of a sketch: reading, writing, colours of labels."""

import io
import struct
import zlib
from collections.abc import Iterable
from functools import lru_cache
from itertools import product
from typing import Any, TypeAlias
from weakref import WeakValueDictionary

import numpy as np
import numpy.typing as npt
from PIL import Image
from PIL.PngImagePlugin import PngImageFile

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS

Box = tuple[int, int, int, int]
"""Top, left, bottom, right: rows and columns of a sketch, the last two exclusive."""


def union_box(a: Box | None, b: Box | None) -> Box | None:
    """Return the bounding box of two boxes, either of which may be missing."""
    if a is None or b is None:
        return a or b
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


LabelImage: TypeAlias = npt.NDArray[np.uint8]

MAX_SIDE = 16384
"""The most pixels along a side of a sketch."""

MAX_LABELS = 16
"""The most labels in one layer: an image with more looks antialiased."""

_BLOCK_PIXELS = 1 << 20

_checked: WeakValueDictionary[int, LabelImage] = WeakValueDictionary()
"""Images that were checked and frozen, by id: the next sketch shares most of them."""


def label_areas(image: LabelImage) -> dict[int, int]:
    """Return the pixel counts of the labels (1 to 255) that occur in an image."""
    rows = max(1, _BLOCK_PIXELS // max(1, image.shape[1]))
    counts = np.zeros(256, dtype=np.int64)
    for top in range(0, image.shape[0], rows):  # bincount widens its input eightfold
        counts += np.bincount(image[top : top + rows].ravel(), minlength=256)
    return {int(label): int(counts[label]) for label in np.flatnonzero(counts) if label}


def labels_in(image: LabelImage) -> tuple[int, ...]:
    """Return the labels in an image, 1 to 255, ascending."""
    return tuple(label_areas(image))


def check_image(name: str, image: LabelImage) -> LabelImage:
    """Return a layer's image, uint8 (height, width), read-only; a writeable array is copied.

    Raise InputError, naming the layer, if it is not a label image.
    """
    if _checked.get(id(image)) is image and not image.flags.writeable:
        return image
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2:
        given = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        raise InputError(f"layer {name}: expected a uint8 array (height, width), got {given}")
    if not 1 <= min(image.shape) <= max(image.shape) <= MAX_SIDE:
        raise InputError(
            f"layer {name} is {image.shape[1]}×{image.shape[0]} px: expected sides of 1 to {MAX_SIDE} px"
        )
    labels = labels_in(image)
    if len(labels) > MAX_LABELS:
        raise InputError(
            f"layer {name} looks antialiased: it has {len(labels)} labels, expected at most {MAX_LABELS}"
        )
    shared = image.flags.writeable or not image.flags.c_contiguous or image.base is not None
    return freeze_image(np.array(image, dtype=np.uint8, order="C") if shared else image)


def freeze_image(image: LabelImage) -> LabelImage:
    """Make a valid label image read-only and register it as checked."""
    image.flags.writeable = False
    _checked[id(image)] = image
    return image


_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _PALETTE = 0, 3
_EMPTY = (0, 0, 0)  # black, so that label 0 stays 0 where a paint program converts the palette to greys
_WHITE = 0xFFFFFF
_MAX_EDGES = 0.25  # of the image
_OR_TRACE = "or `sketchterrain trace FILE --layer {} -o DIR`"


def decode_layer(data: bytes, layer: str) -> tuple[LabelImage, list[str]]:
    """Return the label image in a layer's PNG file, uint8 (height, width), read-only, and notes.

    Grey values, 0 and 1 in images of one bit, and indices of a palette are labels. If the palette has colours
    of the layer as `encode_layer` and `label_rgb` give them, but in other places, and in images of several
    channels, colours decide: black, white and transparent are empty, edges between colours get the nearer
    label. Raise InputError if it is damaged, too large, or has other colours or too many labels.
    """
    width, height, depth, colour_type = _read_header(data)
    several = colour_type not in (_GREY, _PALETTE)
    longest = MAX_SIDE // 2 if several else MAX_SIDE  # bounds the memory
    if not (1 <= width <= longest and 1 <= height <= longest):
        raise InputError(f"{width}×{height} px: expected sides of 1 to {longest} px")
    # Grey of 2 or 4 bits would be decoded as shades spread over 0 to 255, not as labels.
    if colour_type == _GREY and depth in (2, 4):
        raise InputError(f"{depth} bits a pixel: expected labels as a greyscale or palette PNG of 8 bits")
    moved, coloured = dict[int, int](), None
    try:
        # Not Image.open: its limit on image size is global to the process.
        with PngImageFile(io.BytesIO(data)) as image:
            image.load()
            array = np.asarray(image)
            if colour_type == _PALETTE:
                image.apply_transparency()
                moved = _moved_labels(array, np.array(image.getpalette("RGBA")).reshape(-1, 4), layer)
            if moved or several:
                coloured = np.asarray(image.convert("RGBA"))
    except (OSError, SyntaxError, ValueError, EOFError, zlib.error, struct.error) as error:
        raise InputError(f"expected a whole PNG file, this one is damaged ({error})") from None
    listed = ", ".join(f"{index} is {label or 'empty'}" for index, label in moved.items())
    notes = [f"colours decide, as its palette has those of labels in other places: {listed}"] if moved else []
    if coloured is not None:
        array, edges = _labels_by_colour(coloured, layer, depth)
        if edges:
            notes.append(f"{edges:.2%} of it, edges between its colours, is read as the nearer label")
    elif array.dtype == np.uint16 and array.max() > 255:  # paint programs multiply 8 bits by 257
        if (array % 257).any():
            raise InputError(f"16 bits with values up to {array.max()}: expected labels from 0 to 255")
        array = array // 257
    array = array.astype(np.uint8)
    labels = labels_in(array)
    if len(labels) > MAX_LABELS:
        raise InputError(
            f"looks antialiased: it has {len(labels)} labels, expected at most {MAX_LABELS}; "
            f"paint with a hard brush, {_OR_TRACE.format(layer)}"
        )
    array.flags.writeable = False
    return array, notes


def _known_colours(colours: Iterable[int], layer: str) -> dict[int, int]:
    """Return labels by colour, 0xRRGGBB, of a layer, or of another that alone knows all of some colours."""
    known = [_labels_of(each) for each in (layer, *PAINTED_LAYERS)]
    return next((each for each in known if each.keys() >= set(colours)), known[0])


@lru_cache(maxsize=16)
def _labels_of(layer: str) -> dict[int, int]:
    drawn = [(label_rgb(layer, label), label) for label in range(MAX_LABELS, 0, -1)]
    written = [(_shade(label, LAYERS[layer].colour), label) for label in range(MAX_LABELS, -1, -1)]
    pairs = [*drawn, *written]  # the last of equal colours counts
    return {_WHITE: 0} | {int.from_bytes(bytes(colour), "big"): label for colour, label in pairs}


def _packed(rgba: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
    """Return colours as 0xRRGGBB; transparent ones are black."""
    red, green, blue = (rgba[..., channel].astype(np.int32) for channel in range(3))
    return np.where(rgba[..., 3] < 128, 0, red << 16 | green << 8 | blue).astype(np.int32)


def _moved_labels(image: LabelImage, palette: npt.NDArray[Any], layer: str) -> dict[int, int]:
    """Return labels by index where a palette's colours are known and contradict its indices."""
    colours = _packed(palette).tolist()
    used = [each for each in labels_in(image) if each < len(colours)] + [0] * (not image.all())
    seen = {colours[each] for each in used}
    known = _known_colours(seen, layer)
    if not any(map(known.get, seen if seen - {0, _WHITE} else colours)):
        return {}
    written = [int.from_bytes(bytes(_shade(each, LAYERS[layer].colour)), "big") for each in used]
    pairs = ((each, colours[each]) for each, own in zip(used, written, strict=True) if colours[each] != own)
    return {index: known[colour] for index, colour in pairs if known.get(colour, index) != index}


def _labels_by_colour(rgba: npt.NDArray[np.uint8], layer: str, depth: int) -> tuple[LabelImage, float]:
    """Return the labels of an image, its greys or by known colours, and the share of antialiased edges."""
    packed = _packed(rgba)
    table = np.zeros(1 << 24, dtype=np.uint8)
    table[packed] = 1
    present = np.flatnonzero(table)[: 1 << 16].tolist()  # more are of a photograph
    known = _known_colours(present, layer)
    painted = [each for each in present if known.get(each)]
    if not painted and all(each % 0x10101 == 0 for each in present):
        if {0, _WHITE} <= {*present} or (depth == 16 and rgba[..., 3].any()):
            raise InputError(f"grey in several channels: expected one channel, {_OR_TRACE.format(layer)}")
        return np.where(packed == _WHITE, 0, packed & 255).astype(np.uint8), 0.0
    soft = (rgba[..., 3] > 0) & (rgba[..., 3] < 255)
    solid = {*present}
    if not known.keys() >= solid:
        flat = packed[1:, 1:] == packed[:-1, :-1]
        flat &= (packed[1:, 1:] == packed[:-1, 1:]) & (packed[1:, 1:] == packed[1:, :-1])
        solid = {*np.unique(packed[1:, 1:][flat]).tolist()}
        if painted and not solid.intersection(painted):  # thin lines alone
            solid.add(max(painted, key=lambda each: np.count_nonzero(packed == each)))
        solid |= {0, _WHITE}.intersection(present)
        soft |= ~np.isin(packed, [*solid])
        stray = solid - known.keys() or (set() if painted else {*present})
        if stray or soft.mean() > _MAX_EDGES:
            other = f"#{min(stray):06x}" if stray else f"{soft.mean():.0%} between them"
            raise InputError(
                f"expected the colours of layer {layer} alone, got {other}; {_OR_TRACE.format(layer)}"
            )
    kept = np.array(sorted(solid))
    table[:] = len(kept)
    table[kept] = range(len(kept))
    index = table[packed]
    rows, columns = np.nonzero(index == len(kept))
    edges, beside = packed[rows, columns], np.zeros((len(rows), len(kept) + 1), dtype=bool)
    around = np.pad(index, 2, constant_values=len(kept))
    for down, right in product(range(5), repeat=2):
        beside[range(len(rows)), around[rows + down, columns + right]] = True
    apart = sum(((edges[:, None] >> shift & 255) - (kept >> shift & 255)) ** 2 for shift in (0, 8, 16))
    index[rows, columns] = np.argmin(apart + 1e6 * ~beside[:, :-1], axis=1)
    return np.array([known[each] for each in kept.tolist()], np.uint8)[index], float(soft.mean())


def encode_layer(image: LabelImage, colour: tuple[int, int, int]) -> bytes:
    """Return a label image as an 8-bit palette PNG; label 1 has the sRGB `colour`, others shades of it."""
    picture = Image.fromarray(image)
    picture.putpalette([channel for label in range(256) for channel in _shade(label, colour)])
    stream = io.BytesIO()
    picture.save(stream, format="PNG")
    return stream.getvalue()


def _shade(label: int, colour: tuple[int, int, int]) -> tuple[int, ...]:
    if label == 0:
        return _EMPTY
    # Golden-ratio steps keep successive labels distinct.
    light = 1.0 - 0.6 * ((label - 1) * 0.618034 % 1.0)
    return tuple(round(channel * light) for channel in colour)


def _read_header(data: bytes) -> tuple[int, int, int, int]:
    """Return width, height, bits and colour type of a PNG file, after checking every chunk."""
    if not data.startswith(_SIGNATURE):
        raise InputError("expected a PNG file")
    header, position, kind = b"", len(_SIGNATURE), b""
    while kind != b"IEND":
        start = data[position : position + 8]
        length = int.from_bytes(start[:4], "big")
        kind, end = start[4:], position + 8 + length
        crc = data[end : end + 4]
        if len(start) < 8 or len(crc) < 4:
            raise InputError("expected a whole PNG file, this one is truncated")
        if zlib.crc32(memoryview(data)[position + 4 : end]) != int.from_bytes(crc, "big"):
            raise InputError("expected a whole PNG file, this one is damaged (wrong check sum)")
        if not header:
            header = data[position + 8 : end]
            if kind != b"IHDR" or len(header) != 13:
                raise InputError("expected a PNG file, this one has no header")
        position = end + 4
    width, height, depth, colour_type = struct.unpack(">IIBB", header[:10])
    return width, height, depth, colour_type


_SHADES = 16  # distinct labels; later ones repeat

_TO_LMS = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def label_rgb(layer: str, label: int) -> tuple[int, int, int]:
    """Return the sRGB colour, 0 to 255, of a label, 1 to 255: a distinct shade of its layer's colour."""
    return _shades(layer)[(label - 1) % _SHADES]


def to_oklab(colours: npt.ArrayLike) -> Float64Array:
    """Return sRGB colours in 0 … 1, (…, 3), in Oklab: lightness 0 to 1, and two hue axes, about ±0.4."""
    encoded = np.asarray(colours, dtype=np.float64)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.cbrt(linear @ _TO_LMS.T) @ _TO_LAB.T)


@lru_cache(maxsize=16)
def _shades(layer: str) -> tuple[tuple[int, int, int], ...]:
    """Return the colours of labels 1, 2, …: each as far from those before it as the layer's hues allow."""
    light, *_ = base = to_oklab(np.array(LAYERS[layer].colour) / 255.0)
    chroma, hue = np.hypot(base[1], base[2]), np.arctan2(base[2], base[1])
    lights = np.linspace(0.34, 0.66, 5) if LAYERS[layer].light_hatch else np.linspace(0.52, 0.88, 6)
    hues = hue + np.deg2rad([0.0, 15.0, -15.0, 30.0, -30.0])
    chromas = max(chroma, 0.03) * np.array([0.8, 1.25])
    grid = np.stack(np.meshgrid(lights, chromas, hues, indexing="ij"), axis=-1).reshape(-1, 3)
    lab = np.stack([grid[:, 0], grid[:, 1] * np.cos(grid[:, 2]), grid[:, 1] * np.sin(grid[:, 2])], axis=-1)
    shades = [np.array([light, base[1], base[2]])]
    # Hue weighs less than lightness, which colour-blind users see.
    weight = np.array([1.0, 0.6, 0.6])
    nearest = np.full(len(lab), np.inf)
    for _ in range(_SHADES - 1):
        nearest = np.minimum(nearest, np.sqrt((((lab - shades[-1]) * weight) ** 2).sum(axis=1)))
        score = nearest - 0.12 * np.abs(grid[:, 2] - hue) / np.pi
        shades.append(lab[int(np.argmax(score))])
    colours = [LAYERS[layer].colour, *(_rgb(each) for each in shades[1:])]
    return tuple((int(r), int(g), int(b)) for r, g, b in colours)


def _rgb(lab: Float64Array) -> tuple[int, int, int]:
    linear = np.clip(np.linalg.solve(_TO_LMS, np.linalg.solve(_TO_LAB, lab) ** 3), 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    red, green, blue = np.rint(255.0 * np.clip(encoded, 0.0, 1.0)).astype(int)
    return int(red), int(green), int(blue)
