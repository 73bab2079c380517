"""Zarr output of worlds: a pyramid of groups ``0``, ``1``, …, each with a sharded array per layer.

zarr-python encodes in memory; each key is then written atomically, as zarr-python's `LocalStore` does not
flush, and its sharding codec reads the shard that it replaces even if it is damaged.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.document.store import pack_sketch
from sketchterrain.io.files import wrap_os_errors
from sketchterrain.world.grid import CHUNK, LAYER_SPECS, SHARD, GridLevel, LayerSpec, Shard, ShardData
from sketchterrain.world.job import (
    GRID_MAPPING,
    Job,
    WorldFrame,
    axis_attributes,
    read_text,
    write_if_changed,
)

if TYPE_CHECKING:  # of the extra `world`
    import zarr

FORMAT: Final = 1
"""Version of the root group's attribute `OURS`."""
OURS: Final = "sketchterrain"
METADATA: Final = "zarr.json"
SKETCH: Final = "sketch"
LEDGER: Final = "ledger"
"""Arrays of the bytes of a sketch's zip and of the ledger's text."""
BYTES: Final = "c/0"
"""The only chunk of such an array, uncompressed."""

_SKETCH_NAME: Final = "what the world was made from: the bytes of a .sketch file, a zip"
_LEDGER_NAME: Final = "every file of the world with its SHA-256, as lines of JSON"
_ALL_CHUNKS: Final = {"write_empty_chunks": True}  # so that a missing one is detected
_COORDINATES: Final = 65536  # in a chunk
_CLOSING: Final = (METADATA, f"{LEDGER}/{METADATA}", f"{LEDGER}/{BYTES}")  # depend on the ledger


def shard_file(layer: str, shard: Shard) -> str:
    """Return the relative name of a shard's file of a layer."""
    first = "0/" if LAYER_SPECS[layer].dimension else ""
    return f"{shard.level}/{layer}/c/{first}{shard.row}/{shard.column}"


