"""Layers of a paint program as a sketch: OpenRaster files, folders of pictures, one picture for one layer.

OpenRaster (``.ora``) is read after the Layer Stack and File Layout Specifications at openraster.org; like
GIMP's reader (plug-ins/python/file-openraster.py), a group has no offset of its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray
from sketchterrain.document.label_layers import to_oklab
from sketchterrain.document.parameters import LAYERS
from sketchterrain.errors import InputError, format_value, one_line
from sketchterrain.importing.images import Picture, check_size, kind_of_picture, picture_from, read_picture
from sketchterrain.importing.legend import Meaning, meant_by
from sketchterrain.importing.traced_layers import Sheet, Traced, majority
from sketchterrain.io.safe_zip import open_zip

_SETTINGS = "sketch.toml"
_MOST_FILES = 1000
_LIKE = 0.01  # by which the shapes of a folder's pictures may differ
# Paint beside paper
_OTHER = 0.2  # Oklab: farther from the paper's colour is paint; half as far as what is painted most plainly
_SAME = 0.04  # Oklab: a picture that differs by less is of one colour
_ROWS = 512
# OpenRaster
_LARGEST = 1 << 30  # bytes of the file, unpacked or not
_LARGEST_PNG = 256 << 20
_LARGEST_STACK = 4 << 20
_DEEPEST = 100
_MOST_LAYERS = 256
_FARTHEST = 1 << 24  # px of an offset


class _Sheets:
    """Label images that are being put together: what is on top is added first."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.layers = {name: np.zeros(size[::-1], dtype=np.uint8) for name in LAYERS}

    def add(self, meaning: Meaning, mask: BoolArray) -> int:
        """Paint where nothing is yet; return how many pixels that were."""
        thin = (1,) if meaning.layer == "river" else ()
        scaled = majority(mask.astype(np.uint8), self.size, thin=thin) > 0
        image = self.layers[meaning.layer]
        free = scaled & (image == 0)
        image[free] = meaning.label
        return int(np.count_nonzero(free))


def trace_mask(path: Path, layer: str, sheet: Sheet) -> Traced:
    """Return a sketch with one layer (``mountain``, ``river.2``), painted where a picture is."""
    meaning = meant_by(layer)
    if meaning is None:
        raise InputError(
            f"layer {format_value(layer)}: expected {', '.join(LAYERS)}, or one with a label, as river.2"
        )
    mask, how = painted_mask(read_picture(path))
    if not mask.any():
        raise InputError(f"{one_line(path)}: {how}: expected a picture with something on its paper")
    sheets = _Sheets(sheet.size(mask.shape[1], mask.shape[0]))
    sheets.add(meaning, mask)
    sketch, told = sheet.sketch(sheets.layers, path.stem)
    return Traced(sketch, (f"{path.name} is {meaning}: {how}", *told))


class _StackLayer(NamedTuple):
    """A layer of OpenRaster: its meaning or its group's, its north-west corner (px), its picture's entry."""

    name: str
    meaning: Meaning | None
    is_hidden: bool
    x: int
    y: int
    source: str


def trace_open_raster(path: Path, sheet: Sheet) -> Traced:
    """Return the sketch that lies in the layers of an OpenRaster file, named as a sketch's.

    Layers and groups that are hidden, or of no opacity at all, are left out; how faint another is does not
    matter, for people dim what they look through.
    """
    place = one_line(path)
    with open_zip(
        path, place, largest=_LARGEST, expected="a whole OpenRaster file", inside="the archive"
    ) as archive:
        kind = archive.read("mimetype", 256).strip() if "mimetype" in archive.names else b""
        if kind == b"application/x-krita":
            raise InputError(f"{place} is a Krita file: in Krita, File ▸ Save As, OpenRaster (.ora)")
        if kind != b"image/openraster" or "stack.xml" not in archive.names:
            raise InputError(f"{place}: expected an OpenRaster file, with stack.xml in it")
        size, layers = _stack(archive.read("stack.xml", _LARGEST_STACK), f"{place}/stack.xml")
        hidden = [each.name for each in layers if each.is_hidden]
        others = [each.name for each in layers if each.meaning is None and not each.is_hidden]
        named = [(each, each.meaning) for each in layers if each.meaning is not None and not each.is_hidden]
        if not named:
            raise _unnamed(place, "layer", (*others, *hidden))
        if len(named) > _MOST_LAYERS:
            raise InputError(f"{place}: expected at most {_MOST_LAYERS} layers that mean something")
        sheets, notes, total = _Sheets(sheet.size(*size)), [], 0
        for layer, meaning in named:
            if layer.source not in archive.names or layer.source.endswith("/"):
                raise InputError(
                    f"{place}: layer {format_value(layer.name)}: {format_value(layer.source)} is not in it"
                )
            png = archive.read(layer.source, min(_LARGEST_PNG, _LARGEST - total))
            total += len(png)
            mask, how = _layer_mask(
                picture_from(png, f"{place}: layer {format_value(layer.name)}"), layer, size
            )
            notes.append(
                f"layer {format_value(layer.name)} is {meaning}{_empty(sheets.add(meaning, mask), how)}"
            )
    notes += [f"hidden, left out: {_listed(hidden)}"] if hidden else []
    notes += [f"no layer of a sketch, left out: {_listed(others)}"] if others else []
    sketch, told = sheet.sketch(sheets.layers, path.stem)
    return Traced(sketch, (*notes, *told))


