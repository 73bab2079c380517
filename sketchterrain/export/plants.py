"""Plants as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.whole_files import write_whole

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt

__all__ = ["write_foliage"]

_HEADER = "x,y,z,species,scale,rotation\n"
_DECIMALS = {"x": 3, "y": 3, "z": 3, "scale": 3, "rotation": 4}  # mm, parts in 1000, 0.1 mrad
_ROW = "%.3f,%.3f,%.3f,%s,%.3f,%.4f\n"


def write_foliage(folder: Path, plants: npt.NDArray[np.void], species: Sequence[str]) -> tuple[Path, ...]:
    """Write ``foliage.csv``: a line a plant, in the order given.

    Columns: x, y, z (m, to the millimetre), species (a name), scale (1 is grown), rotation (radians,
    counter-clockwise seen from above).

    Parameters
    ----------
    folder
    plants
        As :meth:`sketchterrain.Terrain.foliage` returns them.
    species
        Names that the ``species`` field points into.
    """
    # Rounding first and adding zero keeps "-0.000" out of the table.
    columns = {
        name: (plants[name].astype(np.float64).round(n) + 0.0).tolist() for name, n in _DECIMALS.items()
    }
    names = np.array(species, dtype=object)[plants["species"]].tolist()
    rows = zip(
        columns["x"], columns["y"], columns["z"], names, columns["scale"], columns["rotation"], strict=True
    )
    text = _HEADER + "".join(map(_ROW.__mod__, rows))
    return (write_whole(folder / "foliage.csv", text.encode("ascii")),)
