"""OpenRaster files (``.ora``), as Krita, GIMP and MyPaint save them: their layers that mean something.

After the Layer Stack Specification and the File Layout Specification at openraster.org; like GIMP's reader
(plug-ins/python/file-openraster.py), a group has no offset of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch.safe_zip import open_zip
from sketchterrain.sketch.wording import shown
from sketchterrain.trace.layer_names import meant_by
from sketchterrain.trace.picture import LARGEST_PIXELS, LARGEST_SIDE

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.trace.legend import Meaning

__all__ = ["OpenRaster", "StackLayer", "read_open_raster"]

_LARGEST = 1 << 30  # bytes of the file, unpacked or not
_LARGEST_PNG = 256 << 20
_LARGEST_STACK = 4 << 20
_DEEPEST = 100
_MOST_LAYERS = 256
_FARTHEST = 1 << 24  # px of an offset


@dataclass(frozen=True)
class StackLayer:
    """One layer of the stack.

    Attributes
    ----------
    name : str
    meaning : Meaning
        By its own name, or by that of the innermost group that has one.
    x, y : int
        Of its north-west corner in the picture, px.
    png : bytes
    """

    name: str
    meaning: Meaning
    x: int
    y: int
    png: bytes


@dataclass(frozen=True)
class OpenRaster:
    """What of a file means a layer of a sketch.

    Attributes
    ----------
    width, height : int
        Of the picture, px.
    layers : tuple of StackLayer
        The topmost first.
    hidden, others : tuple of str
        Names of layers that are hidden, and of those whose names mean nothing.
    """

    width: int
    height: int
    layers: tuple[StackLayer, ...]
    hidden: tuple[str, ...]
    others: tuple[str, ...]


@dataclass
class _Group:
    """A group that is being read: what its layers inherit."""

    tag: str
    is_hidden: bool
    meaning: Meaning | None


@dataclass
class _Stack:
    """What `stack.xml` says, element by element."""

    place: str
    size: tuple[int, int] | None = None
    layers: list[tuple[str, Meaning, int, int, str]] = field(default_factory=list)
    hidden: list[str] = field(default_factory=list)
    others: list[str] = field(default_factory=list)
    _open: list[_Group] = field(default_factory=list)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Take the beginning of an element."""
        if len(self._open) >= _DEEPEST:
            raise InputError(f"{self.place}: groups are nested too deeply")
        if not self._open:
            if tag != "image":
                raise InputError(f"{self.place}: expected <image>, got <{one_line(tag)}>")
            self.size = self._size(attributes)
            self._open.append(_Group(tag, False, None))
            return
        above, name = self._open[-1], attributes.get("name", "")
        opacity = self._number(attributes, "opacity", 1.0)
        is_hidden = above.is_hidden or attributes.get("visibility") == "hidden" or not opacity > 0.0
        meaning = meant_by(name) or above.meaning
        self._open.append(_Group(tag, is_hidden, meaning))
        if tag != "layer":
            return
        if is_hidden:
            self.hidden.append(name)
        elif meaning is None:
            self.others.append(name)
        elif len(self.layers) >= _MOST_LAYERS:
            raise InputError(f"{self.place}: expected at most {_MOST_LAYERS} layers that mean something")
        else:
            x, y = (round(self._number(attributes, key, 0.0)) for key in ("x", "y"))
            self.layers.append((name, meaning, x, y, attributes.get("src", "")))

    def end(self, _: str) -> None:
        """Take the end of an element."""
        self._open.pop()

    def doctype(self, *_: Any) -> None:
        """Refuse what could define entities."""
        raise InputError(f"{self.place}: it has a DOCTYPE: expected none")

    def _size(self, attributes: dict[str, str]) -> tuple[int, int]:
        width, height = (round(self._number(attributes, key, 0.0)) for key in ("w", "h"))
        if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
            raise InputError(f"{self.place}: {width}×{height} px: expected sides of 1 to {LARGEST_SIDE} px")
        if width * height > LARGEST_PIXELS:
            most = LARGEST_PIXELS // 10**6
            raise InputError(f"{self.place}: {width}×{height} px: expected at most {most} million pixels")
        return width, height

    def _number(self, attributes: dict[str, str], key: str, default: float) -> float:
        text = attributes.get(key)
        try:
            value = default if text is None else float(text)
        except ValueError:
            value = float("nan")
        if not -_FARTHEST <= value <= _FARTHEST:
            raise InputError(f"{self.place}: {key}={shown(text)}: expected a number of pixels or a share")
        return value


def read_open_raster(path: Path) -> OpenRaster:
    """Read the layers of an OpenRaster file whose names mean a layer of a sketch.

    Layers and groups that are hidden, or of no opacity at all, are left out; how faint another is does not
    matter, for people dim what they look through.

    Raises
    ------
    InputError
        If it is not an OpenRaster file, is unsafe, damaged or too large.
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
        stack = _parsed(archive.read("stack.xml", _LARGEST_STACK), f"{place}/stack.xml")
        layers, total = [], 0
        for name, meaning, x, y, source in stack.layers:
            if source not in archive.names or source.endswith("/"):
                raise InputError(f"{place}: layer {shown(name)}: {shown(source)} is not in it")
            png = archive.read(source, min(_LARGEST_PNG, _LARGEST - total))
            total += len(png)
            layers.append(StackLayer(name, meaning, x, y, png))
    if stack.size is None:
        raise InputError(f"{place}/stack.xml: expected <image>")
    return OpenRaster(*stack.size, tuple(layers), tuple(stack.hidden), tuple(stack.others))


def _parsed(data: bytes, place: str) -> _Stack:
    stack, parser = _Stack(place), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = stack.start, stack.end
    parser.StartDoctypeDeclHandler = stack.doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f"{place}: expected XML ({one_line(error)})") from None
    return stack
