"""A world as one Cloud-Optimised GeoTIFF a layer, joined from shards whose blocks are copied as they are."""

from __future__ import annotations

import mmap
import shutil
from base64 import b64encode
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.errors import InputError, one_line
from sketchterrain.export.files import prepare_folder
from sketchterrain.sketch.files import packed_sketch
from sketchterrain.whole_files import telling_failure, whole_file, write_whole
from sketchterrain.world.cloud_layout import cloud_optimised
from sketchterrain.world.grid import CHUNK, SHARD, Shard
from sketchterrain.world.settled import settle, text_of
from sketchterrain.world.tiff_blocks import Sheet, block_grid, block_places
from sketchterrain.world.tiff_directory import read_directories
from sketchterrain.world.tiff_layers import TIFF_LAYERS, Georeference
from sketchterrain.world.tiff_tiles import written_tile
from sketchterrain.world.tile_names import JOURNAL, SKETCH, layer_file, ledger_file, parts_folder, tile_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import numpy.typing as npt

    from sketchterrain.world.grid import Level
    from sketchterrain.world.ground import Ground
    from sketchterrain.world.job import Job

__all__ = ["TiffStore"]

_SIDE = SHARD // CHUNK  # blocks along a shard


class TiffStore:
    """One file a layer, as :class:`~sketchterrain.world.store.Store` says.

    ``world.tif`` has the heights; ``world_normal.tif`` and ``world_materials.tif`` lie beside it. Each has
    the coarser levels, evaluated for themselves, as its overviews; the sketch stands in the metadata of the
    heights. Until they are joined, shards are kept in a hidden folder beside the file: for that time the disk
    holds all blocks twice.

    Parameters
    ----------
    job
    """

    keeps_shards = False

    def __init__(self, job: Job) -> None:
        self.folder = job.output.parent
        self._parts = parts_folder(job.output)
        self.journal = self._parts / JOURNAL
        self.mark = self._parts / SKETCH
        self._ledger = ledger_file(job.output)
        self._job = job
        self._place = Georeference(job)

    def create(self) -> tuple[str, ...]:
        """Make the folder of the shards; see `Store.create`. Nothing of it stays."""
        prepare_folder(self._parts)
        settle(self.mark, packed_sketch(self._job.sketch))
        return ()

    def write(self, ground: Ground) -> tuple[str, ...]:
        """Write a shard of each layer into the hidden folder; see `Store.write`."""
        paths = {layer: self._parts / tile_name(layer, ground.shard) for layer in self._job.layers}
        for layer, path in paths.items():
            written_tile(path, TIFF_LAYERS[layer], ground, self._place, overviews=False)
        return tuple(path.relative_to(self.folder).as_posix() for path in paths.values())

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Write the files, a row of blocks of a shard held at a time; see `Store.join`."""
        paths = {layer: layer_file(self._job.output, layer) for layer in self._job.layers}
        for index, (layer, path) in enumerate(paths.items()):
            self._join(layer, path, _part(progress, index, len(paths)))
        return tuple(path.name for path in paths.values())

    def close(self, ledger: str) -> None:
        """Write the ledger, delete the shards; see `Store.close`."""
        write_whole(self._ledger, ledger.encode())
        with telling_failure(self._parts):
            self.journal.unlink(missing_ok=True)
            shutil.rmtree(self._parts)

    def ledger_text(self) -> str | None:
        """Return the ledger of a finished world; see `Store.ledger_text`."""
        return text_of(self._ledger)

    def _join(self, name: str, path: Path, progress: Callable[[float], None]) -> None:
        layer, levels = TIFF_LAYERS[name], self._job.world.levels
        facts = self._place.facts()
        if name == "height":
            facts["sketch"] = b64encode(self.mark.read_bytes()).decode()
        sheets = [self._sheet(name, level) for level in levels]
        tags = self._place.tags(layer, self._place.transform(levels[0]), facts)
        total = sum(int(sheet.sizes.sum()) for sheet in sheets)
        written = told = 0
        with whole_file(path) as stream:
            for piece in cloud_optimised(sheets, tags):
                stream.write(piece)
                written += len(piece)
                if written - told > total // 100:
                    told = written
                    progress(min(written / total, 1.0))
        progress(1.0)

    def _sheet(self, layer: str, level: Level) -> Sheet:
        """Return a level as blocks that lie in the files of its shards."""
        shape = block_grid(level.rows, level.columns)
        sizes = np.zeros(shape, np.int64)
        above, across = level.shards
        for row in range(above):
            for column in range(across):
                places = self._places(layer, level, Shard(level.number, row, column))
                high, wide = places.shape[:2]
                top, left = row * _SIDE, column * _SIDE
                sizes[top : top + high, left : left + wide] = places[..., 1]
        return Sheet(level.rows, level.columns, sizes, lambda: self._blocks(layer, level))

    def _blocks(self, layer: str, level: Level) -> Iterator[bytes | memoryview]:
        above, across = level.shards
        for row in range(above):
            shards = [Shard(level.number, row, column) for column in range(across)]
            places = [self._places(layer, level, shard) for shard in shards]
            for line in range(len(places[0])):
                for shard, place in zip(shards, places, strict=True):
                    yield from self._line(self._parts / tile_name(layer, shard), place[line])

    @staticmethod
    def _line(path: Path, places: npt.NDArray[np.int64]) -> Iterator[memoryview]:
        """Return blocks that follow each other in a file."""
        start, end = int(places[0, 0]), int(places[-1].sum())
        with path.open("rb") as stream:
            stream.seek(start)
            run = memoryview(stream.read(end - start))
        for place, size in places.tolist():
            yield run[place - start : place - start + size]

    def _places(self, layer: str, level: Level, shard: Shard) -> npt.NDArray[np.int64]:
        """Return where a shard's blocks lie in its file."""
        path = self._parts / tile_name(layer, shard)
        try:
            with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                return block_places(read_directories(content)[0], block_grid(*level.size_of(shard)))
        except OSError as error:
            raise InputError(f"{one_line(path)}: cannot be joined ({one_line(error.strerror)})") from None
        except ValueError as error:
            raise InputError(f"{one_line(path)}: cannot be joined ({one_line(error)})") from None


def _part(progress: Callable[[float], None], index: int, count: int) -> Callable[[float], None]:
    """Return what tells of one of so many parts."""
    return lambda share: progress((index + share) / count)
