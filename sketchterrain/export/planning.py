"""Export plans: height quantisation, sample grid, tiling and memory, checked before any work is done."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.document.frame import georeference
from sketchterrain.errors import InputError, one_line
from sketchterrain.export.sampled import BYTES_PER_VERTEX, SampleGrid, row_bands
from sketchterrain.export.target import ExportOptions, Target, Tiling
from sketchterrain.export.targets import target_named
from sketchterrain.io.crs import parse_metric_crs
from sketchterrain.io.files import format_bytes
from sketchterrain.io.system import physical_memory

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


_STEPS = 65536
_HIGHEST = _STEPS - 1
_DECIMALS = 3  # of fitted ranges, which users copy into import dialogs
_MIN_RANGE = 1.0  # m, also for flat terrain: engines refuse 0
_LIMIT = 1e5  # m; beyond it a step is metres


@dataclass(frozen=True)
class HeightQuantisation:
    """Heights as the numbers 0 … 65535: height = low + number · range / 65536, as engines scale them.

    Unity reads number / 65536 of its terrain's height, Unreal (number − 32768) / 128 of its Z scale in cm.
    """

    low: float  # m
    range: float  # m of 65536 steps

    @property
    def step(self) -> float:
        """The quantum (m); the error is at most half of it."""
        return self.range / _STEPS

    @property
    def highest(self) -> float:
        """The height of the number 65535 (m)."""
        return self.low + self.step * _HIGHEST

    @property
    def metadata(self) -> dict[str, Any]:
        """Its entry in the sidecar."""
        return {
            "numbers": "uint16",
            "metres": "low + number * metres_per_step",
            "low": self.low,
            "range": self.range,
            "metres_per_step": self.step,
            "height_of_65535": self.highest,
        }

    @classmethod
    def from_heights(
        cls, height: npt.NDArray[np.float32], requested: tuple[float, float] | None = None
    ) -> HeightQuantisation:
        """Return the requested range if all heights fit into it; by default the smallest that they fit into.

        A fitted range is in whole millimetres and at least 1 m.
        """
        low, high = float(height.min()), float(height.max())
        if requested is not None:
            steps = cls.from_range(*requested)
            if low < steps.low - 0.5 * steps.step or high > steps.highest + 0.5 * steps.step:
                lowest, highest = requested
                raise InputError(
                    f"heights {lowest:g},{highest:g}: the terrain goes from {low:.2f} to {high:.2f} m, "
                    f"which does not fit into them"
                )
            return steps
        unit = 10.0**_DECIMALS
        lowest = math.floor(low * unit) / unit
        least = (high - lowest) * (_STEPS / _HIGHEST)
        return cls(lowest, max(math.ceil(least * unit) / unit, _MIN_RANGE))

    @classmethod
    def from_range(cls, lowest: float, highest: float) -> HeightQuantisation:
        """Return the quantisation of a range (m)."""
        if not (math.isfinite(lowest) and math.isfinite(highest) and lowest < highest):
            raise InputError(f"heights {lowest:g},{highest:g}: expected the lowest and the highest, m")
        if max(-lowest, highest) > _LIMIT:
            raise InputError(f"heights {lowest:g},{highest:g}: expected them within ±{_LIMIT:g} m")
        return cls(lowest, highest - lowest)

    def encode(self, height: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
        """Return the nearest numbers, in the heights' shape."""
        result = np.empty(height.shape, np.uint16)
        for rows in row_bands(len(height)):
            number = np.rint((height[rows].astype(np.float64) - self.low) / self.step)
            if number.min() < 0 or number.max() > _HIGHEST:
                low, high = float(height[rows].min()), float(height[rows].max())
                valid = f"{self.low:g} to {self.highest:g} m"
                raise InputError(f"heights from {low:.2f} to {high:.2f} m do not fit into {valid}")
            result[rows] = number
        return result


_COMMON_OPTIONS = frozenset({"plants", "grass"})
_ROUNDING = 1e-9  # of a vertex: 1024.0000000001 m at 1 m are 1025 vertices


@dataclass(frozen=True)
class ExportPlan:
    """A valid export; size and format of its options are set."""

    target: Target
    options: ExportOptions
    grid: SampleGrid
    tiling: Tiling

    @property
    def vertices(self) -> int:
        """Number of vertices of the whole grid."""
        return self.grid.columns * self.grid.rows

    @property
    def tile_side(self) -> tuple[int, int]:
        """Columns and rows of vertices of a tile."""
        tiling = self.tiling
        return (
            tiling.tile_side(self.grid.columns, tiling.columns),
            tiling.tile_side(self.grid.rows, tiling.rows),
        )


