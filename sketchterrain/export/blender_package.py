"""The extension for Blender as a zip."""

import zipfile
from importlib.resources import files
from pathlib import Path
from typing import Final

from sketchterrain.errors import InputError, one_line
from sketchterrain.io.files import atomic_file

_FOLDER: Final = "blender_extension"
_SUFFIXES: Final = (".py", ".toml")


def write_extension(path: Path) -> Path:
    """Write the extension's manifest and modules, uncompressed and without times: always the same bytes."""
    if path.suffix.lower() != ".zip" or path.is_dir():
        raise InputError(f"expected the name of a .zip file, got {one_line(path)!r}")
    parts = files("sketchterrain.export").joinpath(_FOLDER).iterdir()
    with atomic_file(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for part in sorted(parts, key=lambda part: part.name):
            if part.name.endswith(_SUFFIXES):
                archive.writestr(zipfile.ZipInfo(part.name), part.read_bytes())
    return path
