"""Real elevation beneath a sketch: the patchwork of its elevation rasters and the fade at its rim."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.rasters import RasterSource, content_hash, raster_problem
from sketchterrain.document.sketch import Sketch
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.patches import GridPatches, build_patches
from sketchterrain.elevation.selection import Patchwork, RimFade
from sketchterrain.elevation.surface import Heights
from sketchterrain.errors import InputError, one_line

_AUTOMATIC, _MOST = 0.04, 0.4  # margin over the shorter side of the data; at most the weight reaches 1 inside
_MOST_NODES = 1 << 20  # of the fade, which has eight along the margin
_LAST = "last patchwork"  # key of the one from which the next is made
_SUFFIXES: Final = {b"II": ".tif", b"MM": ".tif", b"\x93N": ".npy"}  # by the first bytes


class BaseGrid(NamedTuple):
    """One grid of a base."""

    name: str
    shape: tuple[int, int]  # rows and columns
    patches: GridPatches
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

    def heights(self, x: Float64Array, y: Float64Array, cell_size: float) -> Heights:
        """Return the data's surface for cells (m) at points (m from the sketch's south-west corner)."""
        cover = self.patchwork.cover_for_cells(cell_size)
        area = (float(x.min()), float(y.min()), float(x.max()), float(y.max())) if np.size(x) else (0.0,) * 4
        return self.patchwork.surface(self.patchwork.within(cover, area)).evaluate(x, y)

    def weight(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the weight of the data at points (m), C²."""
        return self.fade.weight(x, y)

    @property
    def facts(self) -> dict[str, Any]:
        """Entries of reports; `error` (m) is the largest of the finest surface."""
        patches, finest = self.patchwork.patches, self.patchwork.cover(0.0)
        names = ("name", "rows", "columns", "step", "accuracy")
        rows = [(each.name, *each.shape, each.patches.step, each.patches.accuracy) for each in self.grids]
        return {
            "id": self.id.hex(),
            "grids": [dict(zip(names, row, strict=True)) for row in rows],
            "error": 0.0 if patches is None else float(patches.error[finest].max()),
            "margin": self.margin,
            "findings": list(self.findings),
        }


def load_base(sketch: Sketch, memory: LRUCache) -> BaseElevation | None:
    """Return the real elevation beneath a sketch; None without rasters whose role is elevation.

    Patches and the last patchwork are cached in `memory`, which changes no bit. Raise InputError, in one line
    that names the raster, if a file is missing, has changed or cannot be read.
    """
    if not sketch.elevation_rasters:
        return None
    frame = SketchFrame(*(sketch.frame[key] for key in SketchFrame._fields))
    options = {"vertical": sketch.frame["vertical"], "margin": sketch.base["margin"]}
    base = combine_rasters(sketch.elevation_rasters, frame, memory, **options)
    findings = list(base.findings)
    for each in base.grids:
        box = each.patches.patches.kernel
        if (box[:, 2:].max(axis=0) <= 0.0).any() or (box[:, :2].min(axis=0) >= sketch.size).any():
            findings.append(f"{each.name}: lies outside of the sketch")
    return replace(base, findings=tuple(findings))


def combine_rasters(
    sources: Sequence[RasterSource],
    frame: SketchFrame,
    memory: LRUCache,
    *,
    vertical: str = "",
    margin: float = -1.0,
) -> BaseElevation:
    """Return the base of at least one raster in a frame; as `load_base`, by the names of its keys."""
    loaded = [_load_grid(source, frame, vertical, memory) for source in sources]
    grids = tuple({each.patches.id: each for each in loaded}.values())
    findings = [f"{each.name}: {line}" for each in grids for line in each.findings]
    if len(grids) < len(loaded):
        findings.append(f"{len(loaded) - len(grids)} rasters have the content and place of another one")
    work = _patchwork({each.patches.id: each.patches for each in grids}, memory)
    box = np.concatenate([each.patches.patches.kernel for each in grids])
    used = _allowed_margin(box[:, 2:].max(axis=0) - box[:, :2].min(axis=0), margin)
    if 0.0 <= margin != used:
        findings.append(f"margin = {margin:g}: {used:.4g} m is what the extent of the data allows")
    digest = blake2b(b"".join(work.grids) + np.float64(used).tobytes(), digest_size=16)
    fade = memory.get_or_compute(("rim fade", digest.digest()), lambda: work.rim_fade(used))
    return BaseElevation(grids, work, fade, used, digest.digest(), tuple(findings))


