"""Plants by the million as a point cloud: PLY, which engines, viewers and scripts read without an importer.

Turk 1994, "The PLY polygon file format": an ASCII header that names the properties, then rows of bytes.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.whole_files import telling_failure, whole_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    import numpy.typing as npt

__all__ = ["VERTEX", "plant_cloud"]

VERTEX = np.dtype(
    [
        *((name, "<f8") for name in ("x", "y")),
        *((name, "<f4") for name in ("z", "nx", "ny", "nz", "scale", "rotation", "tint")),
        *((name, "u1") for name in ("level", "species")),
    ]
)
"""One plant in the file: 46 bytes."""

_TYPES = {"<f8": "double", "<f4": "float", "|u1": "uchar"}
_NOTES = (
    "x east, y north, z up, metres; nx ny nz the ground's normal",
    "scale 1 is a grown plant; rotation radians, counter-clockwise seen from above; tint 0 to 1",
    "level j: among the plants of level j and above none are nearer than 2^j times their distance",
)
_COUNT = 20  # columns kept for the number of plants, which is known at the end
_AT_ONCE = 1 << 16  # plants


@contextmanager
def plant_cloud(path: Path, species: Sequence[str]) -> Iterator[Callable[[npt.NDArray[np.void]], None]]:
    """Yield a function that adds plants to a ``foliage.ply``, binary and little-endian, in the order given.

    The file is there, whole, once the context has ended well; it takes a few megabytes of memory however
    many plants there are.

    Parameters
    ----------
    path
    species
        Names that the ``species`` field points into; they stand in the header as comments.

    Yields
    ------
    callable
        Takes plants as :meth:`sketchterrain.Terrain.foliage` returns them.

    Raises
    ------
    SketchterrainError
        If the system cannot write the file.
    """
    count = 0
    with whole_file(path) as stream:
        stream.write(_header(0, species))

        def add(plants: npt.NDArray[np.void]) -> None:
            nonlocal count
            for first in range(0, len(plants), _AT_ONCE):
                rows = _vertices(plants[first : first + _AT_ONCE])
                with telling_failure(path):
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
