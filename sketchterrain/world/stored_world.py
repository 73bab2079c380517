"""Opening a stored world and reading windows of its levels: Zarr stores and GeoTIFFs."""

from __future__ import annotations

import tempfile
import threading
import zlib
from abc import ABC, abstractmethod
from base64 import b64decode
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.errors import RasterioError
from rasterio.windows import Window

from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import DrapedLayer, moved_drapes
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import InputError, one_line
from sketchterrain.io.files import wrap_read_errors
from sketchterrain.world.grid import CHUNK, LAYER_SPECS, SHARD, GridLevel, Shard, World, layer_specs
from sketchterrain.world.job import SKETCH, TAGS, layer_file, require, tile_name, vrt_name
from sketchterrain.world.zarr_store import BYTES, FORMAT, METADATA, OURS, shard_file
from sketchterrain.world.zarr_store import SKETCH as ZARR_SKETCH

_CHUNKS: Final = 384  # cached decompressed: up to 192 MiB
_FILES: Final = 16  # cached open GeoTIFFs per thread
# Exceptions of zarr-python and GDAL for broken files.
_FAILURES: Final = (OSError, ValueError, TypeError, LookupError, AttributeError, RuntimeError, RasterioError)
_REMEDY: Final = "repair the world with --resume"
_Array = npt.NDArray[Any]


