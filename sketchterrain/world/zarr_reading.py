"""A world read back from its Zarr store; every chunk is checked, and what is broken or missing is named."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch import load_sketch
from sketchterrain.world.chunk_cache import ROOM, ChunkCache
from sketchterrain.world.grid import CHUNK, SHARD, Shard, World
from sketchterrain.world.libraries import require
from sketchterrain.world.windows import check_window, fill_from_chunks
from sketchterrain.world.zarr_layout import LAYERS, METADATA, layer_document, shard_file
from sketchterrain.world.zarr_shards import INDEX_BYTES, ZARR_LIBRARIES, chunk_place
from sketchterrain.world.zarr_tree import BYTES, FORMAT, OURS, SKETCH

if TYPE_CHECKING:
    from pathlib import Path
    from typing import BinaryIO

    import numpy.typing as npt

    from sketchterrain.sketch import Sketch
    from sketchterrain.world.grid import Level

__all__ = ["StoredZarr"]

_READ_BY: Final = ("shape", "data_type", "chunk_grid", "chunk_key_encoding", "codecs")  # of metadata
_EFFORT: Final = ("typesize", "cname", "clevel", "shuffle", "blocksize")  # that chunks tell of themselves
_REMEDY: Final = "writing the world again with --resume mends it"


class StoredZarr:
    """See `sketchterrain.world.stored.StoredWorld`.

    Parameters
    ----------
    folder
        The store.
    room
        Bytes of chunks that are kept, unpacked, for the next windows.

    Raises
    ------
    InputError
        If it is no world of ours, or its metadata are broken.
    SketchterrainError
        If a library that unpacks chunks is missing.
    """

    def __init__(self, folder: Path, *, room: int = ROOM) -> None:
        require("A world in a Zarr store", ZARR_LIBRARIES)
        self.folder = folder
        self._chunks = ChunkCache(room)
        self._indices = ChunkCache(room // 16)
        self._facts = _facts(folder)
        try:
            self._world = World(**self._facts["world"])
            self._levels = self._world.levels
            self._layers = tuple(str(name) for name in self._facts["layers"])
            self._material_names = tuple(str(name) for name in self._facts["materials"])
            # A world of another version may have other materials.
            bands = {"materials": self._material_names}
            self._stored = {
                name: LAYERS[name]._replace(bands=bands.get(name, LAYERS[name].bands))
                for name in self._layers
            }
            known = "height" in self._layers
        except (KeyError, TypeError):
            known = False
        if not known:
            raise InputError(f"{one_line(folder / METADATA)}: does not say what the world holds; {_REMEDY}")
        for level in self._levels:
            for layer in self._layers:
                self._check_metadata(layer, level)

    @property
    def west(self) -> float:
        """Of column 0, m."""
        return self._world.west

    @property
    def north(self) -> float:
        """Of row 0, m."""
        return self._world.north

    @property
    def levels(self) -> tuple[Level, ...]:
        """The finest first."""
        return self._levels

    @property
    def layers(self) -> tuple[str, ...]:
        """Which of ``height``, ``normal``, ``materials`` there are."""
        return self._layers

    @property
    def material_names(self) -> tuple[str, ...]:
        """Of the materials' bands, in order."""
        return self._material_names

    def sketch(self) -> Sketch | None:
        """Return the sketch that it was made from; see `StoredWorld.sketch`."""
        path = self.folder / SKETCH / BYTES
        if not path.is_file():
            raise _missing(path)
        return load_sketch(path)

    def read(
        self, layer: str, level: int, *, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        """Return a window of a layer; see `StoredWorld.read`."""
        check_window(self, layer, level, top=top, left=left, rows=rows, columns=columns)
        stored = self._stored[layer]
        window = np.empty(stored.shape(rows, columns), stored.packing.dtype)
        fill_from_chunks(window, lambda *at: self._chunk(layer, level, *at), top=top, left=left)
        return window

    def _chunk(self, layer: str, level: int, row: int, column: int) -> npt.NDArray[Any]:
        """Return a chunk of a level by its row and column among all of them; not to be changed."""
        return self._chunks.get(
            (layer, level, row, column), lambda: self._unpacked(layer, level, row, column)
        )

    def _unpacked(self, layer: str, level: int, row: int, column: int) -> npt.NDArray[Any]:
        side = SHARD // CHUNK
        path = self.folder / shard_file(layer, Shard(level, row // side, column // side))
        stored = self._stored[layer]
        try:
            with path.open("rb") as stream:
                index, length = self._index(path, stream)
                offset, size = chunk_place(index, row % side, column % side, length=length)
                stream.seek(offset)
                packed = stream.read(size)
            return stored.packing.unpack(packed, stored.shape(CHUNK, CHUNK))
        except FileNotFoundError:
            raise _missing(path) from None
        except OSError as error:
            raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
        except InputError as error:
            raise InputError(f"{one_line(path)}: broken: {error}; {_REMEDY}") from None

    def _index(self, path: Path, stream: BinaryIO) -> tuple[bytes, int]:
        """Return the index of a shard's open file, and the file's length."""
        known = os.fstat(stream.fileno())

        def read() -> npt.NDArray[Any]:
            stream.seek(max(known.st_size - INDEX_BYTES, 0))
            return np.frombuffer(stream.read(INDEX_BYTES), np.uint8)

        # A shard that was mended is another file, with an index of its own.
        key = (path, known.st_ino, known.st_mtime_ns)
        return self._indices.get(key, read).tobytes(), known.st_size

    def _check_metadata(self, layer: str, level: Level) -> None:
        """Refuse an array whose chunks are not read as ours are: another program made it anew."""
        path = self.folder / str(level.number) / layer / METADATA
        found = _document(path)
        expected = json.loads(json.dumps(layer_document(self._stored[layer], level, {})))
        for name in _READ_BY:
            if _without_effort(found.get(name)) != _without_effort(expected[name]):
                raise InputError(f"{one_line(path)}: its {name} is not that of this world; {_REMEDY}")


def _without_effort(value: Any) -> Any:
    """Return metadata without how much was done to pack chunks: they are unpacked whatever it was."""
    if isinstance(value, dict):
        return {name: _without_effort(each) for name, each in value.items() if name not in _EFFORT}
    return [_without_effort(each) for each in value] if isinstance(value, list) else value


def _facts(folder: Path) -> dict[str, Any]:
    """Return what the root group says of the world."""
    path = folder / METADATA
    attributes = _document(path).get("attributes")
    facts = attributes.get(OURS) if isinstance(attributes, dict) else None
    if not isinstance(facts, dict):
        raise InputError(f"{one_line(folder)}: a Zarr store, but no world of {OURS}'s")
    if facts.get("format") != FORMAT:
        raise InputError(
            f"{one_line(path)}: expected a world of format {FORMAT}, got {one_line(facts.get('format'))}"
        )
    return facts


def _document(path: Path) -> dict[str, Any]:
    """Return the metadata in a file."""
    try:
        document = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise _missing(path) from None
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise InputError(f"{one_line(path)}: broken: no JSON ({one_line(error)}); {_REMEDY}") from None
    if not isinstance(document, dict):
        raise InputError(f"{one_line(path)}: broken: expected an object; {_REMEDY}")
    return document


def _missing(path: Path) -> InputError:
    return InputError(
        f"{one_line(path)}: is not there: the world is not finished, or a file of it is lost; {_REMEDY}"
    )
