"""Patches of DEM grids on disk, in the user's cache folder, by the content of the grids."""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import time
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

import numpy as np

from sketchterrain.caching import LRUCache
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import LOCAL, Affine6, ElevationGrid, SketchFrame, open_grid
from sketchterrain.elevation.patches import COEFFICIENTS, GridPatches, PatchTable
from sketchterrain.elevation.planes import DESCRIPTION, ArrayFile, CoefficientPlanes
from sketchterrain.io.files import cache_folder, check_disk, wrap_os_errors, write_atomic

MAX_BYTES: Final = 1 << 36
"""Bytes of all stores: those that were not opened for longest are deleted beyond it."""

_FORMAT = 1
_VALUES, _MASKS = "coefficients", "masks"
_MEMORY = 1 << 27  # bytes of chunks in memory
_BYTES = 6  # a sample, of all levels
_ABANDONED = 86_400.0  # s
_DAMAGE = (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error)


class PatchStore:
    """Stores of the patches of grids, one folder each.

    Coefficients are read when they are needed, and held in `memory`. A file that describes them is written
    last: what was not finished, or has changed, is built again.
    """

    def __init__(
        self, folder: Path | None = None, *, memory: LRUCache | None = None, max_bytes: int = MAX_BYTES
    ) -> None:
        self._folder = folder or cache_folder() / "elevation"
        self._memory = LRUCache(max_bytes=_MEMORY) if memory is None else memory
        self._max_bytes = max_bytes

    def load(
        self,
        path: Path,
        frame: SketchFrame = LOCAL,
        *,
        content: str = "",
        band: int = 1,
        accuracy: float | None = None,
        crs: str | None = None,
        place: Affine6 | None = None,
    ) -> GridPatches:
        """Return the patches of a DEM file of any size, built if they are not stored.

        A file is known by `content`, a hash of it, or else by its path, size and time of change. See
        `open_grid` for the other parameters, and for errors.
        """
        known = content or [(str(each.absolute()), *_stamp(each)) for each in _files(path)]
        key = repr((_FORMAT, known, band, accuracy, crs, place, frame)).encode()
        name = self._folder / f"{blake2b(key, digest_size=16).hexdigest()}.id"
        with suppress(OSError, ValueError):
            if (stored := self._opened(bytes.fromhex(name.read_text("ascii")))) is not None:
                return stored
        part = self.patches(open_grid(path, frame, band=band, accuracy=accuracy, crs=crs, place=place))
        write_atomic(name, part.id.hex().encode())
        return part

    def patches(self, grid: ElevationGrid) -> GridPatches:
        """Return the patches of a grid, built if they are not stored."""
        stored = self._opened(grid.id)
        return self._built(grid) if stored is None else stored

    def _built(self, grid: ElevationGrid) -> GridPatches:
        folder = self._folder / grid.id.hex()
        temporary = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}")
        with wrap_os_errors(folder):
            temporary.mkdir(parents=True)
            try:
                check_disk(temporary, _BYTES * float(np.prod(grid.shape)), "patches of elevation")
                values, masks = _array_files(temporary)
                for each in (values, masks):
                    each.path.touch()
                _describe(build_patches(grid, values=values, masks=masks), temporary / DESCRIPTION)
                if self._opened(grid.id) is None:  # not built by another process meanwhile
                    shutil.rmtree(folder, ignore_errors=True)
                    temporary.rename(folder)
            finally:
                shutil.rmtree(temporary, ignore_errors=True)
        self._delete_old(folder)
        built = self._opened(grid.id)
        assert built is not None  # noqa: S101 # just written
        return built

    def _opened(self, grid_id: bytes) -> GridPatches | None:
        """Return stored patches, or None if there are none or they are damaged."""
        folder = self._folder / grid_id.hex()
        try:
            path = folder / DESCRIPTION
            with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:  # checks its sums
                found = {key: archive[key] for key in archive.files}
            facts: dict[str, Any] = json.loads(str(found.pop("facts")))
            place, frame = tuple(facts["place"]), SketchFrame(*facts["frame"])
            samples = np.broadcast_to(np.float32(np.nan), facts["shape"])
            grid = ElevationGrid(samples, place, facts["accuracy"], facts["crs"], frame, facts["name"])
            values, masks = _array_files(folder)
            sums = found.pop("sums")
            planes = CoefficientPlanes(facts["levels"], values, sums, self._memory)
            table = PatchTable(**found)
            if (len(values), len(masks), facts["format"]) != (planes.size, facts["masks"], _FORMAT):
                return None
            os.utime(folder)
        except _DAMAGE:
            return None
        return GridPatches(grid_id, grid, facts["base"], table, planes, masks, tuple(facts["findings"]))

    def _delete_old(self, kept: Path) -> None:
        """Delete the stores that were opened longest ago, beyond the limit, and abandoned ones."""
        total, now = 0, time.time()
        with suppress(OSError):
            for each in sorted(self._folder.glob("*/"), key=_opened_at, reverse=True):
                total += sum(file.stat().st_size for file in each.iterdir())
                abandoned = each.name.startswith(".") and now - _opened_at(each) > _ABANDONED
                if abandoned or (total > self._max_bytes and each != kept and not each.name.startswith(".")):
                    shutil.rmtree(each, ignore_errors=True)


def _array_files(folder: Path) -> tuple[ArrayFile, ArrayFile]:
    shape = (COEFFICIENTS, COEFFICIENTS)
    return ArrayFile(folder / _VALUES, np.float32), ArrayFile(folder / _MASKS, np.uint8, shape)


def _describe(part: GridPatches, path: Path) -> None:
    """Write all but coefficients and masks."""
    keys = "shape", "place", "accuracy", "crs", "frame", "name"
    facts = {
        **{key: getattr(part.grid, key) for key in keys},
        "format": _FORMAT,
        "base": part.base,
        "levels": part.planes.shapes,
        "masks": int(part.table.mask.max(initial=-1)) + 1,
        "findings": part.findings,
    }
    np.savez(path, facts=np.array(json.dumps(facts)), sums=part.planes.sums, **part.table._asdict())


def _files(path: Path) -> Iterator[Path]:
    """Yield a file, and those that a VRT refers to; the archive of one inside."""
    archive = next(
        (each for each in (path, *path.parents) if each.suffix.lower() == ".zip" and each.is_file()), path
    )
    yield archive
    if archive.suffix.lower() == ".vrt" and archive.is_file():
        for name in re.findall(rb"<SourceFilename[^>]*>([^<]+)<", archive.read_bytes()[: 1 << 24]):
            yield archive.parent / os.fsdecode(name)


def _stamp(path: Path) -> tuple[int, int]:
    """Return the size and the time of change of a file."""
    try:
        facts = path.stat()
    except OSError:
        return 0, 0
    return facts.st_size, facts.st_mtime_ns


def _opened_at(folder: Path) -> float:
    return folder.stat().st_mtime
