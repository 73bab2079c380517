"""Shards of Zarr 3 as bytes: chunks packed one by one, and the index by which each is found.

A shard is a file: its chunks, row after row, then their places, as the specification has it (Zarr core
specification 3, "Sharding codec"). A chunk is packed by the codecs ``bytes``, ``blosc`` and ``crc32c``, so
that a broken one is told from a whole one. They are packed here and not by zarr-python, which would read the
shard that it replaces, whole or broken, and whose files can be lost when the power fails.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.world.grid import CHUNK, SHARD

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["INDEX_BYTES", "ZARR_LIBRARIES", "Packing", "chunk_place", "pack_shard"]

_SIDE: Final = SHARD // CHUNK  # chunks along a shard
_EMPTY: Final = (1 << 64) - 1  # the place of a chunk that is not there
_CHECK: Final = 4  # bytes of a checksum
_SHUFFLES: Final = ("noshuffle", "shuffle", "bitshuffle")  # Blosc's numbers for them

ZARR_LIBRARIES: Final = ("numcodecs", "google_crc32c")
"""What chunks are packed and checked by."""
INDEX_BYTES: Final = _SIDE * _SIDE * 16 + _CHECK
"""At the end of a shard: offset and length of each chunk, and a checksum."""


@dataclass(frozen=True)
class Packing:
    """How an array's chunks become bytes.

    Attributes
    ----------
    dtype : str
        NumPy's name of the type; bytes are little-endian.
    shuffle : {'noshuffle', 'shuffle', 'bitshuffle'}
        What Blosc does before it compresses.
    effort : int
        0 … 9, of Blosc with Zstandard.
    block : int
        Bytes that are compressed together; 0: as Blosc likes.
    """

    dtype: Literal["float32", "float64", "uint8"]
    shuffle: Literal["noshuffle", "shuffle", "bitshuffle"]
    effort: int
    block: int = 0

    @cached_property
    def codecs(self) -> list[dict[str, Any]]:
        """As the metadata of an array has them."""
        size = np.dtype(self.dtype).itemsize
        order = {"configuration": {"endian": "little"}} if size > 1 else {}
        blosc = {
            "typesize": size,
            "cname": "zstd",
            "clevel": self.effort,
            "shuffle": self.shuffle,
            "blocksize": self.block,
        }
        return [{"name": "bytes", **order}, {"name": "blosc", "configuration": blosc}, {"name": "crc32c"}]

    def pack(self, values: npt.NDArray[Any]) -> bytes:
        """Return a chunk as bytes, the same for the same values."""
        from numcodecs import blosc

        # Threads of Blosc's own would put blocks into a chunk in the order in which they are done.
        blosc.use_threads = False
        little = np.ascontiguousarray(values, np.dtype(self.dtype).newbyteorder("<"))
        shuffle = _SHUFFLES.index(self.shuffle)
        packed: bytes = blosc.compress(little, b"zstd", self.effort, shuffle, self.block)
        return with_checksum(packed)

    def unpack(self, packed: bytes, shape: tuple[int, ...]) -> npt.NDArray[Any]:
        """Return the values of a chunk.

        Raises
        ------
        InputError
            If the bytes are not those of a chunk of that shape.
        """
        from numcodecs import blosc

        blosc.use_threads = False
        content = without_checksum(packed)
        try:
            raw = blosc.decompress(content)
        except (RuntimeError, ValueError) as error:
            raise InputError(f"a chunk cannot be unpacked ({error})") from None
        values = np.frombuffer(raw, np.dtype(self.dtype).newbyteorder("<"))
        if values.size != np.prod(shape):
            raise InputError(f"a chunk holds {values.size} values, expected {np.prod(shape)}")
        return values.astype(self.dtype, copy=False).reshape(shape)


def pack_shard(values: npt.NDArray[Any], packing: Packing, fill: float) -> list[bytes]:
    """Return the parts of a shard's file, one after the other.

    Parameters
    ----------
    values
        (…, rows, columns), at most `SHARD` each, of the packing's dtype; chunks wholly beyond are left out.
    packing
    fill
        What stands in a chunk beyond the values.
    """
    rows, columns = values.shape[-2:]
    index = np.full((_SIDE, _SIDE, 2), _EMPTY, "<u8")
    parts, offset = [], 0
    for row in range(-(-rows // CHUNK)):
        for column in range(-(-columns // CHUNK)):
            chunk = values[..., row * CHUNK : (row + 1) * CHUNK, column * CHUNK : (column + 1) * CHUNK]
            if chunk.shape[-2:] != (CHUNK, CHUNK):
                part = chunk
                chunk = np.full((*values.shape[:-2], CHUNK, CHUNK), fill, values.dtype)
                chunk[..., : part.shape[-2], : part.shape[-1]] = part
            packed = packing.pack(chunk)
            parts.append(packed)
            index[row, column] = offset, len(packed)
            offset += len(packed)
    return [*parts, with_checksum(index.tobytes())]


def chunk_place(index: bytes, row: int, column: int, *, length: int) -> tuple[int, int]:
    """Return where a chunk lies in a shard's file: its offset and its length in bytes.

    Parameters
    ----------
    index
        The last `INDEX_BYTES` of the file.
    row, column
        Of the chunk, in the shard.
    length
        Of the file.

    Raises
    ------
    InputError
        If the index is broken, or the chunk is not there.
    """
    if len(index) != INDEX_BYTES:
        raise InputError(f"it is cut off after {length} bytes")
    places = np.frombuffer(without_checksum(index), "<u8").reshape(_SIDE, _SIDE, 2)
    offset, size = (int(number) for number in places[row, column])
    if offset == _EMPTY or not _CHECK < size <= length - INDEX_BYTES - offset:
        raise InputError(f"the chunk in row {row}, column {column} is not in it")
    return offset, size


def with_checksum(content: bytes) -> bytes:
    """Return bytes followed by their checksum, as the codec ``crc32c`` has it."""
    import google_crc32c

    checksum: int = google_crc32c.value(content)
    return content + checksum.to_bytes(_CHECK, "little")


def without_checksum(packed: bytes) -> bytes:
    """Return bytes without the checksum that follows them.

    Raises
    ------
    InputError
        If it is not theirs.
    """
    content = packed[:-_CHECK]
    if with_checksum(content) != packed:
        raise InputError("its checksum is wrong")
    return content
