"""Patches of DEM grids on disk, in the user's cache folder, by the content of the grids."""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

import numpy as np

from sketchterrain.caching import LRUCache
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.detail_law import DetailLaw
from sketchterrain.elevation.grids import MAX_HELD, ElevationGrid, SketchFrame
from sketchterrain.elevation.patches import COEFFICIENTS, GridPatches, PatchTable
from sketchterrain.elevation.planes import CHUNK, DESCRIPTION, ArrayFile, CoefficientPlanes
from sketchterrain.elevation.quirks import Findings
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.io.disk_cache import delete_old, write_folder
from sketchterrain.io.files import cache_folder, check_disk, wrap_os_errors, write_atomic

MAX_BYTES: Final = 1 << 36
"""Bytes of all stores: those that were not opened for longest are deleted beyond it."""

_FORMAT = 3
_VALUES, _MASKS = "coefficients", "masks"
_chunks = LRUCache(max_bytes=1 << 27)  # of all stores
_BYTES = 6  # a sample, of all levels
_DAMAGE = (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error)


class StoredPatches(GridPatches):
    """Patches whose coefficients are in a store; other processes open it again."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the folder of the patches, and how far they were moved."""
        return _sent, (self.planes.values.path.parent, self.corner)


class PatchStore:
    """Stores of the patches of grids, one folder each.

    Coefficients are read when they are needed, and held in `memory`. A file that describes them is written
    last: what was not finished, or has changed, is built again.
    """

    def __init__(
        self, folder: Path | None = None, *, memory: LRUCache = _chunks, max_bytes: int = MAX_BYTES
    ) -> None:
        self._folder = folder or cache_folder() / "elevation"
        self._memory, self._max_bytes = memory, max_bytes

    def load(
        self, key: object, opened: Callable[[], AbstractContextManager[ElevationGrid]]
    ) -> tuple[GridPatches, Findings]:
        """Return patches, and what was found in their grid, which is opened if none are stored by a key."""
        name = f"{blake2b(repr((_FORMAT, key)).encode(), digest_size=16).hexdigest()}.json"
        for path in self._folder.glob(f"*/{name}"):
            with suppress(OSError, ValueError):
                findings = tuple(json.loads(path.read_bytes()))
                if (part := self.opened(bytes.fromhex(path.parent.name))) is not None:
                    return part, findings
        with opened() as grid:
            patches, findings = self.patches(grid), grid.found
        with suppress(SketchterrainError):  # then it is opened again by the next one
            write_atomic(self._folder / patches.id.hex() / name, json.dumps(findings).encode())
        return patches, findings

    def patches(self, grid: ElevationGrid) -> GridPatches:
        """Return the patches of a grid, built if they are not stored; in memory if small and not writable."""
        if (stored := self.opened(grid.id)) is not None:
            return stored
        try:
            return self._built(grid)
        except SketchterrainError as error:
            if np.prod(grid.shape) > MAX_HELD or not isinstance(error.__cause__, OSError):
                raise
            return build_patches(grid)

    def _built(self, grid: ElevationGrid) -> GridPatches:
        folder = self._folder / grid.id.hex()

        def build(temporary: Path) -> None:
            check_disk(temporary, _BYTES * float(np.prod(grid.shape)), "patches of elevation")
            values, masks = _array_files(temporary)
            for each in (values, masks):
                each.path.touch()
            _describe(build_patches(grid, values=values, masks=masks), temporary / DESCRIPTION)

        with wrap_os_errors(folder):
            write_folder(folder, build, lambda: self.opened(grid.id) is not None)
        part = _reopened(self._folder, grid.id, self._memory)  # now the newest
        delete_old(self._folder.glob("*/"), self._max_bytes)
        return part

    def opened(self, grid_id: bytes) -> StoredPatches | None:
        """Return stored patches, or None if there are none or they are damaged."""
        folder = self._folder / grid_id.hex()
        try:
            path = folder / DESCRIPTION
            with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:  # checks its sums
                found = {key: archive[key] for key in archive.files}
            facts: dict[str, Any] = json.loads(str(found.pop("facts")))
            frame, law = SketchFrame(*facts["frame"]), facts["law"]
            samples: Any = np.broadcast_to(np.float32(np.nan), facts["shape"])
            place, name = tuple(facts["place"]), facts["name"]
            grid = ElevationGrid(samples, place, facts["accuracy"], facts["crs"], frame, name)
            values, masks = _array_files(folder)
            planes = CoefficientPlanes(facts["levels"], values, found.pop("sums"), self._memory)
            if (len(values), len(masks), facts["format"]) != (planes.size, facts["masks"], _FORMAT):
                return None
            table, box = PatchTable(**found), tuple(facts["box"])
            law = DetailLaw(**{**law, "shape": tuple(law["shape"])})
            os.utime(folder)
        except _DAMAGE:
            return None
        return StoredPatches(grid_id, grid.without_samples(), facts["base"], table, planes, masks, box, law)


def _array_files(folder: Path) -> tuple[ArrayFile, ArrayFile]:
    values, masks = (np.float32, CHUNK), (np.uint8, (COEFFICIENTS, COEFFICIENTS))
    return ArrayFile(folder / _VALUES, *values), ArrayFile(folder / _MASKS, *masks)


def _describe(part: GridPatches, path: Path) -> None:
    """Write all but coefficients and masks."""
    keys = "shape", "place", "accuracy", "crs", "frame", "name"
    facts = {
        **{key: getattr(part.grid, key) for key in keys},
        "format": _FORMAT,
        "base": part.base,
        "levels": part.planes.shapes,
        "masks": int(part.table.mask.max(initial=-1)) + 1,
        "box": part.box,
        "law": asdict(part.law),
    }
    np.savez(path, facts=np.array(json.dumps(facts)), sums=part.planes.sums, **part.table._asdict())


def _reopened(folder: Path, grid_id: bytes, memory: LRUCache = _chunks) -> StoredPatches:
    """Return stored patches; raise SketchterrainError if they have been deleted or damaged."""
    found = PatchStore(folder, memory=memory).opened(grid_id)
    if found is None:
        raise SketchterrainError(f"{one_line(folder / grid_id.hex())}: has been deleted or damaged")
    return found


def _sent(folder: Path, corner: tuple[float, float]) -> StoredPatches:
    return _reopened(folder.parent, bytes.fromhex(folder.name)).moved(*corner)
