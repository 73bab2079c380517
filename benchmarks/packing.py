"""How chunks of a world are packed, beside other ways: bytes against time."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sketchterrain.benchmarks.grounds import open_ground
from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import alternate, lap, spread
from sketchterrain.export.sampled import quantise_normals, quantise_weights
from sketchterrain.world.grid import CHUNK, LAYER_SPECS
from sketchterrain.world.task_runner import rounded

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext
    from sketchterrain.terrain.terrain import Terrain

_CELL = 1.0  # m
_WAYS = {
    "height": (
        ("zstd", 1, "noshuffle"),
        ("lz4", 5, "shuffle"),
        ("zstd", 1, "shuffle"),
        ("zstd", 3, "shuffle"),
        ("zstd", 5, "shuffle"),
        ("zstd", 1, "bitshuffle"),
        ("zstd", 3, "bitshuffle"),
    ),
    "normal": (
        ("lz4", 5, "noshuffle"),
        ("zstd", 1, "noshuffle"),
        ("zstd", 3, "noshuffle"),
        ("zstd", 1, "bitshuffle"),
        ("zstd", 3, "bitshuffle"),
    ),
    "materials": (
        ("lz4", 5, "noshuffle"),
        ("zstd", 1, "noshuffle"),
        ("zstd", 3, "noshuffle"),
        ("zstd", 1, "bitshuffle"),
    ),
}
_SHUFFLES = ("noshuffle", "shuffle", "bitshuffle")  # Blosc's numbers for them
_STEPS = (0.0, 2.0**-10, 2.0**-7, 2.0**-4)  # m

_PACKED = (
    Column("ground", "ground"),
    Column("layer", "layer"),
    Column("way", "packed by"),
    Column("used", "used"),
    Column("bytes_a_vertex", "bytes a vertex"),
    Column("pack_ms", "packing, ms a million vertices"),
    Column("unpack_ms", "unpacking"),
)
_STEPPED = (
    Column("ground", "ground"),
    Column("step_mm", "steps of heights, mm"),
    Column("bytes_a_vertex", "bytes a vertex"),
    Column("share", "of those of all bits"),
)


class _Way(NamedTuple):
    """Blosc's compressor, its effort, what is done before, and bytes that are compressed together."""

    compressor: str
    effort: int
    shuffle: str
    block: int

    def pack(self, chunk: npt.NDArray[Any]) -> bytes:
        from numcodecs import blosc

        blosc.use_threads = False
        shuffle = _SHUFFLES.index(self.shuffle)
        packed: bytes = blosc.compress(chunk, self.compressor.encode(), self.effort, shuffle, self.block)
        return packed

    def unpack(self, packed: bytes) -> None:
        from numcodecs import blosc

        blosc.decompress(packed)

    def __str__(self) -> str:
        before = "" if self.shuffle == "noshuffle" else f"{self.shuffle}, "
        return f"{before}{self.compressor} {self.effort}{', whole chunks' if self.block else ''}"


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Bytes a vertex of chunks of 256 × 256 vertices, by layer and by the way that they are packed.

    Four chunks at the corners of the middle of each sketch, 1 m between vertices. Times are of the processor,
    one thread, medians, ways in turn. All are Blosc's, a codec of Zarr 3: a compressor with its effort
    (zstd n is Zstandard's level 2n − 1), bytes or bits of values sorted by their place before it, and whole
    chunks or parts that are compressed by themselves. "used" is what worlds are packed by; the checksum that
    they add is not in these times. Steps: heights rounded to multiples of a power of two, packed as they are.
    """
    packed: list[Row] = []
    stepped: list[Row] = []
    for name in effort.presets:
        layers = _chunks(open_ground(name, context))
        for layer, chunks in layers.items():
            packed += [{"ground": name, **row} for row in _rows(layer, chunks, effort.rounds)]
        stepped += [{"ground": name, **row} for row in _stepped(layers["height"])]
    return Outcome(
        (
            Table("Packing of a world's chunks", _PACKED, tuple(packed)),
            Table("Heights in steps", _STEPPED, tuple(stepped)),
        )
    )


def _chunks(terrain: Terrain) -> dict[str, list[npt.NDArray[Any]]]:
    """Return chunks of each layer, of four places of the sketch."""
    east, north = (int(length / _CELL) for length in terrain.size)
    found: dict[str, list[npt.NDArray[Any]]] = {layer: [] for layer in LAYER_SPECS}
    for left in (east // 4, 3 * east // 4 - CHUNK):
        for top in (north // 4, 3 * north // 4 - CHUNK):
            bands = list(
                terrain.window(
                    0.0, terrain.size[1], cell=_CELL, left=left, top=top, columns=CHUNK, rows=CHUNK
                )
            )
            normal = quantise_normals(np.concatenate([band.normal for band in bands]))
            weights = quantise_weights(np.concatenate([band.materials for band in bands]))
            found["height"].append(np.concatenate([band.height for band in bands]))
            found["normal"].append(np.ascontiguousarray(normal.transpose(2, 0, 1)))
            found["materials"].append(np.ascontiguousarray(weights.transpose(2, 0, 1)))
    return found


def _ways(layer: str, size: int) -> Iterator[tuple[_Way, bool]]:
    """Return all ways to pack chunks of so many bytes, and which one is used."""
    spec = LAYER_SPECS[layer]
    used = _Way("zstd", spec.clevel, spec.shuffle, size)
    for known in _WAYS[layer]:
        for block in (0, size) if known == used[:3] else (0,):
            way = _Way(*known, block)
            yield way, way == used


def _rows(layer: str, chunks: Sequence[npt.NDArray[Any]], rounds: int) -> Iterator[Row]:
    ways = dict(_ways(layer, chunks[0].nbytes))
    vertices = len(chunks) * CHUNK * CHUNK
    packed = {way: [way.pack(chunk) for chunk in chunks] for way in ways}
    packing = alternate({way: partial(lap, partial(_all, way.pack, chunks)) for way in ways}, rounds=rounds)
    unpacking = alternate(
        {way: partial(lap, partial(_all, way.unpack, packed[way])) for way in ways}, rounds=rounds
    )
    for way, used in ways.items():
        times = [
            [each.processor / vertices * 1e9 for each in laps[way]] for laps in (packing, unpacking)
        ]  # ms a million
        yield {
            "layer": layer,
            "way": str(way),
            "used": "used" if used else "",
            "bytes_a_vertex": sum(map(len, packed[way])) / vertices,
            "pack_ms": spread(times[0]).median,
            "unpack_ms": spread(times[1]).median,
            "rounds_pack_ms": times[0],
            "rounds_unpack_ms": times[1],
        }


def _all(work: Any, items: Sequence[Any]) -> None:
    for item in items:
        work(item)


def _stepped(chunks: Sequence[npt.NDArray[np.float32]]) -> Iterator[Row]:
    way = next(way for way, used in _ways("height", chunks[0].nbytes) if used)
    vertices = len(chunks) * CHUNK * CHUNK
    found = {step: sum(len(way.pack(rounded(chunk, step))) for chunk in chunks) / vertices for step in _STEPS}
    for step, size in found.items():
        yield {"step_mm": step * 1e3, "bytes_a_vertex": size, "share": size / found[0.0]}
