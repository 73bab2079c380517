"""Plants as a table, for a spreadsheet, a script or a GIS."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from sketchterrain.export.decimals import decimals, joined_rows, words
from sketchterrain.whole_files import telling_failure, whole_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

__all__ = ["ROW_BYTES", "plant_table"]

ROW_BYTES = 84
"""Bytes of a line at most, up to a thousand kilometres from the sketch's corner."""

_HEADER = b"x,y,z,species,scale,rotation,tint,normal_x,normal_y,normal_z\n"
_AT_ONCE = 1 << 15  # rows: what they need as text stays in the processor's cache


@contextmanager
def plant_table(path: Path, species: Sequence[str]) -> Iterator[Callable[[npt.NDArray[np.void]], None]]:
    """Yield a function that adds plants to a ``foliage.csv``: a line a plant, in the order given.

    Columns: x, y, z (m, to the millimetre), species (a name), scale (1 is grown), rotation (radians,
    counter-clockwise seen from above), tint (0 … 1), and the ground's normal. The file is there, whole, once
    the context has ended well; it takes a few megabytes of memory however many plants there are.

    Parameters
    ----------
    path
    species
        Names that the ``species`` field points into.

    Yields
    ------
    callable
        Takes plants as :meth:`sketchterrain.Terrain.foliage` returns them.

    Raises
    ------
    InputError
        If a number is not finite.
    SketchterrainError
        If the system cannot write the file.
    """
    names = words(species)
    with whole_file(path) as stream:
        stream.write(_HEADER)

        def add(plants: npt.NDArray[np.void]) -> None:
            for first in range(0, len(plants), _AT_ONCE):
                text = _text(plants[first : first + _AT_ONCE], names)
                with telling_failure(path):
                    stream.write(text)

        yield add


def _text(plants: npt.NDArray[np.void], names: npt.NDArray[np.uint8]) -> bytes:
    place = [decimals(plants[name], 3) for name in ("x", "y", "z")]
    look = [decimals(plants["scale"], 3), decimals(plants["rotation"], 4), decimals(plants["tint"], 3)]
    normal = [decimals(plants["normal"][:, axis], 4) for axis in range(3)]
    return joined_rows([*place, names[plants["species"]], *look, *normal])
