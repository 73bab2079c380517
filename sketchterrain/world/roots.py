"""Where the files of a world lie: names as the ledger has them, and the paths that they stand for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.world.forms import plants_of, store_of

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from sketchterrain.world.job import Job

__all__ = ["Roots", "is_inside", "plants_folder"]

_PLANTS = "plants/"


@dataclass(frozen=True)
class Roots:
    """The folders that names begin in.

    Attributes
    ----------
    ground : Path
        Of the store.
    plants : Path or None
        Of names that begin with ``plants/``; None where no plants are written.
    """

    ground: Path
    plants: Path | None

    @classmethod
    def of(cls, job: Job) -> Roots:
        """Return those of a job."""
        plants = plants_of(job)
        return cls(store_of(job).folder, None if plants is None else plants.folder)

    @staticmethod
    def named_plants(names: Iterable[str]) -> tuple[str, ...]:
        """Return names of a plant store's files as the ledger has them."""
        return tuple(f"{_PLANTS}{name}" for name in names)

    def path(self, name: str) -> Path:
        """Return the path of a file of the ledger.

        Raises
        ------
        InputError
            If the name leads out of the folders.
        """
        if not is_inside(name):
            raise InputError(f"expected the name of a file of the world, got {one_line(name)!r}")
        if self.plants is not None and name.startswith(_PLANTS):
            return self.plants / name.removeprefix(_PLANTS)
        return self.ground / name


def plants_folder(output: Path) -> Path:
    """Return the folder of a world's plants: ``world-plants`` beside ``world.zarr``."""
    return output.with_name(f"{output.stem if output.suffix else output.name}-plants")


def is_inside(name: str) -> bool:
    """Tell whether a name leads to a place inside the folder that it is looked up in."""
    parts = name.split("/")
    return all(part not in ("", ".", "..") and "\0" not in part and "\\" not in part for part in parts)
