"""Export targets: the record of an engine or file format, its options, tiles, output and sidecar."""

from __future__ import annotations

import json
import math
import re
import string
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError, one_line
from sketchterrain.export.files import write_json
from sketchterrain.export.sampled import ORIENTATION, SampleGrid, TerrainSamples

if TYPE_CHECKING:
    from sketchterrain.export.drapes import DrapedShapes
    from sketchterrain.generation.terrain import Terrain
    from sketchterrain.io.console import Stages


_FIELDS = ("name", "x", "y")
_MAX_NAME = 120  # characters: what file systems allow, less a suffix
_MAX_TILES = 1 << 16
_FORBIDDEN = re.compile(r'[<>:"/\\|?*]|\.\.|^\.|[. ]$')  # not allowed in file names on Windows


class TileWindow(NamedTuple):
    """One tile of a grid."""

    x: int  # numbers, as in its name
    y: int
    left: int  # first column and row in the whole grid
    top: int
    columns: int  # vertices
    rows: int


@dataclass(frozen=True)
class Tiling:
    """Division of a grid into tiles, and their names."""

    columns: int = 1  # tiles
    rows: int = 1
    overlap: int = 1  # vertices shared by neighbours: 1 is a common edge, 0 none
    pattern: str = "{name}_x{x}_y{y}"  # of names, also {x:02}
    first: int = 0  # number of the first tile in x and y
    from_south: bool = False  # whether y counts from the southern row

    def __post_init__(self) -> None:
        if self.columns < 1 or self.rows < 1 or self.columns * self.rows > _MAX_TILES:
            raise InputError(f"expected 1 to {_MAX_TILES} tiles, got {self.columns} × {self.rows}")
        if self.overlap < 0:
            raise InputError(f"expected an overlap of 0 or more vertices, got {self.overlap}")
        if self.first < 0:
            raise InputError(f"expected 0 or more as the first tile's number, got {self.first}")
        self._check_pattern()

    @property
    def count(self) -> int:
        """Number of tiles."""
        return self.columns * self.rows

    def tiles(self, columns: int, rows: int) -> Iterator[TileWindow]:
        """Return the tiles of a grid of vertices, from the north-west, row by row."""
        width, height = self.tile_side(columns, self.columns), self.tile_side(rows, self.rows)
        return (
            TileWindow(
                x=self.first + column,
                y=self.first + (self.rows - 1 - row if self.from_south else row),
                left=column * (width - self.overlap),
                top=row * (height - self.overlap),
                columns=width,
                rows=height,
            )
            for row in range(self.rows)
            for column in range(self.columns)
        )

    def tile_side(self, vertices: int, tiles: int) -> int:
        """Return the vertices along a tile's side for a side of the grid."""
        if tiles == 1:
            return vertices
        step, rest = divmod(vertices - self.overlap, tiles)
        if rest == 0 and step >= 1 and step + self.overlap >= 2:
            return step + self.overlap
        shared = {0: "nothing", 1: "an edge"}.get(self.overlap, f"{self.overlap} vertices")
        nearest = " or ".join(str(side) for side in self.nearest_sides(vertices, tiles))
        raise InputError(
            f"{vertices} vertices cannot be cut into {tiles} equal tiles that share {shared}; "
            f"nearest: {nearest}"
        )

    def grid_side(self, side: int, tiles: int) -> int:
        """Return the vertices along the grid's side for a side of a tile."""
        return tiles * (side - self.overlap) + self.overlap if tiles > 1 else side

    def nearest_sides(self, vertices: int, tiles: int) -> tuple[int, ...]:
        """Return the nearest sides of a grid, below and above or equal, that can be cut into tiles."""
        if tiles == 1:
            return (vertices,)
        least = max(1, 2 - self.overlap)
        step = (vertices - self.overlap) // tiles
        below, above = (tiles * max(count, least) + self.overlap for count in (step, step + 1))
        return (vertices,) if below == vertices else tuple(sorted({below, above}))

    def tile_name(self, name: str, tile: TileWindow) -> str:
        """Return a tile's file name without suffix; `name` itself if there is only one tile."""
        return name if self.count == 1 else self.pattern.format(name=name, x=tile.x, y=tile.y)

    def _check_pattern(self) -> None:
        prefix = f"tile names {one_line(self.pattern)!r}"
        try:
            parts = list(string.Formatter().parse(self.pattern))
        except ValueError as error:
            raise InputError(f"{prefix}: invalid pattern ({error})") from error
        for _, field, width, conversion in parts:
            if field is None:
                continue
            valid_width = not width or (field != "name" and re.fullmatch(r"0?[1-9]", width))
            if field not in _FIELDS or conversion or not valid_width:
                raise InputError(
                    f"{prefix}: expected only {{name}}, {{x}} and {{y}}, or with digits {{x:02}}"
                )
        fields = {field for _, field, _, _ in parts}
        if (self.columns > 1 and "x" not in fields) or (self.rows > 1 and "y" not in fields):
            raise InputError(f"{prefix}: expected {{x}} and {{y}}, else tiles have the same name")
        x, y = (range(self.first, self.first + count) for count in (self.columns, self.rows))
        longest = self.pattern.format(name="terrain", x=max(x[-1], y[-1]), y=max(x[-1], y[-1]))
        if _FORBIDDEN.search(longest) or not longest.isprintable() or len(longest) > _MAX_NAME:
            raise InputError(f"{prefix}: expected a valid file name, got {one_line(longest)!r}")
        # {x}{y} gives tile 1, 11 and tile 11, 1 the same name.
        names = {self.pattern.format(name="terrain", x=i, y=j).casefold() for j in y for i in x}
        if len(names) < self.count:
            raise InputError(f"{prefix}: two tiles would have the same name")


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
    crs: str | None = None  # as GDAL reads it, "EPSG:25832"; None: the sketch's, or local metres
    origin: tuple[float, float] | None = None  # the sketch's south-west corner in the CRS; None: the sketch's
    plants: bool = True  # write trees and shrubs
    grass: bool = False  # write grass, flowers and ferns as well


