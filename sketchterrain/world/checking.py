"""A world that was written, compared with its ledger file by file."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sketchterrain.errors import InputError, one_line
from sketchterrain.world.ledger import read_journal, read_ledger
from sketchterrain.world.roots import Roots, plants_folder
from sketchterrain.world.verification import lost_lines, verify

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sketchterrain.world.ledger import Ledger
    from sketchterrain.world.verification import Broken

__all__ = ["check_world"]

_ZARR: Final = ("ledger/c/0", "ledger/journal.jsonl")
_TILES: Final = ("ledger.jsonl", "journal.jsonl")


def check_world(path: str | Path, *, progress: Callable[[float], None]) -> Iterator[Broken]:
    """Read every file of a world again, and return those that are missing or not as they were written.

    Parameters
    ----------
    path
        A Zarr store, a folder of tiles, or the GeoTIFF of the heights.
    progress
        Called with the share that is read, 0 … 1.

    Raises
    ------
    InputError
        If there is no ledger, or it is broken; a world that is not finished has none.
    """
    place = Path(path)
    ledger = _ledger(place)
    folder = place if place.is_dir() else place.parent
    lost = lost_lines(ledger)
    return chain(
        () if lost is None else (lost,),
        verify(ledger, Roots(folder, plants_folder(place)), progress=progress),
    )


def _ledger(place: Path) -> Ledger:
    if place.is_dir():
        candidates = [(place / text, place / journal) for text, journal in (_ZARR, _TILES)]
    else:
        parts = place.with_name(f".{place.name}.parts")
        candidates = [(place.with_name(f"{place.stem}.ledger.jsonl"), parts / "journal.jsonl")]
    for path, journal in candidates:
        if read_journal(journal) is not None:
            raise InputError(f"{one_line(place)}: is not finished; world --resume goes on with it")
        try:
            return read_ledger(path.read_text("utf-8", "replace"), path)
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    raise InputError(f"{one_line(place)}: no ledger of a world's files is there")
