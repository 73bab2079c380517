"""One run at a time writes a world."""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.system import lock_file
from sketchterrain.whole_files import telling_failure

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import BinaryIO

__all__ = ["held"]


@contextmanager
def held(journal: Path, output: Path) -> Iterator[BinaryIO]:
    """Yield a journal to append to, made if it is not there; its lock ends with the process at the latest.

    Raises
    ------
    InputError
        If another run has it.
    SketchterrainError
        If the system cannot write it.
    """
    with _opened(journal) as stream:
        try:
            lock_file(stream.fileno())
        except BlockingIOError:
            raise InputError(f"{one_line(output)}: another run is at work there") from None
        except OSError:  # some network's file systems have no locks
            pass
        if not _is_open(journal, stream):  # whoever had it was just done with it
            raise InputError(f"{one_line(output)}: another run has just ended there; try again")
        try:
            yield stream
        finally:
            if os.fstat(stream.fileno()).st_size == 0 and _is_open(journal, stream):
                journal.unlink()  # it tells of nothing
                with suppress(OSError):  # where there is more in it
                    journal.parent.rmdir()


def _opened(journal: Path) -> BinaryIO:
    with telling_failure(journal):
        journal.parent.mkdir(parents=True, exist_ok=True)
        return journal.open("ab")


def _is_open(path: Path, stream: BinaryIO) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(stream.fileno()))
    except FileNotFoundError:
        return False