def option_names(target: Target) -> tuple[str, ...]:
    """Return the names of a target's supported options, in the order of `ExportOptions`."""
    size = () if target.spacing is not None else ("size",)
    supported = target.options | _COMMON_OPTIONS | frozenset(size)
    return tuple(field.name for field in fields(ExportOptions) if field.name in supported)


def plan_export(sketch: Sketch, target: Target, options: ExportOptions) -> ExportPlan:
    """Resolve the options of an export; raise `InputError`, naming the nearest valid sizes.

    The grid covers the sketch. With square tiles or a prescribed spacing it starts at the sketch's south-west
    corner and may extend beyond it, where the terrain continues.
    """
    _check_options(target, options)
    default = target.tiling or Tiling()
    tiling = Tiling(
        *options.tiles,
        overlap=default.overlap if options.overlap is None else options.overlap,
        pattern=default.pattern if options.tile_name is None else options.tile_name,
        first=default.first if options.tile_first is None else options.tile_first,
        from_south=default.from_south if options.tiles_from_south is None else options.tiles_from_south,
    )
    if "crs" in option_names(target):
        crs, origin = georeference(sketch.frame, options.crs, options.origin)
        options = replace(options, crs=crs, origin=origin)
        if crs is not None:
            parse_metric_crs(crs)
    if target.check is not None:
        target.check(options)
    grid = _grid(sketch.size, target, tiling, options.size)
    if target.max_vertices is not None and max(grid.columns, grid.rows) > target.max_vertices:
        raise InputError(
            f"{target.name}: {grid.columns} × {grid.rows} vertices {target.spacing:g} m apart, "
            f"at most {target.max_vertices} along a side are supported: expected a smaller extent"
        )
    form = options.format or (target.formats[0] if target.formats else None)
    resolved = replace(options, size=max(grid.columns, grid.rows), format=form)
    return ExportPlan(target, resolved, grid, tiling)


def _check_options(target: Target, options: ExportOptions) -> None:
    supported, defaults = option_names(target), ExportOptions()
    for field in fields(options):
        if field.name in supported or getattr(options, field.name) == getattr(defaults, field.name):
            continue
        if field.name == "size":
            raise InputError(f"{target.name}: size is fixed, vertices are {target.spacing:g} m apart")
        if field.name == "overlap" and "tiles" in supported:
            shared = {0: "nothing", 1: "an edge"}[target.tiling.overlap if target.tiling else 1]
            raise InputError(f"{target.name}: overlap is fixed, tiles share {shared}")
        names = ", ".join(name.replace("_", "-") for name in supported)
        raise InputError(f"{target.name} has no option {field.name.replace('_', '-')}, only {names}")
    if options.format is not None and options.format not in target.formats:
        formats = " or ".join(target.formats)
        raise InputError(f"{target.name}: expected {formats} as format, got {one_line(options.format)!r}")
    if options.grass and not options.plants:
        raise InputError("grass without plants: expected both, or no option grass")
    if options.heights is not None:
        HeightQuantisation.from_range(*options.heights)
    if options.error is not None and not 0.0 < options.error < math.inf:
        raise InputError(f"error = {options.error:g}: expected more than 0 m")
    if not all(math.isfinite(coordinate) for coordinate in options.origin or ()):
        raise InputError(f"origin {options.origin}: expected two finite numbers, m")


def _grid(length: tuple[float, float], target: Target, tiling: Tiling, size: int | None) -> SampleGrid:
    if target.spacing is not None:
        return _grid_of_spacing(length, target.spacing, target.multiple, tiling)
    if size is not None and size < 2:
        raise InputError(f"size = {size}: expected 2 or more vertices")
    if target.square:
        return _grid_of_squares(length, target, tiling, size)
    return _grid_of_sketch(length, target, tiling, size)


