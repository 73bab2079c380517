"""Where the files of a world lie: names as its ledger has them, and their paths."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from sketchterrain.errors import InputError, one_line
from sketchterrain.world.job import Job
from sketchterrain.world.store import plants_of, store_of

_PLANTS = "plants/"


@dataclass(frozen=True)
class OutputLayout:
    """The folder of the ground, and that of names that begin with ``plants/`` (None without plants)."""

    ground: Path
    plants: Path | None

    @classmethod
    def of(cls, job: Job) -> OutputLayout:
        """Return the layout of a job; raise SketchterrainError if a library that it needs is missing."""
        plants = plants_of(job)
        return cls(store_of(job).folder, None if plants is None else plants.folder)

    @staticmethod
    def plant_names(names: Iterable[str]) -> tuple[str, ...]:
        """Return names of a plant store's files as the ledger has them."""
        return tuple(f"{_PLANTS}{name}" for name in names)

    def path(self, name: str) -> Path:
        """Return the path of a file of the ledger; raise InputError if it is not inside the folders."""
        if not is_inside(name):
            raise InputError(f"expected the name of a file of the world, got {one_line(name)!r}")
        if self.plants is not None and name.startswith(_PLANTS):
            return self.plants / name.removeprefix(_PLANTS)
        return self.ground / name


def plants_folder(output: Path) -> Path:
    """Return the folder of a world's plants: ``world-plants`` beside ``world.zarr``."""
    return output.with_name(f"{output.stem if output.suffix else output.name}-plants")


def is_inside(name: str) -> bool:
    """Return whether a relative name stays inside the folder that it is looked up in."""
    parts = name.split("/")
    return all(part not in ("", ".", "..") and "\0" not in part and "\\" not in part for part in parts)
