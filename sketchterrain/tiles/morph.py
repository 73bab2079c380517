"""Geomorphing: the weight of the parent at each vertex of a tile, from nine controls.

The twin of kernels/render/ground.vert.glsl. Controls lie at a tile's corners, the middles of its borders and
its centre. Tiles of one level share those where they touch. A weight changes from a border's control to the
centre's within a quarter of the tile; so a border depends only on its own controls, and both tiles along it
compute the same bits.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

RAMP: Final = 0.25
"""Share of a tile's width in which weights go over from border to middle; a power of two is exact."""


def morph_weights(controls: npt.NDArray[np.float32], quads: int) -> npt.NDArray[np.float32]:
    """Return the parent's weight at each vertex, (n, quads + 1, quads + 1) float32, row 0 north.

    `controls` is (n, 3, 3) in 0 … 1, row 0 north, column 0 west; 0 is the tile's own surface, 1 its parent's.
    """
    along = np.arange(quads + 1, dtype=np.float32) / np.float32(quads)
    near = np.minimum(along, 1 - along) * np.float32(1 / RAMP)
    centre = np.minimum(near, 1)
    border = np.where(along < 0.5, 0, 2)
    rows = (1 - centre) * controls[:, :, border] + centre * controls[:, :, 1:2]
    centre, rows = centre[:, None], np.asarray(rows, np.float32)
    return np.asarray((1 - centre) * rows[:, border] + centre * rows[:, 1:2], np.float32)
