"""Real elevation beneath a sketch: patches of its rasters on disk, their patchwork, the fade at its rim."""

from __future__ import annotations

import json
import math
import os
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.rasters import RasterSource, content_hash, raster_file, raster_problem
from sketchterrain.document.sketch import Sketch
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.detail_law import DetailLaw
from sketchterrain.elevation.grids import MAX_HELD, ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.offsets import measure_offsets
from sketchterrain.elevation.patches import COEFFICIENTS, GridPatches, PatchTable
from sketchterrain.elevation.planes import CHUNK, DESCRIPTION, ArrayFile, CoefficientPlanes
from sketchterrain.elevation.quirks import Findings
from sketchterrain.elevation.raster_reader import file_stamps
from sketchterrain.elevation.selection import Patchwork, RimFade
from sketchterrain.elevation.surface import Heights
from sketchterrain.elevation.vertical import convert_heights, geoid_files
from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.io.disk_cache import delete_old, write_folder
from sketchterrain.io.files import cache_folder, check_disk, wrap_os_errors, write_atomic
from sketchterrain.stages.runner import Runner

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


NODES: Final = 256
"""Nodes of the ground along a sketch's extent."""

NODE_REACH: Final = 3
"""Nodes by which splines, displaced by noise, reach beyond a node, and a little more."""

_AUTOMATIC, _MOST = 0.04, 0.4  # margin over the shorter side of the data; at most the weight reaches 1 inside
_MOST_NODES = 1 << 20  # of the fade, which has eight along the margin
_MOST_HELD, _AT_ONCE = 1 << 28, 1 << 14  # samples of a grid; patches, of 5 kB


class BaseGrid(NamedTuple):
    """One grid of a base."""

    name: str
    patches: GridPatches
    is_declared: bool  # whether its accuracy is
    findings: tuple[str, ...]


