"""Directories of a TIFF as tags with their bytes: read from GDAL's, written anew (TIFF 6.0, BigTIFF)."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping
    from mmap import mmap

    import numpy.typing as npt

__all__ = ["TILE_BYTES", "TILE_OFFSETS", "Directory", "Tag", "longs", "numbers", "read_directory", "shorts"]

TILE_OFFSETS: Final = 324
TILE_BYTES: Final = 325

_BYTES: Final = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 12: 8, 16: 8}  # of a value, by the number of its type
_NUMBERS: Final = {3: "<u2", 4: "<u4", 12: "<f8", 16: "<u8"}
_SHORT, _LONG, _LONG8 = 3, 4, 16


class Tag(NamedTuple):
    """A tag's values: the number of their type, and their little-endian bytes."""

    kind: int
    content: bytes


def shorts(*values: int) -> Tag:
    """Return a tag of 16-bit numbers."""
    return Tag(_SHORT, np.array(values, "<u2").tobytes())


def longs(values: npt.ArrayLike, *, wide: bool = False) -> Tag:
    """Return a tag of numbers of 32 bits, or of 64."""
    return Tag(_LONG8 if wide else _LONG, np.asarray(values).astype("<u8" if wide else "<u4").tobytes())


def numbers(tag: Tag) -> npt.NDArray[np.int64]:
    """Return the whole numbers of a tag."""
    return np.frombuffer(tag.content, _NUMBERS[tag.kind]).astype(np.int64)


def read_directory(content: bytes | memoryview | mmap) -> dict[int, Tag]:
    """Return the tags of the first directory of a little-endian classic TIFF, by their numbers.

    Raises
    ------
    ValueError
        If it is something else, or cut off.
    """
    try:
        mark, place = struct.unpack_from("<4sI", content)
        if mark != b"II*\0":
            raise ValueError("expected a little-endian TIFF")
        (count,) = struct.unpack_from("<H", content, place)
        tags = {}
        for entry in range(place + 2, place + 2 + 12 * count, 12):
            number, kind, length = struct.unpack_from("<HHI", content, entry)
            size = length * _BYTES[kind]
            start = entry + 8 if size <= 4 else struct.unpack_from("<I", content, entry + 8)[0]
            if start + size > len(content):
                raise ValueError("expected a whole TIFF, it is cut off")
            tags[number] = Tag(kind, bytes(content[start : start + size]))
    except (struct.error, KeyError):
        raise ValueError("expected a whole TIFF, it is cut off or broken") from None
    return tags


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
        self._inline, self._entry, self._ends = (8, 20, 16) if big else (4, 12, 6)
        self._big = big

    @property
    def size(self) -> int:
        """Bytes of it and of its values, an even number."""
        far = sum(_even(len(tag.content)) for tag in self._tags.values() if self._is_far(tag))
        return self._ends + self._entry * len(self._tags) + far

    def encoded(self, start: int, following: int) -> bytes:
        """Return its bytes.

        Parameters
        ----------
        start
            Where it stands in the file, an even number.
        following
            Where the next directory stands; 0: there is none.
        """
        count, entry, word = ("<Q", "<HHQ", "<Q") if self._big else ("<H", "<HHI", "<I")
        place = start + self._ends + self._entry * len(self._tags)
        head, far = [struct.pack(count, len(self._tags))], []
        for number, tag in self._tags.items():
            head.append(struct.pack(entry, number, tag.kind, len(tag.content) // _BYTES[tag.kind]))
            if self._is_far(tag):
                head.append(struct.pack(word, place))
                far.append(tag.content.ljust(_even(len(tag.content)), b"\0"))
                place += len(far[-1])
            else:
                head.append(tag.content.ljust(self._inline, b"\0"))
        return b"".join([*head, struct.pack(word, following), *far])

    def _is_far(self, tag: Tag) -> bool:
        return len(tag.content) > self._inline


def _even(size: int) -> int:
    return size + size % 2