NAMED_TILES: Final = frozenset({"tiles", "tile_name", "tile_first", "tiles_from_south"})
"""Options of targets with tiles whose overlap is theirs."""


class SceneView(NamedTuple):
    """The preview's camera, and the light of sun and sky in one unit; x east, y north, z up, m."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float  # vertical, degrees
    sun_azimuth: float  # compass bearing, degrees
    sun_elevation: float  # degrees
    sunlight: Float64Array  # (3,) irradiance on a surface that faces the sun, linear sRGB
    harmonics: Float64Array  # (9, 3) irradiance of the sky, see `render.sky.irradiance_harmonics`
    sky: Float64Array  # (128, 64, 3) radiance at the eye's height, see `render.sky.sky_table`
    haze: Float64Array  # (3,) extinction by aerosols at sea level, 1/m
    haze_height: float  # m over which aerosols get e times thinner
    air: Float64Array  # (3,) extinction by molecules at sea level, 1/m
    air_height: float  # m
    exposure: float  # factor of radiance before tone mapping
    weather: dict[str, Any]  # settings of the sketch's ``[weather]``

    @property
    def heading(self) -> float:
        """Compass bearing of the view, degrees, −180 … 180."""
        return math.degrees(math.atan2(self.target[0] - self.eye[0], self.target[1] - self.eye[1]))

    @property
    def facts(self) -> dict[str, Any]:
        """The sidecar's entry: camera, sun and weather."""
        return {
            "camera": {"eye": list(self.eye), "target": list(self.target), "vertical_fov": self.fov},
            "sun": {"azimuth": self.sun_azimuth, "elevation": self.sun_elevation},
            "sunlight": self.sunlight.tolist(),
            "exposure": self.exposure,
            "weather": self.weather,
            "axes": "x east, y north, z up, m; azimuth clockwise from north, degrees",
        }


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
    stages: Stages
    drapes: Sequence[DrapedShapes] = ()  # vectors on the ground
    view: SceneView | None = None  # the preview's camera and light, for targets with a `scene`

    @property
    def scene_view(self) -> SceneView:
        """The view of a target with a `scene`."""
        if self.view is None:
            raise ValueError("expected the preview's camera and light, got none")
        return self.view


class ExportOutput(NamedTuple):
    """Files of a target, and their entries in the sidecar."""

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
    scene: bool = False  # whether it writes the preview's camera and light


SIDECAR: Final = "terrain.json"

_MAX_ENTRIES = 4  # of a list in rows; the sidecar has all
_DIGITS = 10  # of a number in rows


