"""Layered images as sketches: OpenRaster files, folders of pictures, single layers.

OpenRaster (``.ora``) is read after the Layer Stack and File Layout Specifications at openraster.org; like
GIMP's reader (plug-ins/python/file-openraster.py), a group has no offset of its own.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray
from sketchterrain.document.label_layers import to_oklab
from sketchterrain.errors import InputError, first_few, format_value, one_line
from sketchterrain.importing.images import Picture, check_size, decode_picture, detect_format, read_picture
from sketchterrain.importing.legend import Meaning, parse_layer_name
from sketchterrain.importing.traced_layers import TraceOptions, TraceResult, scale_labels
from sketchterrain.io.files import open_zip, wrap_read_errors
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS

_SETTINGS = "sketch.toml"
_MAX_FILES = 1000
_ASPECT_TOLERANCE = 0.01  # relative, of a folder's pictures
# Paint and background
_CONTRAST = 0.2  # Oklab distance of paint from the background, or half of the largest
_UNIFORM = 0.04  # Oklab range of a picture of one colour
_ROWS = 512
# OpenRaster
_MAX_BYTES = 1 << 30  # of the file, unpacked or not
_MAX_PNG = 256 << 20
_MAX_STACK = 4 << 20
_MAX_DEPTH = 100
_MAX_LAYERS = 256
_MAX_OFFSET = 1 << 24  # px


class _LayerComposer:
    """Label images under composition, from the topmost source down."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.layers = {name: np.zeros(size[::-1], dtype=np.uint8) for name in PAINTED_LAYERS}

    def add(self, meaning: Meaning, mask: BoolArray) -> int:
        """Paint unpainted pixels; return their number."""
        thin = (1,) if LAYERS[meaning.layer].kind == "course" else ()
        scaled = scale_labels(mask.astype(np.uint8), self.size, thin=thin) > 0
        image = self.layers[meaning.layer]
        free = scaled & (image == 0)
        image[free] = meaning.label
        return int(np.count_nonzero(free))


def trace_mask(path: Path, layer: str, options: TraceOptions) -> TraceResult:
    """Return a sketch of one layer (``mountain``, ``river.2``) from the painted area of a picture."""
    meaning = parse_layer_name(layer)
    if meaning is None:
        raise InputError(
            f"layer {format_value(layer)}: expected {', '.join(PAINTED_LAYERS)}, or with a label, as river.2"
        )
    mask, reason = painted_mask(read_picture(path))
    if not mask.any():
        raise InputError(f"{one_line(path)}: {reason}: expected a picture with paint on its background")
    composer = _LayerComposer(options.size(mask.shape[1], mask.shape[0]))
    composer.add(meaning, mask)
    sketch, sketch_notes = options.sketch(composer.layers, path.stem)
    return TraceResult(sketch, (f"{path.name} is {meaning}: {reason}", *sketch_notes))


class _StackLayer(NamedTuple):
    """A layer of an OpenRaster file."""

    name: str
    meaning: Meaning | None  # its own or its group's
    is_hidden: bool
    x: int  # north-west corner, px
    y: int
    source: str  # entry of the archive


def trace_open_raster(path: Path, options: TraceOptions) -> TraceResult:
    """Return the sketch in the layers of an OpenRaster file, named as a sketch's.

    Hidden layers and groups, and those of opacity 0, are skipped; any other opacity is ignored, as it serves
    for looking through while painting.
    """
    location = one_line(path)
    with open_zip(
        path, location, largest=_MAX_BYTES, expected="a whole OpenRaster file", inside="the archive"
    ) as archive:
        kind = archive.read("mimetype", 256).strip() if "mimetype" in archive.names else b""
        if kind == b"application/x-krita":
            raise InputError(f"{location} is a Krita file: in Krita, File ▸ Save As, OpenRaster (.ora)")
        if kind != b"image/openraster" or "stack.xml" not in archive.names:
            raise InputError(f"{location}: expected an OpenRaster file, with stack.xml in it")
        size, layers = _stack(archive.read("stack.xml", _MAX_STACK), f"{location}/stack.xml")
        hidden = [layer.name for layer in layers if layer.is_hidden]
        visible = [layer for layer in layers if not layer.is_hidden]
        others = [layer.name for layer in visible if layer.meaning is None]
        named = [(layer, layer.meaning) for layer in visible if layer.meaning is not None]
        if not named:
            raise _unnamed(location, "layer", (*others, *hidden))
        if len(named) > _MAX_LAYERS:
            raise InputError(f"{location}: expected at most {_MAX_LAYERS} layers named as a sketch's")
        composer, notes, total = _LayerComposer(options.size(*size)), [], 0
        for layer, meaning in named:
            if layer.source not in archive.names or layer.source.endswith("/"):
                raise InputError(
                    f"{location}: layer {format_value(layer.name)}: {format_value(layer.source)} is not in it"
                )
            png = archive.read(layer.source, min(_MAX_PNG, _MAX_BYTES - total))
            total += len(png)
            title = f"layer {format_value(layer.name)}"
            mask, reason = _layer_mask(decode_picture(png, f"{location}: {title}"), layer, size)
            notes.append(f"{title} is {meaning}{_reason(composer.add(meaning, mask), reason)}")
    notes += [f"hidden, skipped: {_listed(hidden)}"] if hidden else []
    notes += [f"not a layer of a sketch, skipped: {_listed(others)}"] if others else []
    sketch, sketch_notes = options.sketch(composer.layers, path.stem)
    return TraceResult(sketch, (*notes, *sketch_notes))


