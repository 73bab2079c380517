"""What the words of a command line mean: the arguments that commands share, and how their texts are read.

A text that cannot be meant raises ``typer.BadParameter``, a usage error.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import typer

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
