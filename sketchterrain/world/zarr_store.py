"""A world as a Zarr store: groups ``0``, ``1``, … of a pyramid, in each an array of each layer, in shards."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from sketchterrain.whole_files import telling_failure, whole_file, write_whole
from sketchterrain.world.libraries import require
from sketchterrain.world.settled import settle, text_of
from sketchterrain.world.tile_names import JOURNAL
from sketchterrain.world.zarr_layout import LAYERS, METADATA, shard_file
from sketchterrain.world.zarr_shards import ZARR_LIBRARIES, pack_shard
from sketchterrain.world.zarr_tree import BYTES, LEDGER, ZarrTree

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sketchterrain.world.ground import Ground
    from sketchterrain.world.job import Job

__all__ = ["ZarrStore"]


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
        require("A world as a Zarr store", ZARR_LIBRARIES)
        self._job = job

    @property
    def folder(self) -> Path:
        """The store."""
        return self._job.output

    @property
    def journal(self) -> Path:
        """Beside the ledger: what lies in an array's folder is no object of its own to readers of Zarr."""
        return self.folder / LEDGER / JOURNAL

    @property
    def mark(self) -> Path:
        """The root group's metadata."""
        return self.folder / METADATA

    @property
    def keeps_shards(self) -> bool:
        """Shards stay as they are written."""
        return True

    def create(self) -> tuple[str, ...]:
        """Write all metadata, the coordinates and the sketch; see `Store.create`.

        Two files also tell how long the ledger is: they are written and not named, as it cannot list them.
        """
        text = self.ledger_text()
        for name, content in self._tree.closing(None if text is None else text.encode()):
            settle(self.folder / name, content)
        names = []
        for name, content in self._tree.fixed():
            settle(self.folder / name, content)
            names.append(name)
        return tuple(names)

    def write(self, ground: Ground) -> tuple[str, ...]:
        """Write a shard of each layer; see `Store.write`."""
        names = []
        for layer in self._job.layers:
            stored = LAYERS[layer]
            name = shard_file(layer, ground.shard)
            with whole_file(self._ready(name)) as stream:
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
        write_whole(self._ready(f"{LEDGER}/{BYTES}"), content)
        for name, document in self._tree.closing(content):
            write_whole(self._ready(name), document)
        with telling_failure(self.journal):
            self.journal.unlink(missing_ok=True)

    def ledger_text(self) -> str | None:
        """Return the ledger; see `Store.ledger_text`."""
        return text_of(self.folder / LEDGER / BYTES)

    @cached_property
    def _tree(self) -> ZarrTree:
        return ZarrTree(self._job)

    def _ready(self, name: str) -> Path:
        """Return the path of a file whose folder is there."""
        path = self.folder / name
        with telling_failure(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        return path
