"""How far a change inside a sketch is felt by what fills its unpainted ground, as that really stands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.features.rules import SPACING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.array_types import Float64Array, StructuredArray
    from sketchterrain.features.fill import Fill

    Change = tuple[float, str, float | None]
    """How far (m) from the change it is felt, type of a placed feature and its radius, or layer and None."""


def fill_influence(fill: Fill, changes: Sequence[Change], *, support: float) -> float:
    """Return how far (m) from what changed inside the sketch the ground of the fill may be other ground.

    Parameters
    ----------
    fill : Fill
    changes : sequence of (distance, name, radius)
        Distance (m) from what changed within which a placed feature (its type and its radius, m), or the
        pixels of a layer (name and None), may differ.
    support : float
        How many of its radii a feature reaches.
    """
    candidate_influence = [
        (start, way) for start, name, radius in changes for way in fill.influence_radii(name, radius).values()
    ]
    if not candidate_influence:
        return 0.0
    wide, (east, north) = max(start + way for start, way in candidate_influence), fill.sketch.size
    around = (-wide, -wide, east + wide, north + wide)
    candidates = {name: fill.candidates(name, around) for name in fill.types}
    pairs = {
        (rival, own): _pairs(candidates[rival], candidates[own], factor)
        for (rival, own), factor in SPACING.items()
        if rival in candidates and own in candidates
    }
    far = [0.0]
    for start, name, radius in changes:
        felt: dict[str, Float64Array] = {}
        for own, points in candidates.items():
            way = fill.candidate_influence(own, name, points["radius"].astype(np.float64), radius)
            if way is not None:
                felt[own] = np.where(_outside(points, (east, north)) <= start + way, start + way, -np.inf)
                far.append(float((felt[own] + support * points["radius"]).max(initial=0.0)))
        for (rival, own), (i, j, apart) in pairs.items():
            if rival in felt:
                reach = felt[rival][i] + apart + support * candidates[own]["radius"][j]
                far.append(float(reach.max(initial=0.0)))
    return max(far)


def _pairs(
    rivals: StructuredArray, own: StructuredArray, factor: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Float64Array]:
    """Pairs of candidates that conflict, and how far apart they are (m)."""
    reach = factor * float(rivals["radius"].max(initial=0.0) + own["radius"].max(initial=0.0))
    trees = [cKDTree(np.stack([points["x"], points["y"]], axis=-1)) for points in (rivals, own)]
    found = trees[0].sparse_distance_matrix(trees[1], reach * 1.001 + 0.01, output_type="ndarray")
    radii = rivals["radius"][found["i"]].astype(np.float64) + own["radius"][found["j"]]
    itself = (found["i"] == found["j"]) & (rivals is own)
    found = found[(found["v"] <= factor * radii * 1.001 + 0.01) & ~itself]
    return found["i"], found["j"], found["v"]


def _outside(points: StructuredArray, size: tuple[float, float]) -> Float64Array:
    """Distance (m) from the sketch; 0 inside."""
    across = np.maximum(np.maximum(-points["x"], points["x"] - size[0]), 0.0)
    along = np.maximum(np.maximum(-points["y"], points["y"] - size[1]), 0.0)
    return np.asarray(np.hypot(across, along))
