"""Layers of a paint program as a sketch: OpenRaster files, folders of pictures, one picture for one layer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch import LAYERS
from sketchterrain.sketch.wording import shown
from sketchterrain.trace.layer_names import meant_by
from sketchterrain.trace.legend import Meaning
from sketchterrain.trace.majority import majority
from sketchterrain.trace.masks import painted
from sketchterrain.trace.open_raster import read_open_raster
from sketchterrain.trace.picture import kind_of_picture, picture_from, read_picture
from sketchterrain.trace.traced import Traced

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from sketchterrain.trace.sheet import Sheet

__all__ = ["trace_folder", "trace_mask", "trace_open_raster"]

Mask = npt.NDArray[np.bool_]

_SETTINGS = "sketch.toml"
_MOST_FILES = 1000
_LIKE: Final = 0.01  # by which the shapes of a folder's pictures may differ


@dataclass(frozen=True, eq=False)
class _Sheets:
    """Label images that are being put together: what is on top is added first."""

    size: tuple[int, int]
    layers: dict[str, npt.NDArray[np.uint8]]

    @classmethod
    def empty(cls, size: tuple[int, int]) -> _Sheets:
        shape = (size[1], size[0])
        return cls(size, {name: np.zeros(shape, dtype=np.uint8) for name in LAYERS})

    def add(self, meaning: Meaning, mask: Mask) -> int:
        """Paint where nothing is yet; return how many pixels that were."""
        thin = (1,) if meaning.layer == "river" else ()
        scaled = majority(mask.astype(np.uint8), self.size, thin=thin) > 0
        image = self.layers[meaning.layer]
        free = scaled & (image == 0)
        image[free] = meaning.label
        return int(np.count_nonzero(free))


def trace_mask(path: Path, layer: str, sheet: Sheet) -> Traced:
    """Return a sketch with one layer, painted where a picture is.

    Parameters
    ----------
    path
    layer
        Its name, with a label if wanted: ``mountain``, ``river.2``.
    sheet

    Raises
    ------
    InputError
        If there is no such layer, it is no picture, or nothing is painted on it.
    """
    meaning = meant_by(layer)
    if meaning is None:
        raise InputError(
            f"layer {shown(layer)}: expected {', '.join(LAYERS)}, or one with a label, as river.2"
        )
    mask, how = painted(read_picture(path))
    if not mask.any():
        raise InputError(f"{one_line(path)}: {how}: expected a picture with something on its paper")
    sheets = _Sheets.empty(sheet.size(mask.shape[1], mask.shape[0]))
    sheets.add(meaning, mask)
    sketch, told = sheet.sketch(sheets.layers, path.stem)
    return Traced(sketch, (f"{path.name} is {meaning}: {how}", *told))


def trace_open_raster(path: Path, sheet: Sheet) -> Traced:
    """Return the sketch that lies in the layers of an OpenRaster file.

    Raises
    ------
    InputError
        If it is none, is unsafe, or no visible layer is called as a sketch's.
    """
    place, read = one_line(path), read_open_raster(path)
    if not read.layers:
        raise _unnamed(place, "layer", (*read.others, *read.hidden))
    sheets, notes = _Sheets.empty(sheet.size(read.width, read.height)), []
    for layer in read.layers:
        picture = picture_from(layer.png, f"{place}: layer {shown(layer.name)}")
        height, width = picture.rgba.shape[:2]
        covers = layer.x <= 0 and layer.y <= 0
        covers = covers and layer.x + width >= read.width and layer.y + height >= read.height
        mask, how = painted(picture)
        # A layer is cut to what is on it: one that does not cover the picture has no paper, nor has one that
        # is filled with a colour.
        if not picture.see_through and not (covers and mask.any()):
            mask, how = np.ones((height, width), dtype=bool), ""
        count = sheets.add(layer.meaning, _placed(mask, layer.x, layer.y, (read.height, read.width)))
        notes.append(f"layer {shown(layer.name)} is {layer.meaning}{_empty(count, how)}")
    notes += [f"hidden, left out: {_listed(read.hidden)}"] if read.hidden else []
    notes += [f"no layer of a sketch, left out: {_listed(read.others)}"] if read.others else []
    sketch, told = sheet.sketch(sheets.layers, path.stem)
    return Traced(sketch, (*notes, *told))


def trace_folder(folder: Path, sheet: Sheet) -> Traced:
    """Return the sketch that lies in a folder's pictures, each called as a layer.

    They may have any size, but one shape: ``river.png``, ``forest 2.png``.

    Raises
    ------
    InputError
        If there are none, one of them cannot be read, or their shapes differ.
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
            sheets, first = _Sheets.empty(sheet.size(width, height)), (width, height, path.name)
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
        mask, how = painted(picture)
        notes.append(f"{path.name} is {meaning}{_empty(sheets.add(meaning, mask), how)}")
    if sheets is None:
        raise RuntimeError("expected a picture")
    notes += [f"no layer of a sketch, left out: {_listed(others)}"] if others else []
    notes += [f"no picture, left out: {_listed(unread)}"] if unread else []
    sketch, told = sheet.sketch(sheets.layers, folder.resolve().name)
    return Traced(sketch, (*notes, *told))


def _named_files(folder: Path) -> tuple[list[tuple[Meaning, Path]], list[str], list[str]]:
    """Return the pictures in a folder that are called as layers, the lowest label first, and names of others.

    These are of other pictures, and of what is called as a layer but is none.
    """
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


def _placed(mask: Mask, x: int, y: int, shape: tuple[int, int]) -> Mask:
    """Return a mask where it lies on a picture of a shape (height, width)."""
    whole = np.zeros(shape, dtype=bool)
    top, left = max(0, y), max(0, x)
    bottom, right = min(shape[0], y + mask.shape[0]), min(shape[1], x + mask.shape[1])
    if bottom > top and right > left:
        whole[top:bottom, left:right] = mask[top - y : bottom - y, left - x : right - x]
    return whole


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
    return ", ".join(shown(name) for name in given[:10]) + (
        f" and {len(given) - 10} more" if len(given) > 10 else ""
    )