def _layer_mask(picture: Picture, layer: _StackLayer, size: tuple[int, int]) -> tuple[BoolArray, str]:
    """Return the painted area of a layer within (width, height), and the reason in words."""
    height, width = picture.rgba.shape[:2]
    covers = layer.x <= 0 and layer.y <= 0 and layer.x + width >= size[0] and layer.y + height >= size[1]
    mask, reason = painted_mask(picture)
    # Layers are cropped to their content: one that does not cover the picture has no background, nor has one
    # of a single colour.
    if not picture.has_transparency and not (covers and mask.any()):
        mask, reason = np.ones((height, width), dtype=bool), ""
    whole = np.zeros((size[1], size[0]), dtype=bool)
    top, left = max(0, layer.y), max(0, layer.x)
    part = mask[top - layer.y :, left - layer.x :][: max(0, size[1] - top), : max(0, size[0] - left)]
    whole[top : top + part.shape[0], left : left + part.shape[1]] = part
    return whole, reason


def trace_folder(folder: Path, options: TraceOptions) -> TraceResult:
    """Return the sketch in a folder's pictures, named as layers: ``river.png``, ``forest 2.png``.

    They may have any size, but the same aspect ratio.
    """
    location = one_line(folder)
    named, others, unread = _named_files(folder)
    if not named:
        raise _unnamed(location, "picture", (*others, *unread))
    composer, notes, first = None, [], (0, 0, "")
    for meaning, path in named:
        picture = read_picture(path)
        height, width = picture.rgba.shape[:2]
        if composer is None:
            composer, first = _LayerComposer(options.size(width, height)), (width, height, path.name)
        if abs(width * first[1] / (height * first[0]) - 1.0) > _ASPECT_TOLERANCE:
            raise InputError(
                f"{one_line(path)} is {width}×{height} px, but {one_line(first[2])} is "
                f"{first[0]}×{first[1]} px: expected the same aspect ratio"
            )
        values = picture.rgba[..., 0]
        if picture.is_grey and not picture.has_transparency and 0 < int(values.max()) <= 16:
            # Nearly black: label values, as in the program's own layers.
            labels = [int(label) for label in np.unique(values) if label]
            counts = [composer.add(Meaning(meaning.layer, label), values == label) for label in labels]
            notes.append(f"{path.name}: its values are labels of {meaning.layer}{_reason(sum(counts), '')}")
            continue
        mask, reason = painted_mask(picture)
        notes.append(f"{path.name} is {meaning}{_reason(composer.add(meaning, mask), reason)}")
    if composer is None:
        raise RuntimeError("expected a picture")
    notes += [f"not a layer of a sketch, skipped: {_listed(others)}"] if others else []
    notes += [f"not a picture, skipped: {_listed(unread)}"] if unread else []
    sketch, sketch_notes = options.sketch(composer.layers, folder.resolve().name)
    return TraceResult(sketch, (*notes, *sketch_notes))


def _named_files(folder: Path) -> tuple[list[tuple[Meaning, Path]], list[str], list[str]]:
    """Return pictures named as layers, the lowest label first; other pictures; other files so named."""
    location = one_line(folder)
    with wrap_read_errors(folder):
        paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        if len(paths) > _MAX_FILES:
            raise InputError(f"{location}: {len(paths)} files: expected at most {_MAX_FILES}")
        if any(path.name == _SETTINGS for path in paths):
            raise InputError(f"{location}: it is a sketch already, with a {_SETTINGS}")
        files = [path for path in paths if path.is_file()]
        pictures = [path for path in files if detect_format(_first_bytes(path))]
    candidates = [(parse_layer_name(path.stem), path) for path in pictures]
    named = [(meaning, path) for meaning, path in candidates if meaning is not None]
    named.sort(key=lambda each: (PAINTED_LAYERS.index(each[0].layer), each[0].label, each[1].name))
    unread = [path.name for path in files if path not in pictures and parse_layer_name(path.stem) is not None]
    return named, [path.name for meaning, path in candidates if meaning is None], unread


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(16)


