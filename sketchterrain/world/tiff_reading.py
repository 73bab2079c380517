"""Worlds of GeoTIFFs, read back."""

from __future__ import annotations

import mmap
import os
import tempfile
from abc import ABC, abstractmethod
from base64 import b64decode
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import rasterio
from rasterio.errors import RasterioError

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch.files import load_sketch
from sketchterrain.world.chunk_cache import ROOM, ChunkCache
from sketchterrain.world.grid import CHUNK, SHARD, Shard, World
from sketchterrain.world.ground import LAYERS
from sketchterrain.world.tiff_blocks import block_grid, block_places, unpacked
from sketchterrain.world.tiff_directory import numbers, read_directories
from sketchterrain.world.tiff_layers import DOMAIN, TIFF_LAYERS
from sketchterrain.world.tile_names import SKETCH, layer_file, tile_name, vrt_name
from sketchterrain.world.windows import check_window, fill_from_chunks

if TYPE_CHECKING:
    from typing import BinaryIO

    import numpy.typing as npt

    from sketchterrain.sketch import Sketch
    from sketchterrain.world.grid import Level
    from sketchterrain.world.tiff_layers import TiffLayer

__all__ = ["StoredTiff", "StoredTiles", "open_tiffs"]

_DEFLATE: Final = 8  # TIFF's number
_QUIET: Final = {"GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR"}  # no looking for files beside each


def open_tiffs(path: Path) -> StoredTiff | StoredTiles:
    """Open a world of GeoTIFFs: a folder of tiles, or the file of the heights.

    Raises
    ------
    InputError
        If it is none, or is not finished.
    """
    if not path.is_dir():
        return StoredTiff(path)
    joined = vrt_name("height", 0)
    if (path / joined).exists():
        return StoredTiles(path)
    if (path / SKETCH).exists():
        raise InputError(f"{one_line(path)}: is not finished; world --resume goes on with it")
    raise InputError(f"{one_line(path)}: no world: it holds neither zarr.json nor {joined}")


