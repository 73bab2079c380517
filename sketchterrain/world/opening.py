"""Written worlds read back in windows, from Zarr by zarr-python or from GeoTIFF by rasterio."""

from __future__ import annotations

import tempfile
import threading
import zlib
from abc import ABC, abstractmethod
from base64 import b64decode
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.errors import RasterioError
from rasterio.windows import Window

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch import Sketch, load_sketch
from sketchterrain.world.grid import CHUNK, SHARD, Level, Shard, World
from sketchterrain.world.ground import LAYER_SPECS
from sketchterrain.world.libraries import require
from sketchterrain.world.store import SKETCH, TAGS, layer_file, tile_name, vrt_name
from sketchterrain.world.zarr_store import BYTES, FORMAT, METADATA, OURS, ZARR_LIBRARIES, shard_file
from sketchterrain.world.zarr_store import SKETCH as ZARR_SKETCH

_CHUNKS: Final = 384  # kept decompressed: 192 MiB of the largest ones
_FILES: Final = 16  # GeoTIFFs that a thread keeps open
_REMEDY: Final = "writing the world again with --resume mends it"


class StoredWorld(ABC):
    """Layers of a pyramid that are read in windows, by any number of threads; the last chunks are kept.

    `west` and `north` (m from the sketch's south-west corner) are of column 0 and row 0; `levels` begin with
    the finest; `layers` are some of ``height``, ``normal``, ``materials``, heights always.
    """

    def __init__(self, world: World, layers: tuple[str, ...], material_names: tuple[str, ...]) -> None:
        if "height" not in layers or not set(layers) <= set(LAYER_SPECS):
            raise ValueError(f"layers {','.join(layers)}")
        self.west, self.north, self.levels = world.west, world.north, world.levels
        self.layers, self.material_names = layers, material_names
        self._chunk = lru_cache(_CHUNKS)(self._load)

    @abstractmethod
    def sketch(self) -> Sketch | None:
        """Return the sketch that the world was made from, None if it holds none; InputError if broken."""

    @abstractmethod
    def _load(self, layer: str, level: int, row: int, column: int) -> npt.NDArray[Any]:
        """Read a chunk by its row and column in the level's grid of chunks: (bands or nothing, …, …)."""

    def read(
        self, layer: str, level: int, *, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        """Return a window of a layer, inside a level.

        Returns
        -------
        ndarray
            Heights: (rows, columns) float32, m. Normals: (3, rows, columns) uint8, east, north, up, 0 is −1,
            255 is 1. Materials: (materials, rows, columns) uint8, summing to 255.

        Raises
        ------
        InputError
            If some of it is missing or broken: its file is named.
        """
        if layer not in self.layers:
            raise InputError(f"expected a layer among {', '.join(self.layers)}, got {one_line(layer)!r}")
        if not 0 <= level < len(self.levels):
            raise InputError(f"expected a level from 0 to {len(self.levels) - 1}, got {level}")
        grid, bottom, right = self.levels[level], top + rows, left + columns
        if min(top, left) < 0 or bottom > grid.rows or right > grid.columns or min(rows, columns) < 1:
            raise InputError(
                f"expected a window inside {grid.rows} rows and {grid.columns} columns, got rows {top} to "
                f"{bottom} and columns {left} to {right}"
            )
        bands = {"height": (), "normal": (3,), "materials": (len(self.material_names),)}[layer]
        window = np.empty((*bands, rows, columns), LAYER_SPECS[layer].dtype)
        chunk_rows = range(top // CHUNK, (bottom - 1) // CHUNK + 1)
        chunk_columns = range(left // CHUNK, (right - 1) // CHUNK + 1)
        for row, column in product(chunk_rows, chunk_columns):
            down, across = row * CHUNK, column * CHUNK  # of the chunk's first vertex
            first, last = max(top, down), min(bottom, down + CHUNK)
            begin, end = max(left, across), min(right, across + CHUNK)
            part = self._chunk(layer, level, row, column)
            part = part[..., first - down : last - down, begin - across : end - across]
            window[..., first - top : last - top, begin - left : end - left] = part
        return window


class _ZarrWorld(StoredWorld):
    """A Zarr store; each chunk carries a checksum, so that no broken one is taken for ground."""

    def __init__(self, folder: Path) -> None:
        require("A world in a Zarr store", ZARR_LIBRARIES)
        self.folder = folder
        try:
            import zarr

            group = zarr.open_group(folder, mode="r")
            facts: Any = group.attrs.get(OURS)
        except (OSError, ValueError, TypeError, LookupError, AttributeError) as error:
            raise _broken(folder / METADATA, error) from None
        if not isinstance(facts, dict):
            raise InputError(f"{one_line(folder)}: a Zarr store, but no world of {OURS}'s")
        if facts.get("format") != FORMAT:
            found, path = one_line(facts.get("format")), one_line(folder / METADATA)
            raise InputError(f"{path}: expected a world of format {FORMAT}, got {found}")
        try:
            world, layers = World(**facts["world"]), tuple(map(str, facts["layers"]))
            super().__init__(world, layers, tuple(map(str, facts["materials"])))
        except (KeyError, TypeError, ValueError, InputError) as error:
            raise _broken(folder / METADATA, error) from None
        self._arrays = {
            (layer, level.number): self._array(group, layer, level)
            for level, layer in product(self.levels, self.layers)
        }

    def _array(self, group: Any, layer: str, level: Level) -> Any:
        """Return an array, which must have the shape and the chunks that the root promises."""
        name, bands = f"{level.number}/{layer}", len(self.material_names) if layer == "materials" else 3
        first = () if layer == "height" else (bands,)
        expected = ((*first, level.rows, level.columns), (*first, SHARD, SHARD), LAYER_SPECS[layer].dtype)
        try:
            array = group[name]
            found = (array.shape, array.shards, str(array.dtype))
        except (OSError, ValueError, TypeError, LookupError, AttributeError) as error:
            raise _broken(self.folder / name / METADATA, error) from None
        if found != expected:
            reason = f"expected shape, shards and type {expected}, got {found}"
            raise _broken(self.folder / name / METADATA, reason)
        return array

    def sketch(self) -> Sketch:
        """Return the sketch that it was made from; see `StoredWorld.sketch`."""
        path = self.folder / ZARR_SKETCH / BYTES
        if not path.is_file():
            raise _broken(path)
        return load_sketch(path)

    def _load(self, layer: str, level: int, row: int, column: int) -> npt.NDArray[Any]:
        side = SHARD // CHUNK
        path = self.folder / shard_file(layer, Shard(level, row // side, column // side))
        if not path.is_file():  # zarr-python would return the fill value
            raise _broken(path)
        rows = slice(row * CHUNK, (row + 1) * CHUNK)
        columns = slice(column * CHUNK, (column + 1) * CHUNK)
        try:
            return np.asarray(self._arrays[layer, level][..., rows, columns])
        except (OSError, ValueError, RuntimeError) as error:
            raise _broken(path, error) from None


class _OpenFiles(threading.local):
    """GDAL's open files, which are for one thread each."""

    def __init__(self) -> None:
        self.open = lru_cache(_FILES)(self._open)

    @staticmethod
    def _open(path: Path, overview: int, _modified: int) -> Any:
        level = {} if overview == 0 else {"overview_level": overview - 1}
        with rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR"):
            return rasterio.open(path, **level)


class _TiffWorld(StoredWorld):
    """A folder of GeoTIFF tiles, or one GeoTIFF a layer."""

    def __init__(self, path: Path) -> None:
        self._path, self._tiled = path, path.is_dir()
        heights = path / vrt_name("height", 0) if self._tiled else path
        try:
            with rasterio.open(heights) as file:
                self._facts: dict[str, str] = file.tags(ns=TAGS)
        except (RasterioError, OSError) as error:
            raise _broken(heights, error) from None
        if not self._facts:
            raise InputError(f"{one_line(heights)}: expected the heights of a world, it tells of none")
        try:
            world = World(*(float(self._facts[name]) for name in ("west", "south", "east", "north", "cell")))
            super().__init__(
                world, *(tuple(self._facts[name].split(",")) for name in ("layers", "materials"))
            )
        except (KeyError, ValueError, InputError) as error:
            raise _broken(heights, error) from None
        self._files = _OpenFiles()

    def sketch(self) -> Sketch | None:
        """Return the sketch beside the tiles or in the tags; see `StoredWorld.sketch`."""
        if self._tiled:
            path = self._path / SKETCH
            return load_sketch(path) if path.exists() else None
        if (packed := self._facts.get("sketch")) is None:
            return None
        with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
            path = Path(folder) / SKETCH
            try:
                path.write_bytes(b64decode(packed, validate=True))
                return load_sketch(path)
            except (ValueError, InputError) as error:
                raise _broken(self._path, f"its sketch: {one_line(error)}") from None

    def _load(self, layer: str, level: int, row: int, column: int) -> npt.NDArray[Any]:
        grid, side, overview = self.levels[level], SHARD // CHUNK, level
        path, shape = layer_file(self._path, layer), (grid.rows, grid.columns)
        if self._tiled:
            shard, overview = Shard(level, row // side, column // side), 0
            path, shape = self._path / tile_name(layer, shard), grid.size_of(shard)
            row, column = row % side, column % side
        expected = (len(LAYER_SPECS[layer].bands), *shape)
        try:
            file = self._files.open(path, overview, path.stat().st_mtime_ns)
            if (file.count, *file.shape) != expected:
                raise ValueError(f"expected {expected} bands, rows, columns, got {file.count, *file.shape}")
            top, left = row * CHUNK, column * CHUNK
            size = min(CHUNK, shape[1] - left), min(CHUNK, shape[0] - top)
            with path.open("rb") as stream:  # the checksum of a block, which GDAL does not look at
                stream.seek(int(file.get_tag_item(f"BLOCK_OFFSET_{column}_{row}", "TIFF", bidx=1)))
                zlib.decompress(
                    stream.read(int(file.get_tag_item(f"BLOCK_SIZE_{column}_{row}", "TIFF", bidx=1)))
                )
            values: npt.NDArray[Any] = file.read(window=Window(left, top, *size))
        except (RasterioError, OSError, ValueError, TypeError, zlib.error) as error:
            raise _broken(path, error.__cause__ or error) from None
        return values[0] if layer == "height" else values


def open_world(path: str | Path) -> StoredWorld:
    """Open a world.

    Parameters
    ----------
    path
        A Zarr store, a folder of GeoTIFF tiles, or the GeoTIFF of the heights.

    Raises
    ------
    InputError
        If there is no world, or its description is broken.
    SketchterrainError
        If a library that reads it is missing.
    """
    place = Path(path)
    try:
        if not place.exists():
            raise InputError(f"{one_line(path)}: no such file or folder, expected a world")
        if (place / METADATA).is_file():
            return _ZarrWorld(place)
        if place.is_dir() and not (place / vrt_name("height", 0)).exists():
            if (place / SKETCH).exists():
                raise InputError(f"{one_line(path)}: is not finished; world --resume goes on with it")
            vrt = vrt_name("height", 0)
            raise InputError(f"{one_line(path)}: no world: it holds neither {METADATA} nor {vrt}")
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    return _TiffWorld(place)


def _broken(path: Path, reason: object = None) -> InputError:
    if not path.exists():
        return InputError(
            f"{one_line(path)}: is missing: the world is not finished, or a file of it is lost; {_REMEDY}"
        )
    return InputError(f"{one_line(path)}: broken ({one_line(reason)}); {_REMEDY}")
