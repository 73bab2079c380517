"""Sketch files: loading and saving a folder or a ``*.sketch`` archive."""

import io
import os
import secrets
import stat
import time
import zipfile
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from hashlib import sha256
from importlib.resources.abc import Traversable
from pathlib import Path, PurePosixPath
from types import MappingProxyType

from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import encode_edits, with_edits
from sketchterrain.document.label_layers import LabelImage, decode_layer, encode_layer
from sketchterrain.document.own_materials import picture_files
from sketchterrain.document.rasters import (
    RasterSource,
    content_digests,
    content_hash,
    embedded_files,
    is_embedded_name,
)
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.toml_format import parse_settings, settings_text, starter_sketch
from sketchterrain.errors import InputError, did_you_mean, format_value, one_line, prefix_errors
from sketchterrain.io.files import (
    open_zip,
    relative_path,
    too_large,
    wrap_os_errors,
    wrap_read_errors,
    write_atomic,
)
from sketchterrain.io.resources import preset, preset_names
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS, VECTOR_LAYERS
from sketchterrain.stages.digests import digest_of

SETTINGS = "sketch.toml"
"""The settings file; each layer's image is ``<layer>.png``, and its vectors, if any, are ``<layer>.fgb``.

Edits of draped layers, if any, are ``drapes.fgb``.
"""

_SUFFIX, _EDITS = ".fgb", "drapes.fgb"
_VECTORS = (*(f"{name}{_SUFFIX}" for name in VECTOR_LAYERS), _EDITS)

MAX_FILE_BYTES = 64 << 20
"""The most bytes of one layer's file."""

MAX_TOTAL_BYTES = 256 << 20
"""The most bytes of all files of a sketch together."""