class _Blocks:
    """Blocks of files, unpacked and checked, the last ones kept; for any number of threads.

    GDAL's files are for one thread each, and it does not find every block that is broken.
    """

    def __init__(self) -> None:
        self._unpacked = ChunkCache(ROOM)
        self._places = ChunkCache(ROOM // 8)

    def block(self, layer: TiffLayer, image: _Image, row: int, column: int) -> npt.NDArray[Any]:
        """Return a block, (bands, CHUNK, CHUNK); not to be changed.

        Raises
        ------
        InputError
            If the file is missing or broken.
        """
        return self._unpacked.get((image, row, column), lambda: self._read(layer, image, row, column))

    def _read(self, layer: TiffLayer, image: _Image, row: int, column: int) -> npt.NDArray[Any]:
        try:
            with image.path.open("rb") as stream:
                known = os.fstat(stream.fileno())
                # A file that was mended is another one, with other places.
                key = (image, known.st_ino, known.st_mtime_ns)
                places = self._places.get(key, lambda: _places(layer, image, stream))
                place, size = places[row, column].tolist()
                stream.seek(place)
                return unpacked(layer, stream.read(size))
        except OSError as error:
            raise _broken(image.path, error.strerror) from None
        except ValueError as error:
            raise _broken(image.path, error) from None


class _Image(NamedTuple):
    """An image in a file, the finest is 0, and how many vertices it has."""

    path: Path
    number: int
    rows: int
    columns: int


def _places(layer: TiffLayer, image: _Image, stream: BinaryIO) -> npt.NDArray[np.int64]:
    """Return where an image's blocks lie, (block rows, block columns, 2)."""
    with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        found = read_directories(content)
    if image.number >= len(found):
        raise ValueError(f"it has {len(found)} images")
    tags = found[image.number]
    expected = {
        "columns": (256, image.columns),
        "rows": (257, image.rows),
        "compression": (259, _DEFLATE),
        "bands": (277, len(layer.bands)),
        "predictor": (317, layer.predictor),
        "block width": (322, CHUNK),
        "block height": (323, CHUNK),
    }
    for what, (number, value) in expected.items():
        told = numbers(tags[number]).tolist() if number in tags else [1]
        if told != [value]:
            raise ValueError(f"expected {what} {value}, got {told[0]}")
    return block_places(tags, block_grid(image.rows, image.columns))


class _StoredGeotiffs(ABC):
    """What both forms share: see :class:`~sketchterrain.world.stored.StoredWorld`."""

    def __init__(self, heights: Path) -> None:
        self._facts = _facts(heights)
        try:
            numbers = [float(self._facts[name]) for name in ("west", "south", "east", "north", "cell")]
            self._world = World(*numbers)
            self.layers: tuple[str, ...] = tuple(self._facts["layers"].split(","))
            self.material_names: tuple[str, ...] = tuple(self._facts["materials"].split(","))
        except (KeyError, ValueError, InputError) as error:
            raise _broken(heights, error) from None
        if "height" not in self.layers or not set(self.layers) <= set(LAYERS):
            raise _broken(heights, f"layers {','.join(self.layers)}")
        self.levels: tuple[Level, ...] = self._world.levels
        self._blocks = _Blocks()

    @property
    def west(self) -> float:
        """Of column 0, m."""
        return self._world.west

    @property
    def north(self) -> float:
        """Of row 0, m."""
        return self._world.north

    def read(
        self, layer: str, level: int, *, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        """Return a window of a layer; see `StoredWorld.read`."""
        grid = check_window(self, layer, level, top=top, left=left, rows=rows, columns=columns)
        form = TIFF_LAYERS[layer]
        window = np.empty((len(form.bands), rows, columns), form.dtype)
        fill_from_chunks(
            window, lambda *at: self._blocks.block(form, *self._where(layer, grid, *at)), top=top, left=left
        )
        return window[0] if layer == "height" else window

    @abstractmethod
    def sketch(self) -> Sketch | None:
        """Return the sketch that it was made from; see `StoredWorld.sketch`."""

    @abstractmethod
    def _where(self, layer: str, level: Level, row: int, column: int) -> tuple[_Image, int, int]:
        """Return the image that a block of a level is in, and its row and column of blocks there."""


class StoredTiff(_StoredGeotiffs):
    """A world of one GeoTIFF a layer, as :class:`~sketchterrain.world.stored.StoredWorld` says.

    Parameters
    ----------
    path
        Of the heights; the other layers lie beside it.

    Raises
    ------
    InputError
        If it is none, or broken.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._path = path

    def sketch(self) -> Sketch | None:
        """Return the sketch in the file's metadata; see `StoredWorld.sketch`."""
        packed = self._facts.get("sketch")
        if packed is None:
            return None
        with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
            file = Path(folder) / SKETCH
            try:
                file.write_bytes(b64decode(packed, validate=True))
                return load_sketch(file)
            except (ValueError, InputError) as error:
                raise _broken(self._path, f"its sketch: {one_line(error)}") from None

    def _where(self, layer: str, level: Level, row: int, column: int) -> tuple[_Image, int, int]:
        file = layer_file(self._path, layer)
        return _Image(file, level.number, level.rows, level.columns), row, column


class StoredTiles(_StoredGeotiffs):
    """A world of tiles, as :class:`~sketchterrain.world.stored.StoredWorld` says.

    Parameters
    ----------
    folder
        Of the world.

    Raises
    ------
    InputError
        If it is none, or is not finished.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder / vrt_name("height", 0))
        self._folder = folder

    def sketch(self) -> Sketch | None:
        """Return the sketch in the folder; see `StoredWorld.sketch`."""
        path = self._folder / SKETCH
        return load_sketch(path) if path.exists() else None

    def _where(self, layer: str, level: Level, row: int, column: int) -> tuple[_Image, int, int]:
        side = SHARD // CHUNK
        shard = Shard(level.number, row // side, column // side)
        file = self._folder / tile_name(layer, shard)
        return _Image(file, 0, *level.size_of(shard)), row % side, column % side


def _facts(heights: Path) -> dict[str, str]:
    """Return what a file of heights tells of its world."""
    try:
        with rasterio.Env(**_QUIET), rasterio.open(heights) as file:
            facts: dict[str, str] = file.tags(ns=DOMAIN)
    except (RasterioError, OSError) as error:
        raise _broken(heights, error) from None
    if not facts:
        raise InputError(f"{one_line(heights)}: expected the heights of a world, it tells of none")
    return facts


def _broken(path: Path, reason: object) -> InputError:
    if not path.exists():
        return InputError(f"{one_line(path)}: expected a part of a world, it is missing")
    return InputError(f"{one_line(path)}: expected a part of a world, it is broken ({one_line(reason)})")