class ZarrStore:
    """Store of one Zarr hierarchy; see `shard_store`."""

    shards_are_final = True

    def __init__(self, job: Job) -> None:
        self._job = job
        self.folder = job.output

    def create(self) -> tuple[str, ...]:
        """Write metadata, coordinates and the sketch; files that depend on the ledger are not returned."""
        text = read_text(self._job.layout.ledger)
        names = []
        for name, content in self._metadata(None if text is None else text.encode()).items():
            write_if_changed(self.folder / name, content)
            names += [] if name in _CLOSING else [name]
        return tuple(names)

    def write(self, shard: ShardData) -> tuple[str, ...]:
        """Write a shard of each layer; see `TileStore.write`."""
        names = []
        at, level = shard.shard, self._job.world.levels[shard.shard.level]
        for layer in self._job.layers:
            content: dict[str, Any] = {}
            array = _create_layer(
                _root_group(content), f"{at.level}/{layer}", self._job.specs[layer], level, {}
            )
            rows, columns = shard.height.shape
            top, left = at.row * SHARD, at.column * SHARD
            array[..., top : top + rows, left : left + columns] = getattr(shard, layer)
            names.append(shard_file(layer, at))
            write_if_changed(self.folder / names[-1], content[names[-1]].to_bytes())
        return tuple(names)

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Do nothing: shards need no joining."""
        progress(1.0)
        return ()

    def close(self, ledger: str) -> None:
        """Write the ledger and delete the journal."""
        content = self._metadata(ledger.encode())
        for name in reversed(_CLOSING):
            write_if_changed(self.folder / name, content.get(name, b""))
        journal = self._job.layout.journal
        with wrap_os_errors(journal):
            journal.unlink(missing_ok=True)

    def _metadata(self, ledger: bytes | None) -> dict[str, bytes]:
        job, georeference, content = self._job, WorldFrame(self._job), dict[str, Any]()
        root = _root_group(content)
        root.attrs.update(self._root_attributes() | georeference.root_attributes())
        for level in job.world.levels:
            group = root.create_group(str(level.number), attributes=georeference.group_attributes(level))
            options: dict[str, Any] = {
                "attributes": georeference.mapping_attributes(level),
                "config": _ALL_CHUNKS,
            }
            _create(group, GRID_MAPPING, "int32", shape=(), chunks=(), **options)[...] = 0
            for axis, count in (("x", level.columns), ("y", level.rows)):
                options = {"shape": (count,), "chunks": (min(count, _COORDINATES),)}
                options |= {"attributes": axis_attributes(axis), "dimension_names": (axis,)}
                array = _create(group, axis, "float64", compressors=_codecs("shuffle", 5, 8), **options)
                array[:] = georeference.coordinates(axis, level)
            for layer in job.layers:
                # As a coordinate, xarray copies it with an array that is selected from its level.
                own = {"grid_mapping": GRID_MAPPING, "coordinates": GRID_MAPPING}
                _create_layer(group, layer, job.specs[layer], level, own)
            _consolidate(group)
        _write_bytes(root, SKETCH, pack_sketch(job.sketch), _SKETCH_NAME)
        _write_bytes(root, LEDGER, ledger or b"", _LEDGER_NAME)
        if ledger is not None:
            _consolidate(root)
        return {name: buffer.to_bytes() for name, buffer in content.items()}

    def _root_attributes(self) -> dict[str, Any]:
        job, program = self._job, f"{OURS} {version(OURS)}"
        ours = {
            "format": FORMAT,
            "program": program,
            "seed": job.sketch.seed,
            "world": asdict(job.world),
            "origin": list(job.origin),
            "layers": list(job.layers),
            "materials": list(job.specs["materials"].bands),
            "step": job.step,
            "fast": job.fast,
        }
        return {"Conventions": "CF-1.11", "title": job.sketch.name, "source": program, OURS: ours}


def _root_group(content: dict[str, Any]) -> zarr.Group:
    import zarr
    from zarr.storage import MemoryStore

    # The device uses every core already; more threads only take memory.
    zarr.config.set({"threading.max_workers": 1, "async.concurrency": 2})
    return zarr.open_group(MemoryStore(content), mode="w", zarr_format=3)


def _consolidate(group: zarr.Group) -> None:
    """Copy all metadata of a group into its own, where xarray reads them."""
    import zarr

    with warnings.catch_warnings():  # not in the specification yet
        warnings.simplefilter("ignore", zarr.errors.ZarrUserWarning)
        zarr.consolidate_metadata(group.store, path=group.path)


def _create(group: zarr.Group, name: str, dtype: str, **options: Any) -> zarr.Array[Any]:
    options = {"compressors": None, "fill_value": float("nan") if dtype[0] == "f" else 0} | options
    return group.create_array(name, dtype=dtype, **options)


def _create_layer(
    group: zarr.Group, name: str, spec: LayerSpec, level: GridLevel, own: dict[str, Any]
) -> zarr.Array[Any]:
    shape = spec.shape
    size = 4 if spec.dtype == "float32" else 1
    block = size * len(spec.bands) * CHUNK * CHUNK  # whole chunks are compressed together
    return _create(
        group,
        name,
        spec.dtype,
        attributes=spec.attributes | own,
        shape=shape(level.rows, level.columns),
        chunks=shape(CHUNK, CHUNK),
        shards=shape(SHARD, SHARD),
        compressors=_codecs(spec.shuffle, spec.clevel, size, block),
        dimension_names=(spec.dimension, "y", "x") if spec.dimension else ("y", "x"),
        config=_ALL_CHUNKS,
    )


def _write_bytes(group: zarr.Group, name: str, content: bytes, about: str) -> None:
    options: dict[str, Any] = {"shape": (len(content),), "chunks": (max(len(content), 1),)}
    options |= {"attributes": {"long_name": about}, "dimension_names": (f"{name}_byte",)}
    array = _create(group, name, "uint8", **options)
    if content:
        array[:] = np.frombuffer(content, np.uint8)


def _codecs(shuffle: str, clevel: int, size: int, block: int = 0) -> tuple[Any, ...]:
    """Return Blosc compression with Zstandard, and a checksum to detect damaged chunks."""
    from numcodecs import blosc
    from zarr.codecs import BloscCodec, Crc32cCodec

    # With Blosc's own threads, the order of blocks in a chunk is not deterministic.
    blosc.use_threads = False
    packed = BloscCodec(typesize=size, cname="zstd", clevel=clevel, shuffle=shuffle, blocksize=block)
    return packed, Crc32cCodec()
