"""The manifest of a batch: what was made from what, with the hash of every file."""

from hashlib import file_digest
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from sketchterrain.errors import InputError, one_line
from sketchterrain.whole_files import write_atomic

MANIFEST = "manifest.json"
# Names come from a file that anyone may have written: none may lead out of the batch's folder.
_PART = r"(?!\.{1,2}(?:/|\Z))[^/\\\x00]+"
_FileName = Annotated[str, msgspec.Meta(pattern=rf"\A{_PART}\Z")]
_ItemName = Annotated[str, msgspec.Meta(pattern=rf"\A{_PART}(?:/{_PART})*\Z")]


class File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file of an item: its name in the item's folder, how many bytes it has, and their SHA-256."""

    file: _FileName
    bytes: int
    sha256: str


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the manifest says of one item.

    `input` is its fingerprint, `seconds` the wall time, `timings` that of each stage, `notes` the devices
    that failed. Partial is an item that lacks its preview, and `error` says why, or why an item failed.
    """

    name: _ItemName
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
        """Return whether every file is in a folder, with the same hash."""
        try:
            return all(hashed(folder / each.file) == each for each in self.files)
        except OSError:
            return False


class Manifest(msgspec.Struct, forbid_unknown_fields=True):
    """What is written of each terrain of a batch, the entries of its items, and its contact sheets."""

    format: Literal[1]
    version: str
    output: Any
    items: list[Entry]
    sheets: list[_FileName]

    @property
    def entries(self) -> dict[str, Entry]:
        """The entries by name."""
        return {entry.name: entry for entry in self.items}

    def write(self, folder: Path) -> None:
        """Write it as a whole; raise SketchterrainError if the system cannot."""
        write_atomic(folder / MANIFEST, msgspec.json.format(msgspec.json.encode(self), indent=1))


def read_manifest(folder: Path) -> Manifest | None:
    """Return the manifest in a folder, None where there is none; raise InputError if it is not valid."""
    path = folder / MANIFEST
    try:
        manifest = msgspec.json.decode(path.read_bytes(), type=Manifest)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(
            f"{one_line(path)}: expected a batch's manifest, this is another file or broken "
            f"({one_line(error)}); take another folder, or move it away to start over"
        ) from None
    if len(manifest.entries) < len(manifest.items):
        raise InputError(f"{one_line(path)}: expected a batch's manifest, this one has an item twice")
    return manifest


def hashed(path: Path) -> File:
    """Return a file's size and hash; raise OSError if it cannot be read."""
    with path.open("rb") as stream:
        digest = file_digest(stream, "sha256").hexdigest()
        return File(path.name, stream.tell(), digest)
