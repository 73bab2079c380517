"""Material weights as images: four materials a file, and every vertex's bytes sum to 255."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.export.files import write_json
from sketchterrain.export.png import write_values_png

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt

    from sketchterrain.terrain import Raster

__all__ = ["four_of", "quantised_weights", "write_materials"]

_CHANNELS = ("red", "green", "blue", "alpha")
_WHOLE = 255
_ROWS_AT_ONCE = 256


def write_materials(folder: Path, raster: Raster, names: Sequence[str]) -> tuple[Path, ...]:
    """Write ``materials.png``, ``materials-2.png`` … (RGBA) and ``materials.json``, which names the channels.

    Parameters
    ----------
    folder
    raster
    names
        One for each material of the raster, in its order.
    """
    weights = quantised_weights(raster.materials)
    files = [
        (f"materials-{number}.png" if number > 1 else "materials.png", first)
        for number, first in enumerate(range(0, len(names), len(_CHANNELS)), start=1)
    ]
    images = [write_values_png(folder / name, four_of(weights, first)) for name, first in files]
    meaning = {
        "format": 1,
        "encoding": "value / 255 is the weight; the weights of a vertex sum to 255 over all files",
        "alpha": "a weight like the others, not opacity: do not premultiply",
        "orientation": {"row_0": "north", "column_0": "west", "samples": "vertices"},
        "materials": [
            {
                "name": name,
                "index": index,
                "file": files[index // len(_CHANNELS)][0],
                "channel": _CHANNELS[index % len(_CHANNELS)],
            }
            for index, name in enumerate(names)
        ],
    }
    return (*images, write_json(folder / "materials.json", meaning))


def quantised_weights(weights: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Return weights as bytes that sum to exactly 255, by the method of the largest remainder.

    A byte is off from 255 times its weight by less than 1, and a weight of 0 stays 0.

    Parameters
    ----------
    weights
        (rows, columns, materials), ≥ 0, with a sum above 0 at each vertex.

    Returns
    -------
    (rows, columns, materials) uint8
        Where remainders are equal the first material gets the step.

    Raises
    ------
    InputError
        If a weight is negative or not finite, or all weights of a vertex are 0.
    """
    result = np.empty(weights.shape, np.uint8)
    for top in range(0, weights.shape[0], _ROWS_AT_ONCE):  # bounds the memory of large rasters
        rows = slice(top, top + _ROWS_AT_ONCE)
        result[rows] = _rounded(weights[rows].reshape(-1, weights.shape[-1])).reshape(result[rows].shape)
    return result


def _rounded(weights: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    total = weights.sum(axis=1, dtype=np.float64, keepdims=True)
    if not (np.isfinite(total).all() and (total > 0).all() and (weights >= 0).all()):
        raise InputError("expected material weights ≥ 0 with a finite sum above 0 at each vertex")
    scaled = weights * (_WHOLE / total)
    whole = np.floor(scaled)
    remainder = scaled - whole
    missing = np.rint(_WHOLE - whole.sum(axis=1)).astype(np.intp)
    result: npt.NDArray[np.uint8] = whole.astype(np.uint8)
    # Few vertices miss more than one or two steps, so this is quicker than sorting all remainders.
    open_rows = np.flatnonzero(missing)
    while open_rows.size:
        largest = remainder[open_rows].argmax(axis=1)
        result[open_rows, largest] += 1
        remainder[open_rows, largest] = -1.0
        missing[open_rows] -= 1
        open_rows = open_rows[missing[open_rows] > 0]
    return result


def four_of(weights: npt.NDArray[np.uint8], first: int) -> npt.NDArray[np.uint8]:
    """Return four materials as the channels of an image, from one on; channels without a material are 0."""
    image = np.zeros((*weights.shape[:2], len(_CHANNELS)), np.uint8)
    part = weights[..., first : first + len(_CHANNELS)]
    image[..., : part.shape[-1]] = part
    return image