def sidecar(export: Export, output: ExportOutput, target: str) -> dict[str, Any]:
    """Return the content of the sidecar; a target's own facts replace the common ones."""
    height, tiling = export.samples.height, export.tiling
    facts = dict(output.facts)
    heights = {"minimum": float(height.min()), "maximum": float(height.max()), "units": "m"}
    content = {
        "format": 1,
        "target": target,
        "program": f"sketchterrain {version('sketchterrain')}",
        "sketch": export.terrain.sketch.name,
        "seed": export.terrain.sketch.seed,
        "grid": _grid_entry(export.grid),
        "heights": heights | facts.pop("heights", {}),
        "byte_order": "as the files' formats have it",
        "orientation": ORIENTATION,
    }
    if tiling.count > 1:
        content["tiling"] = {
            "columns": tiling.columns,
            "rows": tiling.rows,
            "overlap": tiling.overlap,
            "first": tiling.first,
            "y_counts_from": "south" if tiling.from_south else "north",
        }
    content["tiles"] = [
        {
            "name": tiling.tile_name(export.name, tile),
            "x": tile.x,
            "y": tile.y,
            "left": tile.left,
            "top": tile.top,
            **_grid_entry(export.grid.window(tile.left, tile.top, tile.columns, tile.rows)),
        }
        for tile in tiling.tiles(export.grid.columns, export.grid.rows)
    ]
    content |= facts
    files = [{"file": path.name, "what": what} for path, what in output.files.items()]
    return content | {"files": [*files, {"file": SIDECAR, "what": "this"}], "import": output.settings}


def write_sidecar(export: Export, output: ExportOutput, target: str) -> tuple[Path, dict[str, Any]]:
    """Write ``terrain.json`` into the export's folder, and return its path and content."""
    content = sidecar(export, output, target)
    return write_json(export.folder / SIDECAR, content), content


def check_sidecar(folder: Path, sketch: str, target: str) -> None:
    """Raise InputError if a folder has the sidecar of another sketch or target, whose facts would be lost."""
    with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):  # missing, or not ours
        before = json.loads((folder / SIDECAR).read_bytes())
        if (before["sketch"], before["target"]) != (sketch, target):
            holds = one_line(f"{folder}: holds {before['sketch']!r} for {before['target']}, in {SIDECAR}")
            raise InputError(f"{holds}: expected another folder for each sketch and target")


def _grid_entry(grid: SampleGrid) -> dict[str, Any]:
    dx, dy = grid.spacing
    return {
        "columns": grid.columns,
        "rows": grid.rows,
        "spacing": {"x": dx, "y": dy},
        "bounds": {"west": grid.west, "south": grid.south, "east": grid.east, "north": grid.north},
    }


class SettingRow(NamedTuple):
    """One import setting, or a heading (with an empty value) of those below it."""

    depth: int  # number of headings above
    name: str
    value: str


def setting_rows(settings: Mapping[str, Any]) -> list[SettingRow]:
    """Return a target's import settings as rows.

    >>> setting_rows({"Flip": False})
    [SettingRow(depth=0, name='Flip', value='no')]
    """
    return list(_rows(settings, 0))


def _rows(settings: Mapping[str, Any], depth: int) -> Iterator[SettingRow]:
    for name, value in settings.items():
        if isinstance(value, dict) and not all(isinstance(item, (int, float)) for item in value.values()):
            yield SettingRow(depth, name, "")
            yield from _rows(value, depth + 1)
        elif isinstance(value, list) and any(isinstance(item, (dict, list)) for item in value):
            for number, entry in enumerate(value[:_MAX_ENTRIES], start=1):
                title = name.removesuffix("s") + (f" {number}" if len(value) > 1 else "")
                yield SettingRow(depth, title, "")
                yield from _rows(entry, depth + 1)
            if len(value) > _MAX_ENTRIES:
                yield SettingRow(depth, name, f"{len(value) - _MAX_ENTRIES} more in {SIDECAR}")
        else:
            yield SettingRow(depth, name, _text(value))


def _text(value: object) -> str:
    if isinstance(value, dict):
        return "  ".join(f"{name} {_text(item)}" for name, item in value.items())
    if isinstance(value, list):
        return ", ".join(_text(item) for item in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    return "none" if value is None else str(value)