class StoredWorld(ABC):
    """Layers of a pyramid, read in windows through a cache of chunks; thread-safe.

    `west` and `north` (m from the sketch's south-west corner) are of column 0 and row 0.
    """

    def __init__(self, world: World, layers: tuple[str, ...], material_names: tuple[str, ...]) -> None:
        if "height" not in layers or not set(layers) <= set(LAYER_SPECS):
            raise ValueError(f"layers {','.join(layers)}")
        self.west, self.north, self.levels = world.west, world.north, world.levels
        self.layers, self.material_names = layers, material_names
        # A world of another version may have other materials.
        self._specs = layer_specs(material_names)
        self._chunks = LRUCache(_CHUNKS)

    @abstractmethod
    def sketch(self) -> Sketch | None:
        """Return the sketch of the world, None if it is not stored; raise InputError if it is broken."""

    @abstractmethod
    def _load(self, layer: str, level: int, row: int, column: int) -> _Array:
        """Read a chunk by its row and column in the level's grid of chunks."""

    def read(self, layer: str, level: int, *, top: int, left: int, rows: int, columns: int) -> _Array:
        """Return a window inside a level, see `ShardData`; raise InputError for a missing or broken file."""
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
        spec = self._specs[layer]
        window = np.empty(spec.shape(rows, columns), spec.dtype)
        chunk_rows = range(top // CHUNK, (bottom - 1) // CHUNK + 1)
        chunk_columns = range(left // CHUNK, (right - 1) // CHUNK + 1)
        for row, column in product(chunk_rows, chunk_columns):
            down, across = row * CHUNK, column * CHUNK  # first vertex of the chunk
            first, last = max(top, down), min(bottom, down + CHUNK)
            begin, end = max(left, across), min(right, across + CHUNK)
            key = (layer, level, row, column)
            chunk = self._chunks.get_or_compute(key, partial(self._load, *key))
            part = chunk[..., first - down : last - down, begin - across : end - across]
            window[..., first - top : last - top, begin - left : end - left] = part
        return window


class _ZarrWorld(StoredWorld):
    """A Zarr store; checksums of chunks detect damage."""

    def __init__(self, folder: Path) -> None:
        require("A world in a Zarr store", ["zarr"])
        self.folder, path = folder, folder / METADATA
        with _reading(path):
            import zarr

            group = zarr.open_group(folder, mode="r")
            facts: Any = group.attrs.get(OURS)
            if not isinstance(facts, dict):
                raise InputError(f"{one_line(folder)}: expected a world of {OURS}, got another Zarr store")
            if (found := facts.get("format")) != FORMAT:
                raise InputError(
                    f"{one_line(path)}: expected a world of format {FORMAT}, got {one_line(found)}"
                )
            world, layers = World(**facts["world"]), tuple(map(str, facts["layers"]))
            super().__init__(world, layers, tuple(map(str, facts["materials"])))
        self._arrays = {
            (name, level.number): self._array(group, name, level)
            for level, name in product(self.levels, self.layers)
        }

    def _array(self, group: Any, layer: str, level: GridLevel) -> Any:
        name, spec = f"{level.number}/{layer}", self._specs[layer]
        expected = (spec.shape(level.rows, level.columns), spec.shape(SHARD, SHARD), spec.dtype)
        with _reading(self.folder / name / METADATA):
            array = group[name]
            if (found := (array.shape, array.shards, str(array.dtype))) != expected:
                raise ValueError(f"expected shape, shards and type {expected}, got {found}")
        return array

    def sketch(self) -> Sketch:
        """Return the stored sketch."""
        path = self.folder / ZARR_SKETCH / BYTES
        if not path.is_file():
            raise _broken(path)
        return load_sketch(path)

    def _load(self, layer: str, level: int, row: int, column: int) -> _Array:
        side = SHARD // CHUNK
        path = self.folder / shard_file(layer, Shard(level, row // side, column // side))
        if not path.is_file():  # zarr-python would return the fill value
            raise _broken(path, "no file")
        top, left = row * CHUNK, column * CHUNK
        with _reading(path):
            return np.asarray(self._arrays[layer, level][..., top : top + CHUNK, left : left + CHUNK])


class _OpenFiles(threading.local):
    """Open GDAL datasets, which are not thread-safe."""

    def __init__(self) -> None:
        self._files = LRUCache(_FILES)

    def open(self, path: Path, overview: int) -> Any:
        """Return the dataset of a file as it is now."""
        level = {} if overview == 0 else {"overview_level": overview - 1}
        with rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR"):
            key = (path, overview, path.stat().st_mtime_ns)
            return self._files.get_or_compute(key, lambda: rasterio.open(path, **level))


class _TiffWorld(StoredWorld):
    """A folder of GeoTIFF tiles, or one GeoTIFF a layer."""

    def __init__(self, path: Path) -> None:
        self._path, self._tiled, self._files = path, path.is_dir(), _OpenFiles()
        heights = path / vrt_name("height", 0) if self._tiled else path
        with _reading(heights):
            with rasterio.open(heights) as file:
                self._facts: dict[str, str] = file.tags(ns=TAGS)
            if not self._facts:
                raise InputError(f"{one_line(heights)}: expected the heights of a world")
            world = World(*(float(self._facts[name]) for name in ("west", "south", "east", "north", "cell")))
            layers, materials = (tuple(self._facts[name].split(",")) for name in ("layers", "materials"))
            super().__init__(world, layers, materials)

    def sketch(self) -> Sketch | None:
        """Return the sketch beside the tiles or in the tags."""
        if self._tiled:
            path = self._path / SKETCH
            return load_sketch(path) if path.exists() else None
        if "sketch" not in self._facts:
            return None
        with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder, _reading(self._path):
            path = Path(folder) / SKETCH
            path.write_bytes(b64decode(self._facts["sketch"], validate=True))
            return load_sketch(path)

    def _load(self, layer: str, level: int, row: int, column: int) -> _Array:
        grid, side, overview = self.levels[level], SHARD // CHUNK, level
        path, shape = layer_file(self._path, layer), (grid.rows, grid.columns)
        if self._tiled:
            shard, overview = Shard(level, row // side, column // side), 0
            path, shape = self._path / tile_name(layer, shard), grid.size_of(shard)
            row, column = row % side, column % side
        expected = (len(self._specs[layer].bands), *shape)
        with _reading(path):
            file = self._files.open(path, overview)
            if (file.count, *file.shape) != expected:
                raise ValueError(f"expected {expected} bands, rows, columns, got {file.count, *file.shape}")
            with path.open("rb") as stream:  # the checksum of a block, which GDAL ignores
                names = (f"BLOCK_{item}_{column}_{row}" for item in ("OFFSET", "SIZE"))
                offset, size = (int(file.get_tag_item(name, "TIFF", bidx=1)) for name in names)
                stream.seek(offset)
                zlib.decompress(stream.read(size))
            top, left = row * CHUNK, column * CHUNK
            window = Window(left, top, min(CHUNK, shape[1] - left), min(CHUNK, shape[0] - top))
            values: _Array = file.read(window=window)
        return values[0] if layer == "height" else values


def open_world(path: str | Path) -> StoredWorld:
    """Open a Zarr store, a folder of GeoTIFF tiles, or the GeoTIFF of the heights; raise InputError."""
    world, vrt = Path(path), vrt_name("height", 0)
    with wrap_read_errors(world):
        if not world.exists():
            raise InputError(f"{one_line(path)}: no such file or folder, expected a world")
        if (world / METADATA).is_file():
            return _ZarrWorld(world)
        if world.is_dir() and not (world / vrt).exists():
            if (world / SKETCH).exists():
                raise InputError(f"{one_line(path)}: is not finished; world --resume completes it")
            raise InputError(f"{one_line(path)}: expected a world, with {METADATA} or {vrt}")
    return _TiffWorld(world)


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    try:
        yield
    except (*_FAILURES, zlib.error) as error:
        raise _broken(path, error.__cause__ or error) from None


def _broken(path: Path, reason: object = None) -> InputError:
    found = f"broken ({one_line(reason)})"
    if not path.exists():
        found = "is missing: the world is not finished or damaged"
    return InputError(f"{one_line(path)}: {found}; {_REMEDY}")


def draped_sketch(world: StoredWorld, drapes: Sequence[DrapedLayer]) -> Sketch | None:
    """Return the sketch of a world with more draped layers; raise InputError if they have no place."""
    sketch = world.sketch()
    if sketch is None and drapes:
        raise InputError("the world holds no sketch: expected no draped layers, which would have no place")
    return sketch and sketch.replace(drapes=(*sketch.drapes, *drapes))


def at_corner(sketch: Sketch, corner: tuple[float, float]) -> Sketch:
    """Return a sketch whose frame and draped layers have another corner (m) as their origin."""
    if not sketch.drapes:
        return sketch
    frame = {
        name: sketch.frame[name] + offset for name, offset in zip(("east", "north"), corner, strict=True)
    }
    drapes = moved_drapes(sketch.drapes, lambda points: points - corner)
    return sketch.replace(frame={**sketch.frame, **frame}, drapes=drapes)
