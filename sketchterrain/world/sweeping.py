"""What a run that was killed has left half-written in a world's folders."""

from __future__ import annotations

from fnmatch import fnmatchcase
from glob import escape
from typing import TYPE_CHECKING, Final

from sketchterrain.world.tile_names import layer_file, ledger_file

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator
    from pathlib import Path

    from sketchterrain.world.job import Job
    from sketchterrain.world.roots import Roots
    from sketchterrain.world.store import Store

__all__ = ["is_left_over", "sweep"]

_FEW: Final = "[0-9a-f]" * 8
# Of whole_files; GDAL takes no other ending for plants than its own.
_HALVES: Final = (f".*.{_FEW}.tmp", f".*.{_FEW}.fgb")
# What workers of a cluster look for, and what each tries to write.
_TOKENS: Final = (f".sketchterrain-{_FEW * 4}", f".sketchterrain-{_FEW * 4}-{_FEW}")
_SHARDS: Final = "c"  # the folder of an array's chunks


def sweep(job: Job, store: Store, roots: Roots, known: Collection[str]) -> None:
    """Delete half-written files, and shards of a Zarr store that are not known to be whole.

    Other files stay, for they may be a person's.

    Parameters
    ----------
    job
    store
        Of the job.
    roots
        Of its files.
    known
        Names of files that are whole.
    """
    for folder in _folders(job, store, roots):
        for half in _HALVES:
            _delete(folder.rglob(half))
    for token in _TOKENS:
        _delete(store.journal.parent.glob(token))
    _delete(_beside(job))
    if job.form == "zarr":
        _delete(path for path in _shards(job) if path.relative_to(roots.ground).as_posix() not in known)


def is_left_over(name: str) -> bool:
    """Tell whether a file of this name is what a killed run may leave, not a person's."""
    return any(fnmatchcase(name, pattern) for pattern in (*_HALVES, *_TOKENS))


def _folders(job: Job, store: Store, roots: Roots) -> list[Path]:
    """Return folders that are the world's alone."""
    mine = {job.output, store.journal.parent, *((roots.plants,) if roots.plants is not None else ())}
    return [folder for folder in sorted(mine) if folder.is_dir()]


def _beside(job: Job) -> Iterator[Path]:
    """Return half-written files in a folder that is not the world's alone."""
    if job.form == "tif":
        for name in (
            ledger_file(job.output).name,
            *(layer_file(job.output, each).name for each in job.layers),
        ):
            yield from job.output.parent.glob(f".{escape(name)}.{_FEW}.tmp")


def _shards(job: Job) -> Iterator[Path]:
    for level in job.world.levels:
        for layer in job.layers:
            folder = job.output / str(level.number) / layer / _SHARDS
            yield from [path for path in folder.rglob("*") if not path.is_dir()]


def _delete(paths: Iterable[Path]) -> None:
    for path in list(paths):
        if not path.is_dir():
            path.unlink(missing_ok=True)