@dataclass(frozen=True)
class BaseElevation:
    """Real elevation beneath a sketch; equal if `id`, a hash of samples, places and margin, is."""

    grids: tuple[BaseGrid, ...] = field(compare=False)  # in the order of the rasters, equal ones once
    patchwork: Patchwork = field(compare=False, repr=False)
    fade: RimFade = field(compare=False, repr=False)  # 0 at the outermost rim, 1 a margin inside of it
    margin: float = field(compare=False)  # m
    id: bytes
    findings: tuple[str, ...] = field(compare=False)  # in the data, and what was done to them; a line each

    def heights(
        self, x: Float64Array, y: Float64Array, cell_size: float, values: Float64Array | None = None
    ) -> Heights:
        """Return the data's surface for cells (m) at points (m from the sketch's south-west corner).

        Values (grids, k), in the order of the patchwork, have means there.
        """
        work, cover = self.patchwork, self.patchwork.cover_for_cells(cell_size)
        flat = np.stack([np.ravel(x), np.ravel(y)])
        values = np.zeros((0, 0)) if values is None else values
        found = np.empty((5 + values.shape[1], flat.shape[1]))
        groups = [np.arange(flat.shape[1])] if flat.size else []
        while groups:  # that need few patches in memory
            group = groups.pop()
            low, high = flat[:, group].min(axis=1).tolist(), flat[:, group].max(axis=1).tolist()
            which = work.within(cover, (*low, *high))
            if len(which) > _AT_ONCE and len(group) > 1:
                axis = int(high[1] - low[1] > high[0] - low[0])
                groups += np.array_split(group[np.argsort(flat[axis, group], kind="stable")], 2)
                continue
            heights = work.surface(which).evaluate(flat[0, group], flat[1, group], values)
            found[:, group] = np.vstack([*heights[:5], heights.means])
        height, east, north, weight, patches = found[:5].reshape(5, *np.shape(x))
        means = found[5:].reshape(values.shape[1], *np.shape(x))
        return Heights(height, east, north, weight, patches, means)

    def weight(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the weight of the data at points (m), C²."""
        return self.fade.weight(x, y)

    @property
    def facts(self) -> dict[str, Any]:
        """Entries of reports; `error` (m) is the largest of the finest surface."""
        errors = self.patchwork.error[self.patchwork.cover(0.0)]
        names = ("name", "rows", "columns", "step", "accuracy")
        parts = [(each.name, each.patches) for each in self.grids]
        rows = [(name, *part.shape, part.step, part.accuracy) for name, part in parts]
        return {
            "id": self.id.hex(),
            "grids": [dict(zip(names, row, strict=True)) for row in rows],
            "error": float(errors.max()),
            "margin": self.margin,
            "findings": list(self.findings),
        }


def load_base(sketch: Sketch, run: Runner) -> BaseElevation | None:
    """Return the real elevation beneath a sketch; None without rasters whose role is elevation.

    Patches are stored on disk (`PatchStore`); their tables and the patchwork are kept by `run`. Raise
    InputError, in one line that names the raster, if a file is missing, has changed or cannot be read.
    """
    if not sketch.elevation_rasters:
        return None
    frame = _frame_of(sketch)
    options = {"vertical": sketch.frame["vertical"], "margin": sketch.base["margin"], "extent": sketch.extent}
    base = combine_rasters(sketch.elevation_rasters, frame, run, **options)
    findings = list(base.findings)
    for each in base.grids:
        box = np.array(each.patches.box)
        if (box[2:] <= 0.0).any() or (box[:2] >= sketch.size).any():
            findings.append(f"{each.name}: lies outside of the sketch")
    return replace(base, findings=tuple(findings))


def combine_rasters(
    sources: Sequence[RasterSource],
    frame: SketchFrame,
    run: Runner,
    *,
    vertical: str = "",
    margin: float = -1.0,
    extent: float | None = None,
) -> BaseElevation:
    """Return the base of at least one raster in a frame; as `load_base`, by the names of its keys.

    `extent` (m) is that of the sketch; by default of the largest one on the data.
    """
    loaded = [_load_grid(source, frame, vertical, run) for source in sources]
    grids = tuple({each.patches.id: each for each in loaded}.values())
    findings = [f"{each.name}: {line}" for each in grids for line in each.findings]
    if len(grids) < len(loaded):
        findings.append(f"{len(loaded) - len(grids)} rasters have the content and place of another one")
    used_parts = [each.patches for each in grids]
    work = run(Patchwork, {part.id: part for part in used_parts}, hashed=False)
    names = [each.name for each in grids]
    offsets = run(measure_offsets, used_parts)
    findings += [line for each in offsets for line in each.finding(used_parts, names)]
    sides = work.box[2:] - work.box[:2]
    start = NODE_REACH * float(sides.max() if extent is None else extent) / NODES
    used = _allowed_margin(sides, margin, start)
    if 0.0 <= margin != used:
        findings.append(f"margin = {margin:g}: {used:.4g} m is what the extent of the data allows")
    digest = blake2b(b"".join(work.grids) + np.array([used, start]).tobytes(), digest_size=16)
    fade = run(Patchwork.rim_fade, work, used, start, hashed=False)
    return BaseElevation(grids, work, fade, used, digest.digest(), tuple(findings))


def _load_grid(source: RasterSource, frame: SketchFrame, datum: str, run: Runner) -> BaseGrid:
    """Return the patches of a raster."""
    if problem := raster_problem(source):
        raise InputError(problem)
    stated = [each for name, each in source.values.items() if name not in ("path", "role", "sha256")]
    values = (stated, frame.crs, datum, geoid_files())
    stamps = [] if source.content is not None else file_stamps(Path(source.path))
    # Stores are of the CRS, and patches are moved to the sketch's corner.
    key = repr((content_hash(source), Path(source.path).name, values, stamps))
    return run(_built_grid, source, frame, datum, key, hashed=False)


def _built_grid(source: RasterSource, frame: SketchFrame, datum: str, key: str) -> BaseGrid:
    part, findings = PatchStore().load(key, lambda: grid_in_datum(source, SketchFrame(frame.crs), datum))
    return BaseGrid(source.title, part.moved(frame.east, frame.north), source.accuracy >= 0.0, findings)


def patches_of(sketch: Sketch) -> list[GridPatches]:
    """Return the patches of each elevation raster of a sketch."""
    frame, datum, run = _frame_of(sketch), sketch.frame["vertical"], Runner()
    return [_load_grid(each, frame, datum, run).patches for each in sketch.elevation_rasters]


def held_grids(sketch: Sketch) -> list[ElevationGrid]:
    """Return the elevation grids of a sketch, with all their samples in memory."""
    frame, found = _frame_of(sketch), []
    for source in sketch.elevation_rasters:
        with grid_in_datum(source, frame, sketch.frame["vertical"]) as grid:
            if math.prod(grid.shape) > _MOST_HELD:
                raise InputError(f"{grid.name}: expected at most {_MOST_HELD} samples for this")
            found.append(grid.held())
    return found


@contextmanager
def grid_in_datum(source: RasterSource, frame: SketchFrame, datum: str) -> Iterator[ElevationGrid]:
    """Yield the grid of a raster with heights above the sketch's datum; rows are read until the end.

    A grid without a CRS has the coordinates of the sketch's frame. Errors become InputErrors that name it.
    """
    accuracy = None if source.accuracy < 0.0 else source.accuracy
    with raster_file(source) as path:
        grid = read_grid(path, frame, source, accuracy=accuracy)
        if not grid.crs:
            grid = grid.moved(frame.east, frame.north)
        grid = convert_heights(grid, datum, source.vertical)
        if source.offset:
            told = f"{source.offset:+g} m added to all heights"
            rise = np.float32(source.offset)
            grid = grid.raised(lambda first, last: rise, findings=(*grid.findings, told))
        yield grid


def _frame_of(sketch: Sketch) -> SketchFrame:
    return SketchFrame(*(sketch.frame[key] for key in SketchFrame._fields))


def _allowed_margin(sides: Float64Array, asked: float, start: float) -> float:
    """Return the margin (m) of the fade: as asked, automatic if negative, within what the data allow."""
    shorter = float(sides.min())
    least = max(8.0 * math.sqrt(float(sides.prod()) / _MOST_NODES), 2.5 * start)
    return max(min(asked if asked >= 0.0 else _AUTOMATIC * shorter, _MOST * shorter), least)