def _unnamed(location: str, what: str, names: Iterable[str]) -> InputError:
    found = _listed(names)
    return InputError(
        f"{location}: none of its {what}s is named {', '.join(PAINTED_LAYERS)} (river 2 is label 2 of river)"
        + (f": found {found}" if found else "")
    )


def _reason(count: int, reason: str) -> str:
    if count:
        return f": {reason}" if reason else ""
    return f": {reason or 'it is covered by others'}, so it is empty"


def _listed(names: Iterable[str]) -> str:
    return first_few([format_value(name) for name in names], 10)


def painted_mask(picture: Picture) -> tuple[npt.NDArray[np.bool_], str]:
    """Return the painted area of a picture, (height, width), and the reason in words.

    With transparency, what is more than half opaque. Otherwise what differs from the background: the most
    common colour of the border, so white strokes on black are paint as well as black ones on white.
    """
    rgba = picture.rgba
    if picture.has_transparency:
        return rgba[..., 3] >= 128, "opaque pixels are painted"
    background = _background(rgba)
    origin = to_oklab(np.array(background) / 255.0)
    distance = np.empty(rgba.shape[:2], dtype=np.float32)
    for top in range(0, len(rgba), _ROWS):
        colours = to_oklab(rgba[top : top + _ROWS, :, :3] / 255.0)
        distance[top : top + _ROWS] = np.sqrt(((colours - origin) ** 2).sum(axis=-1))
    largest = float(distance.max())
    code = "#{:02x}{:02x}{:02x}".format(*background)
    if largest < _UNIFORM:
        return np.zeros(distance.shape, dtype=bool), f"it is all {code}, so nothing is painted"
    return distance > min(_CONTRAST, 0.5 * largest), f"its border is {code}, other colours are painted"


def _background(rgba: npt.NDArray[np.uint8]) -> tuple[int, int, int]:
    """Return the most common colour of the border."""
    border = np.concatenate([rgba[0], rgba[-1], rgba[:, 0], rgba[:, -1]])[:, :3]
    coarse = (border >> 4).astype(np.int32)
    cells = (coarse[:, 0] << 8) | (coarse[:, 1] << 4) | coarse[:, 2]
    most = np.bincount(cells).argmax()
    red, green, blue = (int(value) for value in np.rint(border[cells == most].mean(axis=0)))
    return red, green, blue


def _stack(data: bytes, location: str) -> tuple[tuple[int, int], list[_StackLayer]]:
    """Return the size (width, height) of an OpenRaster file and its layers, the topmost first."""
    if b"<!DOCTYPE" in data:  # could define entities
        raise InputError(f"{location}: expected no DOCTYPE")
    try:
        image = ET.fromstring(data)  # noqa: S314 # no entities
    except (ET.ParseError, ValueError) as error:
        raise InputError(f"{location}: expected XML ({one_line(error)})") from None
    if image.tag != "image":
        raise InputError(f"{location}: expected <image>, got <{one_line(image.tag)}>")
    width, height = (round(_number(image, key, 0.0, location)) for key in ("w", "h"))
    check_size((width, height), location)
    layers: list[_StackLayer] = []
    stack: list[tuple[ET.Element, bool, Meaning | None, int]] = [(image, False, None, 0)]
    while stack:
        element, is_hidden, meaning, depth = stack.pop()
        if depth > _MAX_DEPTH:
            raise InputError(f"{location}: groups are nested too deeply")
        if element is not image:
            is_hidden |= element.get("visibility") == "hidden"
            is_hidden |= not _number(element, "opacity", 1.0, location) > 0.0
            meaning = parse_layer_name(element.get("name", "")) or meaning
        if element.tag == "layer":
            x, y = (round(_number(element, key, 0.0, location)) for key in ("x", "y"))
            layers.append(
                _StackLayer(element.get("name", ""), meaning, is_hidden, x, y, element.get("src", ""))
            )
        stack.extend((child, is_hidden, meaning, depth + 1) for child in reversed(element))
    return (width, height), layers


def _number(element: ET.Element, key: str, default: float, location: str) -> float:
    text = element.get(key)
    try:
        value = default if text is None else float(text)
    except ValueError:
        value = float("nan")
    if not -_MAX_OFFSET <= value <= _MAX_OFFSET:
        raise InputError(f"{location}: {key}={format_value(text)}: expected a number of pixels or a share")
    return value
