"""Directories of a TIFF as tags with their bytes: read from GDAL's, written anew (TIFF 6.0, BigTIFF)."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping
    from mmap import mmap

    import numpy.typing as npt

__all__ = ["TILE_BYTES", "TILE_OFFSETS", "Directory", "Tag", "longs", "numbers", "read_directories"]

TILE_OFFSETS: Final = 324
TILE_BYTES: Final = 325

_BYTES: Final = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 12: 8, 16: 8}  # of a value, by the number of its type
_NUMBERS: Final = {3: "<u2", 4: "<u4", 12: "<f8", 16: "<u8"}
_LONG, _LONG8 = 4, 16
_MOST: Final = 64  # directories: as many as a world has levels


class Tag(NamedTuple):
    """A tag's values: the number of their type, and their little-endian bytes."""

    kind: int
    content: bytes


class _Form(NamedTuple):
    """How numbers are written in one kind of TIFF: `struct`'s formats, and where the first place stands."""

    entries: str
    entry: str
    word: str
    first: int


_CLASSIC: Final = _Form("<H", "<HHI", "<I", 4)
_BIG: Final = _Form("<Q", "<HHQ", "<Q", 8)


def longs(values: npt.ArrayLike, *, wide: bool = False) -> Tag:
    """Return a tag of numbers of 32 bits, or of 64."""
    return Tag(_LONG8 if wide else _LONG, np.asarray(values).astype("<u8" if wide else "<u4").tobytes())


def numbers(tag: Tag) -> npt.NDArray[np.int64]:
    """Return the whole numbers of a tag."""
    return np.frombuffer(tag.content, _NUMBERS[tag.kind]).astype(np.int64)


def read_directories(content: bytes | memoryview | mmap) -> list[dict[int, Tag]]:
    """Return the tags of each directory of a little-endian TIFF or BigTIFF, by their numbers.

    Raises
    ------
    ValueError
        If it is something else, or cut off.
    """
    mark = bytes(content[:4])
    if mark not in (b"II*\0", b"II+\0"):
        raise ValueError("expected a little-endian TIFF")
    form = _BIG if mark == b"II+\0" else _CLASSIC
    found: list[dict[int, Tag]] = []
    try:
        (place,) = struct.unpack_from(form.word, content, form.first)
        while place and len(found) < _MOST:
            tags, place = _read_directory(content, place, form)
            found.append(tags)
    except (struct.error, KeyError):
        raise ValueError("expected a whole TIFF, it is cut off or broken") from None
    if not found:
        raise ValueError("expected a TIFF with an image")
    return found


def _read_directory(
    content: bytes | memoryview | mmap, place: int, form: _Form
) -> tuple[dict[int, Tag], int]:
    """Return a directory's tags, and where the next one stands."""
    inline = struct.calcsize(form.word)
    (count,) = struct.unpack_from(form.entries, content, place)
    first, step = place + struct.calcsize(form.entries), struct.calcsize(form.entry) + inline
    tags = {}
    for entry in range(first, first + step * count, step):
        number, kind, length = struct.unpack_from(form.entry, content, entry)
        size = length * _BYTES[kind]
        start = entry + step - inline
        if size > inline:
            (start,) = struct.unpack_from(form.word, content, start)
        if start + size > len(content):
            raise ValueError("expected a whole TIFF, it is cut off")
        tags[number] = Tag(kind, bytes(content[start : start + size]))
    return tags, struct.unpack_from(form.word, content, first + step * count)[0]


class Directory:
    """A directory that will stand somewhere in a file.

    Parameters
    ----------
    tags
        By their numbers.
    big
        Whether the file is a BigTIFF.
    """

    def __init__(self, tags: Mapping[int, Tag], *, big: bool) -> None:
        self._tags = dict(sorted(tags.items()))
        self._form = _BIG if big else _CLASSIC
        self._inline = struct.calcsize(self._form.word)

    @property
    def size(self) -> int:
        """Bytes of it and of its values, an even number."""
        far = (tag.content for tag in self._tags.values() if len(tag.content) > self._inline)
        return self._own_size + sum(_even(len(content)) for content in far)

    def encoded(self, start: int, following: int) -> bytes:
        """Return its bytes.

        Parameters
        ----------
        start
            Where it stands in the file, an even number.
        following
            Where the next directory stands; 0: there is none.
        """
        form, place = self._form, start + self._own_size
        head, far = [struct.pack(form.entries, len(self._tags))], []
        for number, tag in self._tags.items():
            size = len(tag.content)
            head.append(struct.pack(form.entry, number, tag.kind, size // _BYTES[tag.kind]))
            if size > self._inline:
                head.append(struct.pack(form.word, place))
                far.append(tag.content.ljust(_even(size), b"\0"))
                place += _even(size)
            else:
                head.append(tag.content.ljust(self._inline, b"\0"))
        return b"".join([*head, struct.pack(form.word, following), *far])

    @property
    def _own_size(self) -> int:
        """Bytes of the directory without values that stand elsewhere."""
        entry = struct.calcsize(self._form.entry) + self._inline
        return struct.calcsize(self._form.entries) + entry * len(self._tags) + self._inline


def _even(size: int) -> int:
    return size + size % 2
