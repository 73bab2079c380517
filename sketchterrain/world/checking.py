"""A world that was written, compared with its ledger file by file."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sketchterrain.errors import InputError, one_line
from sketchterrain.world.ledger import read_journal, read_ledger
from sketchterrain.world.roots import Roots, plants_folder
from sketchterrain.world.settled import text_of
from sketchterrain.world.tile_names import JOURNAL, LEDGER, ledger_file, parts_folder
from sketchterrain.world.verification import lost_lines, verify
from sketchterrain.world.zarr_tree import BYTES
from sketchterrain.world.zarr_tree import LEDGER as ZARR_LEDGER

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sketchterrain.world.ledger import Ledger
    from sketchterrain.world.verification import Broken

__all__ = ["check_world"]

_ZARR: Final = (f"{ZARR_LEDGER}/{BYTES}", f"{ZARR_LEDGER}/{JOURNAL}")
_TILES: Final = (LEDGER, JOURNAL)


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
        candidates = [(ledger_file(place), parts_folder(place) / JOURNAL)]
    for path, journal in candidates:
        if read_journal(journal) is not None:
            raise InputError(f"{one_line(place)}: is not finished; world --resume goes on with it")
        if (text := text_of(path)) is not None:
            return read_ledger(text, path)
    raise InputError(f"{one_line(place)}: no ledger of a world's files is there")
