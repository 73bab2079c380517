"""Labels scaled by majority: each new pixel is what most of its ground was; thin lines do not break."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from scipy import sparse

from sketchterrain.trace.lines import thinned

if TYPE_CHECKING:
    from collections.abc import Collection

__all__ = ["NO_VOTE", "majority", "scaled_size"]

NO_VOTE: Final = 255
"""The value of what is not known: it does not vote, and stands where nothing voted."""

_PIXELS = 4_000_000  # voting together


def scaled_size(width: int, height: int, longest: int) -> tuple[int, int]:
    """Return (width, height), px, of the same shape with a longer side of `longest`, and at least 1."""
    scale = longest / max(width, height)
    return max(1, round(width * scale)), max(1, round(height * scale))


def majority(
    values: npt.NDArray[np.uint8], size: tuple[int, int], *, thin: Collection[int] = ()
) -> npt.NDArray[np.uint8]:
    """Return an image of labels in another size.

    Parameters
    ----------
    values
        uint8, (height, width); `NO_VOTE` is what is not known.
    size
        New (width, height), px.
    thin
        Values of lines: where they go, a line of a pixel at least remains, 8-connected if it was.

    Returns
    -------
    numpy.ndarray
        uint8, (height, width) of `size`: of each pixel the value that covers most of it, the lowest of
        those that cover as much.
    """
    height, width = values.shape
    if (width, height) == size:
        return values.copy()
    across, down = _overlaps(width, size[0]), _overlaps(height, size[1])
    scaled = np.empty((size[1], size[0]), dtype=np.uint8)
    touched = {value: np.zeros(scaled.shape, dtype=bool) for value in thin}
    step = max(1, _PIXELS * size[1] // (width * height))
    for top in range(0, size[1], step):
        rows = down[top : top + step]
        first, last = int(rows.indices.min()), int(rows.indices.max()) + 1
        band = values[first:last]
        most = np.zeros((rows.shape[0], size[0]), dtype=np.float32)
        part = np.full(most.shape, NO_VOTE, dtype=np.uint8)
        for value in map(int, np.flatnonzero(np.bincount(band.ravel(), minlength=256)[:NO_VOTE])):
            mask = (band == value).astype(np.float32)
            votes = rows[:, first:last] @ (across @ mask.T).T
            won = votes > most
            most[won], part[won] = votes[won], value
            if value in touched:
                touched[value][top : top + step] = votes > 0.0
        scaled[top : top + step] = part
    if size[0] < width or size[1] < height:
        for value, where in touched.items():
            scaled[thinned(where)] = value
    return scaled


def _overlaps(old: int, new: int) -> sparse.csr_array:
    """Return how much of each old pixel lies in each new one, float32, (new, old)."""
    edges = np.unique(np.concatenate([np.arange(old + 1) * new, np.arange(new + 1) * old]))  # in 1/(old·new)
    middles = edges[:-1] + np.diff(edges) // 2
    lengths = np.diff(edges) / old
    places = (middles // old, middles // new)
    return sparse.csr_array((lengths.astype(np.float32), places), shape=(new, old))
