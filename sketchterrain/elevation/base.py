"""Real elevation beneath a sketch: the patchwork of its elevation rasters and the fade at its rim."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.document.rasters import RasterSource, content_hash, raster_file, raster_problem
from sketchterrain.document.sketch import Sketch
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.offsets import measure_offsets
from sketchterrain.elevation.patches import GridPatches
from sketchterrain.elevation.raster_reader import file_stamps
from sketchterrain.elevation.selection import Patchwork, RimFade
from sketchterrain.elevation.store import PatchStore
from sketchterrain.elevation.surface import Heights
from sketchterrain.elevation.vertical import convert_heights, geoid_files
from sketchterrain.errors import InputError
from sketchterrain.stages.runner import Runner

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
