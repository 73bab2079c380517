"""What the words of a command line mean: the arguments that commands share, and how their texts are read.

A text that cannot be meant raises ``typer.BadParameter``, a usage error.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = [
    "AsJson",
    "DeviceName",
    "Eye",
    "Folder",
    "LookAt",
    "OptionalPictureFile",
    "PictureFile",
    "PictureSize",
    "Point",
    "Seed",
    "SketchName",
    "Vertices",
]

Point = tuple[float, float, float]

_PIXELS = range(16, 8193)  # what the renderer can draw
_FARTHEST = 1e9  # m


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
Folder = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder to write into.")]
LookAt = Annotated[
    Any,
    typer.Option(
        parser=_parse_point, metavar="X,Y,Z", help="What it looks at, m; the sketch's middle if missing."
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
Seed = Annotated[int | None, typer.Option(metavar="N", help="In place of the sketch's own seed.")]
SketchName = Annotated[
    str, typer.Argument(metavar="SKETCH", help="A sketch's folder or .sketch file, or a preset's name.")
]
Vertices = Annotated[int, typer.Option("--size", metavar="N", help="Vertices along the longer side.")]
