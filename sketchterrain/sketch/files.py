"""Loading sketches from folders, ``.sketch`` files and presets, and saving them atomically."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from weakref import ref

from sketchterrain.errors import InputError, one_line
from sketchterrain.resources import preset, preset_names
from sketchterrain.sketch.archive import pack_zip, read_zip
from sketchterrain.sketch.contents import SETTINGS, read_folder
from sketchterrain.sketch.folder_save import JOURNAL, read_saved_folder, replace_files
from sketchterrain.sketch.layer_images import decode_layer, encode_layer
from sketchterrain.sketch.parameters import LAYERS
from sketchterrain.sketch.starter import starter_sketch
from sketchterrain.sketch.toml_text import parse_settings, settings_text
from sketchterrain.sketch.wording import did_you_mean, format_value
from sketchterrain.whole_files import wrap_os_errors, write_atomic

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sketchterrain.sketch.document import LabelImage, Sketch

_ZIP_SUFFIX = ".sketch"

_encoded: dict[str, tuple[ref[LabelImage], bytes]] = {}
"""The last image of each layer and its file: autosave writes most layers unchanged."""


def load_sketch(path_or_preset: str | Path) -> Sketch:
    """Load a sketch.

    Parameters
    ----------
    path_or_preset
        A sketch's folder, a zip of one, or the name of a preset. A sketch in the working directory takes
        precedence over a preset of the same name.

    Raises
    ------
    InputError
        If there is no such sketch, or it is invalid.
    """
    path = Path(path_or_preset)
    place = one_line(path)
    try:
        is_file, exists = path.is_file(), path.exists()
        is_sketch = (path / SETTINGS).is_file() or (path / JOURNAL).is_file()
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({error.strerror})") from None
    if is_file:
        return _decode(read_zip(path, place), place)
    if isinstance(path_or_preset, str) and not is_sketch and path_or_preset in preset_names():
        place = f"preset {path_or_preset}"
        return _decode(read_folder(preset(path_or_preset), place), place)
    if exists:
        return _decode(read_saved_folder(path, place), place)
    names = preset_names()
    raise InputError(
        f"no sketch {format_value(str(path_or_preset))}: expected a folder, a {_ZIP_SUFFIX} file or a preset "
        f"({', '.join(names)}){did_you_mean(str(path_or_preset), names)}"
    )


def save_sketch(sketch: Sketch, path: str | Path) -> None:
    """Write a sketch: its settings and the image of every layer.

    Loading it returns an equal sketch. It is written as a whole or not at all: a reader finds the old or the
    new sketch, even after a crash. Other files in the folder, and unchanged ones, are not touched. Equal
    sketches give equal bytes.

    Parameters
    ----------
    sketch
        The sketch.
    path
        A folder, created if missing, or a file named ``*.sketch``, written as a zip.

    Raises
    ------
    InputError
        If `path` is a file of another name.
    SketchterrainError
        If the system cannot write there.
    """
    target = Path(path)
    if target.is_dir() or target.suffix.lower() != _ZIP_SUFFIX:
        _save_folder(sketch, target)
    else:
        write_atomic(target, pack_sketch(sketch))


def new_sketch(folder: str | Path) -> None:
    """Write a starter sketch: a small painting, and settings with a comment on every line.

    Raises
    ------
    InputError
        If `folder` is a file, or a folder that is not empty.
    SketchterrainError
        If the system cannot write there.
    """
    target = Path(folder)
    with wrap_os_errors(target):
        if target.is_dir() and any(target.iterdir()):
            raise InputError(f"{one_line(target)}: expected a new or an empty folder, this one is not empty")
    _save_folder(starter_sketch(), target)


def pack_sketch(sketch: Sketch, *, extra_files: Mapping[str, bytes] | None = None) -> bytes:
    """Return the content of a ``.sketch`` file, with extra files by name, which loading ignores."""
    return pack_zip({**_encode(sketch), **(extra_files or {})})


def _decode(contents: Mapping[str, bytes], place: str) -> Sketch:
    with _prefix_errors(f"{place}/{SETTINGS}"):
        sketch = parse_settings(contents[SETTINGS])
    images: dict[str, LabelImage] = {}
    for name in LAYERS:
        if f"{name}.png" in contents:
            with _prefix_errors(f"{place}/{name}.png"):
                images[name] = decode_layer(contents[f"{name}.png"])
                _check_same_size(images, name)
    return sketch.replace(layers=images)


def _check_same_size(images: Mapping[str, LabelImage], name: str) -> None:
    first = next(iter(images))
    (height, width), (first_height, first_width) = images[name].shape, images[first].shape
    if (height, width) != (first_height, first_width):
        raise InputError(
            f"{width}×{height} px, but {first}.png is {first_width}×{first_height} px: expected one size"
        )


def _encode(sketch: Sketch) -> dict[str, bytes]:
    files = {f"{name}.png": _encode_cached(name, sketch.layers[name]) for name in LAYERS}
    return files | {SETTINGS: settings_text(sketch).encode("utf-8")}


def _encode_cached(name: str, image: LabelImage) -> bytes:
    cached = _encoded.get(name)
    if cached is not None and cached[0]() is image:
        return cached[1]
    content = encode_layer(image, LAYERS[name].colour)
    _encoded[name] = ref(image), content
    return content


def _save_folder(sketch: Sketch, folder: Path) -> None:
    with wrap_os_errors(folder):
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{one_line(folder)}: expected a folder or a name that ends in {_ZIP_SUFFIX}")
        replace_files(folder, _encode(sketch))


@contextmanager
def _prefix_errors(place: str) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
