"""Plants as a CSV table or a PLY point cloud, written in chunks of bounded memory.

Turk 1994, "The PLY polygon file format": an ASCII header that names the properties, then rows of bytes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.array_types import Bounds, StructuredArray
from sketchterrain.errors import InputError, one_line
from sketchterrain.export.files import format_rows
from sketchterrain.io.files import atomic_file, check_disk, wrap_os_errors
from sketchterrain.vegetation.plants import STOREYS

if TYPE_CHECKING:  # loads OpenCL
    from sketchterrain.generation.terrain import Terrain

FOLIAGE = {"csv": ("csv",), "ply": ("ply",), "both": ("csv", "ply"), "none": ()}
"""File formats of each value of the option."""

ROW_BYTES = 84
"""Upper bound of a CSV row, up to a thousand kilometres from the sketch's corner."""

VERTEX = np.dtype(
    [
        *((name, "<f8") for name in ("x", "y")),
        *((name, "<f4") for name in ("z", "nx", "ny", "nz", "scale", "rotation", "tint")),
        *((name, "u1") for name in ("level", "species")),
    ]
)
"""One plant of a PLY file: 46 bytes."""

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
_COUNT_DIGITS = 20  # reserved for the number of plants, which is known at the end
_PLANTS_AT_ONCE = 1 << 12


@dataclass(frozen=True)
class FoliageOptions:
    """Plants to write, and their files."""

    kind: str = "csv"  # ``foliage.csv``, ``foliage.ply``, both or none
    grass: bool = False  # whether ``foliage.ply`` also holds grass, flowers and ferns

    def __post_init__(self) -> None:
        if self.kind not in FOLIAGE:
            raise InputError(f"expected foliage as one of {', '.join(FOLIAGE)}, got {one_line(self.kind)!r}")
        if self.grass and _CLOUD not in FOLIAGE[self.kind]:
            raise InputError(f"expected ply or both for grass, which only foliage.ply holds, got {self.kind}")

    @property
    def formats(self) -> tuple[str, ...]:
        """The requested file formats."""
        return FOLIAGE[self.kind]

    @property
    def storeys(self) -> dict[str, tuple[str, ...]]:
        """The requested storeys of plants with the formats of each."""
        formats = {"woody": self.formats, "grass": (_CLOUD,) if self.grass else ()}
        return {storey: names for storey, names in formats.items() if names}


class FoliageResult(NamedTuple):
    """Files of plants, plants per species, and the time taken (s)."""

    files: tuple[Path, ...]
    counts: dict[str, int]
    seconds: float


def check_disk_space(folder: Path, terrain: Terrain, bounds: Bounds, options: FoliageOptions) -> None:
    """Raise `InputError` if a folder's disk may be too small for the plants."""
    plants = _max_plants(terrain, bounds, options)
    needed = sum(plants[storey] * _BYTES[form] for storey, forms in options.storeys.items() for form in forms)
    names = " and ".join(f"foliage.{form}" for form in options.formats)
    check_disk(folder, needed, f"{names}: up to {sum(plants.values()):.3g} plants")


def write_foliage(
    folder: Path,
    terrain: Terrain,
    bounds: Bounds,
    options: FoliageOptions,
    *,
    progress: Callable[[float], None] | None = None,
) -> FoliageResult:
    """Write the plants of a rectangle as ``foliage.csv``, ``foliage.ply`` or both, atomically.

    Memory is constant. Without plants the files are valid and empty.
    """
    start = time.perf_counter()
    names = terrain.species_names
    counts = np.zeros(len(names), np.int64)
    paths = {form: folder / f"foliage.{form}" for form in options.formats}
    with ExitStack() as files:
        add = {form: files.enter_context(_WRITERS[form](path, names)) for form, path in paths.items()}
        for storey, plants in _storey_chunks(terrain, bounds, options, progress):
            for form in options.storeys[storey]:
                add[form](plants)
            counts += np.bincount(plants["species"], minlength=len(names))
    by_name = dict(zip(names, counts.tolist(), strict=True))
    requested = {name: by_name[name] for storey in options.storeys for name in STOREYS[storey]}
    return FoliageResult(tuple(paths.values()), requested, time.perf_counter() - start)


