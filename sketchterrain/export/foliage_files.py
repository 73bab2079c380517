"""Which plants go into which files, whether there is room for these, and how they get there: in pieces."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from sketchterrain.disk import check_disk
from sketchterrain.errors import InputError, one_line
from sketchterrain.export.plant_cloud import VERTEX, plant_cloud
from sketchterrain.export.plants import ROW_BYTES, plant_table
from sketchterrain.terrain.plant import STOREYS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import numpy.typing as npt

    Area = tuple[float, float, float, float]

__all__ = ["FOLIAGE", "FoliageFiles", "Planted", "WrittenFoliage", "check_room", "write_foliage"]

FOLIAGE = {"csv": ("csv",), "ply": ("ply",), "both": ("csv", "ply"), "none": ()}
"""Which formats a request means."""

_TABLE, _CLOUD = "csv", "ply"
_BYTES = {_TABLE: ROW_BYTES, _CLOUD: VERTEX.itemsize}  # of a plant


class Planted(Protocol):
    """What is asked of a terrain."""

    @property
    def species_names(self) -> tuple[str, ...]:
        """Names that the plants' ``species`` field points into."""

    def foliage_pieces(
        self, west: float, south: float, east: float, north: float, *, storey: str
    ) -> Iterator[npt.NDArray[np.void]]:
        """Return the plants of a rectangle in pieces of bounded size, in rows from south to north."""

    def foliage_estimate(
        self, west: float, south: float, east: float, north: float, *, storey: str
    ) -> tuple[int, int]:
        """Return how many there can be at most, and their bytes."""


@dataclass(frozen=True)
class FoliageFiles:
    """Which plants are written, and as what.

    Attributes
    ----------
    kind : {'csv', 'ply', 'both', 'none'}
        ``foliage.csv``, ``foliage.ply``, both or neither.
    grass : bool
        Whether ``foliage.ply`` holds grass, flowers and ferns after the trees and shrubs.

    Raises
    ------
    InputError
        If the kind is none of these, or grass would come into no file.
    """

    kind: str = "csv"
    grass: bool = False

    def __post_init__(self) -> None:
        if self.kind not in FOLIAGE:
            raise InputError(f"expected foliage as one of {', '.join(FOLIAGE)}, got {one_line(self.kind)!r}")
        if self.grass and _CLOUD not in FOLIAGE[self.kind]:
            raise InputError(f"expected ply or both for grass, which only foliage.ply holds, got {self.kind}")

    @property
    def formats(self) -> tuple[str, ...]:
        """``csv`` and ``ply``, those that are wanted."""
        return FOLIAGE[self.kind]

    @property
    def storeys(self) -> dict[str, tuple[str, ...]]:
        """The formats that each storey of plants comes into."""
        wanted = {"woody": self.formats, "grass": (_CLOUD,) if self.grass else ()}
        return {storey: formats for storey, formats in wanted.items() if formats}


class WrittenFoliage(NamedTuple):
    """What :func:`write_foliage` wrote, how many plants of each species, and how long it took, s."""

    files: tuple[Path, ...]
    counts: dict[str, int]
    seconds: float


def check_room(folder: Path, terrain: Planted, area: Area, wanted: FoliageFiles) -> None:
    """Refuse plants that the folder's disk may have no room for, before any work is done for them.

    Parameters
    ----------
    folder
        Where they shall be written; it is there.
    terrain
    area
        West, south, east, north, m.
    wanted

    Raises
    ------
    InputError
        With how many plants there can be, what they take, and what is left.
    """
    points = _most_points(terrain, area, wanted)
    needed = sum(points[storey] * _BYTES[each] for storey, into in wanted.storeys.items() for each in into)
    names = " and ".join(f"foliage.{each}" for each in wanted.formats)
    check_disk(folder, needed, f"{names}: up to {sum(points.values()):.3g} plants")


def write_foliage(
    folder: Path,
    terrain: Planted,
    area: Area,
    wanted: FoliageFiles,
    *,
    progress: Callable[[float], None] | None = None,
) -> WrittenFoliage:
    """Write the plants of a rectangle as ``foliage.csv``, ``foliage.ply`` or both.

    They are found and written piece by piece: more of them take time and disk, not memory. Each file is whole
    or not there; where there are no plants it is a valid one without any.

    Parameters
    ----------
    folder
    terrain
    area
        West, south, east, north, m.
    wanted
    progress
        Called with the share that is done, 0 … 1.

    Raises
    ------
    InputError
        If the rectangle is none.
    SketchterrainError
        If the system cannot write a file.
    """
    start = time.perf_counter()
    names = terrain.species_names
    counts = np.zeros(len(names), np.int64)
    with ExitStack() as files:
        add = {
            form: files.enter_context(_WRITERS[form](folder / f"foliage.{form}", names))
            for form in wanted.formats
        }
        for storey, plants in _told(terrain, area, wanted, progress):
            for form in wanted.storeys[storey]:
                add[form](plants)
            counts += np.bincount(plants["species"], minlength=len(names))
    asked = [name for storey in wanted.storeys for name in STOREYS[storey]]
    by_name = dict(zip(names, counts.tolist(), strict=True))
    paths = tuple(folder / f"foliage.{form}" for form in wanted.formats)
    return WrittenFoliage(paths, {name: by_name[name] for name in asked}, time.perf_counter() - start)


_WRITERS = {_TABLE: plant_table, _CLOUD: plant_cloud}


def _told(
    terrain: Planted, area: Area, wanted: FoliageFiles, progress: Callable[[float], None] | None
) -> Iterator[tuple[str, npt.NDArray[np.void]]]:
    """Return the plants piece by piece with their storeys, and tell how far that is."""
    most = _most_points(terrain, area, wanted)
    before, total = 0, max(sum(most.values()), 1)
    _, south, _, north = area
    for storey, points in most.items():
        share = 0.0
        for plants in terrain.foliage_pieces(*area, storey=storey):
            yield storey, plants
            if progress is not None and len(plants):
                # They come in rows from south to north: so far as one of them stands, so far is it done.
                share = max(share, float(plants["y"].max() - south) / (north - south))
                progress((before + share * points) / total)
        before += points


def _most_points(terrain: Planted, area: Area, wanted: FoliageFiles) -> dict[str, int]:
    return {storey: terrain.foliage_estimate(*area, storey=storey)[0] for storey in wanted.storeys}
