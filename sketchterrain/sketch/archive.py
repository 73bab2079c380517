"""A sketch in one file: a zip, read without trust and never unpacked to disk, written with stable bytes."""

from __future__ import annotations

import io
import stat
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path

from sketchterrain.sketch.contents import LARGEST_TOTAL, SETTINGS, file_limit, sketch_files
from sketchterrain.sketch.safe_zip import open_zip

_EPOCH = (1980, 1, 1, 0, 0, 0)


def read_zip(path: Path, place: str) -> dict[str, bytes]:
    """Return the content of the sketch's files in a zip, by name.

    The files may lie at the top or in one folder at the top. What else lies there is looked at by name
    only. No more is ever decompressed than a sketch's files may have, whatever the zip says of itself.
    """
    with open_zip(
        path, place, largest=LARGEST_TOTAL, expected="a folder or a whole zip", inside="the sketch"
    ) as archive:
        root = _root(archive.names)
        inner = [name.removeprefix(root) for name in archive.names if name.startswith(root)]
        names = [name for name in inner if name and "/" not in name]
        return {
            name: archive.read(f"{root}{name}", file_limit(name), name) for name in sketch_files(names, place)
        }


def pack_zip(files: Mapping[str, bytes]) -> bytes:
    """Return a zip of files, by name; the same files give the same bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, date_time=_EPOCH)
            info.create_system = 3  # Unix, on every system, for the mode below
            info.external_attr = (stat.S_IFREG | 0o644) << 16
            archive.writestr(info, files[name])  # stored: images are compressed already
    return stream.getvalue()


def _root(entries: Collection[str]) -> str:
    """Return the one top folder (with its ``/``) that holds the whole sketch, or nothing."""
    tops = {name.split("/")[0] for name in entries if not name.startswith((".", "__MACOSX/"))}
    top = f"{tops.pop()}/" if len(tops) == 1 else ""
    return top if f"{top}{SETTINGS}" in entries else ""
