"""A sketch in one file: a zip, read without trust and never unpacked to disk, written with stable bytes."""

from __future__ import annotations

import io
import stat
import struct
import zipfile
import zlib
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch.contents import LARGEST_TOTAL, SETTINGS, file_limit, sketch_files, too_large
from sketchterrain.sketch.wording import shown

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["pack_zip", "read_zip"]

_MOST_ENTRIES = 1000
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_EPOCH = (1980, 1, 1, 0, 0, 0)
_BROKEN = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    OSError,
    EOFError,
    ValueError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
)


def read_zip(path: Path, place: str) -> dict[str, bytes]:
    """Return the content of the sketch's files in a zip, by name.

    The files may lie at the top or in one folder at the top. What else lies there is looked at by name
    only. No more is ever decompressed than a sketch's files may have, whatever the zip says of itself.

    Raises
    ------
    InputError
        If it is not a zip, or an entry is unsafe (``..``, an absolute path, a link, encrypted, there
        twice), or it is too large, or a file is missing, unknown or damaged.
    """
    try:
        if path.stat().st_size > LARGEST_TOTAL:
            raise too_large(place, LARGEST_TOTAL)
        with zipfile.ZipFile(path) as archive:
            entries = _safe_entries(archive, place)
            root = _root(entries)
            files = {name[len(root) :]: info for name, info in entries.items() if name.startswith(root)}
            names = [name for name in files if name and "/" not in name]
            return {name: _read(archive, files[name], name, place) for name in sketch_files(names, place)}
    except _BROKEN as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise InputError(f"{place}: expected a folder or a whole zip ({one_line(reason)})") from None


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


def _safe_entries(archive: zipfile.ZipFile, place: str) -> dict[str, zipfile.ZipInfo]:
    infos = archive.infolist()
    if len(infos) > _MOST_ENTRIES:
        raise InputError(f"{place}: {len(infos)} entries: expected at most {_MOST_ENTRIES}")
    if sum(info.file_size for info in infos) > LARGEST_TOTAL:
        raise too_large(f"{place}, unpacked", LARGEST_TOTAL)
    entries: dict[str, zipfile.ZipInfo] = {}
    for info in infos:
        problem = "it is there twice" if info.filename in entries else _problem(info)
        if problem:
            raise InputError(f"{place}: entry {shown(info.orig_filename)} refused: {problem}")
        entries[info.filename] = info
    return entries


def _problem(info: zipfile.ZipInfo) -> str | None:
    name = info.orig_filename
    if "\\" in name or "\0" in name or ":" in name:
        return "expected a plain relative path with /"
    if name.startswith("/") or not {"", ".", ".."}.isdisjoint(name.removesuffix("/").split("/")):
        return "expected a path inside the sketch"
    if info.flag_bits & 0x1:
        return "it is encrypted"
    if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "expected a plain file, not a link or a device"
    if info.compress_type not in _METHODS:
        return "expected it stored or deflated"
    return None


def _root(entries: Mapping[str, zipfile.ZipInfo]) -> str:
    """Return the one top folder (with its ``/``) that holds the whole sketch, or nothing."""
    tops = {name.split("/")[0] for name in entries if not name.startswith((".", "__MACOSX/"))}
    top = f"{tops.pop()}/" if len(tops) == 1 else ""
    return top if f"{top}{SETTINGS}" in entries else ""


def _read(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, place: str) -> bytes:
    limit = file_limit(name)
    if info.file_size > limit:
        raise too_large(f"{place}/{name}", limit)
    with archive.open(info) as stream:
        content = stream.read(limit + 1)
    if len(content) > limit:
        raise too_large(f"{place}/{name}", limit)
    return content