def _storey_chunks(
    terrain: Terrain, bounds: Bounds, options: FoliageOptions, progress: Callable[[float], None] | None
) -> Iterator[tuple[str, StructuredArray]]:
    """Return chunks of plants with their storeys, and report progress."""
    estimate = _max_plants(terrain, bounds, options)
    before, total = 0, max(sum(estimate.values()), 1)
    for storey, count in estimate.items():

        def report(share: float, before: int = before, count: int = count) -> None:
            if progress is not None:
                progress((before + share * count) / total)

        for plants in plant_pieces(terrain, bounds, storey, report):
            yield storey, plants
        before += count


def plant_pieces(
    terrain: Terrain, bounds: Bounds, storey: str, progress: Callable[[float], None]
) -> Iterator[StructuredArray]:
    """Yield the plants of a rectangle, and report progress by y: they are in rows from south to north."""
    _, south, _, north = bounds
    for plants in terrain.foliage_pieces(*bounds, storey=storey):
        yield plants
        if len(plants):
            progress(min(max((float(plants["y"].max()) - south) / (north - south), 0.0), 1.0))


def plant_chunks(pieces: Iterable[StructuredArray]) -> Iterator[StructuredArray]:
    """Yield plants in small chunks, none of them empty."""
    for plants in pieces:
        for first in range(0, len(plants), _PLANTS_AT_ONCE):
            yield plants[first : first + _PLANTS_AT_ONCE]


def _max_plants(terrain: Terrain, bounds: Bounds, options: FoliageOptions) -> dict[str, int]:
    return {storey: terrain.foliage_estimate(*bounds, storey=storey)[0] for storey in options.storeys}


@contextmanager
def plant_table(path: Path, species: Sequence[str]) -> Iterator[Callable[[StructuredArray], None]]:
    """Yield a function that appends plants to a ``foliage.csv``, one a line.

    Columns: x, y, z (m, to the millimetre), species (a name), scale (1 is grown), rotation (radians,
    counter-clockwise seen from above), tint (0 … 1), and the ground's normal.
    """
    names = np.array(species, object)
    with atomic_file(path) as stream:
        stream.write(_HEADER)

        def add(plants: StructuredArray) -> None:
            for rows in plant_chunks([plants]):
                position, normal = (rows[axis] for axis in "xyz"), rows["normal"].T
                look = rows["scale"], rows["rotation"], rows["tint"]
                text = format_rows(_ROW, *position, names[rows["species"]], *look, *normal)
                with wrap_os_errors(path):
                    stream.write(text)

        yield add


@contextmanager
def plant_cloud(path: Path, species: Sequence[str]) -> Iterator[Callable[[StructuredArray], None]]:
    """Yield a function that appends plants to a ``foliage.ply``, binary and little-endian."""
    count = 0
    with atomic_file(path) as stream:
        stream.write(_ply_header(0, species))

        def add(plants: StructuredArray) -> None:
            nonlocal count
            for rows in plant_chunks([plants]):
                with wrap_os_errors(path):
                    stream.write(_ply_vertices(rows).view(np.uint8).data)
            count += len(plants)

        yield add
        stream.seek(0)
        stream.write(_ply_header(count, species))


def _ply_header(count: int, species: Sequence[str]) -> bytes:
    """Return the header, equally long for any count: a comment pads it."""
    number = str(count)
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += [f"comment {note}" for note in _NOTES]
    lines += [f"comment species {code} {name}" for code, name in enumerate(species)]
    lines += ["comment " + "." * (_COUNT_DIGITS - len(number)), f"element vertex {number}"]
    lines += [f"property {_TYPES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()]
    return "\n".join([*lines, "end_header\n"]).encode("ascii")


def _ply_vertices(plants: StructuredArray) -> StructuredArray:
    rows = np.empty(len(plants), VERTEX)
    for axis, name in enumerate(("nx", "ny", "nz")):
        rows[name] = plants["normal"][:, axis]
    for name in ("x", "y", "z", "scale", "rotation", "tint", "level", "species"):
        rows[name] = plants[name]
    return rows


_WRITERS = {_TABLE: plant_table, _CLOUD: plant_cloud}
