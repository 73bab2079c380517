"""The pixels of a shape as columns of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.features.hashing import hash_keys
from sketchterrain.features.rules import LAYER_CODES

if TYPE_CHECKING:
    from sketchterrain.features.shapes import Shape

LEAST_DISC = 1.0
"""Radius (px) of the smallest disc: even a lone pixel must show."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """A shape's pixels as columns, in reading order: one entry a pixel."""

    row: Int64Array  # in the bounding box
    column: Int64Array
    depth: Float64Array  # px
    disc: Float64Array  # px, radius of the user feature that would stand here
    priority: npt.NDArray[np.uint64]  # lowest first

    @classmethod
    def from_shape(cls, shape: Shape, *, most: float, seed: int) -> Pixels:
        """Measure a shape's pixels; `most` is the radius (px) that no disc exceeds."""
        row, column = np.nonzero(shape.mask)
        depth = shape.depth[row, column]
        index = (row + int(shape.rows.start)).astype(np.int64) * shape.image_width
        index += column + int(shape.columns.start)
        return cls(
            row=row,
            column=column,
            depth=depth,
            disc=np.maximum(np.minimum(depth, most), LEAST_DISC),
            priority=hash_keys(seed, "dart", LAYER_CODES[shape.layer], shape.label, index),
        )
