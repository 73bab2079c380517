"""What an export will be: where it is sampled and how it is cut, known before any work is done."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.export.height_steps import HeightSteps
from sketchterrain.export.sampled import Grid
from sketchterrain.export.target import ExportOptions, Target
from sketchterrain.export.tiling import Tiling
from sketchterrain.metric_crs import parse_metric_crs

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch


_EVERYWHERE = frozenset({"plants", "grass"})  # options that all targets heed
_ROUNDING = 1e-9  # of a vertex: 1024.0000000001 m at 1 m are 1025 vertices


@dataclass(frozen=True)
class Plan:
    """An export that can be made; of its options, size and format are set."""

    target: Target
    options: ExportOptions
    grid: Grid
    tiling: Tiling

    @property
    def vertices(self) -> int:
        """Of the whole."""
        return self.grid.columns * self.grid.rows

    @property
    def tile_side(self) -> tuple[int, int]:
        """Columns and rows of vertices of a tile."""
        sides = (self.grid.columns, self.tiling.columns), (self.grid.rows, self.tiling.rows)
        columns, rows = (self.tiling.side(*each) for each in sides)
        return columns, rows


def option_names(target: Target) -> tuple[str, ...]:
    """Return the names of the options that a target heeds, in the order of `ExportOptions`."""
    size = () if target.spacing is not None else ("size",)
    heeded = target.knows | _EVERYWHERE | frozenset(size)
    return tuple(each.name for each in fields(ExportOptions) if each.name in heeded)


def plan(sketch: Sketch, target: Target, options: ExportOptions) -> Plan:
    """Return what an export will be.

    The grid is the sketch's rectangle. For square tiles it is as many of them as were asked for, over the
    sketch from its south-west corner on: the world goes on outside of the sketch. The same holds where a
    target wants just so many metres between vertices.

    Raises
    ------
    InputError
        If an option is not the target's, a size is not, or the grid cannot be cut; with the nearest that can.
    """
    _check_options(target, options)
    _check_numbers(options)
    tiling = _tiling(target, options)
    if options.crs is not None:
        parse_metric_crs(options.crs)
    if target.check is not None:
        target.check(options)
    grid = _grid(sketch.size, target, tiling, options.size)
    if target.most is not None and max(grid.columns, grid.rows) > target.most:
        raise InputError(
            f"{target.name}: {grid.columns} × {grid.rows} vertices {target.spacing:g} m apart, "
            f"it takes {target.most} each way at most: expected a smaller extent"
        )
    made = options.format or (target.formats[0] if target.formats else None)
    whole = replace(options, size=max(grid.columns, grid.rows), format=made)
    return Plan(target, whole, grid, tiling)


def _check_options(target: Target, options: ExportOptions) -> None:
    heeded, usual = option_names(target), ExportOptions()
    for each in fields(options):
        if each.name in heeded or getattr(options, each.name) == getattr(usual, each.name):
            continue
        if each.name == "size":
            raise InputError(f"{target.name}: no size can be chosen, vertices are {target.spacing:g} m apart")
        if each.name == "overlap" and "tiles" in heeded:
            usual_overlap = {0: "nothing", 1: "an edge"}[target.tiling.overlap if target.tiling else 1]
            raise InputError(f"{target.name}: no overlap can be chosen, tiles share {usual_overlap}")
        known = ", ".join(name.replace("_", "-") for name in heeded)
        raise InputError(f"{target.name} has no option {each.name.replace('_', '-')}, only {known}")
    if options.format is not None and options.format not in target.formats:
        formats = " or ".join(target.formats)
        raise InputError(f"{target.name}: expected {formats} as format, got {one_line(options.format)!r}")
    if options.grass and not options.plants:
        raise InputError("grass without plants: expected either, or no option grass")


def _check_numbers(options: ExportOptions) -> None:
    if options.heights is not None:
        HeightSteps.between(*options.heights)
    if options.error is not None and not 0.0 < options.error < math.inf:
        raise InputError(f"error = {options.error:g}: expected more than 0 m")
    if not all(math.isfinite(each) for each in options.origin):
        raise InputError(f"origin {options.origin}: expected two finite numbers, m")


def _tiling(target: Target, options: ExportOptions) -> Tiling:
    usual = target.tiling or Tiling()
    columns, rows = options.tiles
    return Tiling(
        columns,
        rows,
        overlap=usual.overlap if options.overlap is None else options.overlap,
        pattern=usual.pattern if options.tile_name is None else options.tile_name,
        first=usual.first if options.tile_first is None else options.tile_first,
        from_south=usual.from_south if options.tiles_from_south is None else options.tiles_from_south,
    )


def _grid(length: tuple[float, float], target: Target, tiling: Tiling, size: int | None) -> Grid:
    if target.spacing is not None:
        return _spaced(length, target.spacing, target.multiple, tiling)
    if size is not None and size < 2:
        raise InputError(f"size = {size}: expected 2 or more vertices")
    if target.square:
        return _squares(length, target, tiling, size)
    return _rectangle(length, target, tiling, size)


def _rectangle(length: tuple[float, float], target: Target, tiling: Tiling, size: int | None) -> Grid:
    """Return a grid over the sketch; along its shorter side vertices are as far apart as tiles allow."""
    counts = (tiling.columns, tiling.rows)
    longer = 0 if length[0] >= length[1] else 1
    side = _side(target, tiling, counts[longer], size)
    cell = length[longer] / (side - 1)
    about = max(2, round(length[1 - longer] / cell) + 1)
    other = min(tiling.nearest(about, counts[1 - longer]), key=lambda each: abs(each - about))
    columns, rows = (side, other) if longer == 0 else (other, side)
    return Grid(0.0, 0.0, *length, columns, rows)


def _squares(length: tuple[float, float], target: Target, tiling: Tiling, size: int | None) -> Grid:
    """Return a grid of square tiles that covers the sketch, square quads all over."""
    most = max(tiling.columns, tiling.rows)
    side = tiling.side(_side(target, tiling, most, size), most)
    columns, rows = (tiling.whole(side, tiles) for tiles in (tiling.columns, tiling.rows))
    across, up = columns - 1, rows - 1
    if length[0] / across >= length[1] / up:
        return Grid(0.0, 0.0, length[0], length[0] * (up / across), columns, rows)
    return Grid(0.0, 0.0, length[1] * (across / up), length[1], columns, rows)


def _spaced(length: tuple[float, float], spacing: float, multiple: int, tiling: Tiling) -> Grid:
    """Return a grid over the sketch, its vertices just so far apart; its outermost ones may lie beyond.

    Where vertices come in multiples one of them is a pixel, and the last one stands for the ground up to the
    sketch's edge: 4096 m are 4096 pixels of 1 m. Else 4096 m are 4097 vertices.
    """
    quads = [math.ceil(each / spacing - _ROUNDING) for each in length]
    if multiple > 1:  # of each tile
        whole = [multiple * tiles for tiles in (tiling.columns, tiling.rows)]
        least = [max(-(-each // of), 1) * of for each, of in zip(quads, whole, strict=True)]
    else:
        least = [max(each, 1) + 1 for each in quads]
    columns, rows = (
        next(each for each in tiling.nearest(many, tiles) if each >= many)
        for many, tiles in zip(least, (tiling.columns, tiling.rows), strict=True)
    )
    return Grid(0.0, 0.0, (columns - 1) * spacing, (rows - 1) * spacing, columns, rows)


def _side(target: Target, tiling: Tiling, tiles: int, size: int | None) -> int:
    """Return the vertices of a side that is cut into so many tiles, checked."""
    if target.sizes:
        return _legal_side(target, tiling, tiles, size)
    if size is None:
        return min(tiling.nearest(target.size, tiles), key=lambda each: abs(each - target.size))
    tiling.side(size, tiles)
    return size


def _legal_side(target: Target, tiling: Tiling, tiles: int, size: int | None) -> int:
    whole = {side: tiling.whole(side, tiles) for side in target.sizes if tiles == 1 or side > tiling.overlap}
    wanted = whole.get(target.size) if size is None else size
    if wanted is not None and wanted in whole.values():
        return wanted
    if size is None or not whole:
        raise InputError(f"{target.name}: tiles cannot share {tiling.overlap} vertices")
    below = max((each for each in whole.values() if each < size), default=None)
    above = min((each for each in whole.values() if each > size), default=None)
    named = " or ".join(str(each) for each in (below, above) if each is not None)
    of_tiles = f" in {tiles} tiles" if tiles > 1 else ""
    sides = ", ".join(str(side) for side in target.sizes)
    raise InputError(
        f"{target.name}: {size} vertices{of_tiles} is no size it takes; the nearest: {named} "
        f"(a tile's side has {sides})"
    )
