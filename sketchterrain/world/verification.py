"""Whether the files of a world are what was written, by their hashes."""

from __future__ import annotations

import os
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple

from sketchterrain.world.making import hashed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from concurrent.futures import Future

    from sketchterrain.world.ledger import Ledger
    from sketchterrain.world.made import WrittenFile
    from sketchterrain.world.roots import Roots

__all__ = ["Broken", "lost_lines", "verify"]

_MOST_THREADS = 4  # a disk gives no more than they take


class Broken(NamedTuple):
    """A file that is not what was written.

    Attributes
    ----------
    file : str
        Its name in the ledger.
    why : str
        Missing, or how it differs.
    """

    file: str
    why: str


def verify(ledger: Ledger, roots: Roots, *, progress: Callable[[float], None]) -> Iterator[Broken]:
    """Read every file of a ledger again, and return those that have other bytes or are missing.

    Parameters
    ----------
    ledger
    roots
        Where its names begin.
    progress
        Called with the share of the bytes that is read, 0 … 1.
    """
    whole, read = max(sum(file.bytes for file in ledger.files), 1), 0
    for file, why in _checked(ledger.files, roots):
        read += file.bytes
        progress(read / whole)
        if why:
            yield Broken(file.file, why)


def lost_lines(ledger: Ledger) -> Broken | None:
    """Return what is wrong with the ledger of a finished world itself; None where each line tells."""
    if ledger.lost:
        return Broken("ledger", f"has broken lines: {ledger.lost}")
    return None if ledger.others else Broken("ledger", "does not name the files that belong to the whole")


def _checked(files: Iterable[WrittenFile], roots: Roots) -> Iterator[tuple[WrittenFile, str]]:
    """Return each file with what is wrong with it, in order; some are read at once."""
    threads = min(os.cpu_count() or 1, _MOST_THREADS)
    with ThreadPoolExecutor(threads, "verify") as several:
        waiting: deque[tuple[WrittenFile, Future[str]]] = deque()
        try:
            for file in files:
                waiting.append((file, several.submit(_why, file, roots)))
                if len(waiting) > 4 * threads:
                    first, found = waiting.popleft()
                    yield first, found.result()
            while waiting:
                first, found = waiting.popleft()
                yield first, found.result()
        finally:
            several.shutdown(cancel_futures=True)


def _why(file: WrittenFile, roots: Roots) -> str:
    """Return what is wrong with a file; nothing where it is as it was written."""
    path = roots.path(file.file)
    try:
        size = path.stat().st_size
        if size != file.bytes:
            return f"has {size} bytes, {file.bytes} were written"
        return "" if hashed(path, file.file) == file else "has other bytes than were written"
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        return f"cannot be read ({error.strerror})"
