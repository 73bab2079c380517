"""Arguments that commands share, and how their texts are parsed."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from sketchterrain.app.progress import Stages
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import TerrainSource


_PIXELS = range(16, 8193)  # what the renderer can draw
_LONGEST = 3600.0  # s, of a flight
_FILMS = (".mp4", ".webp", ".gif")  # what is no folder of frames
_FOLIAGE = ("csv", "ply", "both", "none")


def _parse_picture_size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,6})[x×](\d{1,6})", text.strip())
    width, height = (int(match[1]), int(match[2])) if match else (0, 0)
    if width not in _PIXELS or height not in _PIXELS:
        bounds = f"{_PIXELS.start} to {_PIXELS.stop - 1}"
        raise typer.BadParameter(f"expected WIDTHxHEIGHT, each {bounds} pixels, got {text!r}")
    return width, height


def _check_picture_file(path: Path | None) -> Path | None:
    if path is None:
        return None
    if path.suffix.lower() != ".png" or path.is_dir():
        raise typer.BadParameter(f"expected the name of a .png file, got {str(path)!r}")
    return path


def _check_film_place(path: Path | None) -> Path | None:
    if path is None or path.is_dir() or path.suffix.lower() in ("", *_FILMS):
        return path
    raise typer.BadParameter(
        f"expected a folder, or the name of a file that ends in {', '.join(_FILMS)}, got {str(path)!r}"
    )


def _check_foliage(kind: str) -> str:
    if kind not in _FOLIAGE:
        raise typer.BadParameter(f"expected {', '.join(_FOLIAGE[:-1])} or {_FOLIAGE[-1]}, got {kind!r}")
    return kind


def _check_seconds(seconds: float | None) -> float | None:
    if seconds is None or 0.0 < seconds <= _LONGEST:
        return seconds
    raise typer.BadParameter(f"expected more than 0 and at most {_LONGEST:g} seconds, got {seconds:g}")


AsJson = Annotated[bool, typer.Option("--json", help="Write JSON to stdout.")]
DeviceName = Annotated[
    str | None,
    typer.Option(
        "--device",
        metavar="NAME",
        help="Index in `devices`, gpu, cpu, or a part of a platform's or device's name.",
    ),
]
Fast = Annotated[bool, typer.Option("--fast", help="Trade the same bits everywhere for speed.")]
FilmPlace = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="DIR|FILE",
        callback=_check_film_place,
        help=f"Folder for the frames, 0000.png and so on, or a file named {', '.join(_FILMS)}; "
        "without it only the numbers.",
    ),
]
FlightFile = Annotated[
    Path | None,
    typer.Option("--path", metavar="FILE", help="A recorded path; by default a round over the sketch."),
]
Folder = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder to write into.")]
FoliageKind = Annotated[
    str,
    typer.Option(
        "--foliage",
        metavar="|".join(_FOLIAGE),
        callback=_check_foliage,
        help="Trees and shrubs as foliage.csv, as foliage.ply (binary, for millions), both, or none.",
    ),
]
FrameQuality = Annotated[
    float | None,
    typer.Option(
        "--quality",
        metavar="0..1",
        min=0.0,
        max=1.0,
        help="What a frame may cost; by default the best, with --real-time what suits the device.",
    ),
]
Fps = Annotated[int, typer.Option("--fps", metavar="N", min=1, max=240, help="Frames a second.")]
Grass = Annotated[bool, typer.Option("--grass", help="Grass, flowers and ferns too, in foliage.ply.")]
PictureFile = Annotated[
    Path,
    typer.Option(
        "--output", "-o", metavar="FILE.png", callback=_check_picture_file, help="Picture to write."
    ),
]
OptionalPictureFile = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="FILE.png", callback=_check_picture_file, help="Picture to write too."
    ),
]
PictureSize = Annotated[
    Any,
    typer.Option(
        "--size",
        parser=_parse_picture_size,
        metavar="WxH",
        help="Width and height, pixels; 1280x720 by default. A map fits in.",
    ),
]
FilmSize = Annotated[
    Any, typer.Option("--size", parser=_parse_picture_size, metavar="WxH", help="Width and height, pixels.")
]
RealTime = Annotated[
    bool,
    typer.Option(
        "--real-time",
        help="Show what is ready within a frame's budget, as a viewer does; else each frame is complete.",
    ),
]
Seconds = Annotated[
    float | None,
    typer.Option(
        "--seconds", metavar="N", callback=_check_seconds, help="Only so much of the path; 20 without --path."
    ),
]
Seed = Annotated[int | None, typer.Option(metavar="N", help="In place of the sketch's own seed.")]
SketchName = Annotated[
    str, typer.Argument(metavar="SKETCH", help="A sketch's folder or .sketch file, or a preset's name.")
]
Vertices = Annotated[int, typer.Option("--size", metavar="N", help="Vertices along the longer side.")]


Point = tuple[float, float, float]

_FARTHEST = 1e9  # m
_MAPS = ("png", "svg")


def _parse_point(text: str) -> Point:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"expected three numbers X,Y,Z in metres, got {text!r}") from None
    if not all(abs(number) <= _FARTHEST for number in (x, y, z)):  # false for NaN too
        raise typer.BadParameter(f"expected numbers of at most {_FARTHEST:g} m, got {text!r}")
    return x, y, z


def _parse_hour(text: str) -> float:
    match = re.fullmatch(r"(\d{1,2})(?::([0-5]\d))?", text.strip())
    hour = int(match[1]) + int(match[2] or 0) / 60.0 if match else 25.0
    if hour > 24.0:
        raise typer.BadParameter(f"expected a time of day HH or HH:MM, up to 24, got {text!r}")
    return hour


def _check_map_kind(kind: str | None) -> str | None:
    if kind not in (None, *_MAPS):
        raise typer.BadParameter(f"expected {' or '.join(_MAPS)}, got {kind!r}")
    return kind


def _check_textures(folder: Path | None) -> Path | None:
    if folder is not None and not folder.is_dir():
        raise typer.BadParameter(f"expected a folder of textures, got {str(folder)!r}")
    return folder


def _check_still_file(path: Path) -> Path:
    if path.suffix.lower() not in (".png", ".svg") or path.is_dir():
        raise typer.BadParameter(
            f"expected the name of a .png file, or with --map of an .svg file, got {str(path)!r}"
        )
    return path


Clouds = Annotated[
    float | None,
    typer.Option(
        "--clouds",
        metavar="0..1",
        min=0.0,
        max=1.0,
        help="Share of the sky that clouds cover, in place of the sketch's.",
    ),
]
Eye = Annotated[
    # Any: typer turns a text that is no tuple of options into one through the parser alone.
    Any,
    typer.Option(parser=_parse_point, metavar="X,Y,Z", help="Where the camera stands, m."),
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
LookAt = Annotated[
    Any,
    typer.Option(
        parser=_parse_point, metavar="X,Y,Z", help="What it looks at, m; the sketch's middle if missing."
    ),
]
MapFlag = Annotated[
    bool, typer.Option("--map", help="A topographic map instead, .png or .svg by the file's name.")
]
MapKind = Annotated[
    str | None,
    typer.Option("--map", metavar="png|svg", callback=_check_map_kind, help="Draw map.png or map.svg too."),
]
OverlayNames = Annotated[
    list[str] | None,
    typer.Option(
        "--overlay",
        metavar="NAME",
        help="Lay over it wireframe, levels, error, screen-error, materials, features, triplanar.",
    ),
]
QualityNumber = Annotated[
    float | None,
    typer.Option(
        "--quality",
        metavar="0..1",
        min=0.0,
        max=1.0,
        help="What the picture may cost; the best by default.",
    ),
]
StillFile = Annotated[
    Path,
    typer.Option(
        "--output", "-o", metavar="FILE", callback=_check_still_file, help="Picture to write, a .png."
    ),
]
Textures = Annotated[
    Path | None,
    typer.Option(
        "--textures",
        metavar="DIR",
        callback=_check_textures,
        help="Your own textures, grass.png and so on, in place of the program's.",
    ),
]
ViewKind = Annotated[
    str | None,
    typer.Option("--view", metavar="KIND", help="The view to find: auto, ground, hill or air."),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without",
        metavar="PART",
        help="Leave out shadows, clouds, haze, water, trees, rocks, grass, detail.",
    ),
]


def reject_combination(option: str, others: dict[str, object], why: str) -> None:
    """Refuse options that contradict one that was given."""
    for name, value in others.items():
        if value is not None and value is not False and value != []:
            raise typer.BadParameter(f"{name} with {option}: {why}")


def camera_from_options(terrain: TerrainSource, eye: Point | None, target: Point | None) -> Camera | None:
    """Return the camera that `--eye` and `--look-at` ask for, None without an eye.

    Without a target it looks at the middle of the sketch, and from the middle north. A note on stderr tells
    of an eye under the ground.
    """
    if eye is None:
        return None
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import visible_rectangle

    west, south, east, north = visible_rectangle(terrain)
    x, y = (west + east) / 2, (south + north) / 2
    if abs(eye[0] - x) + abs(eye[1] - y) < 0.02 * terrain.extent:
        y += terrain.extent / 2  # it stands in the middle: it looks north
    middle, here = (float(z) for z in terrain.heights([x, eye[0]], [y, eye[1]]))
    if eye[2] < here:
        sys.stderr.write(f"sketchterrain: note: the eye is {here - eye[2]:.1f} m under the ground\n")
    return Camera(eye, target or (x, y, middle))


def read_sketch(name: str, seed: int | None, stages: Stages) -> Sketch:
    """Read the sketch that a command was given, with another seed if one was asked for."""
    with stages.stage("sketch", "Reading the sketch"):
        from sketchterrain.document.store import load_sketch  # NumPy and Pillow: not for a command's --help

        sketch = load_sketch(name)
        return sketch if seed is None else sketch.replace(seed=seed)