def _load_grid(source: RasterSource, frame: SketchFrame, datum: str, memory: LRUCache) -> BaseGrid:
    """Return the patches of a raster."""

    def built() -> BaseGrid:
        grid = _in_datum(grid_at(source, frame), source, datum)
        return BaseGrid(source.title, grid.samples.shape, build_patches(grid), grid.findings)

    if problem := raster_problem(source):
        raise InputError(problem)
    values = (source.band, source.accuracy, source.vertical, source.offset)
    key = ("elevation grid", content_hash(source), Path(source.path).name, values, frame, datum)
    return memory.get_or_compute(key, built)


def grid_at(source: RasterSource, frame: SketchFrame) -> ElevationGrid:
    """Return the grid of a raster, without its offset; raise InputError that names it.

    A grid without a CRS has the coordinates of the sketch's frame.
    """
    accuracy = None if source.accuracy < 0.0 else source.accuracy
    with _file_of(source) as path:
        try:
            grid = read_grid(path, frame, band=source.band, accuracy=accuracy)
        except InputError as error:
            reason = str(error).replace(one_line(path), path.name).removeprefix(f"{path.name}: ")
            raise InputError(f"raster {one_line(source.path)}: {reason}") from None
    a, b, c, d, e, f = grid.place
    return grid if grid.crs else replace(grid, place=(a, b, c - frame.east, d, e, f - frame.north))


def _in_datum(grid: ElevationGrid, source: RasterSource, datum: str) -> ElevationGrid:
    """Return a grid with heights above the sketch's datum, the source's offset added."""
    findings = list(grid.findings)
    if source.vertical and datum and source.vertical != datum:
        findings.append(f"heights above {source.vertical}, not converted to the sketch's {datum}")
    if source.offset:
        findings.append(f"{source.offset:+g} m added to all heights")
    return replace(grid, samples=grid.samples + np.float32(source.offset), findings=tuple(findings))


def _patchwork(grids: dict[bytes, GridPatches], memory: LRUCache) -> Patchwork:
    """Return the patchwork of grids, changed from the last one where that is less work; the same bits."""
    work: Patchwork = memory.get(_LAST) or Patchwork()
    if not work.grids.keys() & grids.keys():
        return memory.store(_LAST, Patchwork(grids))
    for key in work.grids.keys() - grids.keys():
        work = work.without_grid(key)
    for each in grids.values():
        work = work.with_grid(each)
    return memory.store(_LAST, work)


def _allowed_margin(sides: Float64Array, asked: float) -> float:
    """Return the margin (m) of the fade: as asked, automatic if negative, within what the data allow."""
    shorter = float(sides.min())
    least = 8.0 * math.sqrt(float(sides.prod()) / _MOST_NODES)
    return max(min(asked if asked >= 0.0 else _AUTOMATIC * shorter, _MOST * shorter), least)


@contextmanager
def _file_of(source: RasterSource) -> Iterator[Path]:
    """Yield a source's file; one stored in the sketch is written to a temporary one of its format."""
    if source.content is None:
        yield Path(source.path)
        return
    head = source.content[:200].lstrip().lower()
    suffix = _SUFFIXES.get(source.content[:2], ".asc" if head.startswith(b"ncols") else ".hgt")
    if head.startswith(b"pk"):
        suffix = ".npz" if b".npy" in head else ".zip"
    with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
        name = Path(source.path).stem.rpartition("-")[0]  # without the hash: that of an HGT is its place
        path = Path(folder) / (name + suffix)
        path.write_bytes(source.content)
        yield path
