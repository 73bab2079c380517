"""The manifest of a batch: what was made from what, what came of it, and whether it is still there."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from hashlib import sha256
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from sketchterrain.errors import InputError, one_line
from sketchterrain.whole_files import write_whole

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

__all__ = ["MANIFEST", "Entry", "File", "Manifest", "hashed", "read_manifest"]

MANIFEST = "manifest.json"
_FORMAT = 1
_LARGEST = 256 << 20  # bytes
_AT_ONCE = 1 << 20


class File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file of an item: its name in the item's folder, how many bytes it has, and their SHA-256."""

    file: str
    bytes: int
    sha256: str


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the manifest says of one item.

    Attributes
    ----------
    name : str
        Of its folder in the batch's.
    sketch : str
        As it was named.
    seed : int
    settings : dict
        In place of the sketch's.
    state : {'waiting', 'done', 'partial', 'failed'}
        Partial: all is written but the preview.
    input : str
        What its files follow from; see `Fingerprints`.
    files : tuple of File
        What is there.
    seconds : float
        It was in work.
    timings : dict
        Seconds of its stages.
    adherence : dict or None
        How far the terrain does what the sketch says.
    notes : tuple of str
        Devices that failed, and what was done about it.
    error : str
        Why it failed, or why there is no preview.
    """

    name: str
    sketch: str
    seed: int
    settings: dict[str, int | float | str] = {}
    state: Literal["waiting", "done", "partial", "failed"] = "waiting"
    input: str = ""
    files: tuple[File, ...] = ()
    seconds: float = 0.0
    timings: dict[str, float] = {}
    adherence: dict[str, Any] | None = None
    notes: tuple[str, ...] = ()
    error: str = ""

    def whole(self, folder: Path) -> bool:
        """Tell whether every file of a finished item is in its folder, as it was written."""
        try:
            return self.state == "done" and all(hashed(folder / each.file) == each for each in self.files)
        except OSError:
            return False


class _Document(msgspec.Struct, forbid_unknown_fields=True):
    format: Literal[1]
    version: str
    output: dict[str, Any]
    items: list[Entry]
    sheets: list[str]


@dataclass
class Manifest:
    """The entries of a batch's items, in their order, and the file that they are kept in.

    Attributes
    ----------
    folder : Path
        Of the batch.
    output : dict
        What is written of each item.
    entries : dict of str to Entry
        By name.
    sheets : list of str
        Contact sheets.
    """

    folder: Path
    output: Mapping[str, Any]
    entries: dict[str, Entry] = field(default_factory=dict)
    sheets: list[str] = field(default_factory=list)
    _lines: dict[str, tuple[Entry, str]] = field(default_factory=dict, repr=False)

    @property
    def path(self) -> Path:
        """Its file."""
        return self.folder / MANIFEST

    def write(self) -> None:
        """Write it; whoever reads it meanwhile finds the old one or this one.

        Raises
        ------
        SketchterrainError
            If the system cannot.
        """
        head = {"format": _FORMAT, "version": version("sketchterrain"), "output": self.output}
        told = [f" {_json(key)}: {_json(value)}," for key, value in head.items()]
        items = ",\n".join(f"  {self._line(entry)}" for entry in self.entries.values())
        text = "\n".join(["{", *told, ' "items": [', items, " ],", f' "sheets": {_json(self.sheets)}', "}\n"])
        write_whole(self.path, text.encode())

    def _line(self, entry: Entry) -> str:
        # Of thousands of entries one has changed since the last time.
        known = self._lines.get(entry.name)
        if known is None or known[0] is not entry:
            known = self._lines[entry.name] = entry, _json(msgspec.to_builtins(entry))
        return known[1]


def read_manifest(folder: Path) -> Manifest | None:
    """Read the manifest of a batch's folder; None where there is none.

    Raises
    ------
    InputError
        If there is something in its place that is none, or is broken.
    """
    path = folder / MANIFEST
    place = one_line(path)
    try:
        if not path.exists():
            return None
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{place}: expected a batch's manifest, this has more than {_LARGEST >> 20} MiB")
        document = msgspec.json.decode(path.read_bytes(), type=_Document)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(
            f"{place}: expected a batch's manifest, this is another file or broken ({one_line(error)}); "
            "take another folder, or move it away to begin anew"
        ) from None
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({error.strerror})") from None
    entries = {entry.name: entry for entry in document.items}
    unsafe = next((name for name, safe in _names(document.items, document.sheets) if not safe), None)
    if unsafe is not None or len(entries) < len(document.items):
        what = "an item twice" if unsafe is None else f"the name {one_line(unsafe)!r}"
        raise InputError(f"{place}: expected a batch's manifest, this one has {what}")
    return Manifest(folder, document.output, entries, document.sheets)


def hashed(path: Path) -> File:
    """Return what a file holds.

    Raises
    ------
    OSError
        If it is not there or cannot be read.
    """
    digest, size = sha256(), 0
    with path.open("rb") as stream:
        while part := stream.read(_AT_ONCE):
            digest.update(part)
            size += len(part)
    return File(path.name, size, digest.hexdigest())


def _names(items: Iterable[Entry], sheets: Iterable[str]) -> Iterator[tuple[str, bool]]:
    """Return every name in a manifest, and whether it leads to where such a thing may be."""
    for entry in items:
        yield entry.name, _inside(entry.name)
        for each in entry.files:
            yield each.file, _inside(each.file) and "/" not in each.file
    for name in sheets:
        yield name, _inside(name)


def _inside(name: str) -> bool:
    """Tell whether a name leads to a place inside the folder that it is looked up in."""
    parts = name.split("/")
    return all(part not in ("", ".", "..") and "\0" not in part and "\\" not in part for part in parts)


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
