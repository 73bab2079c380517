"""Where a world is written to: what each form of output does, whatever it is made of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sketchterrain.world.ground import Ground

__all__ = ["Store"]


class Store(Protocol):
    """One form of output of one `Job`; made anew in each process from the job alone."""

    @property
    def folder(self) -> Path:
        """The folder that names of files begin in."""
        ...

    @property
    def journal(self) -> Path:
        """The file that tells what is done while the world is being written, in a folder that `create` makes.

        Whoever writes the world makes it and holds its lock; `close` deletes it.
        """
        ...

    @property
    def mark(self) -> Path:
        """A file that `create` writes first: where it is, a world was begun."""
        ...

    @property
    def keeps_shards(self) -> bool:
        """Whether what `write` writes stays, or goes once `join` has made something else of it."""
        ...

    def create(self) -> tuple[str, ...]:
        """Write all that does not depend on any ground, and return the names of its files.

        Again does no harm: a file that is not there or has other bytes is written, whole; no other one is.

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

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Write what joins all shards, once they are there; return the names of its files, which may be none.

        Raises
        ------
        SketchterrainError
            If the system cannot write it.
        """
        ...

    def close(self, ledger: str) -> None:
        """Write the ledger's text where it stays, then delete the journal and what the world needs no more.

        Raises
        ------
        SketchterrainError
            If the system cannot write it.
        """
        ...

    def ledger_text(self) -> str | None:
        """Return the ledger of a finished world; None where there is none."""
        ...
