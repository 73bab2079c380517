"""StructuredArray of a terrain: checked requests, split into bounded parts, in a stable order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.plant import PLANT, STOREYS
from sketchterrain.terrain.stepped import run_to_completion
from sketchterrain.terrain.storey import Storey

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from sketchterrain.array_types import StructuredArray
    from sketchterrain.terrain.evaluation import Evaluator

    Area = tuple[int, int, int, int]

MAX_PLANTS: Final = 20_000_000
"""Most plants returned at once."""

_MAX_PER_PIECE = 2_000_000


class FoliageSampler:
    """StructuredArray of a recipe on a device."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._extent = evaluator.recipe.extent
        self._storeys = {name: Storey(evaluator, name) for name in STOREYS}

    def within(
        self, west: float, south: float, east: float, north: float, storey: str = "woody"
    ) -> StructuredArray:
        """Return the plants of a rectangle in metres; see :meth:`Terrain.foliage`."""
        return run_to_completion(self.steps(west, south, east, north, storey))

    def steps(
        self, west: float, south: float, east: float, north: float, storey: str
    ) -> Generator[None, None, StructuredArray]:
        """Do the same in steps; see :meth:`Terrain.foliage_steps`."""
        layer, area = self._validate((west, south, east, north), storey)
        if layer.bound(area) > MAX_PLANTS:
            most, size = self.estimate(west, south, east, north, storey)
            if most > MAX_PLANTS:
                raise InputError(
                    f"the rectangle may hold {most:.3g} plants ({size / 2**30:.1f} GiB); "
                    f"expected at most {MAX_PLANTS} at once, more in pieces"
                )
        parts = []
        for part in layer.parts(area, most=_MAX_PER_PIECE):
            plants = yield from layer.plants_steps(part)
            parts.append(plants)
        return np.concatenate(parts) if parts else np.zeros(0, PLANT)

    def pieces(
        self, west: float, south: float, east: float, north: float, storey: str = "woody"
    ) -> Iterator[StructuredArray]:
        """Return the same piece by piece; see :meth:`Terrain.foliage_pieces`."""
        layer, area = self._validate((west, south, east, north), storey)
        return (
            run_to_completion(layer.plants_steps(part)) for part in layer.parts(area, most=_MAX_PER_PIECE)
        )

    def estimate(
        self, west: float, south: float, east: float, north: float, storey: str = "woody"
    ) -> tuple[int, int]:
        """Return an upper estimate of the number of plants, and their bytes.

        See :meth:`Terrain.foliage_estimate`.
        """
        layer, area = self._validate((west, south, east, north), storey)
        most = layer.estimate(area)
        return most, most * PLANT.itemsize

    def _validate(self, rectangle: tuple[float, float, float, float], storey: str) -> tuple[Storey, Area]:
        if storey not in self._storeys:
            raise InputError(f"expected a storey, {' or '.join(STOREYS)}, got {storey!r}")
        west, south, east, north = (int(each) for each in to_lattice(rectangle, self._extent))
        if west > east or south > north:
            given = ", ".join(f"{each:g}" for each in rectangle)
            raise InputError(f"expected west ≤ east and south ≤ north, got {given}")
        return self._storeys[storey], (west, south, east, north)
