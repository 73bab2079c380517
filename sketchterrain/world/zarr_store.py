"""A world as a Zarr store: groups ``0``, ``1``, … of a pyramid, arrays of each layer in shards."""

from __future__ import annotations

from functools import cached_property
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.export.libraries import require
from sketchterrain.export.target import Library
from sketchterrain.sketch import packed_sketch
from sketchterrain.whole_files import telling_failure, whole_file, write_whole

from sketchterrain.world.zarr_georeference import GRID_MAPPING, ZarrPlace
from sketchterrain.world.zarr_layout import (
    COORDINATE,
    COORDINATES_AT_ONCE,
    LAYERS,
    METADATA,
    bytes_document,
    coordinate_document,
    encoded,
    group_document,
    layer_document,
    scalar_document,
    shard_file,
)
from sketchterrain.world.zarr_shards import pack_shard

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sketchterrain.world.grid import Level
    from sketchterrain.world.ground import Ground
    from sketchterrain.world.job import Job

__all__ = ["FORMAT", "LEDGER", "OURS", "SKETCH", "ZarrStore"]

FORMAT: Final = 1
"""Of what the root group says under `OURS`."""
OURS: Final = "sketchterrain"
SKETCH: Final = "sketch"
LEDGER: Final = "ledger"
"""Arrays of the bytes of a sketch's zip and of the ledger's text; their only chunk is these bytes."""

_LIBRARIES = (Library("numcodecs", "world"), Library("google_crc32c", "world"))
_BYTES: Final = "c/0"  # the chunk of an array of bytes


class ZarrStore:
    """See `sketchterrain.world.store.Store`.

    Parameters
    ----------
    job : Job

    Raises
    ------
    SketchterrainError
        If a library that packs chunks is missing.
    """

    def __init__(self, job: Job) -> None:
        require("A world as a Zarr store", _LIBRARIES)
        self._job = job
        self._place = ZarrPlace.of(job)

    @property
    def folder(self) -> Path:
        """The store."""
        return self._job.output

    @property
    def journal(self) -> Path:
        """Beside the ledger: what lies in an array's folder is no object of its own to readers of Zarr."""
        return self.folder / LEDGER / "journal.jsonl"

    @property
    def mark(self) -> Path:
        """The root group's metadata."""
        return self.folder / METADATA

    @property
    def keeps_shards(self) -> bool:
        """Shards stay as they are written."""
        return True

    def create(self) -> tuple[str, ...]:
        """Write all metadata, the coordinates and the sketch; see `Store.create`."""
        names = []
        for name, content in self._fixed():
            self._settle(name, content)
            names.append(name)
        # Its length is known when the world is done: no file that the ledger lists.
        text = self.ledger_text()
        self._settle(f"{LEDGER}/{METADATA}", self._ledger_metadata(b"" if text is None else text.encode()))
        return tuple(names)

    def write(self, ground: Ground) -> tuple[str, ...]:
        """Write a shard of each layer; see `Store.write`."""
        names = []
        for layer in self._job.layers:
            stored = LAYERS[layer]
            name = shard_file(layer, ground.shard)
            path = self._ready(name)
            with whole_file(path) as stream:
                for part in pack_shard(getattr(ground, layer), stored.packing, stored.fill):
                    stream.write(part)
            names.append(name)
        return tuple(names)

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Do nothing: shards need no joining."""
        progress(1.0)
        return ()

    def close(self, ledger: str) -> None:
        """Write the ledger and delete the journal; see `Store.close`."""
        content = ledger.encode()
        write_whole(self._ready(f"{LEDGER}/{_BYTES}"), content)
        write_whole(self._ready(f"{LEDGER}/{METADATA}"), self._ledger_metadata(content))
        with telling_failure(self.journal):
            self.journal.unlink(missing_ok=True)

    def ledger_text(self) -> str | None:
        """Return the ledger; see `Store.ledger_text`."""
        try:
            return (self.folder / LEDGER / _BYTES).read_bytes().decode(errors="replace")
        except (FileNotFoundError, NotADirectoryError):
            return None

    def _fixed(self) -> Iterator[tuple[str, bytes]]:
        """Return names and contents of all files that do not depend on the ground; the mark first."""
        yield METADATA, encoded(group_document(self._root))
        sketch = self._sketch
        yield f"{SKETCH}/{METADATA}", encoded(bytes_document(SKETCH, len(sketch), _SKETCH_WORDS))
        yield f"{SKETCH}/{_BYTES}", sketch
        for level in self._job.world.levels:
            yield from self._fixed_of(level)

    def _fixed_of(self, level: Level) -> Iterator[tuple[str, bytes]]:
        place, at = self._place, f"{level.number}/"
        yield f"{at}{METADATA}", encoded(group_document({"cell": level.cell} | place.group(level)))
        mapping = scalar_document(place.mapping(level))
        yield f"{at}{GRID_MAPPING}/{METADATA}", encoded(mapping)
        yield f"{at}{GRID_MAPPING}/c", np.int32(0).tobytes()
        for axis, count, position in (("x", level.columns, place.x), ("y", level.rows, place.y)):
            document = coordinate_document(axis, count, place.axis(axis))
            yield f"{at}{axis}/{METADATA}", encoded(document)
            for first in range(0, count, COORDINATES_AT_ONCE):
                chunk = np.full(min(count, COORDINATES_AT_ONCE), np.nan)
                numbers = range(first, min(first + COORDINATES_AT_ONCE, count))
                chunk[: len(numbers)] = [position(level, number) for number in numbers]
                yield f"{at}{axis}/c/{first // COORDINATES_AT_ONCE}", COORDINATE.pack(chunk)
        for layer in self._job.layers:
            document = layer_document(LAYERS[layer], level, place.layer())
            yield f"{at}{layer}/{METADATA}", encoded(document)

    @cached_property
    def _root(self) -> dict[str, Any]:
        job, world = self._job, self._job.world
        program = f"{OURS} {version(OURS)}"
        ours = {
            "format": FORMAT,
            "program": program,
            "seed": job.sketch.seed,
            "world": {
                "west": world.west,
                "south": world.south,
                "east": world.east,
                "north": world.north,
                "cell": world.cell,
            },
            "origin": list(job.origin),
            "layers": list(job.layers),
            "materials": list(LAYERS["materials"].bands),
            "step": job.step,
            "fast": job.fast,
        }
        about = {"Conventions": "CF-1.11", "title": job.sketch.name, "source": program}
        return about | {OURS: ours} | self._place.root()

    @cached_property
    def _sketch(self) -> bytes:
        return packed_sketch(self._job.sketch)

    @staticmethod
    def _ledger_metadata(content: bytes) -> bytes:
        return encoded(bytes_document(LEDGER, len(content), _LEDGER_WORDS))

    def _settle(self, name: str, content: bytes) -> None:
        """Write a file unless it is there with just these bytes."""
        path = self._ready(name)
        with telling_failure(path):
            try:
                same = path.stat().st_size == len(content) and path.read_bytes() == content
            except FileNotFoundError:
                same = False
        if not same:
            write_whole(path, content)

    def _ready(self, name: str) -> Path:
        path = self.folder / name
        with telling_failure(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        return path


_SKETCH_WORDS = {"long_name": "what the world was made from: the bytes of a .sketch file, a zip"}
_LEDGER_WORDS = {"long_name": "every file of the world with its SHA-256, as lines of JSON"}
