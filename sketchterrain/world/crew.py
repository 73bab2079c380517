"""Who does a world's tasks: this process alone, or workers of a cluster."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sketchterrain.world.made import Made, Task

__all__ = ["Crew"]


class Crew(Protocol):
    """Does tasks, in any order, and tells of each once its files are there; a context manager."""

    def __enter__(self) -> Crew:
        """Open devices, or find the workers."""
        ...

    def __exit__(self, *_: object) -> None:
        """End what is begun, leave no half file, give all back."""
        ...

    def make(self, tasks: Iterable[Task]) -> Iterator[Made]:
        """Do tasks, taking only so many of them ahead as keep everyone at work.

        Raises
        ------
        SketchterrainError
            If one cannot be done: the disk is full, or no device or worker is left.
        """
        ...
