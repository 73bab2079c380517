"""Worlds that were written, opened for reading whatever they are made of."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.world.zarr_layout import METADATA

if TYPE_CHECKING:
    from sketchterrain.world.stored import StoredWorld

__all__ = ["open_world"]


def open_world(path: str | Path) -> StoredWorld:
    """Open a world.

    Parameters
    ----------
    path
        A Zarr store, a folder of GeoTIFF tiles, or the GeoTIFF of the heights.

    Raises
    ------
    InputError
        If there is no world, or what it says of itself is broken.
    SketchterrainError
        If a library that reads it is missing.
    """
    place = Path(path)
    try:
        if not place.exists():
            raise InputError(f"{one_line(path)}: no such file or folder, expected a world")
        is_zarr = (place / METADATA).is_file()
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    if is_zarr:
        from sketchterrain.world.zarr_reading import StoredZarr

        return StoredZarr(place)
    from sketchterrain.world.tiff_reading import open_tiffs

    return open_tiffs(place)
