"""What a batch would make and take, before anything is done."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any, Final

from sketchterrain.batch.manifest import Entry, read_manifest
from sketchterrain.batch.output import Fingerprints
from sketchterrain.batch.remaining import duration
from sketchterrain.batch.room import PREVIEW_MEMORY, memory_left, needs_of
from sketchterrain.disk import amount, disk_left
from sketchterrain.errors import SketchterrainError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sketchterrain.batch.output import Output
    from sketchterrain.batch.plan import Item
    from sketchterrain.batch.room import Needs

__all__ = ["Forecast", "forecast"]

# Measured on two threads of an EPYC: placing and plants, a million vertices and their files, a preview.
_SECONDS_EACH: Final = 2.0
_SECONDS_A_MILLION: Final = 1.2
_SECONDS_A_PREVIEW: Final = 5.0


@dataclass(frozen=True)
class _Line:
    item: Item
    state: str
    needs: Needs | None
    problem: str


@dataclass(frozen=True)
class Forecast:
    """What a batch would do.

    Attributes
    ----------
    folder : Path
    items : tuple
        Each with what it takes, and why it would fail.
    jobs : int
        Terrains in work at once.
    memory, disk : float
        Bytes that it takes at once, and in the end.
    seconds : float
        That it will take, roughly.
    measured : bool
        Whether that follows from terrains of this batch, not from another machine's.
    memory_left, disk_left : int
        What there is.
    """

    folder: Path
    items: tuple[_Line, ...]
    jobs: int
    memory: float
    disk: float
    seconds: float
    measured: bool
    memory_left: int
    disk_left: int

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return {
            "folder": str(self.folder),
            "jobs": self.jobs,
            "memory": {"needed": round(self.memory), "left": self.memory_left},
            "disk": {"needed": round(self.disk), "left": self.disk_left},
            "seconds": {"about": round(self.seconds), "measured": self.measured},
            "items": [
                {
                    "name": line.item.name,
                    "sketch": line.item.source.given,
                    "seed": line.item.seed,
                    "settings": dict(line.item.settings),
                    "state": line.state,
                    "vertices": None if line.needs is None else line.needs.vertices,
                    "error": line.problem,
                }
                for line in self.items
            ],
        }

    def lines(self) -> list[str]:
        """Return it for a person."""
        width = max(len(line.item.name) for line in self.items)
        told = [f"{line.item.name:<{width}}  {line.problem or line.state}" for line in self.items]
        to_make = sum(line.state == "to make" for line in self.items)
        by = "by those that are done" if self.measured else "by what another machine of two threads took"
        return [
            *told,
            f"{to_make} terrain{'' if to_make == 1 else 's'} to make in {self.folder}, {self.jobs} at once",
            f"memory: about {amount(self.memory)} at once, {amount(self.memory_left)} are left",
            f"disk: about {amount(self.disk)} at most, {amount(self.disk_left)} are left",
            f"time: about {duration(self.seconds)}, {by}",
        ]


def forecast(items: Sequence[Item], folder: Path, output: Output, *, jobs: int, resume: bool) -> Forecast:
    """Return what a batch would do; nothing is written.

    Parameters
    ----------
    items
        From `plan`.
    folder
        Of the batch; need not be there.
    output
        What would be written of each terrain.
    jobs
        Terrains in work at once.
    resume
        Whether what is whole and unchanged stays.

    Raises
    ------
    InputError
        If there is a manifest in the folder that is none.
    """
    before = read_manifest(folder) if resume and folder.is_dir() else None
    entries = {} if before is None else before.entries
    fingerprints = Fingerprints(output)
    lines = tuple(_line(item, entries.get(item.name), folder, output, fingerprints) for item in items)
    new = [line.needs for line in lines if line.state == "to make" and line.needs is not None]
    took = [entry.seconds for entry in entries.values() if entry.state == "done"]
    each = median(took) / jobs if took else 0.0
    return Forecast(
        folder,
        lines,
        jobs,
        sum(sorted((needs.memory for needs in new), reverse=True)[:jobs]) + output.preview * PREVIEW_MEMORY,
        sum(needs.disk for needs in new),
        sum(each if took else _seconds(needs, output) for needs in new),
        bool(took),
        memory_left(),
        disk_left(folder),
    )


def _line(item: Item, entry: Entry | None, folder: Path, output: Output, fingerprints: Fingerprints) -> _Line:
    try:
        sketch = item.sketch
        needs = needs_of(sketch, output)
    except SketchterrainError as error:
        return _Line(item, "fails", None, str(error))
    if entry is not None and entry.input == fingerprints.of(sketch) and entry.whole(folder / item.name):
        return _Line(item, "there", needs, "")
    return _Line(item, "to make", needs, "")


def _seconds(needs: Needs, output: Output) -> float:
    return (
        _SECONDS_EACH
        + _SECONDS_A_MILLION * needs.vertices / 1e6
        + (_SECONDS_A_PREVIEW if output.preview else 0.0)
    )
