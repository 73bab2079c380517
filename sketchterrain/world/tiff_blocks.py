"""A grid's vertices as blocks of a TIFF: packed by GDAL in memory, or found in a file."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.world.grid import CHUNK
from sketchterrain.world.tiff_directory import TILE_BYTES, TILE_OFFSETS, numbers, read_directories

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy.typing as npt

    from sketchterrain.world.tiff_directory import Tag
    from sketchterrain.world.tiff_layers import TiffLayer

__all__ = ["Sheet", "block_grid", "block_places", "means", "packed", "unpacked"]


_OF_INTEGERS, _OF_FLOATS = 2, 3  # predictors, by TIFF's numbers


@dataclass(frozen=True, eq=False)
class Sheet:
    """One image of a TIFF as blocks.

    Attributes
    ----------
    rows, columns : int
        Vertices.
    sizes : (block rows, block columns) int64
        Bytes of each block.
    blocks : callable
        Returns the blocks, row after row.
    """

    rows: int
    columns: int
    sizes: npt.NDArray[np.int64]
    blocks: Callable[[], Iterator[bytes | memoryview]]


def block_grid(rows: int, columns: int) -> tuple[int, int]:
    """Return how many rows and columns of blocks a grid takes."""
    return -(-rows // CHUNK), -(-columns // CHUNK)


def block_places(tags: dict[int, Tag], shape: tuple[int, int]) -> npt.NDArray[np.int64]:
    """Return where a file's blocks lie.

    Parameters
    ----------
    tags
        Of its first directory.
    shape
        Rows and columns of blocks.

    Returns
    -------
    ndarray, (block rows, block columns, 2)
        The first byte, and how many there are.

    Raises
    ------
    ValueError
        If there are more or fewer blocks.
    """
    try:
        place, size = numbers(tags[TILE_OFFSETS]), numbers(tags[TILE_BYTES])
        return np.stack([place, size], axis=-1).reshape(*shape, 2)
    except (KeyError, ValueError):
        raise ValueError(f"expected {shape[0]} × {shape[1]} blocks") from None


def packed(layer: TiffLayer, values: npt.NDArray[Any]) -> Sheet:
    """Return a grid's values as blocks; the same values give the same bytes.

    Parameters
    ----------
    layer
    values
        (bands, rows, columns) of the layer's type.
    """
    from rasterio import Affine, Env
    from rasterio.io import MemoryFile

    rows, columns = values.shape[1:]
    with Env(), MemoryFile() as memory:
        # rasterio warns of files that lie nowhere; where this one does is not kept.
        with memory.open(**layer.profile(rows, columns), transform=Affine.scale(2.0, -2.0)) as file:
            file.write(values)
        content = bytes(memory.getbuffer())
    places = block_places(read_directories(content)[0], block_grid(rows, columns))
    whole = memoryview(content)

    def blocks() -> Iterator[memoryview]:
        for place, size in places.reshape(-1, 2).tolist():
            yield whole[place : place + size]

    return Sheet(rows, columns, places[..., 1], blocks)


def unpacked(layer: TiffLayer, block: bytes) -> npt.NDArray[Any]:
    """Return a block's values, checked by the checksum that it ends with, which GDAL does not always read.

    Returns
    -------
    ndarray, (bands, CHUNK, CHUNK)
        What lies beyond the grid's edge means nothing.

    Raises
    ------
    ValueError
        If it is broken.
    """
    dtype, bands = np.dtype(layer.dtype), len(layer.bands)
    try:
        raw = zlib.decompress(block)
    except zlib.error as error:
        raise ValueError(f"a block is broken: {error}") from None
    if len(raw) != CHUNK * CHUNK * bands * dtype.itemsize:
        raise ValueError(f"a block of {len(raw)} bytes")
    stored = np.frombuffer(raw, np.uint8)
    if layer.predictor == _OF_FLOATS:
        # Differences of bytes along a row: first the highest byte of each number, then the next ones.
        rows = np.cumsum(stored.reshape(CHUNK, -1), axis=1, dtype=np.uint8)
        numbers = rows.reshape(CHUNK, dtype.itemsize, -1).swapaxes(1, 2)[..., ::-1]
        values = np.ascontiguousarray(numbers).view(dtype.newbyteorder("<")).astype(dtype, copy=False)
    else:
        values = stored.reshape(CHUNK, CHUNK, bands)
        if layer.predictor == _OF_INTEGERS:
            values = np.cumsum(values, axis=1, dtype=np.uint8)
    return np.ascontiguousarray(values.reshape(CHUNK, CHUNK, bands).transpose(2, 0, 1))


def means(layer: TiffLayer, values: npt.NDArray[Any], factor: int) -> npt.NDArray[Any]:
    """Return the mean of each square of vertices; at the south and east edges, of those that are there.

    Weights of materials still sum to 255: where their sums along the bands are rounded, no weight is a whole
    one off, and none that is 0 everywhere becomes more.

    Parameters
    ----------
    layer
    values
        (bands, rows, columns) of its type.
    factor
        Vertices along a square's side.
    """
    wide = np.float64 if values.dtype.kind == "f" else np.uint32
    sums = _summed(_summed(values, factor, 1, wide), factor, 2, wide)
    counts = [_summed(np.ones(length), factor, 0, np.float64) for length in values.shape[1:]]
    mean = sums / np.outer(*counts)
    if layer.shares:
        mean = np.diff(np.rint(np.cumsum(mean, axis=0)), axis=0, prepend=0.0)
    return np.asarray(mean if values.dtype.kind == "f" else np.rint(mean), values.dtype)


def _summed(values: npt.NDArray[Any], factor: int, axis: int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return the sums of each so many values along an axis; the last one of those that are there."""
    shape = list(values.shape)
    shape[axis] = -(-shape[axis] // factor)
    sums = np.zeros(shape, dtype)
    to = np.moveaxis(sums, axis, 0)
    given = np.moveaxis(values, axis, 0)
    for first in range(min(factor, len(given))):
        part = given[first::factor]
        to[: len(part)] += part
    return sums
