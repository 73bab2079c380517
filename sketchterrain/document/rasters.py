"""Raster sources: georeferenced grids and pictures that a sketch refers to by path and hash."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from hashlib import blake2b, sha256
from pathlib import Path
from typing import Any, Final

from sketchterrain.caching import LRUCache
from sketchterrain.document.frame import check_frame
from sketchterrain.errors import InputError, check_keys, format_value, one_line
from sketchterrain.io.disk_cache import RecordCache
from sketchterrain.io.files import hash_file, too_large, wrap_read_errors
from sketchterrain.schema.parameters import (
    FRAME,
    Parameter,
    Sentinel,
    check_items,
    check_values,
    parameter_table,
)

MAX_RASTERS: Final = 64
"""The most raster sources of a sketch."""

MAX_EMBEDDED_BYTES: Final = 64 << 20
"""The most bytes of all raster files that are stored in a sketch."""

RASTER: Final = parameter_table(
    Parameter(
        *("path", str, "", 1, 4096, "", "file, absolute or relative to the sketch"),
        # A line of the settings may have 250 dots.
        form=(r"(?:[^\0.]*\.){0,200}[^\0.]*", "a path of 1 to 4096 characters in UTF-8"),
    ),
    Parameter(
        *("role", str, "picture", 0, 10, ""),
        help="what it is for: a picture lies beneath the paint, an orthophoto on the ground",
        choices=("elevation", "orthophoto", "picture"),
    ),
    Parameter("band", int, 1, 1, 65535, "", "its band; of a picture in colour the first one"),
    Parameter(
        *("sha256", str, "", 0, 64, "", "hash of the file when it was added; empty is any content"),
        form=("[0-9a-f]{64}", "64 hexadecimal digits"),
    ),
    Parameter(
        *("accuracy", float, -1.0, -1.0, 1000.0, "m"),
        "largest error of its heights; -1 is from the file: half a step of whole numbers, else 0",
        sentinel=Sentinel(-1.0, "From the file", 1.0),
        soft_range=(0.0, 50.0),
    ),
    replace(FRAME["vertical"], help="vertical datum of its heights, as EPSG:5773; empty is the frame's"),
    Parameter(
        *("offset", float, 0.0, -12000.0, 12000.0, "m", "added to its heights"),
        soft_range=(-100.0, 100.0),
    ),
    Parameter("units", str, "", 0, 40, "characters", "unit of its heights, as us-ft; empty is the file's"),
    Parameter("signed", int, 0, 0, 1, "", "1 takes whole numbers without a sign for signed ones"),
    Parameter("cell", float, 0.0, 0.0, 1e5, "m", "side of a cell in a file without a place; 0: it has one"),
    Parameter(
        *("range", str, "", 0, 80, ""),
        "heights (m) of its least and greatest numbers; empty: they are heights",
        form=(r"\s*-?\d{1,5}(\.\d{1,9})?\s*,\s*-?\d{1,5}(\.\d{1,9})?\s*", 'two heights as "0,900"'),
    ),
    Parameter(
        *("encoding", str, "", 0, 13, "", "of heights in colours, or order of bytes in .r16 and .raw"),
        choices=("", "big-endian", "little-endian", "mapbox", "terrarium"),
    ),
    Parameter("columns", int, 0, 0, 1 << 17, "", "samples in a row of .r16 and .raw; 0 is a square"),
)
"""Keys of ``[[raster]]``; those from ``accuracy`` on are for elevation."""

_EMBEDDED: Final = re.compile(r"[A-Za-z0-9_-]{1,40}-[0-9a-f]{8}\.raster")
_SUFFIXES: Final = {b"II": ".tif", b"MM": ".tif", b"\x93N": ".npy", b"\x89P": ".png"}  # by the first bytes
_LARGE: Final = 1 << 24  # bytes of a file whose hash is stored on disk
_hashes = LRUCache(256)  # of files by path, size and time of modification, and of embedded contents


@dataclass(frozen=True, eq=False)
class RasterSource:
    """A raster file by its path, absolute once a sketch is loaded, with the keys of `RASTER`.

    `content` is that of a file stored in the sketch, whose path is its name there. Raise InputError if a
    value is not as declared.
    """

    path: str
    role: str = "picture"
    band: int = 1
    sha256: str = ""
    content: bytes | None = None
    accuracy: float = -1.0
    vertical: str = ""
    offset: float = 0.0
    units: str = ""
    signed: int = 0
    cell: float = 0.0
    range: str = ""
    encoding: str = ""
    columns: int = 0

    def __post_init__(self) -> None:
        for name, value in check_values(self.values, RASTER, "[[raster]]", "raster.").items():
            object.__setattr__(self, name, value)
        check_frame({"crs": "", "vertical": self.vertical})
        if self.content is not None and not is_embedded_name(self.path):
            raise InputError(f"raster.path = {format_value(self.path)}: expected the name of a stored raster")

    # By hand: messages to other processes contain values of eq=False only once.
    def __eq__(self, other: object) -> bool:
        return isinstance(other, RasterSource) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash(self.path)

    @property
    def values(self) -> dict[str, Any]:
        """Values by the names in `RASTER`."""
        return {name: getattr(self, name) for name in RASTER}

    @property
    def stored_values(self) -> dict[str, Any]:
        """Values to store: those of elevation of a picture, and those for odd files, only if they are set."""
        always = list(RASTER)[: 7 if self.role == "elevation" else 4]
        return {k: value for k, value in self.values.items() if k in always or value != RASTER[k].default}

    @property
    def title(self) -> str:
        """The file's name."""
        return one_line(Path(self.path).name)

    @property
    def nbytes(self) -> int:
        """Approximate memory."""
        return len(self.content or b"")


