"""What is done of a world at once, and what came of it: tasks, and the files that they leave."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

__all__ = ["Made", "Task", "WrittenFile"]


class Task(NamedTuple):
    """One file of each layer, or one of plants; tasks need nothing of each other.

    Attributes
    ----------
    kind : {'ground', 'plants'}
    level, row, column : int
        A shard of the ground; of plants the level is 0, and they lie in the rectangle of that shard, west and
        south of it inclusive, its last row and column of cells going to the next one.
    """

    kind: Literal["ground", "plants"]
    level: int
    row: int
    column: int


class WrittenFile(NamedTuple):
    """A file's name from the output's folder on, with ``/``; how many bytes it has, and their SHA-256."""

    file: str
    bytes: int
    sha256: str


@dataclass(frozen=True)
class Made:
    """A task that is done.

    Attributes
    ----------
    task : Task
    files : tuple of WrittenFile
    seconds : float
        It took, all in all.
    parts : dict
        Seconds of its parts: ``evaluate``, ``write``.
    worker : str
        Who did it; empty where there are none.
    """

    task: Task
    files: tuple[WrittenFile, ...]
    seconds: float
    parts: dict[str, float]
    worker: str = ""