_MAX_SETTINGS_BYTES = 16 << 20  # with edits of draped layers in former formats
_OTHER_IMAGES = frozenset({".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".webp"})


def reject_sketch_folder(folder: Path) -> None:
    """Raise InputError for a sketch's folder as an output: pictures in it are taken for layers."""
    if (folder / SETTINGS).is_file():
        raise InputError(f"{one_line(folder)}: holds a {SETTINGS}: expected another folder to write into")


def sketch_files(names: Iterable[str], place: str) -> list[str]:
    """Return the sketch's files among the `names` in a folder: its settings and its layers.

    Raise InputError if the settings are missing, or if a file could be mistaken for a layer.
    """
    visible = sorted(name for name in names if not name.startswith("."))
    images, vectors = [f"{layer}.png" for layer in PAINTED_LAYERS], _VECTORS
    for name in visible:
        path = PurePosixPath(name)
        suffix = path.suffix.lower()
        if suffix == ".png" and path.stem in VECTOR_LAYERS and name not in images:
            raise InputError(
                f"{place}/{name}: expected {path.stem}{_SUFFIX}, the layer {path.stem} has vectors alone"
            )
        for ending, known, what in ((".png", images, "layer image"), (_SUFFIX, vectors, "vector layer")):
            if suffix == ending and name not in known:
                raise InputError(
                    f"{place}: unknown {what} {format_value(name)}: expected {', '.join(known)}"
                    f"{did_you_mean(name, known)}"
                )
        if suffix in _OTHER_IMAGES and path.stem.lower() in PAINTED_LAYERS:
            raise InputError(f"{place}: {format_value(name)}: expected a PNG file, {path.stem.lower()}.png")
    if SETTINGS not in visible:
        raise InputError(
            f"{place}: no {SETTINGS} in it: expected a sketch (`sketchterrain new DIR` writes a starter)"
        )
    return [name for name in visible if name in (SETTINGS, *images, *vectors) or is_embedded_name(name)]


def read_folder(
    folder: Traversable,
    place: str,
    *,
    overrides: Mapping[str, bytes] | None = None,
    without: Collection[str] = (),
) -> dict[str, bytes]:
    """Return the content of the sketch's files in a folder, by name; `overrides` replace what is on disk.

    Raise InputError if a file is missing, unknown, too large or unreadable.
    """
    contents: dict[str, bytes] = {}
    overrides = overrides or {}
    with wrap_read_errors(place):
        present = {entry.name for entry in folder.iterdir()}.difference(without)
        for name in sketch_files({*overrides, *present}, place):
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
    return contents


def file_limit(name: str) -> int:
    """Return the most bytes that the sketch's file `name` may have."""
    return _MAX_SETTINGS_BYTES if name == SETTINGS else MAX_FILE_BYTES


_EPOCH = (1980, 1, 1, 0, 0, 0)


def read_zip(path: Path, place: str) -> dict[str, bytes]:
    """Return the content of a sketch's files in a zip, by name; they may be in one folder at its top.

    Nothing else is decompressed. Raise InputError if the zip is unsafe, or a file is missing, unknown or
    damaged.
    """
    with open_zip(
        path, place, largest=MAX_TOTAL_BYTES, expected="a folder or a whole zip", inside="the sketch"
    ) as archive:
        root = _root_folder(archive.names)
        inner = [name.removeprefix(root) for name in archive.names if name.startswith(root)]
        names = [name for name in inner if name and "/" not in name]
        return {
            name: archive.read(f"{root}{name}", file_limit(name), name) for name in sketch_files(names, place)
        }


def pack_zip(files: Mapping[str, bytes]) -> bytes:
    """Return a zip of files by name; equal files give equal bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, date_time=_EPOCH)
            info.create_system = 3  # Unix, on every system, for the mode below
            info.external_attr = (stat.S_IFREG | 0o644) << 16
            archive.writestr(info, files[name])  # stored: images are compressed already
    return stream.getvalue()


def _root_folder(entries: Collection[str]) -> str:
    """Return the one top folder (with its ``/``) that contains the whole sketch, or an empty text."""
    tops = {name.split("/")[0] for name in entries if not name.startswith((".", "__MACOSX/"))}
    top = f"{tops.pop()}/" if len(tops) == 1 else ""
    return top if f"{top}{SETTINGS}" in entries else ""


JOURNAL = ".unfinished.sketch"
"""The journal of an unfinished save, which the next save removes."""

_STALE = 60 * 10**9
"""ns since the last write after which a temporary file is from a save that was killed."""


def replace_files(folder: Path, files: Mapping[str, bytes], *, without: Collection[str] = ()) -> None:
    """Replace files of a folder and remove others, all or none; unchanged ones are not written.

    Raise OSError or SketchterrainError if the system cannot write there: the files are then as they were, or
    the journal exists.
    """
    journal = folder / JOURNAL
    changed = {name: content for name, content in files.items() if not _has(folder / name, content)}
    removed = [folder / name for name in without if (folder / name).exists()]
    _remove_stale_files(folder, (*files, JOURNAL))
    temporary: dict[str, Path] = {}
    try:
        for name, content in changed.items():
            temporary[name] = folder / f".{name}.{secrets.token_hex(4)}.tmp"
            with temporary[name].open("xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
        if len(changed) + len(removed) > 1 or journal.exists():
            write_atomic(journal, pack_zip(files))
        for name, path in temporary.items():
            path.replace(folder / name)
        for path in removed:
            path.unlink(missing_ok=True)
        journal.unlink(missing_ok=True)
    finally:
        for path in temporary.values():
            path.unlink(missing_ok=True)


def read_saved_folder(folder: Path, place: str) -> dict[str, bytes]:
    """Return the content of a sketch's files in a folder, by name, even if a save was not finished."""
    journal = folder / JOURNAL
    committed = _modified(journal)
    if not committed:
        return read_folder(folder, place)
    try:
        contents = read_zip(journal, f"{place}/{JOURNAL}")
    except InputError:
        if journal.exists():
            raise
        return read_folder(folder, place)  # the save was finished meanwhile
    newer = {name: content for name, content in contents.items() if _modified(folder / name) <= committed}
    removed = [
        name
        for name in _optional_files(folder)
        if name not in contents and _modified(folder / name) <= committed
    ]
    return read_folder(folder, place, overrides=newer, without=removed)


def _optional_files(folder: Path) -> list[str]:
    """Return the names of a folder's vector layers and rasters, which a sketch may be without."""
    names = [path.name for path in folder.iterdir()]
    return [name for name in names if name in _VECTORS or is_embedded_name(name)]


def _has(path: Path, content: bytes) -> bool:
    return path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content


def _modified(path: Path) -> int:
    """Return a file's modification time, ns; 0 if it does not exist."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _remove_stale_files(folder: Path, names: Iterable[str]) -> None:
    """Remove temporary files of saves that were killed."""
    for name in names:
        for path in folder.glob(f".{name}.????????.tmp"):
            if time.time_ns() - _modified(path) > _STALE:
                path.unlink(missing_ok=True)


_ZIP_SUFFIX = ".sketch"

_encoded = LRUCache(2 * len(LAYERS))
"""Files of layers: autosave writes most of them unchanged."""


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
    with wrap_read_errors(path):
        is_file, exists = path.is_file(), path.exists()
        is_sketch = (path / SETTINGS).is_file() or (path / JOURNAL).is_file()
    if is_file:
        return _decode(read_zip(path, place), place, path.parent)
    if isinstance(path_or_preset, str) and not is_sketch and path_or_preset in preset_names():
        place = f"preset {path_or_preset}"
        return _decode(read_folder(preset(path_or_preset), place), place)
    if exists:
        return _decode(read_saved_folder(path, place), place, path)
    names = preset_names()
    raise InputError(
        f"no sketch {format_value(str(path_or_preset))}: expected a folder, a {_ZIP_SUFFIX} file or a preset "
        f"({', '.join(names)}){did_you_mean(str(path_or_preset), names)}"
    )


def save_sketch(sketch: Sketch, path: str | Path) -> None:
    """Write a sketch: its settings, the image of every layer, its vectors and embedded rasters.

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
    save_unless_changed(sketch, Path(path), {})


Hashes = Mapping[str, str]  # SHA-256 of a sketch's files by name
CHANGED = "changed on disk by another program"  # the error of `save_unless_changed`


def save_unless_changed(sketch: Sketch, path: Path, known: dict[Path | None, Hashes]) -> None:
    """Save a sketch as `save_sketch` does unless its files are not the ones `known` by path; update these."""
    is_folder = path.is_dir() or path.suffix.lower() != _ZIP_SUFFIX
    with wrap_os_errors(path):
        if is_folder and path.exists() and not path.is_dir():
            raise InputError(f"{one_line(path)}: expected a folder or a name that ends in {_ZIP_SUFFIX}")
        files = _encode(sketch, path if is_folder else path.parent)
        files = files if is_folder else {path.name: pack_zip(files)}
        if path in known and file_hashes(path) not in ({}, known[path]):
            raise InputError(CHANGED)
        if is_folder:
            path.mkdir(parents=True, exist_ok=True)
            kept = {*files, *(Path(each.path).name for each in sketch.rasters)}  # those missing at first too
            replace_files(path, files, without=[each for each in _optional_files(path) if each not in kept])
        else:
            write_atomic(path, files[path.name])
    known[path] = {name: sha256(files[name]).hexdigest() for name in files if not is_embedded_name(name)}


def file_hashes(path: Path) -> Hashes:
    """Return the hashes of a sketch's files but embedded rasters, which their names have; "": unreadable."""
    names = (SETTINGS, JOURNAL, *(f"{layer}.png" for layer in PAINTED_LAYERS), *_VECTORS)
    hashes = dict[str, str]()
    with suppress(OSError):
        for file in [path / name for name in names] if path.is_dir() else [path]:
            if file.is_file():
                hashes[file.name] = ""
                hashes[file.name] = content_hash(RasterSource(str(file)))
    return hashes


def new_sketch(path: str | Path, sketch: Sketch | None = None) -> None:
    """Write a sketch, by default a starter with a comment on every line, where there is none.

    Parameters
    ----------
    path
        A new or an empty folder, or a new file named ``*.sketch``.
    sketch
        By default a small painting.

    Raises
    ------
    InputError
        If `path` is a file, or a folder that is not empty.
    SketchterrainError
        If the system cannot write there.
    """
    target = Path(path)
    with wrap_os_errors(target):
        if target.is_dir() and any(target.iterdir()):
            raise InputError(f"{one_line(target)}: expected a new or an empty folder, this one is not empty")
        if target.is_file():
            raise InputError(f"{one_line(target)}: expected a folder or a new file, this one exists")
    save_sketch(starter_sketch() if sketch is None else sketch, target)


def pack_sketch(sketch: Sketch, *, extra_files: Mapping[str, bytes] | None = None) -> bytes:
    """Return the content of a ``.sketch`` file, with extra files by name, which loading ignores."""
    return pack_zip({**_encode(sketch, None), **(extra_files or {})})


def _decode(contents: Mapping[str, bytes], place: str, base: Path | None = None) -> Sketch:
    """Return a sketch whose folders of pictures, rasters and draped layers are relative to `base`."""
    images, notes = dict[str, LabelImage](), list[str]()
    for name in PAINTED_LAYERS:
        if f"{name}.png" in contents:
            with prefix_errors(f"{place}/{name}.png"):
                images[name], changes = decode_layer(contents[f"{name}.png"], name)
                notes += [f"{name}.png: {change}" for change in changes]
                _check_same_size(images, name)
    with prefix_errors(f"{place}/{SETTINGS}"):
        sketch = parse_settings(contents[SETTINGS], images)
        sketch = _relocated(sketch, str if base is None else base.absolute().joinpath, contents)
        for name, values in sketch.materials.items():
            if base is not None and values.get("folder"):
                picture_files(values["folder"], name)  # raises InputError without pictures
    vectors = {}
    for name in VECTOR_LAYERS:
        if f"{name}{_SUFFIX}" in contents:
            from sketchterrain.features.files import decode_vectors  # GDAL, which takes 90 MB

            with prefix_errors(f"{place}/{name}{_SUFFIX}"):
                vectors[name] = decode_vectors(contents[f"{name}{_SUFFIX}"], name, sketch.frame)
    drapes = sketch.drapes
    if _EDITS in contents:
        with prefix_errors(f"{place}/{_EDITS}"):
            drapes = with_edits(drapes, contents[_EDITS])
    with prefix_errors(place):
        return sketch.replace(vectors=vectors, drapes=drapes, notes=tuple(notes))


def shown_files(sketch: Sketch) -> list[str]:
    """Return digests of the files that are shown on the terrain: draped layers, and pictures of materials."""
    paths = [layer.path for layer in sketch.drapes]
    for name, values in sketch.materials.items():
        if values.get("folder"):
            paths += map(str, picture_files(values["folder"], name).values())
    return content_digests(map(RasterSource, paths))


def _check_same_size(images: Mapping[str, LabelImage], name: str) -> None:
    first = next(iter(images))
    (height, width), (first_height, first_width) = images[name].shape, images[first].shape
    if (height, width) != (first_height, first_width):
        raise InputError(
            f"{width}×{height} px, but {first}.png is {first_width}×{first_height} px: expected one size"
        )


def _relocated(
    sketch: Sketch, place: Callable[[str], str | Path], stored: Mapping[str, bytes] = MappingProxyType({})
) -> Sketch:
    """Return a sketch with changed paths of pictures, rasters and draped layers; with `stored` rasters."""

    def relocated(source: RasterSource) -> RasterSource:
        if source.path in stored and is_embedded_name(source.path):
            return replace(source, content=stored[source.path])
        return replace(source, path=str(place(source.path)))

    if not (sketch.materials or sketch.rasters or sketch.drapes):
        return sketch
    materials = {name: dict(values) for name, values in sketch.materials.items()}
    for values in materials.values():
        if values.get("folder"):
            values["folder"] = str(place(values["folder"]))
    drapes = tuple(each.replace(path=str(place(each.path))) for each in sketch.drapes)
    return sketch.replace(materials=materials, rasters=tuple(map(relocated, sketch.rasters)), drapes=drapes)


def _encode(sketch: Sketch, base: Path | None) -> dict[str, bytes]:
    if base is not None:
        sketch = _relocated(sketch, partial(relative_path, base=base))
    from sketchterrain.features.files import encode_vectors  # GDAL

    files = {}
    for name, image in sketch.layers.items():
        encode = partial(encode_layer, image, LAYERS[name].colour)
        files[f"{name}.png"] = _encoded.get_or_compute((digest_of(image), name), encode)
    place = sketch.frame["crs"], sketch.frame["east"], sketch.frame["north"]
    for name, layer in sketch.vectors.items():
        if len(layer):
            write = partial(encode_vectors, layer, sketch.frame)
            files[f"{name}{_SUFFIX}"] = _encoded.get_or_compute((layer, *place), write)
    if any(each.edits for each in sketch.drapes):
        files[_EDITS] = encode_edits(sketch.drapes)
    files |= embedded_files(sketch.rasters)
    return files | {SETTINGS: settings_text(sketch).encode("utf-8")}
