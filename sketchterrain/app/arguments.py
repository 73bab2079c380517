"""Arguments and options of the commands, and the parsing of their values.

Invalid text raises ``typer.BadParameter``, a usage error. Nothing heavy is imported for ``--help``.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sketchterrain.app.option_groups import reject_combination
from sketchterrain.io.console import Stages, print_note
from sketchterrain.schema.parameters import SKIES

if TYPE_CHECKING:
    from sketchterrain.document.drapes import DrapedLayer
    from sketchterrain.document.rasters import RasterSource
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.export.target import ExportOptions
    from sketchterrain.importing.elevation import RasterArea

_PIXELS = range(16, 8193)  # a picture's side
_MAX_COORDINATE = 1e9  # m
_MAX_SECONDS = 3600.0  # of a flight
_FILMS = (".mp4", ".webp", ".gif")
_FOLIAGE = ("csv", "ply", "both", "none")
_MAPS = ("png", "svg")
_LAYER_OPTION = re.compile(r"(.+),([a-z_]+)=([^,]*)", re.S)
# Those of sketchterrain.export.targets, which is not loaded for --help; a test compares them.
TARGETS = (
    *("unity", "unreal", "godot", "blender", "gltf", "web", "geotiff", "qgis"),
    *("raw", "png16", "exr", "npy", "obj", "stl"),
)
DRAPE_METHODS = ("auto", "tiles", "two-step", "geometry")  # of sketchterrain.render.draped, likewise


def _parse_picture_size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,6})[x×](\d{1,6})", text.strip())
    width, height = (int(match[1]), int(match[2])) if match else (0, 0)
    if width not in _PIXELS or height not in _PIXELS:
        bounds = f"{_PIXELS.start} to {_PIXELS.stop - 1}"
        raise typer.BadParameter(f"expected WIDTHxHEIGHT, each {bounds} pixels, got {text!r}")
    return width, height


def _parse_tiles(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{0,4})[x×]([1-9]\d{0,4})", text.strip())
    if match is None:
        raise typer.BadParameter(f"expected COLUMNSxROWS of tiles, as 4x4, got {text!r}")
    return int(match[1]), int(match[2])


def _parse_hour(text: str) -> float:
    match = re.fullmatch(r"(\d{1,2})(?::([0-5]\d))?", text.strip())
    hour = int(match[1]) + int(match[2] or 0) / 60.0 if match else 25.0
    if hour > 24.0:
        raise typer.BadParameter(f"expected a time of day HH or HH:MM, up to 24, got {text!r}")
    return hour


def _numbers(count: int, expected: str) -> Callable[[str], tuple[float, ...]]:
    def parse(text: str) -> tuple[float, ...]:
        try:
            numbers = tuple(float(part) for part in text.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
            raise typer.BadParameter(f"expected {expected}, got {text!r}")
        return numbers

    return parse


def _parse_point(text: str) -> tuple[float, ...]:
    point = _numbers(3, "three numbers X,Y,Z in metres")(text)
    if max(abs(number) for number in point) > _MAX_COORDINATE:
        raise typer.BadParameter(f"expected numbers of at most {_MAX_COORDINATE:g} m, got {text!r}")
    return point


def _file(expected: str, *suffixes: str, folders: bool = False) -> Callable[[Path | None], Path | None]:
    def check(path: Path | None) -> Path | None:
        if path is not None and not (folders if path.is_dir() else path.suffix.lower() in suffixes):
            raise typer.BadParameter(f"expected {expected}, got {str(path)!r}")
        return path

    return check


def _check_textures(folder: Path | None) -> Path | None:
    if folder is not None and not folder.is_dir():
        raise typer.BadParameter(f"expected a folder of textures, got {str(folder)!r}")
    return folder


def _one_of(*names: str) -> Callable[[str | None], str | None]:
    def check(name: str | None) -> str | None:
        if name not in (None, *names):
            raise typer.BadParameter(f"expected {', '.join(names[:-1])} or {names[-1]}, got {name!r}")
        return name

    return check


def _check_seconds(seconds: float | None) -> float | None:
    if seconds is None or 0.0 < seconds <= _MAX_SECONDS:
        return seconds
    raise typer.BadParameter(f"expected more than 0 and at most {_MAX_SECONDS:g} seconds, got {seconds:g}")


_parse_pair = _numbers(2, "two numbers with a comma between them")
# Values with a parser are Any: typer would take a tuple for several options.

# Sketches, devices, results
SketchName = Annotated[str, typer.Argument(metavar="SKETCH", help="A folder, a .sketch file or a preset.")]
WorldPath = Annotated[
    Path, typer.Argument(metavar="WORLD", help="Output of `world`: .zarr, .tif or a folder of tiles.")
]
Seed = Annotated[int | None, typer.Option(metavar="N", help="In place of the sketch's own seed.")]
DeviceName = Annotated[
    str | None,
    typer.Option("--device", metavar="NAME", help="Index in `devices`, gpu, cpu, or part of a name."),
]
Fast = Annotated[bool, typer.Option("--fast", help="Faster arithmetic, whose bits depend on the device.")]
AsJson = Annotated[bool, typer.Option("--json", help="Write JSON to stdout.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Report what it would take; write nothing.")]
Resume = Annotated[bool, typer.Option("--resume", help="Resume: recompute only missing or broken files.")]
Folder = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder to write into.")]
FoliageKind = Annotated[
    str,
    typer.Option(
        "--foliage",
        metavar="|".join(_FOLIAGE),
        callback=_one_of(*_FOLIAGE),
        help="Trees and shrubs as foliage.csv, as foliage.ply (binary, for millions), both, or none.",
    ),
]
Grass = Annotated[bool, typer.Option("--grass", help="Include grass, flowers and ferns: many plants.")]

# Pictures, maps and films
PictureFile = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE.png",
        callback=_file("the name of a .png file", ".png"),
        help="Picture to write.",
    ),
]
RenderFile = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        callback=_file("the name of a .png file, or with --map of an .svg file", ".png", ".svg"),
        help="Picture to write, a .png.",
    ),
]
ViewKind = Annotated[
    str | None,
    typer.Option("--view", metavar="KIND", help="The view to find: auto, ground, hill, air or layers."),
]
Hour = Annotated[
    Any,
    typer.Option(
        "--time",
        parser=_parse_hour,
        metavar="HH[:MM]",
        help="Local solar time; by default the sketch's, or the light that suits the view.",
    ),
]
Sky = Annotated[
    str | None,
    typer.Option(
        "--sky",
        metavar="|".join(SKIES),
        callback=_one_of(*SKIES),
        help="Kind of clouds, in place of the sketch's.",
    ),
]
Clouds = Annotated[
    float | None,
    typer.Option("--clouds", metavar="0..1", min=0.0, max=1.0, help="Cloud cover, in place of the sketch's."),
]
LayerFiles = Annotated[
    list[str] | None,
    typer.Option(
        "--layer",
        metavar="FILE[,KEY=VALUE…]",
        help="Drape a vector or raster file on it, as trails.gpkg,colour=#d03030,width=3; repeatable.",
    ),
]
MapKind = Annotated[
    str | None,
    typer.Option("--map", metavar="png|svg", callback=_one_of(*_MAPS), help="Draw map.png or map.svg too."),
]
FilmPlace = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="DIR|FILE",
        callback=_file(
            f"a folder, or the name of a file that ends in {', '.join(_FILMS)}", "", *_FILMS, folders=True
        ),
        help=f"Folder of frames, or a file named {', '.join(_FILMS)}; without it only statistics.",
    ),
]
Seconds = Annotated[
    float | None,
    typer.Option(metavar="N", callback=_check_seconds, help="Duration; by default the path's, or 20."),
]

# Exports
TargetName = Annotated[
    str,
    typer.Option(
        "--to",
        metavar="TARGET",
        callback=_one_of(*TARGETS),
        help=f"One of {', '.join(TARGETS)}; `targets` describes them.",
    ),
]
WholeSize = Annotated[
    int | None,
    typer.Option("--size", metavar="N", min=2, help="Vertices along the longer side of all tiles together."),
]
Crs = Annotated[
    str | None,
    typer.Option("--crs", metavar="CRS", help="Coordinate reference system in metres, as EPSG:25832."),
]
Origin = Annotated[
    Any,
    typer.Option("--origin", parser=_parse_pair, metavar="E,N", help="The sketch's south-west corner in it."),
]

# Worlds and vector sources
WorldBounds = Annotated[
    Any,
    typer.Option(
        "--bounds",
        parser=_numbers(4, "WEST,SOUTH,EAST,NORTH in metres"),
        metavar="W,S,E,N",
        help="Metres; by default the sketch's rectangle.",
    ),
]
SourceBounds = Annotated[
    Any,
    typer.Option(
        "--bounds",
        parser=_numbers(4, "WEST,SOUTH,EAST,NORTH"),
        metavar="W,S,E,N",
        help="Part of vectors, in their own coordinates.",
    ),
]


def read_sketch(name: str, seed: int | None, stages: Stages, layers: Sequence[str] | None = None) -> Sketch:
    """Load a folder, a .sketch file or a preset, with another seed and more draped layers if given."""
    with stages.stage("sketch", "Reading the sketch"):
        from sketchterrain.document.store import load_sketch

        sketch = load_sketch(name)
        if layers:
            sketch = sketch.replace(drapes=(*sketch.drapes, *read_layers(layers)))
    print_note(*sketch.notes)
    return sketch if seed is None else sketch.replace(seed=seed)


def read_layers(texts: Sequence[str]) -> tuple[DrapedLayer, ...]:
    """Return the draped layers ``FILE,key=value…``; the file's name may have commas.

    ``class=VALUE:key=value;key=value`` styles features whose property ``by`` has a value.
    """
    from sketchterrain.document.drapes import DRAPE, DrapeClass, draped_layer
    from sketchterrain.errors import InputError, one_line, prefix_errors
    from sketchterrain.schema.styles import STYLE

    kinds = {name: parameter.kind for name, parameter in {**DRAPE, **STYLE}.items()}

    def parsed(name: str, text: str) -> Any:
        with suppress(ValueError):  # refused by the layer
            return kinds.get(name, str)(text)
        return text

    layers = []
    for text in texts:
        path, values, classes = text, dict[str, Any](), list[tuple[str, dict[str, Any]]]()
        while not os.path.exists(path) and (option := _LAYER_OPTION.fullmatch(path)):  # noqa: PTH110 # no error
            path, name, value = option.groups()
            if name == "class":
                kind, _, style = value.partition(":")
                pairs = [each.partition("=") for each in style.split(";") if each]
                classes.insert(0, (kind, {key: parsed(key, each) for key, _, each in pairs}))
            else:
                values.setdefault(name, parsed(name, value))
        with prefix_errors(f"--layer {one_line(text)}"):
            if classes and not values.get("by"):
                raise InputError("class= needs by=, the property whose values are the classes")
            styles = tuple(DrapeClass(*each) for each in classes)
            layers.append(draped_layer(Path(path), **values).replace(classes=styles))
    return tuple(layers)


def read_rasters(texts: Sequence[str], *, embed: bool) -> tuple[tuple[RasterSource, ...], RasterArea | None]:
    """Return the sources ``ROLE=FILE``, and the area of the first georeferenced one."""
    if not texts:
        return (), None
    from sketchterrain.document.rasters import raster_source
    from sketchterrain.importing.elevation import raster_area

    sources = []
    for text in texts:
        role, sign, path = text.partition("=")
        if not sign:
            raise typer.BadParameter(f"--raster {text}: expected ROLE=FILE, as picture=map.tif")
        sources.append(raster_source(Path(path), role, embed=embed))
    areas = [raster_area(source) for source in sources]
    return tuple(sources), next((area for area in areas if area is not None), None)


@dataclass(frozen=True)
class ExportArguments:
    """Options of an export besides size and grass, None by default."""

    tiles: Annotated[
        Any, typer.Option(parser=_parse_tiles, metavar="CxR", help="Columns and rows of tiles.")
    ] = None
    overlap: Annotated[
        int | None,
        typer.Option(metavar="N", min=0, help="Vertices that neighbouring tiles share: 1 is an edge."),
    ] = None
    tile_name: Annotated[
        str | None,
        typer.Option(metavar="PATTERN", help="As {name}_x{x}_y{y}; {x:02} has leading zeros."),
    ] = None
    tile_first: Annotated[
        int | None,
        typer.Option(metavar="N", min=0, help="Number of the first tile each way."),
    ] = None
    tiles_from_south: Annotated[
        bool | None,
        typer.Option(
            "--tiles-from-south/--tiles-from-north", help="Which row of tiles has the first number."
        ),
    ] = None
    format: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of heights, where a target has several.")
    ] = None
    heights: Annotated[
        Any,
        typer.Option(
            parser=_parse_pair,
            metavar="LOW,HIGH",
            help="Range of 16-bit heights, m, as for several terrains; by default the terrain's.",
        ),
    ] = None
    error: Annotated[
        float | None,
        typer.Option(metavar="M", help="Tolerance of a mesh, m; by default it has all vertices."),
    ] = None
    crs: Crs = None
    origin: Origin = None
    plants: Annotated[
        bool | None, typer.Option("--plants/--no-plants", help="Write trees and shrubs, as by default.")
    ] = None

    def given(self) -> dict[str, Any]:
        """Return the values that are not None."""
        return {name: value for name, value in vars(self).items() if value is not None}

    def options(self, size: int | None, *, grass: bool) -> ExportOptions:
        """Return export options; raise a usage error for options of tiles if there is one tile."""
        from sketchterrain.export.target import ExportOptions

        tiles = self.tiles or (1, 1)
        if tiles == (1, 1):
            names = ("overlap", "tile_name", "tile_first", "tiles_from_south")
            tiling = {f"--{name.replace('_', '-')}": getattr(self, name) for name in names}
            reject_combination("no --tiles", tiling, "there is one tile")
        return ExportOptions(**self.given() | {"size": size, "tiles": tiles, "grass": grass})


@dataclass(frozen=True)
class SceneArguments:
    """Light and content of pictures and films, None by default."""

    size: Annotated[
        Any,
        typer.Option(
            parser=_parse_picture_size, metavar="WxH", help="Pixels, by default 1280x720; a map fits in."
        ),
    ] = None
    time: Hour = None
    sky: Sky = None
    clouds: Clouds = None
    quality: Annotated[
        float | None,
        typer.Option(
            metavar="0..1",
            min=0.0,
            max=1.0,
            help="Rendering cost; by default 1, with --real-time what suits the device.",
        ),
    ] = None
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART", help="Leave out shadows, clouds, haze, water, trees, rocks, grass, detail."
        ),
    ] = None
    textures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", callback=_check_textures, help="Your own textures, grass.png and so on."),
    ] = None
    overlay: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Draw wireframe, levels, error, screen-error, materials, features, triplanar on it.",
        ),
    ] = None
    layer: LayerFiles = None
    drape_method: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(DRAPE_METHODS),
            callback=_one_of(*DRAPE_METHODS),
            help="How draped layers are drawn; by default as suits them.",
        ),
    ] = None

    def given(self) -> dict[str, Any]:
        """Return the values that are not None, by their names in `SceneOptions`."""
        names = {"time": "hour", "overlay": "overlays"}
        given = {name: value for name, value in vars(self).items() if value is not None and name != "layer"}
        return {
            names.get(name, name): tuple(value) if isinstance(value, list) else value
            for name, value in given.items()
        }


@dataclass(frozen=True)
class PictureArguments(SceneArguments):
    """The same and the camera of a picture."""

    view: ViewKind = None
    eye: Annotated[Any, typer.Option(parser=_parse_point, metavar="X,Y,Z", help="Camera position, m.")] = None
    look_at: Annotated[
        Any,
        typer.Option(parser=_parse_point, metavar="X,Y,Z", help="Target, m; by default the sketch's middle."),
    ] = None

    def check_camera(self) -> None:
        """Raise a usage error if camera options contradict each other."""
        if self.look_at is not None and (self.eye is None or self.eye == self.look_at):
            raise typer.BadParameter("--look-at needs an --eye at another place")
        if self.eye is not None:
            reject_combination("--eye", {"--view": self.view}, "either a camera or a view to find")
