"""``.sketch`` files: a sketch's files in one zip, never unpacked to disk, with reproducible bytes."""

from __future__ import annotations

import io
import stat
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path

from sketchterrain.sketch.contents import MAX_TOTAL_BYTES, SETTINGS, file_limit, sketch_files
from sketchterrain.sketch.safe_zip import open_zip

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