def _layer_mask(picture: Picture, layer: _StackLayer, size: tuple[int, int]) -> tuple[BoolArray, str]:
    """Return where a layer is painted on a picture of a size (width, height), and how that was told."""
    height, width = picture.rgba.shape[:2]
    covers = layer.x <= 0 and layer.y <= 0 and layer.x + width >= size[0] and layer.y + height >= size[1]
    mask, how = painted_mask(picture)
    # A layer is cut to what is on it: one that does not cover the picture has no paper, nor has one that is
    # filled with a colour.
    if not picture.see_through and not (covers and mask.any()):
        mask, how = np.ones((height, width), dtype=bool), ""
    whole = np.zeros((size[1], size[0]), dtype=bool)
    top, left = max(0, layer.y), max(0, layer.x)
    part = mask[top - layer.y :, left - layer.x :][: max(0, size[1] - top), : max(0, size[0] - left)]
    whole[top : top + part.shape[0], left : left + part.shape[1]] = part
    return whole, how


def trace_folder(folder: Path, sheet: Sheet) -> Traced:
    """Return the sketch that lies in a folder's pictures, each called as a layer.

    They may have any size, but one shape: ``river.png``, ``forest 2.png``.
    """
    place = one_line(folder)
    named, others, unread = _named_files(folder)
    if not named:
        raise _unnamed(place, "picture", (*others, *unread))
    sheets, notes, first = None, [], (0, 0, "")
    for meaning, path in named:
        picture = read_picture(path)
        height, width = picture.rgba.shape[:2]
        if sheets is None:
            sheets, first = _Sheets(sheet.size(width, height)), (width, height, path.name)
        if abs(width * first[1] / (height * first[0]) - 1.0) > _LIKE:
            raise InputError(
                f"{one_line(path)} is {width}×{height} px, but {one_line(first[2])} is "
                f"{first[0]}×{first[1]} px: expected pictures of one shape"
            )
        values = picture.rgba[..., 0]
        if picture.is_grey and not picture.see_through and 0 < int(values.max()) <= 16:
            # Nearly black all over: no picture for the eye but labels, as the program's own layers are.
            labels = [int(label) for label in np.unique(values) if label]
            counts = [sheets.add(Meaning(meaning.layer, label), values == label) for label in labels]
            notes.append(f"{path.name}: its values are labels of {meaning.layer}{_empty(sum(counts), '')}")
            continue
        mask, how = painted_mask(picture)
        notes.append(f"{path.name} is {meaning}{_empty(sheets.add(meaning, mask), how)}")
    if sheets is None:
        raise RuntimeError("expected a picture")
    notes += [f"no layer of a sketch, left out: {_listed(others)}"] if others else []
    notes += [f"no picture, left out: {_listed(unread)}"] if unread else []
    sketch, told = sheet.sketch(sheets.layers, folder.resolve().name)
    return Traced(sketch, (*notes, *told))


def _named_files(folder: Path) -> tuple[list[tuple[Meaning, Path]], list[str], list[str]]:
    """Return pictures named as layers, the lowest label first, other pictures and other files so named."""
    place = one_line(folder)
    try:
        paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        if len(paths) > _MOST_FILES:
            raise InputError(f"{place}: {len(paths)} files: expected at most {_MOST_FILES}")
        if any(path.name == _SETTINGS for path in paths):
            raise InputError(f"{place}: it is a sketch already, with a {_SETTINGS}")
        files = [path for path in paths if path.is_file()]
        pictures = [path for path in files if kind_of_picture(_start(path))]
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({one_line(error.strerror or error)})") from None
    meant = [(meant_by(path.stem), path) for path in pictures]
    named = [(meaning, path) for meaning, path in meant if meaning is not None]
    order = tuple(LAYERS)
    named.sort(key=lambda each: (order.index(each[0].layer), each[0].label, each[1].name))
    unread = [path.name for path in files if path not in pictures and meant_by(path.stem) is not None]
    return named, [path.name for meaning, path in meant if meaning is None], unread


