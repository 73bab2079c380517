"""A world that was written, as whoever reads it back sees it, whatever it is made of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.sketch import Sketch
    from sketchterrain.world.grid import Level

__all__ = ["StoredWorld"]


class StoredWorld(Protocol):
    """Layers of a pyramid that are read in windows; for threads, any number at once."""

    @property
    def west(self) -> float:
        """Of column 0, m from the sketch's south-west corner."""
        ...

    @property
    def north(self) -> float:
        """Of row 0, m from the sketch's south-west corner."""
        ...

    @property
    def levels(self) -> tuple[Level, ...]:
        """The finest first; tiles of GeoTIFF without overviews have that one alone."""
        ...

    @property
    def layers(self) -> tuple[str, ...]:
        """Which of ``height``, ``normal``, ``materials`` there are; heights are always."""
        ...

    @property
    def material_names(self) -> tuple[str, ...]:
        """Of the materials' bands, in order."""
        ...

    def sketch(self) -> Sketch | None:
        """Return the sketch that it was made from; None if it does not hold it.

        Raises
        ------
        InputError
            If what it holds is broken.
        """
        ...

    def read(
        self, layer: str, level: int, *, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        """Return a window of a layer.

        Parameters
        ----------
        layer
            One of `layers`.
        level
            A level's number.
        top, left, rows, columns
            The window, inside the level.

        Returns
        -------
        ndarray
            Heights: (rows, columns) float32, m. Normals: (3, rows, columns) uint8, east, north, up, 0 is −1,
            255 is 1. Materials: (materials, rows, columns) uint8, summing to 255.

        Raises
        ------
        InputError
            If some of it is missing or broken: its file is named.
        """
        ...
