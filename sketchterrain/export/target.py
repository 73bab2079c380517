"""What a target is: a program that a terrain is taken to, or a plain format."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from sketchterrain.export.sampled import Grid, Sampled
from sketchterrain.export.tiling import Tiling

if TYPE_CHECKING:
    from sketchterrain.terrain import Terrain


@dataclass(frozen=True)
class ExportOptions:
    """What can be asked of an export; what a target does not know must be as it is here.

    Attributes
    ----------
    size : int or None
        Vertices along the longer side of the whole; None: what suits the target.
    tiles : (int, int)
        Columns and rows of tiles.
    overlap : int or None
        Vertices that tiles share; None: as the target wants it.
    tile_name : str or None
        Pattern, see `Tiling`; None: the target's.
    tile_first : int or None
        Number of the first tile; None: the target's.
    tiles_from_south : bool or None
        Whether y counts from the south; None: as the target wants it.
    format : str or None
        One of the target's; None: its first.
    heights : (float, float) or None
        m: lowest and highest height of 16-bit numbers, the same for many terrains; None: what is there.
    error : float or None
        m that a mesh may be off; None: a mesh of all vertices.
    crs : str or None
        Coordinate reference system as GDAL reads it, "EPSG:25832"; None: metres that lie nowhere on Earth.
    origin : (float, float)
        Where the sketch's south-west corner lies in it.
    plants, grass : bool
        Whether trees and shrubs are written, and grass, flowers and ferns besides.
    """

    size: int | None = None
    tiles: tuple[int, int] = (1, 1)
    overlap: int | None = None
    tile_name: str | None = None
    tile_first: int | None = None
    tiles_from_south: bool | None = None
    format: str | None = None
    heights: tuple[float, float] | None = None
    error: float | None = None
    crs: str | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    plants: bool = True
    grass: bool = False


class Tellable(Protocol):
    """Stages of work, see `sketchterrain.progress.Stages`."""

    def stage(self, name: str, title: str) -> AbstractContextManager[Callable[[float], None]]:
        """Time what is done within, and tell that it is being done."""


@dataclass(frozen=True, eq=False)
class Export:
    """One terrain on its way into a target's files.

    Attributes
    ----------
    terrain : Terrain
    name : str
        Of the sketch, as file names can have it.
    options : ExportOptions
        As they count: size and format are set.
    grid : Grid
        Vertices of the whole.
    tiling : Tiling
    sampled : Sampled
        The terrain at the grid's vertices.
    folder : Path
        To write into; a hidden one: all files come into the person's folder together.
    stages : Tellable
    """

    terrain: Terrain
    name: str
    options: ExportOptions
    grid: Grid
    tiling: Tiling
    sampled: Sampled
    folder: Path
    stages: Tellable


class Written(NamedTuple):
    """What a target wrote.

    Attributes
    ----------
    files : dict of Path to str
        Each file and what it is, one line.
    settings : dict
        What to type in where the files are imported, in the words of that program.
    facts : dict
        What else the sidecar says: byte order, steps of heights, orientation, tiles, errors; JSON.
    """

    files: dict[Path, str]
    settings: dict[str, Any] = {}  # noqa: RUF012 # a NamedTuple's default, never changed
    facts: dict[str, Any] = {}  # noqa: RUF012


@dataclass(frozen=True)
class Target:
    """A program that a terrain is taken to, or a plain format.

    Attributes
    ----------
    name : str
        As the command line has it.
    title : str
        As a person knows it.
    line : str
        What is written, in one line.
    write : callable
        Takes an `Export`, writes all files but the sidecar, returns `Written`.
    sizes : tuple of int
        Vertices that a tile's side may have; empty: any.
    size : int
        Vertices along the longer side unless something else is asked for.
    square : bool
        Whether tiles must be square: the square over the sketch's longer side is taken then.
    spacing : float or None
        m between vertices, where the target wants just that: the size follows from it.
    multiple : int
        With a spacing: columns and rows of a tile are whole multiples of it.
    most : int or None
        With a spacing: vertices along a side of the whole, at most.
    formats : tuple of str
        Formats of heights that can be chosen, the usual one first.
    knows : frozenset of str
        Names of the `ExportOptions` that it heeds, besides ``size``, ``plants`` and ``grass``: ``tiles``,
        ``overlap``, ``tile_name``, ``tile_first`` and ``tiles_from_south`` each, ``format`` and so on.
    tiling : Tiling or None
        How tiles are named and numbered; None: it has no tiles.
    check : callable or None
        Takes the options and raises `InputError` where they cannot be meant, before any work is done.
    disk, memory : float
        Bytes a vertex, at most: that its files take, and that writing them takes besides what was sampled.
    bytes_per_plant : float
        Of its files, at most.
    """

    name: str
    title: str
    line: str
    write: Callable[[Export], Written]
    sizes: tuple[int, ...] = ()
    size: int = 1025
    square: bool = False
    spacing: float | None = None
    multiple: int = 1
    most: int | None = None
    formats: tuple[str, ...] = ()
    knows: frozenset[str] = field(default_factory=frozenset)
    tiling: Tiling | None = None
    check: Callable[[ExportOptions], None] | None = None
    disk: float = 16.0
    memory: float = 16.0
    bytes_per_plant: float = 100.0
