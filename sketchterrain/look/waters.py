"""What is asked of rivers and lakes, and of all that was placed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    import numpy.typing as npt


class Reach(Protocol):
    """A river's centreline: x, y and water surface z (m), springs first, and its width (m)."""

    @property
    def centreline(self) -> npt.NDArray[np.float64]:
        """(m, 3) x, y, z (m)."""
        ...

    @property
    def centreline_width(self) -> npt.NDArray[np.float32]:
        """(m,) m."""
        ...


class Field(Protocol):
    """Samples of the distance inside a shape's border (m), rows northward, and where they lie (m)."""

    @property
    def west(self) -> float:
        """Of the first sample (m)."""
        ...

    @property
    def south(self) -> float:
        """Of the first sample (m)."""
        ...

    @property
    def spacing(self) -> float:
        """Between samples (m)."""
        ...

    @property
    def inside(self) -> npt.NDArray[np.float32]:
        """(rows, columns) m, negative outside."""
        ...


class Pool(Protocol):
    """A lake: its shape and the height of its water (m)."""

    @property
    def shape(self) -> Field:
        """Where it is."""
        ...

    @property
    def level(self) -> float:
        """Height of the water (m)."""
        ...


class Features(Protocol):
    """Placed features."""

    @property
    def points(self) -> npt.NDArray[np.void]:
        """Placed point features."""
        ...

    @property
    def rivers(self) -> Sequence[Reach]:
        """Placed rivers."""
        ...

    @property
    def lakes(self) -> Sequence[Pool]:
        """Placed lakes."""
        ...