def _grid_of_sketch(
    length: tuple[float, float], target: Target, tiling: Tiling, size: int | None
) -> SampleGrid:
    """Return a grid that covers the sketch; the spacing of its shorter side is as near as tiles allow."""
    tiles = (tiling.columns, tiling.rows)
    longer = 0 if length[0] >= length[1] else 1
    side = _side(target, tiling, tiles[longer], size)
    cell = length[longer] / (side - 1)
    ideal = max(2, round(length[1 - longer] / cell) + 1)
    other = min(tiling.nearest_sides(ideal, tiles[1 - longer]), key=lambda side: abs(side - ideal))
    columns, rows = (side, other) if longer == 0 else (other, side)
    return SampleGrid(0.0, 0.0, *length, columns, rows)


def _grid_of_squares(
    length: tuple[float, float], target: Target, tiling: Tiling, size: int | None
) -> SampleGrid:
    """Return a grid of square tiles and square quads that covers the sketch."""
    most = max(tiling.columns, tiling.rows)
    side = tiling.tile_side(_side(target, tiling, most, size), most)
    columns, rows = (tiling.grid_side(side, tiles) for tiles in (tiling.columns, tiling.rows))
    across, up = columns - 1, rows - 1
    if length[0] / across >= length[1] / up:
        return SampleGrid(0.0, 0.0, length[0], length[0] * (up / across), columns, rows)
    return SampleGrid(0.0, 0.0, length[1] * (across / up), length[1], columns, rows)


def _grid_of_spacing(
    length: tuple[float, float], spacing: float, multiple: int, tiling: Tiling
) -> SampleGrid:
    """Return a grid of a given spacing that covers the sketch; its last vertices may lie beyond it.

    With a multiple, vertices are pixels, the last one for the ground up to the sketch's edge: 4096 m are 4096
    pixels of 1 m. Else 4096 m are 4097 vertices.
    """
    tiles = (tiling.columns, tiling.rows)
    quads = [math.ceil(side / spacing - _ROUNDING) for side in length]
    if multiple > 1:  # of each tile
        steps = [multiple * count for count in tiles]
        least = [max(-(-count // step), 1) * step for count, step in zip(quads, steps, strict=True)]
    else:
        least = [max(count, 1) + 1 for count in quads]
    columns, rows = (
        next(side for side in tiling.nearest_sides(vertices, count) if side >= vertices)
        for vertices, count in zip(least, tiles, strict=True)
    )
    return SampleGrid(0.0, 0.0, (columns - 1) * spacing, (rows - 1) * spacing, columns, rows)


def _side(target: Target, tiling: Tiling, tiles: int, size: int | None) -> int:
    """Return the vertices along a side that is cut into tiles, or raise `InputError`."""
    if not target.sizes:
        if size is None:
            sides = tiling.nearest_sides(target.size, tiles)
            return min(sides, key=lambda side: abs(side - target.size))
        tiling.tile_side(size, tiles)
        return size
    valid = {
        side: tiling.grid_side(side, tiles) for side in target.sizes if tiles == 1 or side > tiling.overlap
    }
    requested = valid.get(target.size) if size is None else size
    if requested is not None and requested in valid.values():
        return requested
    if size is None or not valid:
        raise InputError(f"{target.name}: tiles cannot share {tiling.overlap} vertices")
    below = max((side for side in valid.values() if side < size), default=None)
    above = min((side for side in valid.values() if side > size), default=None)
    nearest = " or ".join(str(side) for side in (below, above) if side is not None)
    in_tiles = f" in {tiles} tiles" if tiles > 1 else ""
    raise InputError(
        f"{target.name}: {size} vertices{in_tiles} is not a valid size; nearest: {nearest} "
        f"(valid sides of a tile: {', '.join(map(str, target.sizes))})"
    )


_BYTES_AT_LEAST = 500 << 20  # the program, what a device compiles, a band of rows


def checked_plan(sketch: Sketch, target: str, options: ExportOptions) -> ExportPlan:
    """Return the plan of an export; raise InputError if it exceeds this machine's memory."""
    plan = plan_export(sketch, target_named(target), options)
    needed, available = memory_needed(plan), physical_memory()
    if needed > available:
        size = f"{plan.grid.columns} × {plan.grid.rows} vertices"
        raise InputError(
            f"{size} need about {format_bytes(needed)} of memory, this machine has {format_bytes(available)}"
        )
    return plan


def memory_needed(plan: ExportPlan) -> float:
    """Return the approximate memory of an export, bytes."""
    return _BYTES_AT_LEAST + plan.vertices * (BYTES_PER_VERTEX + plan.target.memory)
