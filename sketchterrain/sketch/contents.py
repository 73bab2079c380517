"""Files of a folder or archive that belong to a sketch, and their size limits."""

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
"""The settings file; each layer's image is ``<layer>.png``."""

MAX_FILE_BYTES = 64 << 20
"""The most bytes of one layer image."""

MAX_TOTAL_BYTES = 256 << 20
"""The most bytes of all files of a sketch together."""

_MAX_SETTINGS_BYTES = 2 << 20
_OTHER_IMAGES = frozenset({".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".webp"})


def sketch_files(names: Iterable[str], place: str) -> list[str]:
    """Return the sketch's files among the `names` in a folder: its settings and its layers.

    Raise InputError if the settings are missing, or if an image could be mistaken for a layer.
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
    folder: Traversable, place: str, *, overrides: Mapping[str, bytes] | None = None
) -> dict[str, bytes]:
    """Return the content of the sketch's files in a folder, by name; `overrides` replace what is on disk.

    Raise InputError if a file is missing, unknown, too large or unreadable.
    """
    contents: dict[str, bytes] = {}
    overrides = overrides or {}
    try:
        for name in sketch_files({*overrides, *(entry.name for entry in folder.iterdir())}, place):
            if name in overrides:
                contents[name] = overrides[name]
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
    return _MAX_SETTINGS_BYTES if name == SETTINGS else MAX_FILE_BYTES
