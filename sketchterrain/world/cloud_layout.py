"""Cloud-Optimised GeoTIFF from blocks that are packed already: one of them is held at a time.

The order is that of GDAL's driver COG (its documentation: "COG -- Cloud Optimized GeoTIFF generator", section
"File format details"): what is told of the layout, all directories with the finest first, then the blocks of
the coarsest image, row after row, up to those of the finest.
"""

from __future__ import annotations

import struct
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.world.tiff_directory import TILE_BYTES, TILE_OFFSETS, Directory, Tag, longs

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.world.tiff_blocks import Sheet

__all__ = ["cloud_optimised"]

_LAYOUT: Final = (
    b"LAYOUT=IFDS_BEFORE_DATA\nBLOCK_ORDER=ROW_MAJOR\nBLOCK_LEADER=SIZE_AS_UINT4\n"
    b"BLOCK_TRAILER=LAST_4_BYTES_REPEATED\nKNOWN_INCOMPATIBLE_EDITION=NO\n "
)
_TOLD: Final = b"GDAL_STRUCTURAL_METADATA_SIZE=%06d bytes\n" % len(_LAYOUT) + _LAYOUT
_AROUND: Final = 4  # bytes before a block, its size, and after it, its last ones again
_CLASSIC: Final = 1 << 32  # bytes that a TIFF with places of 32 bits has at most

_KIND, _COLUMNS, _ROWS = 254, 256, 257
_OVERVIEW = 1
_OF_PLACE: Final = 33550  # the first tag of GeoTIFF: places and names are told of the finest image alone


def cloud_optimised(sheets: Sequence[Sheet], tags: Mapping[int, Tag]) -> Iterator[bytes | memoryview]:
    """Return a file in pieces; a BigTIFF if it has 4 GiB or more.

    Parameters
    ----------
    sheets
        The finest first, then its overviews.
    tags
        What is said of the finest but its size and blocks: as
        :meth:`~sketchterrain.world.tiff_layers.Georeference.tags` returns them.
    """
    blocks = sum(int(sheet.sizes.sum()) + 2 * _AROUND * sheet.sizes.size for sheet in sheets)
    head = _head(sheets, tags, big=False)
    if len(head) + blocks >= _CLASSIC:
        head = _head(sheets, tags, big=True)
    yield head
    for sheet in reversed(sheets):
        for block in sheet.blocks():
            yield len(block).to_bytes(_AROUND, "little")
            yield block
            yield block[-_AROUND:]


def _head(sheets: Sequence[Sheet], tags: Mapping[int, Tag], *, big: bool) -> bytes:
    """Return all that stands before the blocks."""
    start = (16 if big else 8) + len(_TOLD)
    start += start % 2
    nowhere = [np.zeros(sheet.sizes.shape, np.int64) for sheet in sheets]
    sizes = [directory.size for directory in _directories(sheets, tags, nowhere, big=big)]
    ends = start + np.cumsum([0, *sizes])
    places: list[npt.NDArray[np.int64]] = []
    after = int(ends[-1])
    for sheet in reversed(sheets):
        steps = sheet.sizes.ravel() + 2 * _AROUND
        places.insert(0, after + _AROUND + np.cumsum(steps) - steps)
        after += int(steps.sum())
    first = struct.pack("<4sHHQ", b"II+\0", 8, 0, start)[:16] if big else struct.pack("<4sI", b"II*\0", start)
    following = [*ends[1:-1].tolist(), 0]
    written = [
        directory.encoded(int(begin), after)
        for directory, (begin, _), after in zip(
            _directories(sheets, tags, places, big=big), pairwise(ends), following, strict=True
        )
    ]
    return b"".join([(first + _TOLD).ljust(start, b"\0"), *written])


def _directories(
    sheets: Sequence[Sheet], tags: Mapping[int, Tag], places: Sequence[npt.NDArray[np.int64]], *, big: bool
) -> list[Directory]:
    coarse = {number: tag for number, tag in tags.items() if number < _OF_PLACE}
    made = []
    for index, (sheet, place) in enumerate(zip(sheets, places, strict=True)):
        own = {
            _KIND: longs([_OVERVIEW if index else 0]),
            _COLUMNS: longs([sheet.columns]),
            _ROWS: longs([sheet.rows]),
            TILE_OFFSETS: longs(place.ravel(), wide=big),
            TILE_BYTES: longs(sheet.sizes.ravel()),
        }
        made.append(Directory((coarse if index else dict(tags)) | own, big=big))
    return made
