"""What the words of a command line mean: the arguments that commands share, and how their texts are read.

A text that cannot be meant raises ``typer.BadParameter``, a usage error.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from sketchterrain.render.camera import Camera
    from sketchterrain.terrain import Terrain

__all__ = [
    "AsJson",
    "DeviceName",
    "Eye",
    "Fast",
    "FilmPlace",
    "FlightFile",
    "Folder",
    "Fps",
    "LookAt",
    "OptionalPictureFile",
    "OverlayNames",
    "PictureFile",
    "PictureSize",
    "Point",
    "QualityNumber",
    "RealTime",
    "Seconds",
    "Seed",
    "SketchName",
    "Vertices",
    "camera_at",
]

Point = tuple[float, float, float]

_PIXELS = range(16, 8193)  # what the renderer can draw
_FARTHEST = 1e9  # m
_LONGEST = 3600.0  # s, of a flight
_FILMS = (".mp4", ".webp", ".gif")  # what is no folder of frames


def _parse_point(text: str) -> Point:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"expected three numbers X,Y,Z in metres, got {text!r}") from None
    if not all(abs(number) <= _FARTHEST for number in (x, y, z)):  # false for NaN too
        raise typer.BadParameter(f"expected numbers of at most {_FARTHEST:g} m, got {text!r}")
    return x, y, z


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


def _check_seconds(seconds: float | None) -> float | None:
    if seconds is None or 0.0 < seconds <= _LONGEST:
        return seconds
    raise typer.BadParameter(f"expected more than 0 and at most {_LONGEST:g} seconds, got {seconds:g}")


AsJson = Annotated[bool, typer.Option("--json", help="Write JSON to stdout.")]
DeviceName = Annotated[
    str | None,
    typer.Option("--device", metavar="NAME", help="Index in `devices`, or a part of a device's name."),
]
Eye = Annotated[
    # Any: typer turns a text that is no tuple of options into one through the parser alone.
    Any,
    typer.Option(parser=_parse_point, metavar="X,Y,Z", help="Where the camera stands, m."),
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
Fps = Annotated[int, typer.Option("--fps", metavar="N", min=1, max=240, help="Frames a second.")]
LookAt = Annotated[
    Any,
    typer.Option(
        parser=_parse_point, metavar="X,Y,Z", help="What it looks at, m; the sketch's middle if missing."
    ),
]
OverlayNames = Annotated[
    list[str] | None,
    typer.Option(
        "--overlay",
        metavar="NAME",
        help="Lay over it wireframe, levels, error, screen-error, materials, features, triplanar.",
    ),
]
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
    Any, typer.Option("--size", parser=_parse_picture_size, metavar="WxH", help="Width and height, pixels.")
]
QualityNumber = Annotated[
    float | None,
    typer.Option(
        "--quality",
        metavar="0..1",
        min=0.0,
        max=1.0,
        help="What a frame may cost; by default the best, with --real-time what suits the device.",
    ),
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


def camera_at(terrain: Terrain, eye: Point | None, target: Point | None) -> Camera | None:
    """Return the camera that `--eye` and `--look-at` ask for, None without an eye.

    Without a target it looks at the middle of the sketch, and from the middle north. A note on stderr tells
    of an eye under the ground.
    """
    if eye is None:
        return None
    from sketchterrain.render.camera import Camera

    east, north = terrain.size
    x, y = east / 2, north / 2
    if abs(eye[0] - x) + abs(eye[1] - y) < 0.02 * terrain.extent:
        y += terrain.extent / 2  # it stands in the middle: it looks north
    middle, here = (float(z) for z in terrain.heights([x, eye[0]], [y, eye[1]]))
    if eye[2] < here:
        sys.stderr.write(f"sketchterrain: note: the eye is {here - eye[2]:.1f} m under the ground\n")
    return Camera(eye, target or (x, y, middle))
