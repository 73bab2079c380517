"""Tributaries painted a few pixels short of their stem: the gap is closed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import Float64Array, Int64Array

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.features.river_network import RiverEnd
    from sketchterrain.features.skeleton import Skeleton


_AHEAD = 0.8  # cosine between an end's heading and the way to the stem
_LEAD = 8  # px of a reach that say where its end heads
_MIDDLE = 4.0  # px farther than a spur that both rivers must go on


def close_gaps(
    painted: npt.NDArray[np.uint8],
    rivers: Sequence[tuple[Skeleton, Sequence[RiverEnd]]],
    gap: float,
) -> npt.NDArray[np.uint8] | None:
    """Paint on from ends that head at another river's middle.

    Only an end joins, and only two rivers that are not one already: so none joins both ways, and rivers side
    by side stay apart.

    Parameters
    ----------
    painted : (height, width) uint8
        Labels of rivers.
    rivers : sequence of (Skeleton, sequence of RiverEnd)
        The networks, dabs left out.
    gap : float
        Most pixels between the border of a stroke and that of the next that a person does not mean.

    Returns
    -------
    (height, width) uint8 or None
        A copy with lines one pixel wide over the gaps; None if there are none.
    """
    labelled, count = ndimage.label(painted > 0, structure=np.ones((3, 3)))
    regions = np.asarray(labelled, dtype=np.int64)
    of = {int(regions[bone.rows[0], bone.columns[0]]): (bone, ends) for bone, ends in rivers}
    family = np.arange(count + 1)
    closed = None
    for region, (bone, ends) in of.items():
        for end in ends:
            at = np.array([bone.rows[end.pixel], bone.columns[end.pixel]], dtype=np.int64)
            found = _ahead(regions, region, at, _heading(bone, end), float(bone.depth[end.pixel]) + gap + 1.0)
            if found is None:
                continue
            other = int(regions[tuple(found)])
            if other not in of or family[other] == family[region]:
                continue
            if not _in_the_middle(*of[other], found, end.length):
                continue
            family[family == family[other]] = family[region]
            closed = painted.copy() if closed is None else closed
            steps = int(np.abs(found - at).max())
            line = np.rint(np.linspace(at, found, steps + 1)).astype(np.int64)
            line = line[painted[line[:, 0], line[:, 1]] == 0]
            closed[line[:, 0], line[:, 1]] = painted[tuple(at)]
    return closed


def _heading(bone: Skeleton, end: RiverEnd) -> Float64Array | None:
    """Rows and columns in which an end heads, a unit vector; None if it is too short to say."""
    back = end.lead[-min(max(_LEAD, int(2.0 * bone.depth[end.pixel])), len(end.lead))]
    run = np.array([bone.rows[end.pixel] - bone.rows[back], bone.columns[end.pixel] - bone.columns[back]])
    length = float(np.hypot(*run))
    return run / length if length >= 2.0 else None


def _ahead(
    regions: Int64Array, own: int, at: Int64Array, heading: Float64Array | None, reach: float
) -> Int64Array | None:
    """Find the nearest pixel of another region ahead."""
    if heading is None:
        return None
    low = np.maximum(at - int(reach) - 1, 0)
    window = regions[low[0] : at[0] + int(reach) + 2, low[1] : at[1] + int(reach) + 2]
    there = np.argwhere((window > 0) & (window != own)) + low
    away = np.hypot(*(there - at).T)
    meant = (away <= reach) & ((there - at) @ heading >= _AHEAD * away)
    if not meant.any():
        return None
    return np.asarray(there[meant][int(np.argmin(away[meant]))])


def _in_the_middle(bone: Skeleton, ends: Sequence[RiverEnd], at: Int64Array, length: float) -> bool:
    """Whether both the river at a place and what joins it there are longer than a spur would be."""
    away = np.hypot(bone.rows - at[0], bone.columns - at[1])
    least = 2.0 * float(bone.depth[int(np.argmin(away))]) + 2.0 + _MIDDLE
    return length >= least and min(float(away[end.pixel]) for end in ends) >= least