def _start(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(16)


def _unnamed(place: str, what: str, names: Iterable[str]) -> InputError:
    found = _listed(names)
    return InputError(
        f"{place}: no {what} of it is called {', '.join(LAYERS)} (river 2 is label 2 of river)"
        + (f": there is {found}" if found else "")
    )


def _empty(count: int, how: str) -> str:
    if count:
        return f": {how}" if how else ""
    return f": {how or 'nothing of it is left'}, so it is empty"


def _listed(names: Iterable[str]) -> str:
    given = list(names)
    return ", ".join(format_value(name) for name in given[:10]) + (
        f" and {len(given) - 10} more" if len(given) > 10 else ""
    )


def painted_mask(picture: Picture) -> tuple[npt.NDArray[np.bool_], str]:
    """Return where a layer is painted, (height, width), and in words how that was told.

    A layer that is transparent somewhere is painted where it is more than half opaque. Any other has a paper:
    the colour that most of its border has. White strokes on black are paint, and so are black ones on white.
    """
    rgba = picture.rgba
    if picture.see_through:
        return rgba[..., 3] >= 128, "what is opaque is painted"
    paper = _paper(rgba)
    origin = to_oklab(np.array(paper) / 255.0)
    far = np.empty(rgba.shape[:2], dtype=np.float32)
    for top in range(0, len(rgba), _ROWS):
        colours = to_oklab(rgba[top : top + _ROWS, :, :3] / 255.0)
        far[top : top + _ROWS] = np.sqrt(((colours - origin) ** 2).sum(axis=-1))
    farthest = float(far.max())
    code = "#{:02x}{:02x}{:02x}".format(*paper)
    if farthest < _SAME:
        return np.zeros(far.shape, dtype=bool), f"it is all {code}, so nothing is painted"
    return far > min(_OTHER, 0.5 * farthest), f"its border is {code}, so what is not is painted"


def _paper(rgba: npt.NDArray[np.uint8]) -> tuple[int, int, int]:
    """Return the colour that most of the border has."""
    border = np.concatenate([rgba[0], rgba[-1], rgba[:, 0], rgba[:, -1]])[:, :3]
    coarse = (border >> 4).astype(np.int32)
    cells = (coarse[:, 0] << 8) | (coarse[:, 1] << 4) | coarse[:, 2]
    most = np.bincount(cells).argmax()
    red, green, blue = (int(value) for value in np.rint(border[cells == most].mean(axis=0)))
    return red, green, blue


def _stack(data: bytes, place: str) -> tuple[tuple[int, int], list[_StackLayer]]:
    """Return the size (width, height) of an OpenRaster picture and its layers, the topmost first."""
    if b"<!DOCTYPE" in data:  # could define entities
        raise InputError(f"{place}: it has a DOCTYPE: expected none")
    try:
        image = ET.fromstring(data)  # noqa: S314 # no entities
    except (ET.ParseError, ValueError) as error:
        raise InputError(f"{place}: expected XML ({one_line(error)})") from None
    if image.tag != "image":
        raise InputError(f"{place}: expected <image>, got <{one_line(image.tag)}>")
    width, height = (round(_number(image, key, 0.0, place)) for key in ("w", "h"))
    check_size((width, height), place)
    layers: list[_StackLayer] = []
    waiting: list[tuple[ET.Element, bool, Meaning | None, int]] = [(image, False, None, 0)]
    while waiting:
        element, is_hidden, meaning, depth = waiting.pop()
        if depth > _DEEPEST:
            raise InputError(f"{place}: groups are nested too deeply")
        if element is not image:
            is_hidden |= element.get("visibility") == "hidden"
            is_hidden |= not _number(element, "opacity", 1.0, place) > 0.0
            meaning = meant_by(element.get("name", "")) or meaning
        if element.tag == "layer":
            x, y = (round(_number(element, key, 0.0, place)) for key in ("x", "y"))
            layers.append(
                _StackLayer(element.get("name", ""), meaning, is_hidden, x, y, element.get("src", ""))
            )
        waiting.extend((child, is_hidden, meaning, depth + 1) for child in reversed(element))
    return (width, height), layers


def _number(element: ET.Element, key: str, default: float, place: str) -> float:
    text = element.get(key)
    try:
        value = default if text is None else float(text)
    except ValueError:
        value = float("nan")
    if not -_FARTHEST <= value <= _FARTHEST:
        raise InputError(f"{place}: {key}={format_value(text)}: expected a number of pixels or a share")
    return value
