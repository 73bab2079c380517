"""Crests of unpainted mountains: they fall from a line, not from a point, as ranges do.

What is painted has its shape from the sketch; a round mountain that stands alone is a cone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.features.catalogue import FEATURE_TYPES
from sketchterrain.features.hashing import hash_unit

if TYPE_CHECKING:
    from sketchterrain.array_types import StructuredArray

_LEAST, _MOST = 0.15, 0.45  # half the length of a crest, in ground radii


def crest_offsets(points: StructuredArray) -> npt.NDArray[np.float64]:
    """Return half the crest of each feature, eastward and northward, in its ground radii.

    A function of the id, so that a feature that is moved keeps its crest.

    Parameters
    ----------
    points : (n,) array of FEATURE

    Returns
    -------
    (n, 2) float64, 0 for what was painted and for all but mountains.
    """
    number = points["id"].astype(np.uint64).view(np.int64)
    length = _LEAST + (_MOST - _LEAST) * hash_unit(0, "crest length", number)
    length[points["painted"] | (points["type"] != FEATURE_TYPES.index("mountain"))] = 0.0
    turn = np.pi * hash_unit(0, "crest direction", number)
    return np.stack([length * np.cos(turn), length * np.sin(turn)], axis=-1)