def parse_raster(table: Mapping[str, object]) -> RasterSource:
    """Return the source in one ``[[raster]]`` table; raise InputError if it is invalid."""
    check_keys(table, RASTER)
    if "path" not in table:
        raise InputError(f"no path: expected {', '.join(RASTER)}")
    return RasterSource(**table)  # type: ignore[arg-type] # it checks every value


def check_rasters(rasters: Iterable[object]) -> tuple[RasterSource, ...]:
    """Return a sketch's raster sources; raise InputError if they are too many or too large."""
    checked = check_items(RasterSource, rasters, "rasters", most=MAX_RASTERS)
    if sum(map(len, embedded_files(checked).values())) > MAX_EMBEDDED_BYTES:
        raise too_large("rasters stored in the sketch", MAX_EMBEDDED_BYTES)
    return checked


def raster_source(path: Path, role: str, *, embed: bool = False, **values: Any) -> RasterSource:
    """Return a source of a file, with its hash; `embed`: with a copy of it to store in the sketch."""
    source = RasterSource(str(path.absolute()), role, **values)
    if problem := raster_problem(source):
        raise InputError(problem)
    with wrap_read_errors(path):
        return embedded(source) if embed else replace(source, sha256=content_hash(source))


def embedded(source: RasterSource) -> RasterSource:
    """Return a source with a copy of its file to store in the sketch; raise InputError if it is too large."""
    path = Path(source.path)
    beside = path.with_name(f"{path.name}.aux.xml")
    with wrap_read_errors(path), path.open("rb") as stream:
        content = stream.read(MAX_EMBEDDED_BYTES + 1)
        if beside.is_file() and b"<NoDataValue" in beside.read_bytes():
            raise InputError(
                f"{one_line(beside)}: its no-data value cannot be stored, expected it in the raster"
            )
    if len(content) > MAX_EMBEDDED_BYTES:
        raise too_large(one_line(path), MAX_EMBEDDED_BYTES)
    digest = sha256(content).hexdigest()
    stem = re.sub(r"[^A-Za-z0-9_-]+", "_", path.stem)[:40] or "raster"
    return replace(source, path=f"{stem}-{digest[:8]}.raster", sha256=digest, content=content)


def is_embedded_name(name: str) -> bool:
    """Return whether a file of a sketch is a raster stored in it, by its name."""
    return _EMBEDDED.fullmatch(name) is not None


def embedded_files(rasters: Iterable[RasterSource]) -> dict[str, bytes]:
    """Return the files stored in the sketch by name."""
    return {each.path: each.content for each in rasters if each.content is not None}


@contextmanager
def raster_file(source: RasterSource, what: str = "raster") -> Iterator[Path]:
    """Yield a source's file; one stored in the sketch is written to a temporary one of its format.

    An InputError that is raised meanwhile names the source.
    """
    path = Path(source.path)
    with ExitStack() as stack:
        if source.content is not None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="sketchterrain-"))
            # Without the hash: the name of an HGT is its place.
            path = Path(folder) / (path.stem.rpartition("-")[0] + _suffix(source.content, source.range))
            path.write_bytes(source.content)
        try:
            yield path
        except InputError as error:
            reason = str(error).replace(one_line(path), path.name).removeprefix(f"{path.name}: ")
            raise InputError(f"{what} {one_line(source.path)}: {reason}") from None


def _suffix(content: bytes, height_range: str) -> str:
    """Return the suffix of a raster's format."""
    head = content[:200].lstrip().lower()
    if head.startswith(b"pk"):
        return ".npz" if b".npy" in head else ".zip"
    other = ".asc" if head.startswith(b"ncols") else ".r16" if height_range else ".hgt"
    return _SUFFIXES.get(content[:2], other)


def raster_problem(source: RasterSource, what: str = "raster") -> str:
    """Return in one line that a source is missing or has changed since it was added; empty if neither."""
    place, path = f"{what} {one_line(source.path)}", Path(source.path)
    try:
        if source.content is None and not path.is_file():
            return f"{place}: {'expected a file' if path.exists() else 'the file is missing'}"
        if source.sha256 and source.sha256 != content_hash(source):
            return f"{place}: its content has changed since it was added"
    except OSError as error:
        return f"{place}: cannot be read ({one_line(error.strerror or error)})"
    return ""


def content_hash(source: RasterSource) -> str:
    """Return the SHA-256 of a source's content; a file is hashed once until it changes.

    Hashes of large files are stored on disk, by their path, size and times.
    """
    if source.content is not None:
        return _hashes.get_or_compute(source.content, sha256(source.content).hexdigest)
    path = Path(source.path)
    facts = path.stat()
    stamp = facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns
    return _hashes.get_or_compute((path, *stamp), lambda: _file_hash(path, stamp))


def _file_hash(path: Path, stamp: tuple[int, int, int]) -> str:
    name = blake2b(os.fsencode(path.absolute()), digest_size=8).digest()
    key = int.from_bytes(name, "big", signed=True), *stamp
    if stamp[0] >= _LARGE and (stored := _stored_hashes().get(key)):
        return stored.decode()
    found = hash_file(path)[1]
    if stamp[0] >= _LARGE:
        _stored_hashes().add({key: found.encode()})
    return found


@cache
def _stored_hashes() -> RecordCache:
    return RecordCache("hashes", "sha256", max_bytes=1 << 24)


def content_digests(rasters: Iterable[RasterSource]) -> list[str]:
    """Return the SHA-256 of the content of each source, or why there is none: results depend on them."""
    return [raster_problem(each) or content_hash(each) for each in rasters]
