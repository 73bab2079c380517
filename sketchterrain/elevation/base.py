"""Real elevation beneath a sketch: the patchwork of its elevation rasters and the fade at its rim."""

from __future__ import annotations

import itertools
import math
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from hashlib import blake2b
from io import BytesIO
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

MARGIN_SHARE: Final = 0.04
"""Automatic margin, over the shorter side of the data."""

NODES: Final = 256
"""Nodes of the ground along a sketch's extent."""

NODE_REACH: Final = 3
"""Nodes by which splines, displaced by noise, reach beyond a node, and a little more."""

_MOST_MARGIN = 0.4  # over the shorter side: the weight reaches 1 in the middle
_MOST_NODES = 1 << 20  # of the fade, which has eight along the margin
_LAST = "last patchwork"  # key of the one from which the next is made
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_HGT_SIDES = (1201, 3601)


class BaseGrid(NamedTuple):
    """One grid of a base."""

    name: str
    shape: tuple[int, int]  # rows and columns
    patches: GridPatches
    findings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class BaseElevation:
    """Real elevation beneath a sketch; equal if `id`, a hash of samples, places and margin, is.

    Attributes
    ----------
    grids
        In the order of the sketch's rasters, equal ones once.
    fade
        Weight of the data, 0 at their outermost rim, 1 a `margin` (m) inside of it.
    findings
        What was found in the data and done to them, one line each.
    """

    grids: tuple[BaseGrid, ...]
    patchwork: Patchwork
    fade: RimFade
    margin: float
    id: bytes
    findings: tuple[str, ...]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, BaseElevation) and self.id == other.id

    def __hash__(self) -> int:
        return hash(self.id)

    def heights(self, x: Float64Array, y: Float64Array, cell_size: float) -> Heights:
        """Return the data's surface for cells (m) at points (m from the sketch's south-west corner)."""
        cover = self.patchwork.cover_for_cells(cell_size)
        area = (float(x.min()), float(y.min()), float(x.max()), float(y.max())) if np.size(x) else (0.0,) * 4
        return self.patchwork.surface(self.patchwork.within(cover, area)).evaluate(x, y)

    def weight(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the weight of the data at points (m), C²."""
        return self.fade.weight(x, y)

    @property
    def error(self) -> float:
        """Largest error (m) of the finest surface, from the accuracy of the grids it consists of."""
        patches = self.patchwork.patches
        return 0.0 if patches is None else float(patches.error[self.patchwork.cover(0.0)].max())

    @property
    def facts(self) -> dict[str, Any]:
        """Entries of reports."""
        grids = [
            {
                "name": each.name,
                "rows": each.shape[0],
                "columns": each.shape[1],
                "step": round(each.patches.step, 3),
                "accuracy": each.patches.accuracy,
                "patches": len(each.patches.patches),
            }
            for each in self.grids
        ]
        return {
            "id": self.id.hex(),
            "error": self.error,
            "margin": self.margin,
            "grids": grids,
            "findings": list(self.findings),
        }


def load_base(sketch: Sketch, memory: LRUCache) -> BaseElevation | None:
    """Return the real elevation beneath a sketch; None without rasters whose role is elevation.

    Patches and the last patchwork are cached in `memory`, which changes no bit.

    Raises
    ------
    InputError
        If a file is missing, has changed or cannot be read; in one line that names the raster.
    """
    if not sketch.elevation_rasters:
        return None
    place = sketch.frame
    base = combine_rasters(
        sketch.elevation_rasters,
        SketchFrame(place["crs"], place["east"], place["north"]),
        memory,
        vertical=place["vertical"],
        margin=sketch.base["margin"],
        extent=sketch.extent,
    )
    kernels = [each.patches.patches.kernel for each in base.grids]
    outside = [
        (box[:, 2:].max(axis=0) <= 0.0).any() or (box[:, :2].min(axis=0) >= sketch.size).any()
        for box in kernels
    ]
    far = [f"{each.name}: lies outside of the sketch" for each in itertools.compress(base.grids, outside)]
    return replace(base, findings=(*base.findings, *far)) if far else base


def combine_rasters(
    sources: Sequence[RasterSource],
    frame: SketchFrame,
    memory: LRUCache,
    *,
    vertical: str = "",
    margin: float = -1.0,
    extent: float | None = None,
) -> BaseElevation:
    """Return the base of at least one raster in a frame; as `load_base`, by the names of its keys.

    `extent` (m) is that of a sketch; by default of the largest one on the data.
    """
    loaded = [_load_grid(source, frame, vertical, memory) for source in sources]
    grids = tuple({each.patches.id: each for each in loaded}.values())
    findings = [f"{each.name}: {line}" for each in grids for line in each.findings]
    if len(grids) < len(loaded):
        findings.append(f"{len(loaded) - len(grids)} rasters have the content and place of another one")
    work = _patchwork({each.patches.id: each.patches for each in grids}, memory)
    box = np.concatenate([each.patches.patches.kernel for each in grids])
    sides = box[:, 2:].max(axis=0) - box[:, :2].min(axis=0)
    start = NODE_REACH * float(sides.max() if extent is None else extent) / NODES
    used = _allowed_margin(sides, margin, start)
    if 0.0 <= margin != used:
        findings.append(f"margin = {margin:g}: {used:.4g} m is what the extent of the data allows")
    digest = blake2b(b"".join(work.grids) + np.array([used, start]).tobytes(), digest_size=16)
    fade = memory.get_or_compute(("rim fade", digest.digest()), lambda: work.rim_fade(used, start))
    return BaseElevation(grids, work, fade, used, digest.digest(), tuple(findings))


def _load_grid(source: RasterSource, frame: SketchFrame, datum: str, memory: LRUCache) -> BaseGrid:
    """Return the patches of a raster; raise InputError that names it."""
    if problem := raster_problem(source):
        raise InputError(problem)

    def built() -> BaseGrid:
        grid = _in_datum(grid_at(source, frame), source, datum)
        with _named(source, grid.name):
            return BaseGrid(source.title, grid.samples.shape, build_patches(grid), grid.findings)

    values = (source.band, source.accuracy, source.vertical, source.offset)
    key = ("elevation grid", content_hash(source), Path(source.path).name, values, frame, datum)
    found: BaseGrid = memory.get_or_compute(key, built)
    return found


def grid_at(source: RasterSource, frame: SketchFrame) -> ElevationGrid:
    """Return the grid of a raster in a frame, without its offset; raise InputError that names it."""
    accuracy = None if source.accuracy < 0.0 else source.accuracy
    with _file_of(source) as path, _named(source, path.name, one_line(path)):
        return _placed(read_grid(path, frame, band=source.band, accuracy=accuracy), frame)


@contextmanager
def _named(source: RasterSource, *names: str) -> Iterator[None]:
    """Raise an InputError with the raster in place of the names of its temporary file and grid."""
    try:
        yield
    except InputError as error:
        reason = str(error)
        for name in names[1:]:
            reason = reason.replace(name, names[0])
        reason = reason.removeprefix(f"{names[0]}: ")
        raise InputError(f"raster {one_line(source.path)}: {reason}") from None


def _placed(grid: ElevationGrid, frame: SketchFrame) -> ElevationGrid:
    """Return a grid in sketch metres; one without a CRS has the coordinates of the sketch's frame."""
    if grid.crs:
        return grid
    a, b, c, d, e, f = grid.place
    return replace(grid, place=(a, b, c - frame.east, d, e, f - frame.north))


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


def _allowed_margin(sides: Float64Array, asked: float, start: float) -> float:
    """Return the margin (m) of the fade: as asked, automatic if negative, within what the data allow."""
    margin = asked if asked >= 0.0 else MARGIN_SHARE * float(sides.min())
    least = max(8.0 * math.sqrt(float(sides.prod()) / _MOST_NODES), 2.5 * start)
    return max(min(margin, _MOST_MARGIN * float(sides.min())), least)


@contextmanager
def _file_of(source: RasterSource) -> Iterator[Path]:
    """Yield a source's file; one stored in the sketch is written to a temporary one of its format."""
    if source.content is None:
        yield Path(source.path)
        return
    with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
        name = Path(source.path).stem.rpartition("-")[0]  # without the hash: that of an HGT is its place
        path = Path(folder) / (name + _suffix(source.content))
        path.write_bytes(source.content)
        yield path


def _suffix(content: bytes) -> str:
    """Return the usual suffix of a file of elevation; empty if its content is none."""
    if content.startswith(_TIFF):
        return ".tif"
    if content.startswith(b"\x93NUMPY"):
        return ".npy"
    if content.startswith(b"PK"):
        with suppress(zipfile.BadZipFile, ValueError, OSError), zipfile.ZipFile(BytesIO(content)) as archive:
            return ".npz" if any(each.endswith(".npy") for each in archive.namelist()) else ".zip"
    if content[:200].lstrip().lower().startswith(b"ncols"):
        return ".asc"
    return ".hgt" if len(content) in [2 * side * side for side in _HGT_SIDES] else ""
