"""Export targets: the record of an engine or file format, its options and its output."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from sketchterrain.export.sampled import SampleGrid, TerrainSamples
from sketchterrain.export.tiling import Tiling

if TYPE_CHECKING:
    from sketchterrain.terrain import Terrain


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export; those that a target does not support must have their defaults."""

    size: int | None = None  # vertices along the longer side of the whole grid; None: the target's default
    tiles: tuple[int, int] = (1, 1)  # columns, rows
    overlap: int | None = None  # vertices shared by neighbouring tiles; None: the target's default
    tile_name: str | None = None  # pattern, see `Tiling`; None: the target's
    tile_first: int | None = None  # number of the first tile; None: the target's
    tiles_from_south: bool | None = None  # whether y counts from the south; None: the target's
    format: str | None = None  # one of the target's; None: its first
    heights: tuple[float, float] | None = None  # m, range of 16-bit heights; None: fitted to the terrain
    error: float | None = None  # m, largest error of a mesh; None: a mesh of all vertices
    crs: str | None = None  # as GDAL reads it, "EPSG:25832"; None: local metres
    origin: tuple[float, float] = (0.0, 0.0)  # the sketch's south-west corner in the CRS
    plants: bool = True  # write trees and shrubs
    grass: bool = False  # write grass, flowers and ferns as well


class ProgressStages(Protocol):
    """Timed stages of work, see `sketchterrain.progress.Stages`."""

    def stage(self, name: str, title: str) -> AbstractContextManager[Callable[[float], None]]:
        """Time a stage, and yield a function that reports its progress, 0 … 1."""


@dataclass(frozen=True, eq=False)
class Export:
    """Input of a target's writer: one sampled terrain and where to write it."""

    terrain: Terrain
    name: str  # of the sketch, as part of file names
    options: ExportOptions  # resolved: size and format are set
    grid: SampleGrid  # of all tiles
    tiling: Tiling
    samples: TerrainSamples  # at the grid's vertices
    folder: Path  # a staging folder: all files are moved to their destination together
    stages: ProgressStages


class ExportOutput(NamedTuple):
    """Files that a target wrote, and what the sidecar records of them."""

    files: dict[Path, str]  # each file and its description
    settings: dict[str, Any] = {}  # noqa: RUF012 # import settings, named as in the target program
    facts: dict[str, Any] = {}  # noqa: RUF012 # byte order, height encoding, orientation, tiles, errors


@dataclass(frozen=True)
class Target:
    """An engine, a program or a plain file format to export to."""

    name: str  # on the command line
    title: str
    summary: str  # of the files, one line
    write: Callable[[Export], ExportOutput]  # writes all files but the sidecar
    sizes: tuple[int, ...] = ()  # vertices that a tile's side may have; empty: any
    size: int = 1025  # default vertices along the longer side
    square: bool = False  # whether tiles must be square
    spacing: float | None = None  # m between vertices where the target prescribes it; determines the size
    multiple: int = 1  # with a spacing: vertices along a tile's side are multiples of it
    max_vertices: int | None = None  # with a spacing: along a side of the whole grid
    formats: tuple[str, ...] = ()  # of heights, the default first
    options: frozenset[str] = frozenset()  # names of supported `ExportOptions`; size, plants, grass implied
    tiling: Tiling | None = None  # defaults of tile names and numbers; None: tiles are not supported
    check: Callable[[ExportOptions], None] | None = None  # raises `InputError` for invalid options
    disk: float = 16.0  # upper bound, bytes per vertex of all files
    memory: float = 16.0  # upper bound, bytes per vertex of writing, besides the samples
    bytes_per_plant: float = 100.0  # upper bound, of all files
