"""Where a world is written to: what each form of output does, whatever it is made of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sketchterrain.world.ground import Ground
    from sketchterrain.world.made import WrittenFile

__all__ = ["Store"]


class Store(Protocol):
    """One form of output of one `Job`; made anew in each process from the job alone."""

    @property
    def folder(self) -> Path:
        """The folder that names of files begin in."""
        ...

    @property
    def journal(self) -> Path:
        """The file that tells what is done while the world is being written."""
        ...

    def create(self) -> None:
        """Make the folders and all that does not depend on any ground; again does no harm.

        Raises
        ------
        SketchterrainError
            If the system cannot write it.
        """
        ...

    def write(self, ground: Ground) -> tuple[str, ...]:
        """Write one shard, its files whole or not there, and return their names; any number at once.

        Raises
        ------
        SketchterrainError
            If the system cannot write them.
        """
        ...

    def finish(self, ledger: str, *, progress: Callable[[float], None]) -> tuple[WrittenFile, ...]:
        """Write what joins all shards, and the ledger's text where it stays; return what was added.

        Raises
        ------
        SketchterrainError
            If the system cannot write it.
        """
        ...

    def ledger_text(self) -> str | None:
        """Return the ledger of a finished world; None where there is none."""
        ...
