"""Plants of a terrain: what is asked for, checked, cut into parts that fit, and put into a stable order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.plant import PLANT, STOREYS
from sketchterrain.terrain.stepped import finished
from sketchterrain.terrain.storey import Storey

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    import numpy.typing as npt

    from sketchterrain.terrain.evaluation import Evaluator

    Area = tuple[int, int, int, int]
    Plants = npt.NDArray[np.void]

MOST_PLANTS: Final = 20_000_000
"""Plants that are given back at once at most."""

_A_PIECE = 2_000_000  # plants at most


class FoliageSampler:
    """Plants of a recipe on a device."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._extent = evaluator.recipe.extent
        self._storeys = {name: Storey(evaluator, name) for name in STOREYS}

    def within(self, west: float, south: float, east: float, north: float, storey: str = "woody") -> Plants:
        """Return the plants of a rectangle in metres; see :meth:`Terrain.foliage`."""
        return finished(self.steps(west, south, east, north, storey))

    def steps(
        self, west: float, south: float, east: float, north: float, storey: str
    ) -> Generator[None, None, Plants]:
        """Do the same in steps; see :meth:`Terrain.foliage_steps`."""
        chosen, area = self._asked((west, south, east, north), storey)
        if chosen.bound(area) > MOST_PLANTS:
            most, size = self.estimate(west, south, east, north, storey)
            if most > MOST_PLANTS:
                raise InputError(
                    f"the rectangle may hold {most:.3g} plants ({size / 2**30:.1f} GiB); "
                    f"at most {MOST_PLANTS} are given back at once, more in pieces"
                )
        found = []
        for part in chosen.parts(area, most=_A_PIECE):
            plants = yield from chosen.plants_steps(part)
            found.append(plants)
        return np.concatenate(found) if found else np.zeros(0, PLANT)

    def pieces(
        self, west: float, south: float, east: float, north: float, storey: str = "woody"
    ) -> Iterator[Plants]:
        """Return the same piece by piece; see :meth:`Terrain.foliage_pieces`."""
        chosen, area = self._asked((west, south, east, north), storey)
        return (finished(chosen.plants_steps(part)) for part in chosen.parts(area, most=_A_PIECE))

    def estimate(
        self, west: float, south: float, east: float, north: float, storey: str = "woody"
    ) -> tuple[int, int]:
        """Return how many there can be, and their bytes; see :meth:`Terrain.foliage_estimate`."""
        chosen, area = self._asked((west, south, east, north), storey)
        most = chosen.estimate(area)
        return most, most * PLANT.itemsize

    def _asked(self, rectangle: tuple[float, float, float, float], storey: str) -> tuple[Storey, Area]:
        if storey not in self._storeys:
            raise InputError(f"expected a storey, {' or '.join(STOREYS)}, got {storey!r}")
        west, south, east, north = (int(each) for each in to_lattice(rectangle, self._extent))
        if west > east or south > north:
            told = ", ".join(f"{each:g}" for each in rectangle)
            raise InputError(f"expected west ≤ east and south ≤ north, got {told}")
        return self._storeys[storey], (west, south, east, north)
