"""What a person gives to be traced: which kind it is by its first bytes, and so who traces it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch.wording import shown
from sketchterrain.trace.picture import kind_of_picture

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Kind", "kind_of"]

Kind = Literal["folder", "picture", "open raster", "vectors"]

_EXPECTED = (
    "expected a PNG, JPEG, TIFF or WebP picture, an OpenRaster file (.ora), a folder of pictures, "
    "GeoJSON or a GeoPackage"
)
_REFUSED = (
    (b"gimp xcf", "a GIMP file", "in GIMP, File ▸ Export As, name.ora"),
    (b"8BPS", "a Photoshop file", "save its layers as OpenRaster (.ora), in Krita or GIMP"),
)


def kind_of(path: Path) -> Kind:
    """Return what kind of thing lies at a path.

    Raises
    ------
    InputError
        If there is nothing, or nothing that can be traced; for files of paint programs it says what to save.
    """
    place = one_line(path)
    try:
        if path.is_dir():
            return "folder"
        if not path.exists():
            raise InputError(f"{place} is not there: {_EXPECTED}")
        if not path.is_file():
            raise InputError(f"{place} is no file: {_EXPECTED}")
        with path.open("rb") as stream:
            start = stream.read(100)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({one_line(error.strerror or error)})") from None
    if kind_of_picture(start):
        return "picture"
    if start.startswith(b"PK"):
        return "open raster"
    for magic, what, instead in _REFUSED:
        if start.startswith(magic):
            raise InputError(f"{place} is {what}: {instead}")
    from sketchterrain.trace.vectors import is_vectors

    if is_vectors(path):
        return "vectors"
    begins = f"begins with {shown(start[:12])}" if start else "is empty"
    raise InputError(f"{place} {begins}: {_EXPECTED}")
