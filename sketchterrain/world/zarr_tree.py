"""All that a world's Zarr store holds besides its shards: metadata, coordinates, the sketch."""

from __future__ import annotations

from functools import cached_property
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.sketch import packed_sketch
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
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sketchterrain.world.grid import Level
    from sketchterrain.world.job import Job

__all__ = ["BYTES", "FORMAT", "LEDGER", "OURS", "SKETCH", "ZarrTree"]

FORMAT: Final = 1
"""Of what the root group says under `OURS`."""
OURS: Final = "sketchterrain"
SKETCH: Final = "sketch"
LEDGER: Final = "ledger"
"""Arrays of the bytes of a sketch's zip and of the ledger's text."""
BYTES: Final = "c/0"
"""The only chunk of such an array, in its folder: a file of just these bytes."""

_SKETCH_ATTRIBUTES = {"long_name": "what the world was made from: the bytes of a .sketch file, a zip"}
_LEDGER_ATTRIBUTES = {"long_name": "every file of the world with its SHA-256, as lines of JSON"}


class ZarrTree:
    """The files of a store that follow from the job alone, and those that also tell of the ledger.

    Parameters
    ----------
    job : Job
    """

    def __init__(self, job: Job) -> None:
        self._job = job
        self._place = ZarrPlace.of(job)

    def fixed(self) -> Iterator[tuple[str, bytes]]:
        """Return names and contents of the files that follow from the job alone."""
        yield f"{SKETCH}/{METADATA}", encoded(self._sketch_document)
        yield f"{SKETCH}/{BYTES}", self._sketch
        for level in self._job.world.levels:
            at, members = level.number, self._members[level.number]
            yield f"{at}/{METADATA}", encoded(group_document(self._group(level), members))
            for name, document in members.items():
                yield f"{at}/{name}/{METADATA}", encoded(document)
            yield f"{at}/{GRID_MAPPING}/c", np.int32(0).tobytes()
            for name, chunk, content in self._coordinates(level):
                yield f"{at}/{name}/c/{chunk}", content

    def closing(self, ledger: bytes | None) -> Iterator[tuple[str, bytes]]:
        """Return names and contents of metadata that tell how long the ledger is, the root's first.

        Parameters
        ----------
        ledger
            Its text; None while there is none: metadata are consolidated when all of it is known.
        """
        document = bytes_document(LEDGER, 0 if ledger is None else len(ledger), _LEDGER_ATTRIBUTES)
        members = None
        if ledger is not None:
            members = {LEDGER: document, SKETCH: self._sketch_document}
            for level in self._job.world.levels:
                # A group within has no members of its own there: all lie side by side.
                members[str(level.number)] = group_document(self._group(level), {})
                for name, each in self._members[level.number].items():
                    members[f"{level.number}/{name}"] = each
        yield METADATA, encoded(group_document(self._root, members))
        yield f"{LEDGER}/{METADATA}", encoded(document)

    def _group(self, level: Level) -> dict[str, Any]:
        return {"cell": level.cell} | self._place.group(level)

    @cached_property
    def _members(self) -> list[dict[str, dict[str, Any]]]:
        """Metadata of the arrays of each level, by name."""
        place, found = self._place, []
        for level in self._job.world.levels:
            members = {GRID_MAPPING: scalar_document(place.mapping(level))}
            for name, count in (("x", level.columns), ("y", level.rows)):
                members[name] = coordinate_document(name, count, place.axis(name))
            for layer in self._job.layers:
                members[layer] = layer_document(LAYERS[layer], level, place.layer())
            found.append(members)
        return found

    def _coordinates(self, level: Level) -> Iterator[tuple[str, int, bytes]]:
        """Return the chunks of coordinates: the axis, the chunk's number, its bytes."""
        for name, count in (("x", level.columns), ("y", level.rows)):
            size = min(count, COORDINATES_AT_ONCE)
            for number, first in enumerate(range(0, count, size)):
                values = np.full(size, np.nan)
                held = min(size, count - first)
                values[:held] = self._place.along(name, level, first, held)
                yield name, number, COORDINATE.pack(values)

    @cached_property
    def _sketch(self) -> bytes:
        return packed_sketch(self._job.sketch)

    @cached_property
    def _sketch_document(self) -> dict[str, Any]:
        return bytes_document(SKETCH, len(self._sketch), _SKETCH_ATTRIBUTES)

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
