"""Where a program has its east, north and up, its unit and its origin: places of the world in its words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Direction = Literal["east", "north", "up", "south"]
    Reals = npt.NDArray[np.floating]

__all__ = ["EngineAxes"]

_WORLD: Final = {"east": (1, 0, 0), "north": (0, 1, 0), "up": (0, 0, 1), "south": (0, -1, 0)}


@dataclass(frozen=True)
class EngineAxes:
    """A program's coordinate system.

    Attributes
    ----------
    x, y, z : {'east', 'north', 'up', 'south'}
        Where each axis points.
    unit : str
        Its name, "m" or "cm".
    per_metre : float
        Units a metre has.
    origin : (float, float, float)
        The program's own origin: east, north and up of the sketch's south-west corner, m.
    """

    x: Direction
    y: Direction
    z: Direction
    unit: str = "m"
    per_metre: float = 1.0
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def turn(self) -> int:
        """1 where angles about the vertical axis grow counter-clockwise seen from above, else −1."""
        return round(float(np.linalg.det(self._matrix)))

    @property
    def facts(self) -> dict[str, Any]:
        """What a file says of them."""
        return {
            "x": self.x,
            "y": self.y,
            "z": self.z,
            "unit": self.unit,
            "handed": "right" if self.turn > 0 else "left",
            "origin": dict(zip(("east", "north", "up"), self.origin, strict=True)),
        }

    def places(self, east: Reals, north: Reals, up: Reals) -> Reals:
        """Return places of the world (m each) as the program has them.

        Returns
        -------
        (n, 3) float64
            In its unit.
        """
        world = np.stack([east, north, up], axis=-1).astype(np.float64) - self.origin
        return world @ self._matrix.T * self.per_metre

    def directions(self, vectors: Reals) -> Reals:
        """Return vectors east, north, up, shape (n, 3), along the program's axes; lengths stay."""
        return vectors.astype(np.float64) @ self._matrix.T

    @property
    def _matrix(self) -> npt.NDArray[np.float64]:
        return np.array([_WORLD[axis] for axis in (self.x, self.y, self.z)], np.float64)
