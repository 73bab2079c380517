"""Plants as files, written in pieces: a CSV table, a PLY point cloud, and which plants go into which.

Turk 1994, "The PLY polygon file format": an ASCII header that names the properties, then rows of bytes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from sketchterrain.disk import check_disk
from sketchterrain.errors import InputError, one_line
from sketchterrain.export.files import text_rows
from sketchterrain.terrain.plant import STOREYS
from sketchterrain.whole_files import atomic_file, wrap_os_errors

Area = tuple[float, float, float, float]
FOLIAGE = {"csv": ("csv",), "ply": ("ply",), "both": ("csv", "ply"), "none": ()}
"""Which formats a request means."""

ROW_BYTES = 84
"""Bytes of a line at most, up to a thousand kilometres from the sketch's corner."""

VERTEX = np.dtype(
    [
        *((name, "<f8") for name in ("x", "y")),
        *((name, "<f4") for name in ("z", "nx", "ny", "nz", "scale", "rotation", "tint")),
        *((name, "u1") for name in ("level", "species")),
    ]
)
"""One plant in the file: 46 bytes."""

_TABLE, _CLOUD = "csv", "ply"
_BYTES = {_TABLE: ROW_BYTES, _CLOUD: VERTEX.itemsize}  # of a plant
_HEADER = b"x,y,z,species,scale,rotation,tint,normal_x,normal_y,normal_z\n"
_ROW = "%.3f,%.3f,%.3f,%s,%.3f,%.4f,%.3f,%.4f,%.4f,%.4f\n"
_TYPES = {"<f8": "double", "<f4": "float", "|u1": "uchar"}
_NOTES = (
    "x east, y north, z up, metres; nx ny nz the ground's normal",
    "scale 1 is a grown plant; rotation radians, counter-clockwise seen from above; tint 0 to 1",
    "level j: among the plants of level j and above none are nearer than 2^j times their distance",
)
_COUNT = 20  # columns kept for the number of plants, which is known at the end
_AT_ONCE = 1 << 12  # plants


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


@contextmanager
def plant_table(path: Path, species: Sequence[str]) -> Iterator[Callable[[npt.NDArray[np.void]], None]]:
    """Yield a function that adds plants to a ``foliage.csv``: a line a plant, in the order given.

    Columns: x, y, z (m, to the millimetre), species (a name), scale (1 is grown), rotation (radians,
    counter-clockwise seen from above), tint (0 … 1), and the ground's normal. The file is there, whole, once
    the context has ended well; it takes a few megabytes of memory however many plants there are.
    """
    names = np.array(species, object)
    with atomic_file(path) as stream:
        stream.write(_HEADER)

        def add(plants: npt.NDArray[np.void]) -> None:
            for first in range(0, len(plants), _AT_ONCE):
                text = _text(plants[first : first + _AT_ONCE], names)
                with wrap_os_errors(path):
                    stream.write(text)

        yield add


def _text(plants: npt.NDArray[np.void], names: npt.NDArray[np.object_]) -> bytes:
    place, normal = (plants[axis] for axis in "xyz"), plants["normal"].T
    return text_rows(
        _ROW, *place, names[plants["species"]], plants["scale"], plants["rotation"], plants["tint"], *normal
    )


@contextmanager
def plant_cloud(path: Path, species: Sequence[str]) -> Iterator[Callable[[npt.NDArray[np.void]], None]]:
    """Yield a function that adds plants to a ``foliage.ply``, binary and little-endian, in the order given.

    The file is there, whole, once the context has ended well; it takes a few megabytes of memory however
    many plants there are.
    """
    count = 0
    with atomic_file(path) as stream:
        stream.write(_header(0, species))

        def add(plants: npt.NDArray[np.void]) -> None:
            nonlocal count
            for first in range(0, len(plants), _AT_ONCE):
                rows = _vertices(plants[first : first + _AT_ONCE])
                with wrap_os_errors(path):
                    stream.write(rows.view(np.uint8).data)
            count += len(plants)

        yield add
        stream.seek(0)
        stream.write(_header(count, species))


def _header(count: int, species: Sequence[str]) -> bytes:
    """Return the header, equally long for any count: a comment has the columns that the count leaves."""
    number = str(count)
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += [f"comment {note}" for note in _NOTES]
    lines += [f"comment species {code} {name}" for code, name in enumerate(species)]
    lines += ["comment " + "." * (_COUNT - len(number)), f"element vertex {number}"]
    lines += [f"property {_TYPES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()]
    return "\n".join([*lines, "end_header\n"]).encode("ascii")


def _vertices(plants: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    rows = np.empty(len(plants), VERTEX)
    for axis, name in enumerate(("nx", "ny", "nz")):
        rows[name] = plants["normal"][:, axis]
    for name in ("x", "y", "z", "scale", "rotation", "tint", "level", "species"):
        rows[name] = plants[name]
    return rows


_WRITERS = {_TABLE: plant_table, _CLOUD: plant_cloud}
