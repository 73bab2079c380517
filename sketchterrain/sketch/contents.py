"""Which files of a folder or archive belong to a sketch, and how much of them is read."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch.parameters import LAYERS
from sketchterrain.sketch.safe_zip import too_large
from sketchterrain.sketch.wording import did_you_mean, format_value

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from importlib.resources.abc import Traversable

SETTINGS = "sketch.toml"
"""The file of settings; each layer's image is ``<layer>.png``."""

LARGEST_FILE = 64 << 20
"""The most bytes of one layer image."""

LARGEST_TOTAL = 256 << 20
"""The most bytes of all files of a sketch together."""

_LARGEST_SETTINGS = 2 << 20
_OTHER_IMAGES = frozenset({".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".webp"})


def sketch_files(names: Iterable[str], place: str) -> list[str]:
    """Return which of the `names` in a folder are the sketch's: its settings and its layers.

    Other files may lie there too, but no image that a person could take for a layer.
    """
    visible = sorted(name for name in names if not name.startswith("."))
    images = [f"{layer}.png" for layer in LAYERS]
    for name in visible:
        path = PurePosixPath(name)
        suffix = path.suffix.lower()
        if suffix == ".png" and name not in images:
            raise InputError(
                f"{place}: unknown layer image {format_value(name)}: expected {', '.join(images)}"
                f"{did_you_mean(name, images)}"
            )
        if suffix in _OTHER_IMAGES and path.stem.lower() in LAYERS:
            raise InputError(f"{place}: {format_value(name)}: expected a PNG file, {path.stem.lower()}.png")
    if SETTINGS not in visible:
        raise InputError(
            f"{place}: no {SETTINGS} in it: expected a sketch (`sketchterrain new DIR` writes a starter)"
        )
    return [name for name in visible if name == SETTINGS or name in images]


def read_folder(
    folder: Traversable, place: str, *, given: Mapping[str, bytes] | None = None
) -> dict[str, bytes]:
    """Return the content of the sketch's files in a folder, by name."""
    contents: dict[str, bytes] = {}
    given = given or {}
    try:
        for name in sketch_files({*given, *(entry.name for entry in folder.iterdir())}, place):
            if name in given:
                contents[name] = given[name]
                continue
            entry, limit = folder.joinpath(name), file_limit(name)
            if not entry.is_file():
                raise InputError(f"{place}/{name}: expected a file")
            with entry.open("rb") as stream:
                contents[name] = stream.read(limit + 1)
            if len(contents[name]) > limit:
                raise too_large(f"{place}/{name}", limit)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({one_line(error.strerror or error)})") from None
    return contents


def file_limit(name: str) -> int:
    """Return the most bytes that the sketch's file `name` may have."""
    return _LARGEST_SETTINGS if name == SETTINGS else LARGEST_FILE
