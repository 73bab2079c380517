"""What there is of a world before a run: nothing, a part, all of it, or something else."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch import packed_sketch
from sketchterrain.world.fingerprint import fingerprint
from sketchterrain.world.forms import store_of
from sketchterrain.world.ledger import Ledger, read_journal, read_ledger
from sketchterrain.world.roots import plants_folder
from sketchterrain.world.sweeping import is_left_over
from sketchterrain.world.tile_names import layer_file
from sketchterrain.world.zarr_tree import OURS

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sketchterrain.world.job import Job
    from sketchterrain.world.store import Store

__all__ = ["Known", "known", "refuse_taken", "there"]


@dataclass(frozen=True)
class Known:
    """What the files of a world tell of it, which nothing has verified.

    Attributes
    ----------
    ledger : Ledger
    finished : bool
        Whether it is the ledger of a world that was whole; else its journal.
    """

    ledger: Ledger
    finished: bool


def known(job: Job, store: Store) -> Known | None:
    """Return what is known of a job's world; None where there is nothing.

    Raises
    ------
    InputError
        If it is another world, or what tells of it is broken.
    """
    ledger, finished = read_journal(store.journal), False
    if ledger is None and (text := store.ledger_text()) is not None:
        ledger, finished = read_ledger(text, store.folder), True
    if ledger is None:
        return None
    if ledger.header.version != version("sketchterrain"):
        raise InputError(
            f"{one_line(job.output)}: was begun by version {one_line(ledger.header.version)} of the program, "
            f"this is {version('sketchterrain')}; take another output"
        )
    if ledger.header.fingerprint != fingerprint(job):
        raise InputError(
            f"{one_line(job.output)}: what is there was made from another sketch, seed, bounds or options, "
            "or by other code; take another output"
        )
    return Known(ledger, finished)


def refuse_taken(job: Job, *, resume: bool) -> None:
    """Refuse an output that a job's world cannot be written to; nothing is changed.

    Raises
    ------
    InputError
        If there is something else, or a world and `resume` is not given, or another world.
    """
    store, output, place = store_of(job), job.output, one_line(job.output)
    try:
        parent = next(each for each in store.folder.parents if each.exists())
        if not parent.is_dir():
            raise InputError(f"{place}: expected a path to write to, {one_line(parent)} is a file")
        if job.form != "tif" and output.exists() and not output.is_dir():
            raise InputError(f"{place}: expected a folder to write into, this is a file")
        begun = _is_begun(job, store)
        places = () if begun else _places(job)
        strange = next((each for each in places if _holds_something(each, store)), None)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({error.strerror})") from None
    if strange is not None:
        raise InputError(f"{one_line(strange)}: there is something else; take another output")
    if begun and not resume:
        raise InputError(f"{place}: there is a world; --resume goes on with it, or take another output")
    if begun:
        known(job, store)


def _is_begun(job: Job, store: Store) -> bool:
    """Tell whether there is a world or a part of it; its mark alone may be a person's file of that name."""
    if (store.journal.is_file() and store.journal.stat().st_size > 0) or store.ledger_text() is not None:
        return True
    if not store.mark.is_file():
        return False
    content = store.mark.read_bytes()
    return f'"{OURS}"'.encode() in content if job.form == "zarr" else content == packed_sketch(job.sketch)


def _places(job: Job) -> Iterator[Path]:
    """Return the files and folders that are to be the world's."""
    yield job.output
    if job.form == "tif":
        yield from (layer_file(job.output, layer) for layer in job.layers)
        yield store_of(job).journal.parent
    if job.plants != "none":
        yield plants_folder(job.output)


def _holds_something(place: Path, store: Store) -> bool:
    """Tell whether a place holds more than what a run leaves that was killed before it made anything."""
    if not place.is_dir():
        return os.path.lexists(place)
    return any(
        not each.is_dir() and each != store.journal and not is_left_over(each.name)
        for each in place.rglob("*")
    )


def there(job: Job) -> tuple[int, int]:
    """Return how many tasks of a job are done, and how many bytes are there, as its ledger tells.

    Raises
    ------
    InputError
        If there is another world, or what tells of it is broken.
    """
    found = known(job, store_of(job))
    if found is None:
        return 0, 0
    return len(found.ledger.done), sum(file.bytes for file in found.ledger.files)
