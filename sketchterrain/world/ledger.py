"""What is done of a world, and the hashes of its files: first a journal, then a ledger."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Final, Literal

import msgspec

from sketchterrain.errors import InputError, one_line
from sketchterrain.whole_files import telling_failure
from sketchterrain.world.made import Task, WrittenFile
from sketchterrain.world.roots import is_inside

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path
    from typing import BinaryIO

__all__ = ["Header", "Journal", "Ledger", "ledger_text", "read_journal", "read_ledger"]

_FORMAT: Final = 1
_SYNC = 5.0  # s between two times that the journal is flushed to disk


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The first line of a journal or a ledger.

    Attributes
    ----------
    fingerprint : str
        What the world follows from; see :func:`~sketchterrain.world.fingerprint.fingerprint`.
    version : str
        The program's.
    device : str
        What all of it is made on where that has bits of its own; empty where any device will do that passes
        the self-test.
    format : int
    """

    fingerprint: str
    version: str
    device: str = ""
    format: Literal[1] = _FORMAT


class Ledger(msgspec.Struct):
    """What a journal or a ledger tells.

    Attributes
    ----------
    header : Header
    done : dict of Task to tuple of WrittenFile
        Tasks whose files are there.
    others : tuple of WrittenFile
        Files that belong to the whole.
    lost : int
        Lines that were broken and told of nothing.
    """

    header: Header
    done: dict[Task, tuple[WrittenFile, ...]]
    others: tuple[WrittenFile, ...] = ()
    lost: int = 0

    @property
    def files(self) -> Iterator[WrittenFile]:
        """All files."""
        yield from self.others
        for files in self.done.values():
            yield from files


def ledger_text(ledger: Ledger) -> str:
    """Return the ledger of a world that is whole: sorted, so the same whoever made what and when."""
    lines = [_line(*each) for each in sorted(ledger.done.items())]
    return "".join(f"{line}\n" for line in (_head(ledger.header), _line(None, sorted(ledger.others)), *lines))


def read_ledger(text: str, place: object) -> Ledger:
    """Read a ledger's text. Lines that are broken tell of nothing.

    Raises
    ------
    InputError
        If it is none.
    """
    return _read(text.encode().splitlines(), place)


def read_journal(path: Path) -> Ledger | None:
    """Read a journal; None where there is none yet. Lines that a crash has cut off tell of nothing.

    Raises
    ------
    InputError
        If there is something else in its place, or it cannot be read.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    return _read(content.splitlines(), path) if b"\n" in content else None


class Journal:
    """Appends a line for each task that is done.

    Parameters
    ----------
    path
    stream
        Of that file, to append to, with its lock held.
    """

    def __init__(self, path: Path, stream: BinaryIO) -> None:
        self._path, self._stream = path, stream
        self._synced = time.monotonic()

    def begin(self, ledger: Ledger) -> None:
        """Tell anew all that is known; before, the file may hold anything or nothing.

        Raises
        ------
        SketchterrainError
            If the system cannot write it.
        """
        with telling_failure(self._path):
            self._stream.truncate(0)
        lines = [_line(*each) for each in ledger.done.items()]
        self._write(_head(ledger.header), _line(None, ledger.others), *lines)
        self.sync()

    def go_on(self, others: tuple[WrittenFile, ...]) -> None:
        """Keep what the file holds, ending a line that was cut off; tell which files belong to the whole.

        Raises
        ------
        SketchterrainError
            If the system cannot write it.
        """
        self._write("", _line(None, others))

    def add(self, task: Task | None, files: tuple[WrittenFile, ...]) -> None:
        """Tell that a task is done, or which files belong to the whole; no files: it is not, any more.

        Raises
        ------
        SketchterrainError
            If the system cannot write it.
        """
        self._write(_line(task, files))
        if time.monotonic() - self._synced > _SYNC:
            self.sync()

    def sync(self) -> None:
        """Let what was told survive a crash of the machine, too.

        Raises
        ------
        SketchterrainError
            If the system cannot write it.
        """
        with telling_failure(self._path):
            os.fsync(self._stream.fileno())
        self._synced = time.monotonic()

    def _write(self, *lines: str) -> None:
        with telling_failure(self._path):
            self._stream.write("".join(f"{line}\n" for line in lines).encode())
            self._stream.flush()


class _Line(msgspec.Struct, forbid_unknown_fields=True):
    task: Task | None
    files: tuple[WrittenFile, ...]


def _read(lines: Sequence[bytes], place: object) -> Ledger:
    """Return what lines tell; a broken one costs no more than that its files are made again."""
    try:
        ledger = Ledger(msgspec.json.decode(lines[0] if lines else b"", type=Header), {})
    except msgspec.MsgspecError as error:
        raise InputError(
            f"{one_line(place)}: expected a list of a world's files, this is another file or broken "
            f"({one_line(error)})"
        ) from None
    decoder = msgspec.json.Decoder(_Line)
    for line in lines[1:]:
        if not line:
            continue
        try:
            told = decoder.decode(line)
        except msgspec.MsgspecError:
            ledger.lost += 1
            continue
        if not all(is_inside(each.file) for each in told.files):
            raise InputError(f"{one_line(place)}: names a file that is not in the world's folder")
        if told.task is None:
            ledger.others = told.files
        elif told.files:
            ledger.done[told.task] = told.files
        else:
            ledger.done.pop(told.task, None)
    return ledger


def _head(header: Header) -> str:
    return msgspec.json.encode(header).decode()


def _line(task: Task | None, files: Iterable[WrittenFile]) -> str:
    return msgspec.json.encode(_Line(task, tuple(files))).decode()
